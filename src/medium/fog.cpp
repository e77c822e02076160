#include "medium/fog.h"

#include "volume/sampler.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace lpvbake::medium {
namespace {

/// Gauss and Legendre's four places in [-1, 1] and their weights.
constexpr std::array<glm::dvec2, 4> gauss{glm::dvec2{-0.8611363115940526, 0.3478548451374538},
                                          {-0.3399810435848563, 0.6521451548625461},
                                          {0.3399810435848563, 0.6521451548625461},
                                          {0.8611363115940526, 0.3478548451374538}};
constexpr double widest_angle = 0.2; ///< at a lamp, of a piece that the rule is used on
constexpr double finest = 0.25;      ///< of Medium::grain(), a step
constexpr int most_steps = 4096;     ///< of a lit part: a layer may be thinner than any of them
constexpr double nothing = 1e-10;    ///< of light, that a step takes and nobody sees
constexpr double nearest = 1e-3;     ///< frame units that a ray passes a lamp by, at least

/// The sum of a volume's coefficients times those of `basis`, of valid cells by their trilinear
/// weights.
volume::LevelReading<glm::dvec3> read(const Volume& volume, glm::dvec3 point,
                                      const volume::ShValues& basis) {
    const volume::CellWeights cells =
        volume::weights_at(volume, point, {0, 1, 0}, Reading::trilinear);
    glm::dvec3 sum(0.0);
    double weight = 0;
    for (std::size_t corner = 0; corner < 8; ++corner) {
        const std::size_t cell = cells.cell[corner];
        if (cells.weight[corner] == 0 || !volume.is_valid(cell))
            continue;
        weight += cells.weight[corner];
        for (std::size_t k = 0; k < volume.sh.size(); ++k)
            sum += cells.weight[corner] * double(basis[k]) * glm::dvec3(volume.sh[k][cell]);
    }
    return {weight > 0 ? sum / weight : glm::dvec3(0), weight > 0};
}

/// Where on a ray, seen from its origin, it crosses a cone around `axis` from `from`, between the
/// ends of `part`.
void add_crossings(glm::dvec3 from, glm::dvec3 axis, double cosine, glm::dvec3 direction,
                   glm::dvec2 part, std::vector<double>& crossings) {
    // That far (t direction - from) . axis is the cosine times the length; both squared.
    const double square = cosine * cosine;
    const double a = glm::dot(direction, axis), b = -glm::dot(from, axis);
    const double two = a * a - square, one = a * b + square * glm::dot(from, direction),
                 none = b * b - square * glm::dot(from, from);
    const double root = std::sqrt(one * one - two * none);
    for (const double t : {(-one - root) / two, (-one + root) / two})
        if (t > part.x && t < part.y)
            crossings.push_back(t);
}

} // namespace

Fog::Fog(const Scene& scene, const visibility::Visibility& visibility, const scene::Frame& frame,
         const volume::Levels* levels, const Medium& medium, const FogSettings& settings)
    : visibility_(visibility),
      frame_(frame),
      levels_(levels),
      air_(medium, frame),
      settings_(settings) {
    for (const Light& light : scene.lights) {
        if (light.is_static && levels) // the field has its light
            continue;
        if (light.type == LightType::directional && !settings.suns)
            continue;
        Source source{light, light.intensity * glm::dvec3(light.color), {}, {}, {}, {}};
        source.direction = glm::normalize(light.direction);
        if (light.type != LightType::directional)
            source.at = frame.from_world(light.position);
        if (light.type == LightType::spot)
            source.cone = scene::Cone(light);
        if (settings.steps == 0)
            source.depths.emplace_back(light, visibility, frame, air_.lo(), air_.hi(),
                                       settings.map_size);
        sources_.push_back(std::move(source));
    }
}

glm::dvec3 Fog::transmittance(glm::dvec3 origin, glm::dvec3 direction, double distance) const {
    const auto part = air_.part_in(origin, direction, distance);
    return part ? glm::exp(-air_.extinction()
                           * air_.column(part->at(part->begin), part->at(part->end)))
                : glm::dvec3(1.0);
}

double Fog::way_in(const Source& source, glm::dvec3 place) const {
    return source.light.type == LightType::directional ? air_.column_before(place, source.direction)
                                                       : air_.column_from(source.at, place);
}

glm::dvec3 Fog::illuminance(const Source& source, glm::dvec3 place) const {
    if (source.light.type == LightType::directional)
        return source.power;
    const glm::dvec3 way = (place - source.at) * frame_.unit;
    const double distance = std::max(glm::length(way), nearest * frame_.unit);
    double share = scene::range_window(source.light, distance) / (distance * distance);
    if (source.light.type == LightType::spot)
        share *= source.cone(way / distance);
    return share * source.power;
}

double Fog::deflection(const Source& source, glm::dvec3 place, glm::dvec3 direction) const {
    if (source.light.type == LightType::directional)
        return -glm::dot(source.direction, direction);
    const glm::dvec3 way = place - source.at;
    return -glm::dot(way, direction) / std::max(glm::length(way), nearest);
}

glm::dvec3 Fog::marched(const Source& source, const Part& part) const {
    const double step = (part.end - part.begin) / settings_.steps;
    glm::dvec3 sum(0.0);
    double before = 0, reached = part.begin;
    for (int i = 0; i < settings_.steps; ++i) {
        const double t = part.begin + (i + 0.5) * step;
        const glm::dvec3 place = part.at(t);
        before += air_.column(part.at(reached), place);
        reached = t;
        const bool parallel = source.light.type == LightType::directional;
        const glm::dvec3 arrives = illuminance(source, place);
        if (arrives == glm::dvec3(0))
            continue;
        const glm::dvec3 way = parallel ? -source.direction : source.at - place;
        const float open = visibility_.transmittance(
            {glm::vec3(place), glm::vec3(way), 0.0f, parallel ? HUGE_VALF : 1.0f});
        sum += double(open) * air_.density(place)
               * phase(air_.medium().g, deflection(source, place, part.direction)) * arrives
               * glm::exp(-air_.extinction() * (before + way_in(source, place)));
    }
    return air_.scatter() * step * sum;
}

glm::dvec3 Fog::of_parallel(const Source& source, const Part& part, glm::dvec2 lit) const {
    // The way of light in the box to a point of the ray, before each face by which it may enter, is
    // linear along the ray; the shortest counts.
    std::array<glm::dvec2, 3> ways; // at the ray's origin, and a unit on
    for (int axis = 0; axis < 3; ++axis) {
        const double d = source.direction[axis];
        ways[std::size_t(axis)] =
            d == 0 ? glm::dvec2(HUGE_VAL, 0)
                   : glm::dvec2((part.origin[axis] - (d > 0 ? air_.lo() : air_.hi())[axis]) / d,
                                part.direction[axis] / d);
    }
    std::array<double, 5> cuts{lit.x, lit.y, lit.y, lit.y, lit.y};
    for (std::size_t i = 0; i < 3; ++i) {
        const glm::dvec2 a = ways[i], b = ways[(i + 1) % 3];
        const double t = (b.x - a.x) / (a.y - b.y);
        cuts[i + 2] = t > lit.x && t < lit.y ? t : lit.y;
    }
    std::ranges::sort(cuts);
    glm::dvec3 sum(0.0);
    for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
        const double from = cuts[i], to = cuts[i + 1], middle = 0.5 * (from + to);
        if (!(from < to))
            continue;
        const glm::dvec2 way = *std::ranges::min_element(
            ways, {}, [&](glm::dvec2 each) { return each.x + each.y * middle; });
        for (int c = 0; c < 3; ++c)
            sum[c] += std::exp(-air_.extinction()[c] * (from - part.begin + way.x + way.y * from))
                      * decay(air_.extinction()[c] * (1 + way.y), 0, to - from);
    }
    return air_.scatter() * phase(air_.medium().g, deflection(source, {}, part.direction))
           * source.power * sum;
}

std::vector<double> Fog::steps_in(const Source* source, const Part& part, glm::dvec2 lit) const {
    const double grain = std::min(1.0, finest * air_.medium().grain() / frame_.unit);
    const int count = int(std::ceil(std::clamp((lit.y - lit.x) / grain, 1.0, double(most_steps))));
    std::vector<double> ends{lit.x};
    for (int i = 0; i < count; ++i) {
        const double from = ends.back(), to = lit.x + (lit.y - lit.x) * (i + 1) / count;
        int parts = 1;
        double middle = 0, beside = 1, first = 0, last = 0;
        if (source && source->light.type != LightType::directional) {
            middle = glm::dot(source->at - part.origin, part.direction);
            beside = std::max(glm::length(source->at - part.at(middle)), nearest);
            first = std::atan((from - middle) / beside);
            last = std::atan((to - middle) / beside);
            parts = std::max(1, int(std::ceil((last - first) / (0.5 * widest_angle))));
        }
        for (int k = 1; k < parts; ++k)
            ends.push_back(std::clamp(
                middle + beside * std::tan(first + (last - first) * k / parts), from, to));
        ends.push_back(to);
    }
    return ends;
}

glm::dvec3 Fog::in_steps(const Source& source, const Part& part, glm::dvec2 lit) const {
    const bool parallel = source.light.type == LightType::directional;
    const double middle = parallel ? 0 : glm::dot(source.at - part.origin, part.direction);
    const double beside =
        parallel ? 1 : std::max(glm::length(source.at - part.at(middle)), nearest);
    const std::vector<double> ends = steps_in(&source, part, lit);
    const glm::dvec3 extinction = air_.extinction();
    const double thickest = std::max({extinction.x, extinction.y, extinction.z});
    double before = air_.column(part.at(part.begin), part.at(lit.x));
    glm::dvec3 sum(0.0);
    for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
        const double from = ends[i], to = ends[i + 1], t = 0.5 * (from + to);
        const double own = air_.column(part.at(from), part.at(to));
        if (own * thickest > nothing) {
            const glm::dvec3 place = part.at(t);
            double more = 1; // the mean of 1 / r^2 over that in the middle
            if (!parallel && to > from)
                more = (std::atan((to - middle) / beside) - std::atan((from - middle) / beside))
                       / (beside * (to - from)) * (beside * beside + (t - middle) * (t - middle));
            sum += more * phase(air_.medium().g, deflection(source, place, part.direction))
                   * illuminance(source, place)
                   * glm::exp(-air_.extinction() * way_in(source, place))
                   * air_.step_weight(before, own);
        }
        before += own;
    }
    return air_.scatter() * sum;
}

glm::dvec3 Fog::of_lamp(const Source& source, const Part& part, glm::dvec2 lit) const {
    if (source.light.type != LightType::spot)
        return of_smooth_lamp(source, part, lit);
    std::vector<double> cuts{lit.x, lit.y}; // its ramp begins and ends
    for (const double cosine : {source.cone.cos_inner, source.cone.cos_outer})
        add_crossings(source.at - part.origin, source.cone.axis, cosine, part.direction, lit, cuts);
    std::ranges::sort(cuts);
    glm::dvec3 sum(0.0);
    for (std::size_t i = 0; i + 1 < cuts.size(); ++i)
        sum += of_smooth_lamp(source, part, {cuts[i], cuts[i + 1]});
    return sum;
}

glm::dvec3 Fog::of_smooth_lamp(const Source& source, const Part& part, glm::dvec2 lit) const {
    // t = middle + beside tan(angle), after Kulla and Fajardo 2012: dt / r^2 = d angle / beside.
    const double middle = glm::dot(source.at - part.origin, part.direction);
    const double beside = std::max(glm::length(source.at - part.at(middle)), nearest);
    const double first = std::atan((lit.x - middle) / beside);
    const double last = std::atan((lit.y - middle) / beside);
    const double thick =
        std::max({air_.extinction().x, air_.extinction().y, air_.extinction().z}) * (lit.y - lit.x);
    const int pieces =
        std::clamp(int(std::ceil(std::max((last - first) / widest_angle, 0.5 * thick))), 1, 1000);
    const double half = 0.5 * (last - first) / pieces;
    glm::dvec3 sum(0.0);
    for (int i = 0; i < pieces; ++i)
        for (const glm::dvec2 point : gauss) {
            const double angle = first + half * (2 * i + 1 + point.x);
            const double t = middle + beside * std::tan(angle);
            const glm::dvec3 place = part.at(t);
            const double square = beside * beside + (t - middle) * (t - middle);
            sum += point.y * phase(air_.medium().g, deflection(source, place, part.direction))
                   * square * illuminance(source, place)
                   * glm::exp(-air_.extinction() * (t - part.begin + way_in(source, place)));
        }
    return air_.scatter() * half / beside * sum;
}

glm::dvec3 Fog::direct(glm::dvec3 origin, glm::dvec3 direction, double distance) const {
    const auto part = air_.part_in(origin, direction, distance);
    glm::dvec3 sum(0.0);
    if (!part || air_.scatter() == glm::dvec3(0))
        return sum;
    std::vector<glm::dvec2> lit;
    for (const Source& source : sources_) {
        if (settings_.steps > 0) {
            sum += marched(source, *part);
            continue;
        }
        source.depths.front().lit_parts(origin, direction, part->begin, part->end, lit);
        for (const glm::dvec2 each : lit)
            sum += !air_.medium().is_even()                      ? in_steps(source, *part, each)
                   : source.light.type == LightType::directional ? of_parallel(source, *part, each)
                                                                 : of_lamp(source, *part, each);
    }
    return sum;
}

glm::dvec3 Fog::of_field(glm::dvec3 origin, glm::dvec3 direction, double distance) const {
    const auto part = air_.part_in(origin, direction, distance);
    glm::dvec3 sum(0.0);
    if (!part || !levels_ || air_.scatter() == glm::dvec3(0))
        return sum;
    // Light that goes on as it came is seen where it comes from.
    volume::ShValues basis = volume::sh_basis(volume::sh_max_order, glm::vec3(direction));
    for (int l = 0, k = 0; l <= volume::sh_max_order; ++l)
        for (int m = 0; m <= 2 * l; ++m, ++k)
            basis[std::size_t(k)] *= float(std::pow(air_.medium().g, l));
    std::vector<double> ends;
    if (settings_.steps > 0)
        for (int i = 0; i <= settings_.steps; ++i)
            ends.push_back(part->begin + (part->end - part->begin) * i / settings_.steps);
    else if (air_.medium().is_even())
        for (int i = 0, n = std::max(1, int(std::ceil(part->end - part->begin))); i <= n; ++i)
            ends.push_back(part->begin + (part->end - part->begin) * i / n);
    else
        ends = steps_in(nullptr, *part, {part->begin, part->end});
    double before = 0;
    for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
        const double own = air_.column(part->at(ends[i]), part->at(ends[i + 1]));
        if (own > 0) {
            const glm::dvec3 world = frame_.to_world(part->at(0.5 * (ends[i] + ends[i + 1])));
            const glm::dvec3 seen = volume::blend(*levels_, world, [&](std::size_t level) {
                return read(levels_->volumes[level], world, basis);
            });
            sum += glm::max(seen, 0.0) * air_.step_weight(before, own);
        }
        before += own;
    }
    return air_.scatter() * sum;
}

} // namespace lpvbake::medium
