#include "render/tracking.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::render {
namespace {

double largest(glm::dvec3 v) {
    return std::max({v.r, v.g, v.b});
}

} // namespace

TrackedAir::TrackedAir(const reference::Paths& paths, const scene::Frame& frame,
                       const medium::Medium& medium)
    : paths_(paths),
      frame_(frame),
      medium_(medium),
      lo_(frame.from_world(medium.box.lo)),
      hi_(frame.from_world(medium.box.hi)),
      scatters_(medium.scatter * frame.unit),
      extinction_((medium.scatter + medium.absorb) * frame.unit),
      most_(largest(extinction_) * medium.peak()) {}

TrackedAir::Part TrackedAir::part_in(glm::dvec3 origin, glm::dvec3 direction,
                                     double distance) const {
    Part part{0, distance};
    for (int axis = 0; axis < 3; ++axis) {
        const double a = (lo_[axis] - origin[axis]) / direction[axis];
        const double b = (hi_[axis] - origin[axis]) / direction[axis];
        if (direction[axis] == 0 && (origin[axis] < lo_[axis] || origin[axis] > hi_[axis]))
            return {0, 0};
        if (direction[axis] == 0)
            continue;
        part.begin = std::max(part.begin, std::min(a, b));
        part.end = std::min(part.end, std::max(a, b));
    }
    return part;
}

double TrackedAir::density(glm::dvec3 place) const {
    return medium_.density_at(glm::clamp(frame_.to_world(place), medium_.box.lo, medium_.box.hi));
}

double TrackedAir::phase(double cosine) const {
    const double g = medium_.g;
    return (1 - g * g) / (4 * glm::pi<double>() * std::pow(1 + g * g - 2 * g * cosine, 1.5));
}

glm::dvec3 TrackedAir::transmittance(glm::dvec3 origin, glm::dvec3 direction, double distance,
                                     reference::PathSampler& sampler) const {
    const Part part = part_in(origin, direction, distance);
    glm::dvec3 left(1.0);
    for (double t = part.begin; t < part.end;) {
        t -= std::log1p(-sampler.plain()) / most_;
        if (t < part.end)
            left *= 1.0 - extinction_ * (density(origin + t * direction) / most_);
    }
    return left;
}

glm::dvec3 TrackedAir::scattered_at(glm::dvec3 place, glm::dvec3 direction, Kinds kinds,
                                    reference::PathSampler& sampler, uint64_t& rays) const {
    glm::dvec3 sum(0.0);
    for (std::size_t i = 0; kinds.direct && i < paths_.lights(); ++i) {
        const auto light = paths_.from_light(i, place, rays);
        if (light.is_static || light.lux == glm::dvec3(0.0))
            continue;
        const double length = glm::length(light.way);
        const glm::dvec3 towards = light.way / length;
        sum += phase(glm::dot(towards, direction)) * light.lux
               * transmittance(place, towards, length, sampler);
    }
    if (kinds.field)
        for (const auto& seen : paths_.arriving(glm::vec3(place), sampler, rays))
            sum +=
                4 * glm::pi<double>() * phase(glm::dot(seen.direction, direction)) * seen.luminance;
    return sum;
}

TrackedAir::Seen TrackedAir::track(glm::dvec3 origin, glm::dvec3 direction, double distance,
                                   Kinds kinds, reference::PathSampler& sampler,
                                   uint64_t& rays) const {
    const Part part = part_in(origin, direction, distance);
    glm::dvec3 weight(1.0);
    for (double t = part.begin; t < part.end;) {
        t -= std::log1p(-sampler.plain()) / most_;
        if (t >= part.end)
            break;
        const glm::dvec3 place = origin + t * direction;
        const double here = density(place);
        const glm::dvec3 goes_on = weight * (1.0 - extinction_ * (here / most_));
        const glm::dvec3 turns = weight * scatters_ * (here / most_);
        const double all = largest(goes_on) + largest(turns);
        if (!(all > 0))
            return {};
        const double chance = largest(turns) / all;
        if (sampler.plain() < chance)
            return {turns / chance * scattered_at(place, direction, kinds, sampler, rays), {}};
        weight = goes_on / (1 - chance);
    }
    return {{}, weight};
}

} // namespace lpvbake::render
