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

/// What is known of bricks before they are baked.
struct BrickPlan {
    volume::BrickLevels levels;
    Bounds box;               ///< that is asked for
    uint64_t expected = 0;    ///< bricks, an estimate
    uint64_t most = 0;        ///< that are left at most
    uint64_t other_bytes = 0; ///< of memory, beside bricks and samples
};

/// Memory that a brick that is left takes, and a sample of any.
uint64_t brick_bytes(int order);
uint64_t sample_bytes(int order);
/// Numbers that a brick has in a file.
uint64_t brick_numbers(int order);

struct BakePlan {
    BakeSettings settings;            ///< its volumes in the order of grids_in
    Grid grid;                        ///< of several the finest
    std::vector<Grid> coarser;        ///< the levels around it, or volumes beside it; mostly none
    std::optional<Grid> layers_grid;  ///< of BakeSettings::layers_level; none: layers are in those
    std::optional<volume::Slab> slab; ///< of BakeSettings::shard
    std::optional<BrickPlan> bricks;  ///< instead; the grid is all of the finest level
    scene::Frame frame;               ///< the grid's, with the boxes of the others
    int lights = 0;                   ///< punctual ones
    bool emitters = false;            ///< some surface emits, and is wanted to
    bool lit = false; ///< surfaces are lit as a whole, not by reflective shadow maps alone
    solver::ReflectiveMaps maps;
    uint64_t triangles = 0;
    uint64_t device_bytes = 0; ///< peak of what it takes of the device
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

/// What is solved: those, and last the layers' own grid where there is one.
struct Solved {
    Grid grid;
    std::size_t layers; ///< all of them, or none
};
std::vector<Solved> solved_in(const BakePlan& plan);

/// Begins what is told of one of several: "level 1: ", "volume hall: ".
std::string of_level(std::size_t level, const BakePlan& plan);

/// A volume of one cell with the grids that the bake's will have.
Volume grids_of(const BakePlan& plan);
/// The same of one of its layers.
Volume grids_of(const BakePlan& plan, const Layer& layer);

} // namespace lpvbake::bake
