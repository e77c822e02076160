// Virtual point lights into cells.
#pragma once

#include "solver/vpl/rsm.h"
#include "visibility/visibility.h"
#include "volume/grid.h"

#include <span>
#include <vector>

namespace lpvbake::solver::lpv {

/// The light that starts in each cell: SH L1 of intensity (cd) in travel direction.
struct Injection {
    /// [12 * cell + 4 * colour + k], k in the order 1, y, z, x.
    std::vector<float> coefficients;
    std::vector<std::vector<float>> layers; ///< the same, of each layer of the VPLs
    double power = 0;                       ///< lm injected, the three channels together
    double lost = 0; ///< lm that found no cell in front of its surface, inside the grid
    double shut = 0; ///< lm of these that do not leave the grid: no centre sees their surface
    std::vector<size_t> cells; ///< where each VPL is; nowhere: found none
};

inline constexpr size_t nowhere = ~size_t(0);

/// Adds (Phi / pi) K(n) for each VPL to a cell on the front of its surface: the one nearest to
/// p + n / 2 (grid units) whose centre is before the surface and seen from it, among the 27
/// around that point. So no light starts behind a wall, however the wall lies in the grid.
/// Sums run in the order of the VPLs, in double.
Injection inject(std::span<const vpl::Vpl> vpls, const visibility::Visibility& visibility,
                 const Grid& grid);

} // namespace lpvbake::solver::lpv
