// A suite of hard cases: scenes, what is true of each, and how far each solver may be from it.
//
// A suite is a JSON file beside its scenes:
//
//   {"cases": [{
//     "name": "two-rooms",
//     "reason": "light through a door, a wall of a third of a cell",
//     "scene": "two_rooms.gltf",                 relative; may not leave the suite's folder
//     "options": {"resolution": 24, ...},        see SuiteOptions
//     "truth": "reference",                      or {"furnace": {"emission", "albedo"}}
//                                                or {"polygon": {"corners": [[x, y, z], ...],
//                                                    "luminance"}}, or "none"
//     "region": {"lo": [x, y, z], "hi": [...], "dark": false},
//     "same_as": {"case": "another", "scale": 1},
//     "limits": {"lpv": {"error": 1.3, "energy": [0.9, 2.1], "leak": [0.9, 1.1],
//                        "negative": 0.3, "same": 0.001}},
//     "cheap": true                              left out: false
//   }]}
//
// name, reason, scene and limits are needed. A case runs with every solver that has limits, of
// which there has to be one at least. NaN and infinity fail whatever the limits say.
#pragma once

#include "bake/kinds.h"
#include "gpu/gpu.h"
#include "lpvbake/progress.h"
#include "report/suite_truth.h"
#include "scene/scene.h"
#include "volume/volume.h"

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::report {

struct SuiteRange {
    double lo = 0, hi = 0;
};

/// What a row may measure at most, or within; none: not judged.
struct SuiteLimits {
    std::optional<double> error;      ///< relative L1 error of irradiance: Comparison::relative_l1
    std::optional<SuiteRange> energy; ///< Comparison::energy_ratio
    std::optional<SuiteRange> leak;   ///< SuiteRow::leak
    std::optional<double> negative;   ///< share of the irradiance samples below 0
    std::optional<double> same;       ///< SuiteRow::same
};

/// As the options of `bake` and `reference` of the same names.
struct SuiteOptions {
    int resolution = 16;
    int margin = 1;
    std::optional<Bounds> bounds;   ///< [x0, y0, z0, x1, y1, z1], metres
    std::optional<int> bounces = 1; ///< or "inf"
    double max_albedo = 0.95;
    int iterations = 0;    ///< of lpv; 0: until it has converged
    uint64_t probes = 300; ///< cells at which the truth is found, and as many in the region
    uint64_t rays = 4096;  ///< of a path-traced truth, from each probe at most
    double noise = 0.02;   ///< of a path-traced truth's irradiance
};

/// Where a leak is looked for: cells with their centres in the box, metres.
struct SuiteRegion {
    Bounds box;
    bool dark = false; ///< no light reaches it in truth
};

/// Another case whose field times `scale` is this one's, cell by cell, wherever its grid lies.
struct SuiteSame {
    std::string name;
    double scale = 1;
};

struct SuiteCase {
    std::string name;
    std::string reason; ///< one line
    std::string scene;  ///< path that can be opened
    SuiteOptions options;
    SuiteTruth truth;
    std::optional<SuiteRegion> region;
    std::optional<SuiteSame> same_as;
    std::map<std::string, SuiteLimits> limits; ///< by solver
    bool cheap = false;
};

struct Suite {
    std::string path;
    std::vector<SuiteCase> cases;
};

/// Reads a suite. Throws Error: file; invalid (names file, place and what is allowed there; a scene
/// outside the suite's folder; a solver or a case that there is not).
Suite load_suite(const std::string& path, solver::SolverKinds kinds = bake::solver_kinds());

/// A way to bake a case.
struct SuiteSolver {
    std::string name;
    std::function<Volume(const Scene&, const SuiteOptions&, Progress&)> bake;
};

/// The solvers on a device, which has to outlive them.
std::vector<SuiteSolver> suite_solvers(const gpu::Device& device,
                                       solver::SolverKinds kinds = bake::solver_kinds());

/// One case by one solver. Numbers are those of the probes, cells drawn from those outside
/// geometry.
struct SuiteRow {
    std::string name;
    std::string solver;
    bool measured = false;        ///< false: something went wrong, and the numbers mean nothing
    double noise = 0;             ///< of the truth, relative standard error of its irradiance
    std::optional<double> error;  ///< see SuiteLimits; none without a truth
    std::optional<double> energy; ///< the same
    double negative = 0;
    /// Mean luminance of the region's cells over their truth; in a dark region over the truth's
    /// mean outside of it, all cells of the region counted.
    std::optional<double> leak;
    /// How far the field is from the other case's: relative L1 of irradiance over all cells, or the
    /// share of cells that only one of the two calls valid, whichever is larger.
    std::optional<double> same;
    uint64_t not_finite = 0; ///< numbers in the volume that are NaN or infinite
    double seconds = 0;      ///< of the bake, shader compilation included
    /// One phrase for each limit that does not hold, or the reason why nothing could be measured.
    std::vector<std::string> failures;
};

/// The cells of a grid that count, by Grid::index.
struct SuiteCells {
    std::vector<size_t> probes;
    std::vector<size_t> region; ///< where a leak is measured
};

/// Judges a volume by a truth that is known at the probes and, unless it is dark, in the region;
/// `other` is the field that it must agree with, null if there is none. Throws Error (invalid): the
/// other's grid has other dims.
SuiteRow judge(const SuiteCase& suite_case, const SuiteLimits& limits, const Volume& baked,
               const TruthField& truth, const SuiteCells& cells, const Volume* other);

/// Which rows to run; empty lists select all.
struct SuiteSelection {
    std::vector<std::string> cases;
    std::vector<std::string> solvers;
    bool cheap = false; ///< cheap cases alone
};

/// Runs the selected rows in the order of the file and tells `done` of each. What goes wrong in one
/// is that row's failure. Throws Error: argument (a selected case or solver that there is not,
/// nothing selected), interrupted, terminated, and device.
std::vector<SuiteRow> run_suite(const Suite& suite, const SuiteSelection& selection,
                                const std::vector<SuiteSolver>& solvers, Progress& progress,
                                const std::function<void(const SuiteRow&)>& done);

} // namespace lpvbake::report
