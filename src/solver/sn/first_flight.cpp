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

Sight SnLight::sight(const visibility::Hit& hit, glm::vec3 direction) const {
    return {hit.instance == visibility::no_hit ? Sight::sky : lit.side(hit, direction), hit.tint};
}

glm::vec3 SnLight::luminance(const Sight& sight, glm::vec3 direction) const {
    if (sight.side == Sight::sky) {
        const glm::vec3 own = scene::sky_luminance(sky, direction);
        if (!layer)
            return sight.tint * own;
        return sight.tint
               * (layer->sky * own
                  + (layer->is_seen() ? layer->beyond(direction) : glm::vec3(0.0f)));
    }
    if (sight.side == surface::LitSurfaces::no_side)
        return glm::vec3(0.0f);
    const glm::vec3 all = lit.luminance[sight.side];
    if (!layer)
        return sight.tint * (all - surface::luminance_above(all, limit));
    const float mean = (all.x + all.y + all.z) / 3.0f;
    const float share = mean > limit ? limit / mean : 1.0f;
    return sight.tint * share * lit.layers[lit.layer_count * sight.side + index];
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
            const glm::vec3 along = rays[i].direction;
            const glm::vec3 luminance = light.luminance(light.sight(hits[i], along), along);
            seen[part * block + i] = (luminance.x + luminance.y + luminance.z) / 3.0f;
        }
    });
    double sum = 0.0;
    for (const float luminance : seen)
        sum += double(luminance);
    return float(sum / double(mean_rays));
}

namespace {

/// Where what arrives in some places is put.
struct Arrivals {
    const SnLight& light;
    std::span<const SnPlace> places;
    const Travel& travel;
    size_t stride;
    std::span<glm::vec4> luminance;
    Sights* sights;
    size_t first;

    /// Of place i along direction d.
    void take(size_t i, size_t d, const visibility::Ray& ray, const visibility::Hit& hit,
              uint32_t side) {
        const Sight sight{hit.instance == visibility::no_hit ? Sight::sky : side, hit.tint};
        const glm::vec3 point = ray.origin, back = ray.direction;
        glm::vec4& arrives = luminance[i * stride + d];
        const float end = sight.side == Sight::sky ? HUGE_VALF : hit.t;
        arrives =
            glm::vec4(light.part == LightPart::surfaces ? light.luminance(sight, back)
                                                        : light.air->sent(point, back, 0.0f, end),
                      light.air ? light.air->column(point, back, 0.0f, end) : 0.0f);
        if (sights)
            sights->sides[first + i * stride + d] = sight.side;
        if (sights && !sights->tints.empty())
            sights->tints[first + i * stride + d] = sight.tint;
    }

    /// By Embree, whose rays of a direction are alike, of up to eight places of a quadrant.
    void trace_eight() {
        constexpr size_t eight = 8, together = 8; // directions whose patches are sought at once
        std::array<visibility::Ray, eight * together> rays;
        std::array<visibility::Hit, eight * together> hits;
        std::array<uint32_t, eight * together> sides;
        const size_t count = places.size();
        const std::span<const glm::vec3> own_travel = travel.of(places.front());
        for (size_t begin = 0; begin < own_travel.size(); begin += together) {
            const size_t end = std::min(own_travel.size(), begin + together);
            size_t used = 0;
            for (size_t d = begin; d < end; ++d, used += count) {
                const std::span own = std::span(rays).subspan(used, count);
                for (size_t i = 0; i < count; ++i)
                    own[i] = {places[i].point, -own_travel[d], 0.0f, HUGE_VALF};
                light.visibility.closest_of_eights(own, visibility::Bundle::tight,
                                                   std::span(hits).subspan(used, count));
            }
            light.lit.sides(std::span(hits).first(used), rays, sides);
            for (size_t k = 0; k < used; ++k)
                take(k % count, begin + k / count, rays[k], hits[k], sides[k]);
        }
    }

    /// By a caster, all at once.
    void trace_many() {
        thread_local std::vector<visibility::Ray> rays;
        thread_local std::vector<visibility::Hit> hits;
        thread_local std::vector<uint32_t> sides;
        rays.clear();
        for (size_t d = 0; d < travel.of_each(); ++d)
            for (size_t i = 0; i < places.size(); ++i)
                rays.push_back({places[i].point, -travel.of(places[i])[d], 0.0f, HUGE_VALF});
        hits.resize(rays.size());
        sides.resize(rays.size());
        light.visibility.closest_of_many(rays, hits);
        light.lit.sides(hits, rays, sides);
        for (size_t k = 0; k < rays.size(); ++k)
            take(k % places.size(), k / places.size(), rays[k], hits[k], sides[k]);
    }
};

} // namespace

void trace_arriving(const SnLight& light, std::span<const SnPlace> places, const Travel& travel,
                    size_t stride, std::span<glm::vec4> luminance, Sights* sights, size_t first) {
    Arrivals arrivals{light, places, travel, stride, luminance, sights, first};
    if (light.visibility.batch() > 0)
        arrivals.trace_many();
    else
        arrivals.trace_eight();
}

} // namespace lpvbake::solver::sn
