// What the path tracers share: directions, offsets, the spot's ramp. The solvers have their own of
// each, so that they are not compared with themselves.
#pragma once

#include <glm/glm.hpp>
#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::reference {

template <class Number>
Number max_component(glm::vec<3, Number> v) {
    return std::max({v.x, v.y, v.z});
}

/// How far a ray's origin is moved off the surface that it leaves: 32 steps of single precision of
/// the largest coordinate, above the error of a hit's place. In a corner a larger one steps through
/// the next wall, and light is lost at every reflection.
template <class Number>
Number ray_offset(glm::vec<3, Number> point) {
    return Number(0x1p-18) * std::max(Number(1), max_component(glm::abs(point)));
}

/// A direction of uniform density over the sphere, 1 / (4 pi), of a sample in [0, 1)^2.
inline glm::dvec3 on_sphere(glm::dvec2 sample) {
    const double z = 1.0 - 2.0 * sample.x, turn = glm::two_pi<double>() * sample.y;
    const double radius = std::sqrt(std::max(0.0, 1.0 - z * z));
    return {radius * std::cos(turn), radius * std::sin(turn), z};
}

/// A direction of density cos / pi around the unit normal n, of a sample in [0, 1)^2 (Malley's
/// method).
template <class Number>
glm::vec<3, Number> sample_cosine(glm::vec<3, Number> n, glm::vec<2, Number> sample) {
    const Number one = 1, radius = std::sqrt(sample.x), phi = glm::two_pi<Number>() * sample.y;
    // A frame around n without a branch on its direction (Duff et al. 2017).
    const Number sign = std::copysign(one, n.z), a = -one / (sign + n.z), b = n.x * n.y * a;
    const glm::vec<3, Number> u{one + sign * n.x * n.x * a, sign * b, -sign * n.x};
    const glm::vec<3, Number> v{b, sign + n.y * n.y * a, -n.y};
    return radius * (std::cos(phi) * u + std::sin(phi) * v) + std::sqrt(one - sample.x) * n;
}

/// A spot's share of its intensity: the square of a ramp in the cosine; a step where both angles
/// are the same.
template <class Number>
Number spot_ramp(Number cosine, Number cos_inner, Number cos_outer) {
    if (cosine <= cos_outer)
        return 0;
    const Number ramp =
        cosine >= cos_inner ? Number(1) : (cosine - cos_outer) / (cos_inner - cos_outer);
    return ramp * ramp;
}

} // namespace lpvbake::reference
