#include "reference/paths.h"

#include "lpvbake/error.h"
#include "reference/sampling.h"
#include "scene/material.h"
#include "scene/names.h"
#include "scene/roles.h"
#include "scene/sky.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::reference {
namespace {

/// No path of a scene that loses light is this long.
constexpr int longest_path = 100'000;

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
                            std::cos(light.outer_cone), light.is_static});
    for (size_t i = 0; i < sources_.size(); ++i)
        if (sources_[i].is_static)
            statics_.push_back(i);
    const auto find = [&](std::optional<LitPieces>& pieces, LitPieces::Light light) {
        pieces.emplace(scene, visibility, frame, light);
        if (pieces->empty())
            pieces.reset();
    };
    if (goes_on(0) && !sources_.empty())
        find(lit_, LitPieces::Light::all);
    if (goes_on(1) && lit_)
        find(spots_, LitPieces::Light::spots);
}

Paths::LightWay Paths::way_to(const PunctualLight& source, glm::dvec3 point) const {
    LightWay found{-across_ * source.direction, 1.0, 1.0};
    if (source.type == LightType::directional)
        return found;
    found.way = source.position - point;
    const double metres = glm::length(found.way) * unit_;
    if (!(metres > 0.0))
        return {};
    found.end = std::max(0.0, 1.0 - ray_offset(source.position) / glm::length(found.way));
    found.share = 1.0 / (metres * metres);
    if (source.range > 0.0)
        found.share *= std::clamp(1.0 - std::pow(metres / source.range, 4.0), 0.0, 1.0);
    if (source.type == LightType::spot) {
        const double cosine = -glm::dot(found.way, source.direction) / glm::length(found.way);
        found.share *= spot_ramp(cosine, source.cos_inner, source.cos_outer);
    }
    return found;
}

glm::dvec3 Paths::illuminance(glm::dvec3 point, glm::dvec3 n, uint64_t& rays, Lights which) const {
    glm::dvec3 sum{0.0};
    for (const PunctualLight& source : sources_) {
        if (which != Lights::all && source.is_static != (which == Lights::statics))
            continue;
        auto [way, share, end] = way_to(source, point);
        if (!(share > 0.0))
            continue;
        share *= glm::dot(n, way) / glm::length(way);
        if (!(share > 0.0))
            continue;
        ++rays;
        const visibility::Ray shadow{glm::vec3(point), glm::vec3(way), 0.0f, float(end)};
        sum += share * glm::dvec3(visibility_.filter(shadow)) * source.color;
    }
    return sum;
}

Paths::FromLight Paths::from_light(std::size_t i, glm::dvec3 point, uint64_t& rays) const {
    const PunctualLight& source = sources_[i];
    const auto [way, share, end] = way_to(source, point);
    FromLight light{way, glm::dvec3(0.0), source.is_static};
    if (share > 0.0) {
        ++rays;
        light.lux =
            share * source.color
            * glm::dvec3(visibility_.filter({glm::vec3(point), glm::vec3(way), 0.0f, float(end)}));
    }
    return light;
}

Paths::Glimpse Paths::seen_light(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const {
    if (statics_.empty())
        return {};
    const double count = double(statics_.size());
    const std::size_t drawn =
        statics_.size() == 1 ? 0
                             : std::min(statics_.size() - 1, std::size_t(sampler.plain() * count));
    const FromLight light = from_light(statics_[drawn], glm::dvec3(origin), rays);
    if (light.lux == glm::dvec3(0.0))
        return {};
    // Of the mean over the sphere.
    return {glm::normalize(light.way), count / (4.0 * glm::pi<double>()) * light.lux};
}

glm::dvec3 Paths::emission(const visibility::Hit& hit) const {
    const Instance& instance = scene_.instances[hit.instance];
    if (instance.role == Role::cast_only)
        return glm::dvec3(0.0);
    const Mesh& mesh = scene_.meshes[size_t(instance.mesh)];
    const glm::dvec3 covered = scene::sample_emission(scene_, mesh, hit.triangle, hit.barycentric);
    if (covered == glm::dvec3(0.0) || instance.role == Role::lights_only)
        return covered;
    // The hit was drawn with probability alpha already, which sample_emission holds as a factor.
    return covered
           / double(scene::sample_surface(scene_, mesh, hit.triangle, hit.barycentric).alpha);
}

glm::dvec3 Paths::Lobe::sample(glm::dvec2 sample) const {
    return n ? sample_cosine(*n, sample) : on_sphere(sample);
}

double Paths::Lobe::density(glm::dvec3 towards) const {
    return n ? glm::dot(*n, towards) / glm::pi<double>() : 0.25 * glm::one_over_pi<double>();
}

bool Paths::is_guided(int reflections) const {
    return reflections == 0 && lit_;
}

double Paths::density_of(const visibility::Hit& hit, glm::vec3 origin, glm::dvec3 towards,
                         const Lobe& lobe, int reflections) const {
    const double own = lobe.density(towards);
    if (!is_guided(reflections))
        return own;
    return hit.instance == visibility::no_hit
               ? 0.5 * own
               : 0.5 * (own + lit_->density(hit, glm::dvec3(origin), towards));
}

std::optional<Paths::Met> Paths::meet(const Emitters::Target& target, glm::vec3 origin,
                                      const Lobe& lobe, uint64_t& rays) const {
    const glm::dvec3 way = target.point - glm::dvec3(origin);
    const double distance = glm::length(way);
    if (!(distance > 0.0))
        return std::nullopt;
    const glm::dvec3 towards = way / distance;
    if (!(lobe.density(towards) > 0.0))
        return std::nullopt;
    ++rays;
    if (target.unmet) {
        visibility::Hit hit = *target.unmet;
        if (hit.facing == visibility::Facing::front
            && glm::dot(glm::dvec3(hit.normal), towards) > 0.0)
            return std::nullopt;
        hit.t = float(distance);
        hit.tint = visibility_.filter({origin, glm::vec3(towards), 0.0f,
                                       float(std::max(0.0, distance - ray_offset(target.point)))});
        return Met{towards, hit};
    }
    const float end = float(distance + ray_offset(target.point));
    const visibility::Hit hit = visibility_.closest({origin, glm::vec3(towards), 0.0f, end});
    // Of two triangles at one place only one is ever hit, and only it may count.
    if (!target.is_met(hit) || hit.facing == visibility::Facing::back)
        return std::nullopt;
    return Met{towards, hit};
}

Paths::Glimpse Paths::aim(glm::vec3 origin, const Lobe& lobe, int reflections, PathSampler& sampler,
                          uint64_t& rays) const {
    if (emitters_.empty())
        return {};
    const auto met = meet(emitters_.target(sampler.pair()), origin, lobe, rays);
    if (!met)
        return {};
    const double path = scene::blocks(scene_.instances[met->hit.instance].role)
                            ? density_of(met->hit, origin, met->towards, lobe, reflections)
                            : 0.0;
    return {met->towards, glm::dvec3(met->hit.tint) * emission(met->hit)
                              * (lobe.density(met->towards)
                                 / (path + emitters_.density(met->hit, met->towards)))};
}

Paths::Glimpse Paths::aim_at_sky(glm::vec3 origin, const Lobe& lobe, int reflections,
                                 PathSampler& sampler, uint64_t& rays) const {
    if (!sky_)
        return {};
    Glimpse seen;
    seen.direction = scene::sample_sky(*sky_, sampler.pair());
    const double own = lobe.density(seen.direction);
    if (!(own > 0.0))
        return {};
    ++rays;
    const glm::vec3 towards(seen.direction);
    const glm::dvec3 passes(visibility_.filter({origin, towards, 0.0f, HUGE_VALF}));
    const double path = density_of({}, origin, seen.direction, lobe, reflections);
    seen.luminance = passes * own / (path + scene::sky_density(*sky_, towards))
                     * glm::dvec3(scene::sky_luminance(scene_.sky, towards));
    return seen;
}

Paths::Bounce Paths::bounce_of(const visibility::Hit& hit, glm::vec3 origin,
                               glm::dvec3 towards) const {
    const Instance& instance = scene_.instances[hit.instance];
    const Mesh& mesh = scene_.meshes[size_t(instance.mesh)];
    glm::dvec3 n{hit.normal};
    if (glm::dot(n, towards) > 0.0)
        n = -n;
    return {off_surface(glm::dvec3(origin) + double(hit.t) * towards, n), n,
            scene::reflects(instance.role) ? glm::dvec3(
                scene::sample_surface(scene_, mesh, hit.triangle, hit.barycentric).albedo)
                                           : glm::dvec3(0.0)};
}

double Paths::share_of_path(const visibility::Hit& hit, glm::vec3 origin, glm::dvec3 towards,
                            const Lobe& lobe) const {
    const double own = lobe.density(towards);
    return spots_ ? own / (own + spots_->density(hit, glm::dvec3(origin), towards)) : 1.0;
}

glm::dvec3 Paths::aim_at_spot(glm::vec3 origin, const Lobe& lobe, PathSampler& sampler,
                              uint64_t& rays) const {
    if (!spots_)
        return glm::dvec3(0.0);
    const auto met = meet(spots_->target(glm::dvec3(origin), sampler.pair()), origin, lobe, rays);
    if (!met)
        return glm::dvec3(0.0);
    const Bounce bounce = bounce_of(met->hit, origin, met->towards);
    // Of the two ways to get here: the density of one cancels.
    return share_of_path(met->hit, origin, met->towards, lobe) * glm::dvec3(met->hit.tint)
           * bounce.albedo / glm::pi<double>() * illuminance(bounce.point, bounce.n, rays);
}

std::array<Paths::Glimpse, 4> Paths::arriving(glm::vec3 origin, PathSampler& sampler,
                                              uint64_t& rays) const {
    const Glimpse path = trace(origin, {}, sampler, rays);
    const Glimpse emitter = aim(origin, {}, 0, sampler, rays);
    const Glimpse sky = aim_at_sky(origin, {}, 0, sampler, rays);
    return {path, emitter, sky, seen_light(origin, sampler, rays)};
}

glm::dvec3 Paths::irradiance(glm::vec3 origin, glm::dvec3 n, PathSampler& sampler,
                             uint64_t& rays) const {
    const Lobe lobe{n};
    glm::dvec3 sum = trace(origin, lobe, sampler, rays).luminance;
    sum += aim(origin, lobe, 0, sampler, rays).luminance;
    sum += aim_at_sky(origin, lobe, 0, sampler, rays).luminance;
    sum *= glm::pi<double>();
    return statics_.empty() ? sum : sum + illuminance(glm::dvec3(origin), n, rays, Lights::statics);
}

Paths::Glimpse Paths::trace(glm::vec3 origin, Lobe lobe, PathSampler& sampler,
                            uint64_t& rays) const {
    Glimpse seen;
    glm::dvec3& sum = seen.luminance;
    glm::dvec3 throughput{1.0};
    double chance = 1.0; // of it, what is due to how the rays were drawn
    for (int reflections = 0;; ++reflections) {
        const bool last = !goes_on(reflections);
        if (last && emitters_.empty() && !scene::has_sky(scene_))
            break;
        const glm::dvec2 sample = sampler.pair();
        std::optional<Emitters::Target> target;
        glm::dvec3 towards;
        if (!is_guided(reflections)) {
            towards = lobe.sample(sample);
        } else if (sample.x >= 0.5) {
            towards = lobe.sample({2.0 * sample.x - 1.0, sample.y});
        } else {
            target = lit_->target(glm::dvec3(origin), {2.0 * sample.x, sample.y});
            towards = target->point - glm::dvec3(origin);
            towards /= std::max(glm::length(towards), 1e-300);
        }
        if (reflections == 0)
            seen.direction = towards;
        const double own = lobe.density(towards);
        if (!(own > 0.0))
            break;
        ++rays;
        const visibility::Hit hit =
            visibility_.closest({origin, glm::vec3(towards), 0.0f, HUGE_VALF});
        if (target && !target->is_met(hit))
            break;
        const double density = density_of(hit, origin, towards, lobe, reflections);
        throughput *= glm::dvec3(hit.tint) * (own / density);
        chance *= own / density;
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
        const double share = reflections > 0 ? share_of_path(hit, origin, towards, lobe) : 1.0;
        const Bounce bounce = bounce_of(hit, origin, towards);
        throughput *= bounce.albedo;
        if (throughput == glm::dvec3(0.0))
            break;
        origin = glm::vec3(bounce.point);
        lobe = {bounce.n};
        sum += share * throughput / glm::pi<double>() * illuminance(bounce.point, bounce.n, rays);
        if (goes_on(reflections + 1))
            sum += throughput * aim_at_spot(origin, lobe, sampler, rays);
        sum += throughput * aim(origin, lobe, reflections + 1, sampler, rays).luminance;
        sum += throughput * aim_at_sky(origin, lobe, reflections + 1, sampler, rays).luminance;

        const double reflectance = max_component(throughput) / chance;
        if (!rules_.bounces && reflectance < rules_.faint) {
            const double survival = reflectance / rules_.faint;
            if (sampler.plain() >= survival)
                break;
            throughput /= survival;
        }
        if (reflections > longest_path)
            throw Error(ErrorKind::invalid, scene::endless_reflection(scene_, hit.instance));
    }
    return seen;
}

} // namespace lpvbake::reference
