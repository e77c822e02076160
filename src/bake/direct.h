// The stage that keeps direct light, apart from the field.
#pragma once

#include "bake/plan.h"
#include "visibility/visibility.h"

namespace lpvbake::bake {

/// Adds visibility and direct light of the scene's lights, as the plan's settings want them, to a
/// volume that has its walls. The names of the lights of visibility_0, ... stand in its metadata,
/// as a JSON list. Nothing where there is no light.
void add_direct(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
                const scene::Frame& frame, solver::Stages& stages, Volume& volume);

} // namespace lpvbake::bake
