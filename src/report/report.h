// Speed against error: bakes of one scene by many settings, measured against a converged reference
// and beside the path-traced probes that one could use instead.
#pragma once

#include "report/measure.h"
#include "report/pareto.h"
#include "report/sweep.h"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::report {

struct ReportSettings {
    int repeats = 3;        ///< of each bake; at least 1
    uint64_t probes = 1000; ///< cells of each grid, and points on surfaces
    uint64_t seed = 1;
    TruthSettings truth;
    bool peer = true;   ///< measure path-traced probes as well
    bool slices = true; ///< draw the best row of each grid
    bool views = true;  ///< draw what programs show of the row that is best on surfaces
};

/// Seconds of the repeats.
struct Timing {
    double median = 0, min = 0, max = 0;
};

/// The median is the mean of the middle two of an even number. `seconds` is not empty.
Timing timing_of(std::vector<double> seconds);

struct StageTiming {
    std::string name;
    Timing seconds;
    std::string detail; ///< the last repeat's
};

/// What a program shows on surfaces of the files that its target writes.
struct ReaderError {
    const char* reader; ///< its name in readers::all_readers()
    FieldError error;
};

/// One bake, measured.
struct RowResult {
    SweepRow row;
    std::size_t grid = 0; ///< index into SceneReport::grids
    int sh_order = 1;
    Timing seconds; ///< of bake(), without loading and writing
    std::vector<StageTiming> stages;
    FieldError error;     ///< at the grid's probes, against the true irradiance
    FieldError projected; ///< against that of the reference's bands up to sh_order
    /// At the scene's surface points, read through our own sampler; none without such points.
    std::optional<FieldError> surface;
    /// There too: the programs of targets, in the order of the readers.
    std::vector<ReaderError> shown;
    bool front = false; ///< no other row is as fast and as accurate by `error`
    /// How the peer compares, by `projected`; none without a peer.
    std::optional<EqualError> peer;
    std::optional<EqualError> sharing; ///< the same for GridResult::sharing
    std::vector<std::string> warnings;
    std::string command; ///< that repeats it, as the caller has it
};

/// Path-traced probes with one number of rays.
struct PeerPoint {
    uint64_t rays = 0;                 ///< from each probe
    Timing seconds;                    ///< for all valid cells of the grid, scaled from the probes
    double measured = 0;               ///< median seconds of the probes
    double rays_per_second = 0;        ///< traced in all, reflected and shadow rays included
    double embree_rays_per_second = 0; ///< the same rays without anything done to them; 0: unknown
    std::array<FieldError, 3> error;   ///< of floor_orders, against the true irradiance
    std::array<FieldError, 3> projected; ///< against that of the reference's same bands
};

/// The SH orders whose cost is told.
inline constexpr std::array<int, 3> floor_orders{1, 2, 4};
/// Index into floor_orders of the lowest that holds `order`.
std::size_t floor_index(int order);

/// A look at one layer of a grid, as PNG files.
struct Slices {
    std::size_t row = 0; ///< index into SceneReport::rows
    int axis = 0, index = 0;
    uint64_t rays = 0;      ///< from each cell of the reference
    double white = 0;       ///< mean luminance drawn white, nits
    double error_white = 0; ///< error drawn white, as a fraction of the layer's mean irradiance
    std::vector<unsigned char> result, reference, error;
};

/// What the rows on one grid share.
struct GridResult {
    Grid grid;
    reference::PathRules rules;
    uint64_t valid = 0;  ///< cells
    uint64_t probes = 0; ///< of them measured
    double noise = 0;    ///< of the reference, as ProbeField::noise
    uint64_t rays = 0;   ///< from each probe
    bool converged = true;
    double seconds = 0;              ///< that the reference took
    std::array<FieldError, 3> floor; ///< exact luminance projected to floor_orders
    std::vector<PeerPoint> peer;     ///< by rising rays
    /// Probes whose rays end where they hit first, on surfaces lit as the bakes light them, the
    /// lighting's time included; none where light is reflected once at most.
    std::vector<PeerPoint> sharing;
    std::optional<Slices> slices;
};

/// What a camera sees of a row, as programs show it; as PNG files.
struct Views {
    std::size_t row = 0; ///< index into SceneReport::rows
    std::string camera;
    int paths = 0;       ///< of each pixel of the path-traced picture
    double exposure = 0; ///< EV, of all pictures
    std::vector<unsigned char> traced;
    struct View {
        std::string what;
        FieldError error; ///< on surfaces
        double flip = 0;  ///< from the path-traced picture
        std::vector<unsigned char> picture;
    };
    std::vector<View> shown;
};

struct SceneReport {
    std::string path;
    uint64_t triangles = 0;
    std::vector<GridResult> grids;
    std::vector<RowResult> rows;
    std::optional<Views> views; ///< none where no light arrives on surfaces
    uint64_t surface_points = 0;
    double surface_noise = 0;
    uint64_t surface_rays = 0;
    std::vector<std::string> warnings;
};

struct Report {
    std::string device;
    unsigned threads = 0;
    ReportSettings settings;
    std::vector<SceneReport> scenes;
    double seconds = 0; ///< for everything
};

/// Bakes and measures every row; path and commands of the result are the caller's. Throws Error, as
/// plan_bake (before any row is baked), bake and trace_probes do.
SceneReport measure_scene(const Scene& scene, const std::vector<SweepRow>& rows,
                          const ReportSettings& settings, const gpu::Device& device,
                          Progress& progress);

/// Seconds that measure_scene is expected to take: bakes by their plans, references and peers by a
/// pass of few paths in the first row's grid. Throws Error as plan_bake does.
double expected_seconds(const Scene& scene, const std::vector<SweepRow>& rows,
                        const ReportSettings& settings, const gpu::Device& device,
                        Progress& progress);

/// What the ratios mean, in a few words: "peer needs 12 x as long; sharing bounces it needs 3.1 x
/// as long", ...
std::string ratio_text(const RowResult& row);

/// What the rows together say of the solvers against the peer: a sentence each.
std::vector<std::string> verdicts(const SceneReport& scene);

} // namespace lpvbake::report
