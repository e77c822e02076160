// What a field should be at some of a grid's cells, by path tracing or in closed form.
#pragma once

#include "reference/reference.h"
#include "volume/sh.h"
#include "volume/volume.h"

#include <array>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace lpvbake::report {

/// Path-traced.
struct TracedTruth {};

/// A closed room whose walls all emit and reflect alike: the same luminance everywhere in it, where
/// the first surface towards +X is a front, and none outside.
struct FurnaceTruth {
    double emission = 1; ///< nits
    double albedo = 0;
};

/// A flat polygon of uniform luminance in an otherwise empty scene.
struct PolygonTruth {
    std::vector<glm::dvec3> corners; ///< metres, counter-clockwise seen from the side that shines
    double luminance = 1;            ///< nits
};

/// Nobody asks.
struct NoTruth {};

using SuiteTruth = std::variant<TracedTruth, FurnaceTruth, PolygonTruth, NoTruth>;

/// Highest band of the truth.
inline constexpr int suite_truth_order = volume::sh_max_order;

/// Light of a polygon of luminance 1 at `point`, without anything between: its integrals with the
/// basis functions of bands 0 to 4 over the solid angle that it takes up; 0 behind it. The solid
/// angle is exact (Van Oosterom and Strackee 1983); the bands above 0 are summed over pieces of a
/// 32nd of its edges, to 0.6 % at a distance of one and a half pieces.
std::array<double, volume::sh_count(suite_truth_order)>
polygon_light(std::span<const glm::dvec3> corners, glm::dvec3 point);

/// emission (1 + albedo + albedo^2 + ...) with `bounces` reflections; none: all.
double furnace_luminance(const FurnaceTruth& furnace, std::optional<int> bounces);

struct SuiteTracing {
    std::optional<int> bounces = 1; ///< reflections at most; none: all
    uint64_t rays = 4096;           ///< from each cell at most
    double noise = 0.01;            ///< stop at this relative standard error of irradiance
};

struct TruthField {
    Volume volume;    ///< valid at the wanted cells alone
    double noise = 0; ///< relative standard error of irradiance; 0 for closed forms
};

/// The truth at `cells` (Grid::index), darkness for NoTruth. Throws Error: see trace_probes.
TruthField find_truth(const SuiteTruth& truth, const Scene& scene,
                      const visibility::Visibility& visibility, const Grid& grid,
                      std::span<const size_t> cells, const SuiteTracing& settings,
                      Progress& progress);

} // namespace lpvbake::report
