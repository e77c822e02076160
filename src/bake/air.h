// The stage that keeps what air does to light.
#pragma once

#include "bake/plan.h"
#include "visibility/visibility.h"

namespace lpvbake::bake {

/// Grids that --medium brings: `extinction` and `scatter`, and where the medium does not scatter
/// evenly `scattered`.
void set_air_grids(const medium::Medium& medium, Volume& volume);

/// Adds them to a volume that has its walls, and no direct light in its field yet: what air
/// scatters of the field, which is baked without it, and of punctual lights, which are attenuated
/// on their way to it; once. Nothing without a medium.
void add_air(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
             const scene::Frame& frame, solver::Stages& stages, Volume& volume);

} // namespace lpvbake::bake
