// Luminance that arrives at a point from triangles of constant luminance, by brute force: each is
// cut until its pieces are small against their distance, and a ray goes to each piece. In double;
// spherical harmonics from the recurrences of the associated Legendre functions.
#pragma once

#include <glm/glm.hpp>

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

namespace lpvbake::oracle {

/// sh[l * l + l + m] for all m of the bands up to `order`, real and orthonormal, without the
/// Condon-Shortley sign, z the polar axis.
inline std::vector<double> harmonics(int order, glm::dvec3 w) {
    std::vector<double> y(size_t((order + 1) * (order + 1)));
    const double phi = std::atan2(w.y, w.x), sine = std::sqrt(std::max(0.0, 1.0 - w.z * w.z));
    for (int m = 0; m <= order; ++m) {
        double before = 0.0, p = 1.0; // P_m^m = (2m - 1)!! sin^m
        for (int i = 1; i <= m; ++i)
            p *= (2.0 * i - 1.0) * sine;
        for (int l = m; l <= order; ++l) {
            double ratio = 1.0; // (l - m)! / (l + m)!
            for (int i = l - m + 1; i <= l + m; ++i)
                ratio /= i;
            const double k = std::sqrt((2.0 * l + 1.0) / (4.0 * std::numbers::pi) * ratio);
            if (m == 0) {
                y[size_t(l * l + l)] = k * p;
            } else {
                y[size_t(l * l + l + m)] = std::numbers::sqrt2 * k * std::cos(m * phi) * p;
                y[size_t(l * l + l - m)] = std::numbers::sqrt2 * k * std::sin(m * phi) * p;
            }
            const double next = ((2.0 * l + 1.0) * w.z * p - (l + m) * before) / (l - m + 1.0);
            before = p;
            p = next;
        }
    }
    return y;
}

struct Triangle {
    glm::dvec3 a, b, c;
    glm::dvec3 normal; ///< to where it shines
    glm::dvec3 luminance;
};

/// True if nothing is between the two points.
using Sees = std::function<bool(glm::dvec3 from, glm::dvec3 to)>;

/// Adds what arrives at x to `sh`, (order + 1)^2 coefficients.
inline void arrive(const oracle::Triangle& t, glm::dvec3 x, int order, const oracle::Sees& sees,
                   std::vector<glm::dvec3>& sh) {
    if (glm::dot(x - t.a, t.normal) <= 0.0)
        return;
    const glm::dvec3 center = (t.a + t.b + t.c) / 3.0, way = center - x;
    const double distance = glm::length(way);
    const double across =
        std::max({glm::distance(t.a, t.b), glm::distance(t.b, t.c), glm::distance(t.c, t.a)});
    if (across > 0.25 * distance) {
        const glm::dvec3 ab = 0.5 * (t.a + t.b), bc = 0.5 * (t.b + t.c), ca = 0.5 * (t.c + t.a);
        oracle::arrive({t.a, ab, ca, t.normal, t.luminance}, x, order, sees, sh);
        oracle::arrive({ab, t.b, bc, t.normal, t.luminance}, x, order, sees, sh);
        oracle::arrive({ca, bc, t.c, t.normal, t.luminance}, x, order, sees, sh);
        oracle::arrive({ab, bc, ca, t.normal, t.luminance}, x, order, sees, sh);
        return;
    }
    const double area = 0.5 * glm::length(glm::cross(t.b - t.a, t.c - t.a));
    if (!sees(x, center + 1e-3 * t.normal))
        return;
    const glm::dvec3 w = way / distance;
    const double angle = area * -glm::dot(w, t.normal) / (distance * distance);
    const std::vector<double> y = oracle::harmonics(order, w);
    for (size_t k = 0; k < y.size(); ++k)
        sh[k] += t.luminance * (angle * y[k]);
}

} // namespace lpvbake::oracle
