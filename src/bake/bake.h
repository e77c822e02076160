// The driver: from a scene to a volume, stage by stage.
//
//     const SceneFacts facts = survey(scene);
//     const BakePlan plan = plan_bake(facts, settings, device.info()); // or choose_settings()
//     const Baked baked = bake(scene, plan, device, progress);
#pragma once

#include "bake/choose.h"
#include "bake/facts.h"
#include "bake/lighting.h"
#include "bake/plan.h"
#include "bake/settings.h"
#include "gpu/gpu.h"
#include "lpvbake/bake.h"

namespace lpvbake::bake {

/// Runs the plan, which must be one of this scene. Throws Error: memory, device, and whatever
/// `progress` throws.
Baked bake(const Scene& scene, const BakePlan& plan, const gpu::Device& device, Progress& progress);

} // namespace lpvbake::bake
