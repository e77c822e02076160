#include "solver/sn/first_flight.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>

namespace lpvbake::solver::sn {
namespace {

constexpr size_t mean_rays = 8192;
constexpr size_t block = 256;

/// Additive sequences of whole numbers, exact for any index (steps: the generalised golden ratio of
/// two dimensions, Roberts 2018).
glm::vec2 spread(uint32_t index) {
    return {float(0xc13fa9a9u * index >> 8) * 0x1p-24f, float(0x91e10da5u * index >> 8) * 0x1p-24f};
}

} // namespace

glm::vec3 SnLight::luminance(const visibility::Hit& hit, glm::vec3 direction) const {
    if (hit.instance == visibility::no_hit)
        return hit.tint * scene::sky_luminance(sky, direction);
    const glm::vec3 all = lit.leaving(hit, direction);
    return hit.tint * (all - surface::luminance_above(all, limit));
}

float mean_luminance(const SnLight& light, const Grid& grid, std::span<const float> validity) {
    std::vector<uint32_t> cells;
    for (size_t i = 0; i < validity.size(); ++i)
        if (validity[i] > 0.0f)
            cells.push_back(uint32_t(i));
    if (cells.empty())
        return 0.0f;
    std::array<float, mean_rays> seen;
    tbb::parallel_for(size_t(0), mean_rays / block, [&](size_t part) {
        std::array<visibility::Ray, block> rays;
        std::array<visibility::Hit, block> hits;
        for (size_t i = 0; i < block; ++i) {
            const size_t sample = part * block + i;
            const uint32_t cell = cells[sample * cells.size() / mean_rays];
            const glm::vec2 u = spread(uint32_t(sample));
            const float z = 2.0f * u.x - 1.0f, angle = 2.0f * glm::pi<float>() * u.y;
            const float radius = std::sqrt(1.0f - z * z);
            rays[i] = {light.visibility.capture(grid.cell_at(cell)).point,
                       {radius * std::cos(angle), radius * std::sin(angle), z},
                       0.0f,
                       HUGE_VALF};
        }
        light.visibility.closest_of_eights(rays, visibility::Bundle::loose, hits);
        for (size_t i = 0; i < block; ++i) {
            const glm::vec3 luminance = light.luminance(hits[i], rays[i].direction);
            seen[part * block + i] = (luminance.x + luminance.y + luminance.z) / 3.0f;
        }
    });
    double sum = 0.0;
    for (const float luminance : seen)
        sum += double(luminance);
    return float(sum / double(mean_rays));
}

void trace_arriving(const SnLight& light, std::span<const SnPlace> places,
                    std::span<const glm::vec3> travel, size_t stride,
                    std::span<glm::vec4> luminance) {
    std::array<visibility::Ray, 8> rays;
    std::array<visibility::Hit, 8> hits;
    std::array<glm::vec3, 8> points;
    for (size_t i = 0; i < places.size(); ++i)
        points[i] = light.visibility.capture(places[i].cell).point;
    for (size_t d = 0; d < travel.size(); ++d) {
        for (size_t i = 0; i < places.size(); ++i)
            rays[i] = {points[i], -travel[d], 0.0f, HUGE_VALF};
        light.visibility.closest_of_eights(std::span(rays).first(places.size()),
                                           visibility::Bundle::tight, hits);
        for (size_t i = 0; i < places.size(); ++i)
            luminance[i * stride + d] = glm::vec4(light.luminance(hits[i], -travel[d]), 0.0f);
    }
}

} // namespace lpvbake::solver::sn
