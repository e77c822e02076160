// Ground truth: incident luminance by path tracing, with its standard error.
#pragma once

#include "lpvbake/progress.h"
#include "reference/paths.h"
#include "volume/volume.h"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::reference {

struct ReferenceSettings {
    PathRules paths;
    int sh_order = 1;     ///< 0 to 4
    uint64_t rays = 1024; ///< from each point, rounded up to a multiple of ray_batches
    double noise = 0.0;   ///< above 0: stop at this ProbeField::noise, `rays` at the latest
    double seconds = 0.0; ///< above 0: begin no pass but the first that would end later than this
    uint64_t seed = 1;    ///< another one gives an independent estimate
    uint64_t probes = 0;  ///< cells to evaluate, drawn from the valid ones; 0: all cells
    visibility::Isa isa = visibility::Isa::automatic; ///< that make_reference traces with
};

/// The rays of a point come in this many independent batches, each stratified in itself; how far
/// their means scatter tells the standard error. With fewer the tails of Student's distribution
/// put more than 0.5 % of the values beyond three standard errors.
inline constexpr int ray_batches = 64;

/// Planes on which irradiance is wanted beside the coefficients, by their unit normals.
struct ProbeNormals {
    std::span<const glm::dvec3> common; ///< at every point, such as neighbour_normals()
    std::span<const glm::dvec3> own;    ///< empty, or one a point
};

/// What arrives at a set of points.
struct ProbeField {
    /// sh[k][point]: coefficient k of incident luminance, RGB, nits, canonical (see sh.h).
    std::vector<std::vector<glm::vec3>> sh;
    /// Their standard errors, nits.
    std::vector<std::vector<glm::vec3>> error;
    /// irradiance[n][point] on the plane that faces ProbeNormals::common[n], RGB, lux, and its
    /// standard error: summed over the same rays, and not from the coefficients.
    std::vector<std::vector<glm::vec3>> irradiance, irradiance_error;
    /// The same on the plane that faces a point's own normal; empty without ProbeNormals::own.
    std::vector<glm::vec3> own_irradiance, own_irradiance_error;
    /// A point's standard error of irradiance (from the coefficients; root mean square over 26
    /// normals and RGB) relative to its mean irradiance over them; 0 where no light arrives.
    std::vector<float> point_noise;
    /// The same for all points: mean standard error over mean irradiance.
    double noise = 0.0;
    uint64_t rays = 0;        ///< from each point
    uint64_t traced = 0;      ///< in all, reflected and shadow rays included
    bool converged = true;    ///< false: settings.noise was not reached
    bool interrupted = false; ///< it is what whole passes brought before `progress` threw
};

/// Traces paths from `points` (frame units). `keys` are one a point and choose its random numbers:
/// a point of the same place and key gives the same bits in whatever set it is, on any number of
/// threads, whatever `normals` asks for besides. With settings.noise or settings.seconds rays come
/// in passes, each of which doubles them; an Error (interrupted, terminated) of `progress` after
/// the first one ends it with what there is. Directions are uniform over the sphere, stratified
/// within a batch; sums are in double. Throws Error (invalid: see Paths::arriving), and whatever
/// `progress` throws.
ProbeField trace_probes(const Scene& scene, const visibility::Visibility& visibility,
                        const scene::Frame& frame, std::span<const glm::vec3> points,
                        std::span<const uint64_t> keys, const ReferenceSettings& settings,
                        Progress& progress, const ProbeNormals& normals = {});

struct Reference {
    /// Cells that were not evaluated are 0 and not valid. metadata: solver, content, bounces, rays,
    /// seed, probes (with ReferenceSettings::probes), noise, and standard_error: the root mean
    /// square of each grid's over the evaluated cells and RGB.
    Volume volume;
    Volume error;                       ///< sh holds the standard errors
    std::vector<double> standard_error; ///< nits, a number a grid of sh: see metadata
    double noise = 0.0;                 ///< as in ProbeField
    uint64_t rays = 0;
    uint64_t traced = 0;
    uint64_t probes = 0;      ///< cells evaluated
    bool interrupted = false; ///< as in ProbeField
    std::vector<std::string> warnings;
};

/// The reference on a grid: trace_probes at the centres of its cells. Throws Error: invalid (no
/// triangles; no light that paths.bounces lets arrive; `probes` asked for where no cell is valid),
/// memory, and what trace_probes throws.
Reference make_reference(const Scene& scene, const Grid& grid, const ReferenceSettings& settings,
                         Progress& progress);

} // namespace lpvbake::reference
