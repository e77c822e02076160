// Classic LPV propagation in double precision, written for legibility: cells push light through the
// faces of their neighbours, one face at a time. It shares no code or data layout with the solver.
#pragma once

#include <glm/glm.hpp>

#include <cmath>
#include <functional>
#include <vector>

namespace lpvbake::oracle {

/// One colour channel: intensity in travel direction, constant part and vector part, so that
/// I(w) = constant + dot(vector, w).
struct Lobe {
    double constant = 0.0;
    glm::dvec3 vector{0.0};
};

using Field = std::vector<oracle::Lobe>;

/// Solid angle of the unit square facing the origin at distance 1.5, half shifted sideways by
/// (a, b), by midpoint quadrature: what a face subtends from the centre of the source cell.
inline double solid_angle(glm::dvec3 center, glm::dvec3 u, glm::dvec3 v, int n = 400) {
    const glm::dvec3 normal = glm::cross(u, v);
    double sum = 0.0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const glm::dvec3 p = center + ((i + 0.5) / n - 0.5) * u + ((j + 0.5) / n - 0.5) * v;
            const double r2 = glm::dot(p, p);
            sum += std::abs(glm::dot(normal, p)) / (r2 * std::sqrt(r2)) / (n * n);
        }
    return sum;
}

/// Transmittance of the way from a source cell through the face with outward normal `face` of its
/// neighbour in direction `toward`.
using Transmittance = std::function<double(glm::ivec3 source, glm::ivec3 toward, glm::ivec3 face)>;

/// Returns the light after `steps` steps (injected and all fronts), and the last front's power
/// (lm).
struct Propagated {
    oracle::Field sum;
    oracle::Field front;
};

inline oracle::Propagated propagate(glm::ivec3 dims, const oracle::Field& injected, int steps,
                                    const oracle::Transmittance& transmittance,
                                    bool first_free = false) {
    static const double far_angle = oracle::solid_angle({1.5, 0, 0}, {0, 1, 0}, {0, 0, 1});
    static const double side_angle = oracle::solid_angle({1, 0.5, 0}, {1, 0, 0}, {0, 0, 1});
    const auto at = [&](glm::ivec3 c) {
        return size_t(c.x) + size_t(dims.x) * (size_t(c.y) + size_t(dims.y) * size_t(c.z));
    };
    std::vector<glm::ivec3> axes;
    for (int axis = 0; axis < 3; ++axis)
        for (const int sign : {1, -1}) {
            glm::ivec3 d{0};
            d[axis] = sign;
            axes.push_back(d);
        }
    oracle::Propagated result{injected, injected};
    for (int step = 0; step < steps; ++step) {
        oracle::Field next(injected.size());
        for (int z = 0; z < dims.z; ++z)
            for (int y = 0; y < dims.y; ++y)
                for (int x = 0; x < dims.x; ++x) {
                    const glm::ivec3 source{x, y, z};
                    const oracle::Lobe& lobe = result.front[at(source)];
                    const auto flux = [&](glm::ivec3 d, glm::ivec3 n) {
                        const glm::dvec3 w =
                            d == n ? glm::dvec3(d)
                                   : glm::normalize(glm::dvec3(n) + 2.0 * glm::dvec3(d));
                        return std::max(0.0, lobe.constant + glm::dot(lobe.vector, w))
                               * (d == n ? far_angle : side_angle);
                    };
                    double leaving = 0.0;
                    for (const glm::ivec3 d : axes)
                        for (const glm::ivec3 n : axes)
                            if (n != -d)
                                leaving += flux(d, n);
                    if (leaving <= 0.0)
                        continue;
                    // What the cell emits over the sphere: 4 pi times the mean intensity.
                    const double budget = 4.0 * M_PI * lobe.constant / leaving;
                    for (const glm::ivec3 d : axes) {
                        const glm::ivec3 target = source + d;
                        if (glm::any(glm::lessThan(target, glm::ivec3(0)))
                            || glm::any(glm::greaterThanEqual(target, dims)))
                            continue;
                        for (const glm::ivec3 n : axes) {
                            if (n == -d)
                                continue;
                            const bool open = first_free && step == 0;
                            const double power =
                                budget * flux(d, n) * (open ? 1.0 : transmittance(source, d, n));
                            // A Lambert emitter of this power projected on the constant and
                            // linear parts: (P / pi) max(0, n.w) ~ (P / pi) (1/4 + n.w / 2).
                            next[at(target)].constant += power / (4.0 * M_PI);
                            next[at(target)].vector += power / (2.0 * M_PI) * glm::dvec3(n);
                        }
                    }
                }
        for (size_t i = 0; i < next.size(); ++i) {
            result.sum[i].constant += next[i].constant;
            result.sum[i].vector += next[i].vector;
        }
        result.front = std::move(next);
    }
    return result;
}

inline double power(const oracle::Field& field) {
    double sum = 0.0;
    for (const oracle::Lobe& lobe : field)
        sum += 4.0 * M_PI * lobe.constant;
    return sum;
}

} // namespace lpvbake::oracle
