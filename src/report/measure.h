// How wrong a field is: the truth at a set of points, and the distance from it.
#pragma once

#include "bake/settings.h"
#include "reference/reference.h"
#include "report/points.h"

#include <span>
#include <vector>

namespace lpvbake::report {

/// Highest band of the reference: what lower orders cost is told from the same rays.
inline constexpr int truth_order = 4;

/// The light that bake puts into its field.
reference::PathRules field_rules(const bake::BakeSettings& settings);

/// How exact a reference is to be.
struct TruthSettings {
    double noise = 0.01;          ///< as ReferenceSettings::noise
    uint64_t most_rays = 1 << 16; ///< from each point
    uint64_t seed = 1;
};

/// What arrives at a set of points.
struct Truth {
    /// sh[k][point], nits, up to truth_order; lower orders are its first coefficients.
    std::vector<std::vector<glm::vec3>> sh;
    /// irradiance[point * normals + n], lux, of all bands: `normals` are the 26 neighbours', or one
    /// a point.
    std::vector<glm::dvec3> irradiance;
    std::vector<glm::dvec3> error; ///< their standard errors
    double noise = 0;              ///< as ProbeField::noise
    uint64_t rays = 0;             ///< from each point
    uint64_t traced = 0;
    double seconds = 0;
    bool converged = true;
};

/// Traces at points in frame units: towards `own` normals, one a point, or, where there are none,
/// the 26 of neighbour_normals(). Throws what trace_probes throws.
Truth trace_truth(const Scene& scene, const visibility::Visibility& visibility,
                  const scene::Frame& frame, std::span<const glm::vec3> points,
                  std::span<const glm::dvec3> own, const reference::PathRules& rules,
                  const TruthSettings& settings, Progress& progress);

/// Irradiance (lux) from the coefficients up to `order` at every point, towards each of the 26
/// normals: [point * 26 + n]; 0 where it is negative, which `negative` counts (values, RGB).
std::vector<glm::dvec3> irradiance_of(const std::vector<std::vector<glm::vec3>>& sh, int order,
                                      uint64_t* negative = nullptr);

/// How far estimated irradiance is from the true one, over all values and RGB.
struct FieldError {
    double relative_l1 = 0;  ///< sum |E - T| / sum T
    double relative_rms = 0; ///< root of the mean square of E - T, over the mean of T
    double energy_ratio = 1; ///< luminance of sum E over that of sum T
    uint64_t negative = 0;   ///< values of E below 0 before they were clamped
};

/// Both of one length. Where the truth is dark, 0 stays 0 and the rest is infinite.
FieldError error_of(std::span<const glm::dvec3> estimate, std::span<const glm::dvec3> truth);

} // namespace lpvbake::report
