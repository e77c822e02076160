// Which cells are solved, and which are interpolated between those (Greger et al. 1998).
#pragma once

#include "solver/gather/cell_zone.h"
#include "volume/volume.h"

#include <cstdint>
#include <vector>

namespace lpvbake::solver::gather {

/// Edge of the boxes whose corners are solved first, cells.
inline constexpr int coarse_edge = 4;

/// Where a cell's light comes from.
enum class CellState : uint8_t {
    open,
    between_4, ///< interpolated over a box of this edge
    between_2,
    wanted,
    solved,
};

/// A box of cells from lo to hi, both included.
struct CellBox {
    glm::ivec3 lo, hi;

    glm::ivec3 corner(size_t i) const {
        return {i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z};
    }
};

/// The state of all cells.
class AdaptiveGrid {
public:
    /// The arguments outlive it; `tolerance` as GatherSettings has it.
    AdaptiveGrid(const Volume& volume, const Occupied& occupied, float tolerance);

    std::vector<CellState> state;

    CellBox all() const { return {glm::ivec3(0), grid_.dims - 1}; }
    /// Wants the valid cells of a box at multiples of `step` and at its corners.
    void want(const CellBox& box, int step);
    /// Of all boxes of `edge`: leaves those that are smooth to interpolation, returns the others.
    std::vector<CellBox> leave_smooth(int edge);
    /// The same of the halves, of `edge`, of boxes.
    std::vector<CellBox> leave_smooth_halves(const std::vector<CellBox>& boxes, int edge);
    /// Interpolates the cells that are left to it, from the corners of their boxes.
    void interpolate(Volume& volume) const;
    uint64_t interpolated() const; ///< cells

private:
    CellBox box_around(glm::ivec3 cell, int edge) const;
    void leave(const CellBox& box, int edge);
    bool smooth(const CellBox& box, int edge) const;

    const Volume& volume_;
    const Grid& grid_;
    const Occupied& occupied_;
    float tolerance_;
};

} // namespace lpvbake::solver::gather
