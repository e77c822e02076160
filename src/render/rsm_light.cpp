#include "render/rsm_light.h"

#include "mix_word.h"
#include "scene/material.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::render {
namespace {

const double pi = glm::pi<double>();

/// Points in [0, 1)^2 that are evenly spread for any number of them (Roberts 2018), shifted by
/// numbers of the key's own.
glm::dvec2 spread(uint32_t key, int i) {
    const glm::dvec2 shift(mix_word(key) >> 8, mix_word(key ^ 0x9e3779b9u) >> 8);
    return glm::fract(shift * 0x1p-24 + double(i + 1) * glm::dvec2(0.7548776662, 0.5698402910));
}

} // namespace

SeenPlanes::SeenPlanes(const scene::RsmView& view, glm::ivec2 size, std::vector<Plane> planes)
    : view_(view),
      size_(size),
      planes_(std::move(planes)) {}

bool SeenPlanes::blocks(glm::dvec3 place, double thickness) const {
    const glm::dvec3 to = place - view_.origin;
    const double depth = glm::dot(to, view_.axis);
    if (!(depth > view_.nearest))
        return false;
    const glm::dvec2 at = glm::dvec2(glm::dot(to, view_.u) / glm::dot(view_.u, view_.u),
                                     glm::dot(to, view_.v) / glm::dot(view_.v, view_.v))
                          / depth;
    const glm::dvec2 pixel = glm::floor(0.5 * (at + 1.0) * glm::dvec2(size_));
    if (!(pixel.x >= 0 && pixel.y >= 0 && pixel.x < size_.x && pixel.y < size_.y))
        return false;
    const Plane& plane =
        planes_[std::size_t(pixel.y) * std::size_t(size_.x) + std::size_t(pixel.x)];
    const double towards = glm::dot(plane.normal, to);
    if (towards == 0)
        return false;
    const double seen = depth * glm::dot(plane.normal, plane.point - view_.origin) / towards;
    return seen > 0 && seen < depth * (1 - 1e-4) && seen > depth - thickness;
}

RsmLight::RsmLight(const Scene& scene, const scene::Frame& frame,
                   const visibility::Visibility& visibility, const RsmLightSettings& settings)
    : visibility_(visibility),
      settings_(settings),
      unit_(frame.unit) {
    const int size = settings.map_size;
    for (const Light& light : scene.lights)
        for (const scene::RsmView& view : scene::views_of(light, frame, glm::dvec3(visibility.lo()),
                                                          glm::dvec3(visibility.hi()))) {
            Map& map = maps_.emplace_back(
                Map{view, std::vector<Texel>(std::size_t(size) * std::size_t(size))});
            const scene::TexelFlux flux(light, frame, view, size);
            const double across =
                4 * glm::length(view.u) * glm::length(view.v) / (double(size) * size);
            tbb::parallel_for(0, size * size, [&](int i) {
                const int column = i % size, row = i / size;
                const glm::dvec2 at = (glm::dvec2(column, row) + 0.5) * 2.0 / double(size) - 1.0;
                const glm::dvec3 along = view.along(at);
                const glm::dvec3 start =
                    view.start(at) + (view.perspective ? 0.0 : view.nearest) * along;
                const visibility::Hit hit =
                    visibility.closest({glm::vec3(start), glm::vec3(along),
                                        view.perspective ? float(view.nearest) : 0.0f, HUGE_VALF});
                if (hit.instance == visibility::no_hit || hit.facing == visibility::Facing::back)
                    return;
                Texel& texel = map.texels[std::size_t(i)];
                texel.normal = glm::dvec3(hit.normal);
                if (glm::dot(texel.normal, along) > 0)
                    texel.normal = -texel.normal;
                texel.point = reference::off_surface(start + double(hit.t) * along, texel.normal);
                const double cosine =
                    std::max(-glm::dot(texel.normal, along) / glm::length(along), 0.05);
                const double distance = double(hit.t) * glm::length(along);
                // Of perspective the texel's square lies `t` deep, across its ray's slant.
                texel.area = view.perspective ? across * distance * distance
                                                    / (std::pow(glm::length(along), 3) * cosine)
                                              : across / cosine;
                const Mesh& mesh = scene.meshes[std::size_t(scene.instances[hit.instance].mesh)];
                const glm::dvec3 albedo(
                    scene::sample_surface(scene, mesh, hit.triangle, hit.barycentric).albedo);
                texel.luminance = flux(column, row) * glm::dvec3(light.color) * albedo
                                  * glm::dvec3(hit.tint)
                                  / (pi * texel.area * frame.unit * frame.unit);
            });
        }
}

glm::dvec2 RsmLight::place_in(const Map& map, glm::dvec3 point) const {
    const scene::RsmView& view = map.view;
    const double size = settings_.map_size;
    const glm::dvec3 to = point - view.origin;
    const double depth = view.perspective ? glm::dot(to, view.axis) : 1.0;
    if (!(depth > 0)) // behind the light
        return glm::dvec2(0.5 * size);
    const glm::dvec2 at(glm::dot(to, view.u) / glm::dot(view.u, view.u),
                        glm::dot(to, view.v) / glm::dot(view.v, view.v));
    return glm::clamp((at / depth + 1.0) * 0.5 * size, 0.0, size);
}

glm::dvec3 RsmLight::from_texel(const Texel& texel, glm::dvec3 point, glm::dvec3 n,
                                double times) const {
    const glm::dvec3 to = texel.point - point;
    const double square = glm::dot(to, to), distance = std::sqrt(square);
    const double sends = -glm::dot(to, texel.normal), takes = glm::dot(to, n);
    if (texel.area == 0 || !(sends > 0) || !(takes > 0))
        return glm::dvec3(0.0);
    // What is nearer than it is large counts as half a sphere at most.
    const double angle = std::min(times * texel.area * sends / (square * distance), 2 * pi);
    return angle * takes / distance * texel.luminance;
}

bool RsmLight::is_hidden_by_rays(const Texel& texel, glm::dvec3 point, uint64_t& rays) const {
    ++rays;
    return visibility_.transmittance({glm::vec3(point), glm::vec3(texel.point - point)}) < 0.5f;
}

bool RsmLight::is_hidden(const Texel& texel, glm::dvec3 point, uint32_t key,
                         const SeenPlanes* planes, uint64_t& rays, PairCount& count) const {
    using Seen = RsmLightSettings::Seen;
    bool hidden = false;
    if (settings_.seen == Seen::rays)
        hidden = is_hidden_by_rays(texel, point, rays);
    const glm::dvec3 way = texel.point - point;
    const double reach = std::min(1.0, settings_.radius / unit_ / glm::length(way));
    for (int i = 0; settings_.seen == Seen::ssdo && i < settings_.samples && !hidden; ++i) {
        const double jitter = double(mix_word(key + uint32_t(i)) >> 8) * 0x1p-24;
        hidden = planes->blocks(point + (i + jitter) / settings_.samples * reach * way,
                                settings_.thickness / unit_);
    }
    ++count.pairs;
    if (settings_.compare) {
        const bool truth = is_hidden_by_rays(texel, point, rays);
        count.hidden += truth;
        count.falsely_lit += truth && !hidden;
        count.falsely_dark += hidden && !truth;
    }
    return hidden;
}

glm::dvec3 RsmLight::illuminance(glm::dvec3 point, glm::dvec3 n, uint32_t key,
                                 const SeenPlanes* planes, uint64_t& rays, PairCount& count) const {
    const double size = settings_.map_size;
    glm::dvec3 sum(0.0);
    for (const Map& map : maps_) {
        key = mix_word(key + 1);
        const glm::dvec2 place = place_in(map, point);
        const double radius = glm::length(glm::max(place, size - place));
        for (int i = 0; i < settings_.texels; ++i) {
            const glm::dvec2 u = spread(key, i);
            const glm::ivec2 at(glm::floor(
                place + radius * u.x * glm::dvec2(std::sin(2 * pi * u.y), std::cos(2 * pi * u.y))));
            if (at.x < 0 || at.y < 0 || at.x >= settings_.map_size || at.y >= settings_.map_size)
                continue;
            const Texel& texel =
                map.texels[std::size_t(at.y) * std::size_t(settings_.map_size) + std::size_t(at.x)];
            // Their density is 1 / (2 pi radius^2 u.x) a texel.
            const glm::dvec3 light =
                from_texel(texel, point, n, 2 * pi * radius * radius * u.x / settings_.texels);
            if (light != glm::dvec3(0.0)
                && !is_hidden(texel, point, mix_word(key ^ uint32_t(i)), planes, rays, count))
                sum += light;
        }
    }
    return sum;
}

glm::dvec3 RsmLight::all_texels(glm::dvec3 point, glm::dvec3 n, uint64_t& rays) const {
    glm::dvec3 sum(0.0);
    for (const Map& map : maps_)
        for (const Texel& texel : map.texels) {
            const glm::dvec3 light = from_texel(texel, point, n, 1);
            if (light != glm::dvec3(0.0) && !is_hidden_by_rays(texel, point, rays))
                sum += light;
        }
    return sum;
}

} // namespace lpvbake::render
