#include "medium/medium.h"

#include "lpvbake/error.h"
#include "text.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::medium {
namespace {

/// At a height.
double share_of(const std::optional<Falloff>& falloff, double y) {
    return falloff ? std::exp((falloff->from - y) / falloff->scale) : 1;
}

/// Calls visit(voxel, begin, end) for the voxels that a ray is in from t0 to t1, in their order.
template <class Visit>
void walk(const volume::Density& density, glm::dvec3 origin, glm::dvec3 way, double t0, double t1,
          const Visit& visit) {
    glm::ivec3 voxel;
    glm::dvec3 next, across;
    for (int axis = 0; axis < 3; ++axis) {
        const double d = way[axis];
        voxel[axis] = std::clamp(int(std::floor(origin[axis] + t0 * d)), 0, density.dims[axis] - 1);
        across[axis] = d != 0 ? std::abs(1 / d) : HUGE_VAL;
        next[axis] = d != 0 ? (voxel[axis] + (d > 0 ? 1 : 0) - origin[axis]) / d : HUGE_VAL;
    }
    for (double t = t0; t < t1;) {
        const int axis = next.x <= next.y && next.x <= next.z ? 0 : next.y <= next.z ? 1 : 2;
        const double end = std::clamp(next[axis], t, t1);
        if (end > t)
            visit(voxel, t, end);
        t = end;
        voxel[axis] += way[axis] < 0 ? -1 : 1;
        next[axis] += across[axis];
        if (voxel[axis] < 0 || voxel[axis] >= density.dims[axis])
            return;
    }
}

} // namespace

double Medium::density_at(glm::dvec3 place) const {
    if (glm::any(glm::lessThan(place, box.lo)) || glm::any(glm::greaterThan(place, box.hi)))
        return 0;
    const double given =
        density ? density->at(glm::dvec3(density->to_voxels * glm::dvec4(place, 1))) : 1;
    return given > 0 ? given * share_of(height, place.y) : 0;
}

double Medium::peak() const {
    return (density ? double(density->most) : 1)
           * std::max(share_of(height, box.lo.y), share_of(height, box.hi.y));
}

double Medium::column(glm::dvec3 from, glm::dvec3 to) const {
    const glm::dvec3 way = to - from;
    const auto in = within(from, way, box.lo, box.hi, 0, 1);
    if (!in)
        return 0;
    const double length = glm::length(way);
    const auto part = [&](double t0, double t1) {
        if (!height)
            return length * (t1 - t0);
        // From the denser end on: from the other one, far above, it would be 0 times infinity.
        const double thinning = way.y / height->scale;
        return length * share_of(height, from.y + (thinning < 0 ? t1 : t0) * way.y)
               * decay(std::abs(thinning), 0, t1 - t0);
    };
    if (!density)
        return part(in->x, in->y);
    const glm::dvec3 origin(density->to_voxels * glm::dvec4(from, 1));
    const glm::dvec3 across(density->to_voxels * glm::dvec4(way, 0));
    const auto there =
        within(origin, across, glm::dvec3(0), glm::dvec3(density->dims), in->x, in->y);
    double sum = 0;
    if (there)
        walk(*density, origin, across, there->x, there->y,
             [&](glm::ivec3 voxel, double t0, double t1) {
                 if (const float value = density->value(voxel); value > 0)
                     sum += double(value) * part(t0, t1);
             });
    return sum;
}

double Medium::mean_density(glm::dvec3 lo, glm::dvec3 hi) const {
    const glm::dvec3 all = hi - lo;
    lo = glm::max(lo, box.lo);
    hi = glm::min(hi, box.hi);
    if (!glm::all(glm::lessThan(lo, hi)))
        return 0;
    const int lines = density ? 4 : 1;
    double sum = 0;
    for (int i = 0; i < lines * lines; ++i) {
        const glm::dvec2 at = (glm::dvec2(i % lines, i / lines) + 0.5) / double(lines);
        const double x = glm::mix(lo.x, hi.x, at.x), z = glm::mix(lo.z, hi.z, at.y);
        sum += column({x, lo.y, z}, {x, hi.y, z}) / (lines * lines);
    }
    return sum * (hi.x - lo.x) * (hi.z - lo.z) / (all.x * all.y * all.z);
}

double Medium::grain() const {
    double grain = height ? 0.25 * std::abs(height->scale) : HUGE_VAL;
    if (density) {
        const glm::dmat3 to_metres = glm::inverse(glm::dmat3(density->to_voxels));
        for (int axis = 0; axis < 3; ++axis)
            grain = std::min(grain, glm::length(to_metres[axis]));
    }
    return std::isfinite(grain) ? grain : 0;
}

void check_medium(const Medium& medium, const std::string& place) {
    const glm::dvec3 most = medium.peak() * medium.extinction();
    if (!(std::max({most.r, most.g, most.b}) <= most_extinction))
        throw Error(ErrorKind::invalid,
                    place
                        + format(": takes up to %.3g of light a metre, more than %.0g; give a "
                                 "smaller scatter and absorb, a `height` near the box, or less "
                                 "density",
                                 std::max({most.r, most.g, most.b}), most_extinction));
    if (!glm::all(glm::lessThan(medium.box.lo, medium.box.hi)))
        throw Error(ErrorKind::invalid,
                    place + ": its box is empty; give it one by `medium_bounds`");
}

std::string text_of(const Medium& medium) {
    const auto rgb = [](glm::dvec3 v) { return format("%.9g/%.9g/%.9g", v.r, v.g, v.b); };
    std::string text = "scatter=" + rgb(medium.scatter) + ",absorb=" + rgb(medium.absorb)
                       + format(",g=%.9g", medium.g);
    if (medium.height)
        text += format(",height=%.9g:%.9g", medium.height->from, medium.height->scale);
    return text;
}

double phase(double g, double cosine) {
    const double root = 1 + g * g - 2 * g * cosine;
    return (1 - g * g) / (4 * glm::pi<double>() * root * std::sqrt(root));
}

std::optional<glm::dvec2> within(glm::dvec3 origin, glm::dvec3 direction, glm::dvec3 lo,
                                 glm::dvec3 hi, double begin, double end) {
    for (int axis = 0; axis < 3; ++axis) {
        if (direction[axis] == 0) {
            if (!(origin[axis] >= lo[axis] && origin[axis] < hi[axis]))
                return std::nullopt;
            continue;
        }
        const double a = (lo[axis] - origin[axis]) / direction[axis];
        const double b = (hi[axis] - origin[axis]) / direction[axis];
        begin = std::max(begin, std::min(a, b));
        end = std::min(end, std::max(a, b));
    }
    if (!(begin < end))
        return std::nullopt;
    return glm::dvec2(begin, end);
}

double decay(double a, double t0, double t1) {
    const double x = a * (t1 - t0);
    return std::exp(-a * t0) * (t1 - t0) * (x == 0 ? 1 : -std::expm1(-x) / x);
}

} // namespace lpvbake::medium
