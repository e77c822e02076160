#include "report/suite_truth.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lpvbake::report {
namespace {

/// Of the triangle as seen from the origin, above 0 where it faces it.
double solid_angle(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
    const double la = glm::length(a), lb = glm::length(b), lc = glm::length(c);
    return -2.0
           * std::atan2(glm::dot(a, glm::cross(b, c)), la * lb * lc + glm::dot(a, b) * lc
                                                           + glm::dot(a, c) * lb
                                                           + glm::dot(b, c) * la);
}

void trace(const Scene& scene, const visibility::Visibility& visibility,
           std::span<const size_t> cells, const SuiteTracing& settings, Progress& progress,
           TruthField& field) {
    const Grid& grid = field.volume.grid;
    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    for (const size_t cell : cells) {
        points.push_back(visibility.capture(grid.cell_at(cell)).point);
        keys.push_back(cell);
    }
    reference::ReferenceSettings reference;
    reference.paths = {settings.bounces, true};
    reference.sh_order = suite_truth_order;
    reference.rays = settings.rays;
    reference.noise = settings.noise;
    const reference::ProbeField traced = reference::trace_probes(
        scene, visibility, scene::frame_of(grid), points, keys, reference, progress);
    for (size_t k = 0; k < traced.sh.size(); ++k)
        for (size_t i = 0; i < cells.size(); ++i)
            field.volume.sh[k][cells[i]] = traced.sh[k][i];
    field.noise = traced.noise;
}

} // namespace

std::array<double, volume::sh_count(suite_truth_order)>
polygon_light(std::span<const glm::dvec3> corners, glm::dvec3 point) {
    constexpr int pieces = 32; // along an edge
    std::array<double, volume::sh_count(suite_truth_order)> light{};
    for (size_t i = 1; i + 1 < corners.size(); ++i) {
        const glm::dvec3 a = corners[0] - point, u = (corners[i] - corners[0]) / double(pieces),
                         v = (corners[i + 1] - corners[0]) / double(pieces);
        const auto add = [&](glm::dvec3 p, glm::dvec3 q, glm::dvec3 r) {
            const double angle = solid_angle(p, q, r);
            if (!(angle > 0.0))
                return;
            const auto basis =
                volume::sh_basis(suite_truth_order, glm::vec3(glm::normalize(p + q + r)));
            for (size_t k = 0; k < light.size(); ++k)
                light[k] += angle * double(basis[k]);
        };
        for (int y = 0; y < pieces; ++y)
            for (int x = 0; x + y < pieces; ++x) {
                const glm::dvec3 corner = a + double(x) * u + double(y) * v;
                add(corner, corner + u, corner + v);
                if (x + y + 1 < pieces)
                    add(corner + u, corner + u + v, corner + v);
            }
    }
    return light;
}

double furnace_luminance(const FurnaceTruth& furnace, std::optional<int> bounces) {
    if (!bounces)
        return furnace.emission / (1.0 - furnace.albedo);
    double sum = 0.0;
    for (int i = 0; i <= *bounces; ++i)
        sum += std::pow(furnace.albedo, i);
    return furnace.emission * sum;
}

TruthField find_truth(const SuiteTruth& truth, const Scene& scene,
                      const visibility::Visibility& visibility, const Grid& grid,
                      std::span<const size_t> cells, const SuiteTracing& settings,
                      Progress& progress) {
    TruthField field;
    Volume& volume = field.volume;
    volume.grid = grid;
    volume.sh_order = suite_truth_order;
    volume.sh.assign(size_t(volume::sh_count(suite_truth_order)),
                     std::vector<glm::vec3>(grid.size(), glm::vec3(0.0f)));
    volume.validity.assign(grid.size(), 0.0f);
    for (const size_t cell : cells)
        volume.validity[cell] = 1.0f;

    if (const auto* furnace = std::get_if<FurnaceTruth>(&truth)) {
        const double c0 =
            furnace_luminance(*furnace, settings.bounces) * std::sqrt(4.0 * std::numbers::pi);
        const float across = 2.0f * glm::distance(visibility.lo(), visibility.hi())
                             + 2.0f * float(std::max({grid.dims.x, grid.dims.y, grid.dims.z}));
        for (const size_t cell : cells) {
            const visibility::Hit hit = visibility.closest(
                {visibility.capture(grid.cell_at(cell)).point, {across, 0.0f, 0.0f}, 0.0f, 1.0f});
            if (hit.instance != visibility::no_hit && hit.facing != visibility::Facing::back)
                volume.sh[0][cell] = glm::vec3(float(c0));
        }
    } else if (const auto* polygon = std::get_if<PolygonTruth>(&truth)) {
        for (const size_t cell : cells) {
            const glm::dvec3 point(visibility.capture(grid.cell_at(cell)).point);
            const auto light = polygon_light(polygon->corners, grid.origin + grid.cell * point);
            for (size_t k = 0; k < light.size(); ++k)
                volume.sh[k][cell] = glm::vec3(float(polygon->luminance * light[k]));
        }
    } else if (std::holds_alternative<TracedTruth>(truth)) {
        trace(scene, visibility, cells, settings, progress, field);
    }
    return field;
}

} // namespace lpvbake::report
