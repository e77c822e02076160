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

struct BakedLevels {
    std::vector<Volume> levels; ///< as grids_in has them
    /// Of each level BakeSettings::layers; walls are those of the level. Where they have a grid of
    /// their own they are of that alone, and this is all light in it.
    std::vector<std::vector<Volume>> layers;
    std::optional<Volume> layers_whole = {};
    std::vector<StageReport> stages;
    std::vector<std::string> warnings; ///< a line each
};

/// Runs the plan, which must be one of this scene: it is lit once, for the finest grid near that
/// and ever less finely around it, then each grid is solved by itself. Throws as bake().
BakedLevels bake_levels(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                        Progress& progress);

/// Runs a plan of one grid, which must be one of this scene. Throws Error: memory, device, and
/// whatever `progress` throws.
Baked bake(const Scene& scene, const BakePlan& plan, const gpu::Device& device, Progress& progress);

} // namespace lpvbake::bake
