// Light of a level that is solved, into a finer one in it.
#pragma once

#include "solver/lpv/inject.h"
#include "solver/lpv/propagator.h"

namespace lpvbake::solver::lpv {

/// What a level is to finer ones.
struct SolvedLevel {
    Grid grid;
    std::vector<float> coefficients;  ///< LpvField::coefficients
    std::vector<float> transmittance; ///< as LpvProgram::propagate has it
    Occlusion occlusion = Occlusion::face;

    /// The cell whose centre is a point, in this grid or not.
    glm::ivec3 cell_at(glm::dvec3 point) const {
        return glm::ivec3(glm::round(grid.to_grid(point) - 0.5));
    }
    /// Whether its cells go on beyond a side of a finer grid in it.
    bool is_beyond(int side, const Grid& fine) const;
};

struct Inflow {
    glm::dvec3 power{0.0}; ///< lm that comes in
    glm::dvec3 shut{0.0};  ///< lm that no cell of the side sees
};

/// Adds to an injection into `fine` what light comes in by a side (Sides) from the level around,
/// which goes on beyond it: the flux over the links from its cells beside the hull of `fine` to
/// those on it, of the field as it has converged. A link's light is parted among the border cells
/// less than a link away across that see the centre it comes from (all, where `visibility`, in the
/// frame of `fine`, is null), by bilinear weights; of links on the rim, that share which lies
/// before the grid. So the power is that of the links, link by link, and light that was born inside
/// does not come again: only what came back does.
Inflow let_flow(const SolvedLevel& coarse, const Grid& fine, int side,
                const visibility::Visibility* visibility, Injection& injection);

} // namespace lpvbake::solver::lpv
