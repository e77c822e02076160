#include "reference/paths.h"

#include "lpvbake/error.h"
#include "reference/sampling.h"
#include "scene/material.h"
#include "scene/names.h"
#include "scene/sky.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::reference {
namespace {

/// Below this throughput a path of unlimited reflections goes on by chance.
constexpr double faint = 0.1;
/// No path of a scene that loses light is this long.
constexpr int longest_path = 100'000;

/// Density of a direction that is uniform over the sphere, 1 / sr.
constexpr double over_sphere = 0.25 * glm::one_over_pi<double>();

} // namespace

glm::dvec3 off_surface(glm::dvec3 point, glm::dvec3 n) {
    return point + ray_offset(point) * n;
}

Paths::Paths(const Scene& scene, const visibility::Visibility& visibility,
             const scene::Frame& frame, const PathRules& rules)
    : scene_(scene),
      visibility_(visibility),
      rules_(rules),
      unit_(frame.unit),
      emitters_(rules.emitters ? Emitters(scene, frame) : Emitters({}, frame)),
      sky_(scene::has_sky(scene) ? scene.sky.map.get() : nullptr) {
    across_ = 1.01 * glm::length(glm::dvec3(visibility.hi()) - glm::dvec3(visibility.lo())) + 1.0;
    for (const Light& light : scene.lights)
        sources_.push_back({light.type, glm::dvec3(light.color) * light.intensity,
                            frame.from_world(light.position), light.direction, light.range,
                            std::cos(std::min(light.inner_cone, light.outer_cone)),
                            std::cos(light.outer_cone)});
}

glm::dvec3 Paths::illuminance(glm::dvec3 point, glm::dvec3 n, uint64_t& rays) const {
    glm::dvec3 sum{0.0};
    for (const PunctualLight& source : sources_) {
        glm::dvec3 way = -across_ * source.direction;
        double share = 1.0; // of `color` on a surface that faces the light
        double end = 1.0;   // of the shadow ray: before a surface that the light lies on
        if (source.type != LightType::directional) {
            way = source.position - point;
            const double metres = glm::length(way) * unit_;
            if (!(metres > 0.0))
                continue;
            end = std::max(0.0, 1.0 - ray_offset(source.position) / glm::length(way));
            share = 1.0 / (metres * metres);
            if (source.range > 0.0)
                share *= std::clamp(1.0 - std::pow(metres / source.range, 4.0), 0.0, 1.0);
            if (source.type == LightType::spot) {
                const double cosine = -glm::dot(way, source.direction) / glm::length(way);
                share *= spot_ramp(cosine, source.cos_inner, source.cos_outer);
            }
        }
        share *= glm::dot(n, way) / glm::length(way);
        if (!(share > 0.0))
            continue;
        ++rays;
        const visibility::Ray shadow{glm::vec3(point), glm::vec3(way), 0.0f, float(end)};
        sum += share * glm::dvec3(visibility_.filter(shadow)) * source.color;
    }
    return sum;
}

glm::dvec3 Paths::emission(const visibility::Hit& hit) const {
    const Mesh& mesh = scene_.meshes[size_t(scene_.instances[hit.instance].mesh)];
    const glm::dvec3 covered = scene::sample_emission(scene_, mesh, hit.triangle, hit.barycentric);
    if (covered == glm::dvec3(0.0))
        return covered;
    // The hit was drawn with probability alpha already, which sample_emission holds as a factor.
    return covered
           / double(scene::sample_surface(scene_, mesh, hit.triangle, hit.barycentric).alpha);
}

template <class Density>
Paths::Glimpse Paths::aim(glm::vec3 origin, const Density& density, PathSampler& sampler,
                          uint64_t& rays) const {
    const Emitters::Target target = emitters_.target(sampler.pair());
    const glm::dvec3 way = target.point - glm::dvec3(origin);
    const double distance = glm::length(way);
    if (!(distance > 0.0))
        return {};
    Glimpse seen;
    seen.direction = way / distance;
    const double own = density(seen.direction);
    if (!(own > 0.0))
        return {};
    ++rays;
    const float end = float(distance + ray_offset(target.point));
    const visibility::Hit hit = visibility_.closest({origin, glm::vec3(seen.direction), 0.0f, end});
    // Of two triangles at one place only one is ever hit, and only it may count.
    if (hit.instance != target.instance || hit.triangle != target.triangle
        || hit.facing == visibility::Facing::back)
        return seen;
    seen.luminance = glm::dvec3(hit.tint) * emission(hit)
                     * (own / (own + emitters_.density(hit, seen.direction)));
    return seen;
}

Paths::Glimpse Paths::glimpse(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const {
    if (emitters_.empty())
        return {};
    return aim(
        origin, [](glm::dvec3) { return over_sphere; }, sampler, rays);
}

template <class Density>
Paths::Glimpse Paths::aim_at_sky(glm::vec3 origin, const Density& density, PathSampler& sampler,
                                 uint64_t& rays) const {
    Glimpse seen;
    seen.direction = scene::sample_sky(*sky_, sampler.pair());
    const double own = density(seen.direction);
    if (!(own > 0.0))
        return {};
    ++rays;
    const glm::vec3 towards(seen.direction);
    const glm::dvec3 passes(visibility_.filter({origin, towards, 0.0f, HUGE_VALF}));
    seen.luminance = passes * own / (own + scene::sky_density(*sky_, towards))
                     * glm::dvec3(scene::sky_luminance(scene_.sky, towards));
    return seen;
}

Paths::Glimpse Paths::glimpse_sky(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const {
    if (!sky_)
        return {};
    return aim_at_sky(
        origin, [](glm::dvec3) { return over_sphere; }, sampler, rays);
}

glm::dvec3 Paths::luminance(glm::vec3 origin, glm::dvec3 towards, PathSampler& sampler,
                            uint64_t& rays) const {
    return trace(origin, towards, over_sphere, sampler, rays);
}

glm::dvec3 Paths::irradiance(glm::vec3 origin, glm::dvec3 n, PathSampler& sampler,
                             uint64_t& rays) const {
    const auto density = [n](glm::dvec3 w) { return glm::dot(n, w) / glm::pi<double>(); };
    const glm::dvec3 towards = sample_cosine(n, sampler.pair());
    glm::dvec3 sum = trace(origin, towards, density(towards), sampler, rays);
    if (!emitters_.empty())
        sum += aim(origin, density, sampler, rays).luminance;
    if (sky_)
        sum += aim_at_sky(origin, density, sampler, rays).luminance;
    return glm::pi<double>() * sum;
}

glm::dvec3 Paths::trace(glm::vec3 origin, glm::dvec3 towards, double density, PathSampler& sampler,
                        uint64_t& rays) const {
    glm::dvec3 sum{0.0}, throughput{1.0};
    for (int reflections = 0;; ++reflections) {
        const bool last = rules_.bounces && reflections == *rules_.bounces;
        if (last && emitters_.empty() && !scene::has_sky(scene_))
            break;
        ++rays;
        const visibility::Hit hit =
            visibility_.closest({origin, glm::vec3(towards), 0.0f, HUGE_VALF});
        throughput *= glm::dvec3(hit.tint);
        if (hit.instance == visibility::no_hit) {
            const double share =
                sky_ ? density / (density + scene::sky_density(*sky_, glm::vec3(towards))) : 1.0;
            sum += share * throughput
                   * glm::dvec3(scene::sky_luminance(scene_.sky, glm::vec3(towards)));
        }
        if (hit.instance == visibility::no_hit || hit.facing == visibility::Facing::back)
            break;
        if (!emitters_.empty())
            sum += throughput * emission(hit)
                   * (density / (density + emitters_.density(hit, towards)));
        if (last)
            break;
        const Mesh& mesh = scene_.meshes[size_t(scene_.instances[hit.instance].mesh)];
        throughput *=
            glm::dvec3(scene::sample_surface(scene_, mesh, hit.triangle, hit.barycentric).albedo);
        if (throughput == glm::dvec3(0.0))
            break;

        glm::dvec3 n{hit.normal};
        if (glm::dot(n, towards) > 0.0)
            n = -n;
        glm::dvec3 point = glm::dvec3(origin) + double(hit.t) * towards;
        point = off_surface(point, n);
        origin = glm::vec3(point);
        sum += throughput / glm::pi<double>() * illuminance(point, n, rays);
        const auto cosine_density = [n](glm::dvec3 w) {
            return glm::dot(n, w) / glm::pi<double>();
        };
        if (!emitters_.empty())
            sum += throughput * aim(origin, cosine_density, sampler, rays).luminance;
        if (sky_)
            sum += throughput * aim_at_sky(origin, cosine_density, sampler, rays).luminance;

        if (!rules_.bounces && max_component(throughput) < faint) {
            const double survival = max_component(throughput) / faint;
            if (sampler.plain() >= survival)
                break;
            throughput /= survival;
        }
        if (reflections > longest_path)
            throw Error(ErrorKind::invalid, scene::endless_reflection(scene_, hit.instance));
        towards = sample_cosine(n, sampler.pair());
        density = cosine_density(towards);
    }
    return sum;
}

} // namespace lpvbake::reference
