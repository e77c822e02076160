// A look at the light of some cells before settings are chosen: what bakes of this scene lose.
#pragma once

#include "bake/choose.h"
#include "lpvbake/progress.h"
#include "solver/pilot.h"

#include <optional>

namespace lpvbake::bake {

/// Lights all surfaces with the fewest rays, and gathers at up to 256 cells in up to 48 zones of
/// the grid, with bands up to 4 and many clusters, then with few: what that changes is what bakes
/// lose. None where no cell is outside geometry, or no light comes to one. The same bits for any
/// number of threads. `settings`: grid, light and bounces; of the solver nothing. Throws Error as a
/// bake.
std::optional<solver::Pilot> run_pilot(const Scene& scene, const SceneFacts& facts,
                                       const BakeSettings& settings, const gpu::Device& device,
                                       Progress& progress);

/// Where the wish is for an error at cells, has it go by a pilot, unless that is expected to take
/// more than half a minute.
void add_pilot(const Scene& scene, const SceneFacts& facts, const BakeSettings& settings,
               const gpu::Device& device, Progress& progress, Wish& wish);

} // namespace lpvbake::bake
