// What is true at some cells of a grid, and how far coefficients there are from it.
#pragma once

#include "report/measure.h"
#include "scene/frame.h"
#include "visibility/visibility.h"

#include <memory>
#include <span>
#include <vector>

namespace lpvbake::report {

/// What is needed to trace in a grid's frame.
struct Place {
    Place(const Scene& scene, const Grid& grid);
    scene::Frame frame;
    visibility::Visibility visibility;
};

/// Cells that were drawn from the valid ones.
struct DrawnCells {
    std::unique_ptr<const Place> place;
    double setup = 0; ///< seconds until rays can be traced, and it is known which cells are valid
    std::vector<float> validity;
    uint64_t valid = 0;
    std::vector<std::size_t> cells;
    std::vector<glm::vec3> points; ///< where their light is taken, frame units
};

/// Throws Error (invalid) where no cell is valid.
DrawnCells draw_cells(const Scene& scene, const Grid& grid, uint64_t count, uint64_t seed);

/// What arrives at the cells, as trace_truth has it.
Truth trace_truth(const Scene& scene, const DrawnCells& drawn, const reference::PathRules& rules,
                  const TruthSettings& settings, Progress& progress);

/// How long that is going to take, by a pass of few paths.
struct TruthCost {
    double seconds = 0;
    double path = 0; ///< seconds of a path from a cell
};
TruthCost truth_cost(const Scene& scene, const DrawnCells& drawn, const reference::PathRules& rules,
                     const TruthSettings& settings, Progress& progress);

/// Coefficients sh[k][point] against the true irradiance, and against that of the truth's bands up
/// to `order`.
struct CellErrors {
    FieldError error, projected;
};
FieldError error_at_cells(const std::vector<std::vector<glm::vec3>>& sh, int order,
                          const std::vector<std::vector<glm::vec3>>& true_sh,
                          std::span<const glm::dvec3> truth);
CellErrors errors_at_cells(const std::vector<std::vector<glm::vec3>>& sh, int order,
                           const Truth& truth);

/// The coefficients that a volume has at the cells, in their order.
std::vector<std::vector<glm::vec3>> coefficients_at(const Volume& volume,
                                                    std::span<const std::size_t> cells);

} // namespace lpvbake::report
