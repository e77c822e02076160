// A look at the light of some cells before settings are chosen: what bakes of this scene lose.
#pragma once

#include "bake/choose.h"
#include "lpvbake/progress.h"
#include "solver/pilot.h"

#include <optional>

namespace lpvbake::bake {

/// What a pilot of such a bake takes. `settings`: grid, light and bounces; of the solver nothing.
BakePlan plan_pilot(const SceneFacts& facts, const BakeSettings& settings,
                    const gpu::DeviceInfo& device);

/// Lights all surfaces with the fewest rays, gathers with few clusters at up to 2048 cells in up to
/// 64 zones of the grid, and at 256 of them, drawn by their light, with bands up to 4 and many
/// clusters: what that changes is what bakes lose. None where no cell is outside geometry, no light
/// comes to one, or it is expected to take more than half a minute. The same bits for any number of
/// threads. Throws Error as a bake.
std::optional<solver::Pilot> run_pilot(const Scene& scene, const BakePlan& plan,
                                       const gpu::Device& device, Progress& progress);

/// Where the wish is for an error at cells, has it go by a pilot.
void add_pilot(const Scene& scene, const SceneFacts& facts, const BakeSettings& settings,
               const gpu::Device& device, Progress& progress, Wish& wish);

} // namespace lpvbake::bake
