// The driver: from a scene to a volume, stage by stage.
//
//     const SceneFacts facts = survey(scene);
//     const BakePlan plan = plan_bake(facts, settings, device.info()); // or choose_settings()
//     const Baked baked = bake(scene, plan, device, progress);
#pragma once

#include "bake/choose.h"
#include "bake/facts.h"
#include "bake/plan.h"
#include "bake/settings.h"
#include "gpu/gpu.h"
#include "lpvbake/bake.h"
#include "surface/lit_surfaces.h"

namespace lpvbake::bake {

/// How a bake of the plan lights surfaces.
surface::LightingSettings lighting_of(const BakePlan& plan);

/// Runs the plan, which must be one of this scene. Throws Error: memory, device, and whatever
/// `progress` throws.
Baked bake(const Scene& scene, const BakePlan& plan, const gpu::Device& device, Progress& progress);

} // namespace lpvbake::bake
