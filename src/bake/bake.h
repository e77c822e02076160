// The driver: from a scene to a volume, stage by stage.
#pragma once

#include "gpu/gpu.h"
#include "progress.h"
#include "solver/vpl/rsm.h"
#include "scene/scene.h"
#include "solver/gather/discs.h"
#include "solver/gather/gather.h"
#include "solver/lpv/lpv.h"
#include "solver/sn/sn.h"
#include "volume/volume.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake {

/// How light gets from the surfaces to the cells.
enum class Solver {
    lpv,    ///< classic propagation from cell to cell
    sn,     ///< discrete ordinates: swept along fixed directions
    gather, ///< from clusters of patches straight to each cell
};
const char* name_of(Solver solver);
/// How often light is reflected unless it is said: once with lpv, without end with the others.
std::optional<int> default_bounces(Solver solver);

struct BakeSettings {
    Solver solver = Solver::lpv;
    GridSettings grid;
    std::optional<Bounds> bounds; ///< what the grid is fitted to; none: the scene's bounds
    int rsm_size = 0;             ///< texels a side; 0: 8 a cell of the longest axis, at least 256
    int rsm_kernel = 4;           ///< texels a side of a clustered block
    bool emitters = true;         ///< emissive surfaces give light
    std::optional<int> bounces = 1;   ///< reflections at most; none: all
    uint64_t lighting_rays = 1 << 21; ///< LightingSettings::rays of sn and gather
    LpvSettings lpv;
    SnSettings sn;
    GatherSettings gather;
    /// gather: texels of each reflective shadow map from which a cell takes the first reflection of
    /// punctual lights; 0: clusters of patches bring that too.
    int rsm_samples = 0;
};

/// Highest band of the harmonics that a bake gives.
int sh_order_of(const BakeSettings& settings);

enum class Quality { fast, balanced, accurate };

/// What trades time for error in each solver; nothing else is changed.
void set_quality(Quality quality, BakeSettings& settings);

/// What a stage did and cost.
struct StageReport {
    std::string name;
    double seconds = 0;
    std::string detail; ///< one phrase: counts and residuals
};

/// What a bake will do, known before it does it.
struct BakePlan {
    Grid grid;
    Frame frame;           ///< the grid's
    bool emitters = false; ///< some surface emits, and is wanted to
    bool lit = false;      ///< surfaces are lit as a whole, not by reflective shadow maps alone
    int rsm_size = 0;
    int rsm_maps = 0; ///< 0: nothing is drawn
    uint64_t triangles = 0;
    uint64_t device_bytes = 0;       ///< peak of the solver's device memory
    uint64_t host_bytes = 0;         ///< estimate
    double seconds = 0;              ///< estimate, as on two threads of a CPU device; see plan.cpp
    std::vector<StageReport> stages; ///< what will run, and why (detail)
    struct Skipped {
        std::string name;
        std::string why;
    };
    std::vector<Skipped> skipped; ///< what such a bake has no need of
    std::vector<std::string> warnings;
};

/// Fits the grid and sizes everything. Throws Error: invalid (nothing to bake, no light: names the
/// options that add one).
BakePlan plan_bake(const Scene& scene, const BakeSettings& settings, const gpu::DeviceInfo& device);

/// What of a bake's settings is left to choose, and by what.
struct Wish {
    std::vector<Solver> solvers = {Solver::gather, Solver::sn, Solver::lpv}; ///< that may be taken
    std::optional<int> order;      ///< of the harmonics; none: 2, or 4 where `error` needs it
    std::optional<double> error;   ///< relative error of irradiance, at most
    std::optional<double> seconds; ///< of a bake without loading and writing, at most
    /// Puts in place what is not to be chosen.
    std::function<void(BakeSettings&)> fixed = [](BakeSettings&) {};
};

struct Choice {
    BakeSettings settings;
    double error = 0;   ///< expected_error
    double seconds = 0; ///< BakePlan::seconds
    std::string text;   ///< solver and settings, as in "gather, order 2, 192 clusters, ..."
    std::vector<std::string> warnings; ///< what of the wish is not reached
};

/// Settings for a wish: the fastest that are expected to reach the error, or the most accurate in
/// the time, among rungs of each solver's ladder from coarse to fine; without either the first of
/// Wish::solvers as `base` has it. What no rung reaches is told in a warning, and the nearest is
/// taken. Depends on the arguments and on constants of the program, never on a clock. Throws Error
/// as plan_bake does where no rung can be planned.
Choice choose_settings(const Scene& scene, const BakeSettings& base, const Wish& wish,
                       const gpu::DeviceInfo& device);

/// Relative error of irradiance that is expected of settings: that of the Cornell box,
/// the hardest of the scenes that it was measured in; more evenly lit ones err by down to a third.
double expected_error(const BakeSettings& settings);

struct Baked {
    Volume volume;
    std::vector<StageReport> stages;
    std::vector<std::string> warnings;
};

/// Runs the plan. Throws Error: memory (names the largest resolution that fits), device, and
/// whatever `progress` throws.
Baked bake(const Scene& scene, const BakeSettings& settings, const gpu::Device& device,
           Progress& progress);

} // namespace lpvbake
