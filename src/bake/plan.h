// What a bake will do, known before it does it.
#pragma once

#include "bake/facts.h"
#include "bake/settings.h"
#include "gpu/gpu.h"
#include "lpvbake/volume.h"
#include "scene/frame.h"

#include <string>
#include <vector>

namespace lpvbake::bake {

struct BakePlan {
    BakeSettings settings;
    Grid grid;                 ///< of nested ones the finest
    std::vector<Grid> coarser; ///< the levels around it; mostly none
    scene::Frame frame;        ///< the grid's, with the boxes of the levels around it
    bool emitters = false;     ///< some surface emits, and is wanted to
    bool lit = false;          ///< surfaces are lit as a whole, not by reflective shadow maps alone
    solver::ReflectiveMaps maps;
    uint64_t triangles = 0;
    uint64_t device_bytes = 0; ///< peak of the solver's device memory
    uint64_t host_bytes = 0;   ///< estimate
    int threads = 0;           ///< those of the caller's arena
    double seconds = 0; ///< estimate, on so many threads and such a device; see solver/models.h
    std::vector<StageReport> stages;           ///< what will run, and why (detail)
    std::vector<solver::SkippedStage> skipped; ///< what such a bake has no need of
    std::vector<std::string> warnings;
};

/// Fits the grid and sizes everything. Throws Error: argument (the processor lacks the instruction
/// set), invalid (no light), memory (names the largest resolution that fits).
BakePlan plan_bake(const SceneFacts& scene, const BakeSettings& settings,
                   const gpu::DeviceInfo& device);

/// The grid and those around it, finest first.
std::vector<Grid> grids_in(const BakePlan& plan);

/// A volume of one cell with the grids that the bake's will have.
Volume grids_of(const BakePlan& plan);

} // namespace lpvbake::bake
