// From a scene to the light at given points: the bake of a grid, but for the cells.
#pragma once

#include "bake/bake.h"
#include "volume/points.h"

namespace lpvbake::bake {

struct BakedPoints {
    volume::LitPoints lit;
    /// Of each of BakeSettings::layers what LitPoints::light is of all light.
    std::vector<Volume> layers;
    std::vector<StageReport> stages;
    std::vector<std::string> warnings; ///< a line each
};

/// Runs the plan, of this scene and of as many points (BakeSettings::points), by a solver that is
/// SolverKind::at_places. The plan's grid says how finely surfaces are lit, and where patterns lie;
/// points may be outside. A point of a surface (see surface_margin) that has a normal takes its
/// light before it, one that has none where a cell would (visibility/capture.h). The same bits for
/// any order of the points. Throws Error: invalid (a point is so far away that floats do not tell
/// where it is; it is named), and as bake().
BakedPoints bake_points(const Scene& scene, const BakePlan& plan, volume::Points points,
                        const gpu::Device& device, Progress& progress);

/// Fills LitPoints::irradiance, by the coefficients; 0 where that is negative.
void find_irradiance(volume::LitPoints& lit);

} // namespace lpvbake::bake
