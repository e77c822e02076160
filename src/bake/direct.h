// The stage that keeps direct light: that of static lights in the field, all other apart from it.
#pragma once

#include "bake/plan.h"
#include "medium/beams.h"
#include "visibility/visibility.h"

namespace lpvbake::bake {

/// What --direct, --static and --medium send beams by, whatever is summed of them.
medium::BeamSettings beam_settings(const DirectSettings& settings);

/// How many lights send beams.
uint64_t beamed_lights(std::span<const Light> lights, const DirectSettings& settings);

/// Adds visibility and direct light of the scene's lights, as the plan's settings want them, to a
/// volume that has its walls; the light of static ones to the field, whatever they want. Its
/// metadata tell, as JSON lists, the names of the lights of visibility_0, ..., and as
/// shadow_channels those of each of the four channels of shadow_0, ...: a light is in the first in
/// which no other reaches a cell that it reaches. Nothing where no light is asked for.
void add_direct(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
                const scene::Frame& frame, solver::Stages& stages, Volume& volume);

} // namespace lpvbake::bake
