#include "readers/equations.h"

#include <cmath>

namespace lpvbake::readers {
namespace {

glm::dvec3 dot(const Values& a, const Values& b) {
    return ordered_sum<glm::dvec3>(a.size(), [&](std::size_t i) { return a[i] * b[i]; });
}

/// a / b of each colour; 0 where there is nothing left to divide.
glm::dvec3 ratio(glm::dvec3 a, glm::dvec3 b) {
    glm::dvec3 result(0.0);
    for (int c = 0; c < 3; ++c)
        if (b[c] > 0)
            result[c] = a[c] / b[c];
    return result;
}

/// Unknowns that may move, a colour: 1 or 0.
using Mask = std::vector<glm::dvec3>;

/// Steps of conjugate gradients on the free unknowns, from x on; `residual` is that of x.
void descend(const Equations& equations, const Mask& free, const std::vector<double>& inverse,
             int steps, double enough, Values& x, Values& residual, FitReport& report,
             glm::dvec3& first) {
    const std::size_t unknowns = x.size();
    Values product(unknowns), way(unknowns), of_points(equations.weights.size());
    const auto size_of = [&] {
        return ordered_sum<glm::dvec3>(unknowns, [&](std::size_t i) {
            return inverse[i] * free[i] * residual[i] * residual[i];
        });
    };
    for (std::size_t i = 0; i < unknowns; ++i)
        way[i] = inverse[i] * free[i] * residual[i];
    glm::dvec3 size = size_of();
    if (first == glm::dvec3(0.0))
        first = size;
    const auto left = [&] {
        const glm::dvec3 share = ratio(size, first);
        return std::sqrt(std::max({share.x, share.y, share.z}));
    };
    report.residual = left();
    for (int step = 0; step < steps && report.residual > enough; ++step, ++report.steps) {
        equations.apply(way, of_points, product);
        const glm::dvec3 length = ratio(size, dot(way, product));
        tbb::parallel_for(std::size_t(0), unknowns, [&](std::size_t i) {
            x[i] += length * way[i];
            residual[i] -= length * product[i];
        });
        const glm::dvec3 next = size_of();
        const glm::dvec3 turn = ratio(next, size);
        tbb::parallel_for(std::size_t(0), unknowns, [&](std::size_t i) {
            way[i] = inverse[i] * free[i] * residual[i] + turn * way[i];
        });
        size = next;
        report.residual = left();
    }
}

/// Of the normal equations at x.
void find_residual(const Equations& equations, const Values& lacking, const Values& x,
                   Values& residual) {
    Values of_points(lacking.size());
    tbb::parallel_for(std::size_t(0), lacking.size(), [&](std::size_t i) {
        of_points[i] = equations.weights[i] * (lacking[i] - equations.lookups.shown(x, i));
    });
    Values back(x.size());
    for (std::size_t i = 0; i < x.size(); ++i)
        back[i] = -x[i];
    equations.transpose(of_points, back, residual);
}

} // namespace

void Equations::transpose(const Values& of_points, const Values& x, Values& out) const {
    const std::size_t count = lookups.coefficients();
    tbb::parallel_for(std::size_t(0), lookups.cells.size(), [&](std::size_t u) {
        for (std::size_t k = u * count; k < (u + 1) * count; ++k)
            out[k] = hold[k] * x[k];
        lookups.gather(of_points, u, &out[u * count], false);
    });
}

void Equations::apply(const Values& x, Values& of_points, Values& out) const {
    tbb::parallel_for(std::size_t(0), weights.size(),
                      [&](std::size_t i) { of_points[i] = weights[i] * lookups.shown(x, i); });
    transpose(of_points, x, out);
}

std::vector<double> Equations::preconditioner() const {
    const std::size_t count = lookups.coefficients();
    Values of_points(weights.size());
    for (std::size_t i = 0; i < weights.size(); ++i)
        of_points[i] = glm::dvec3(weights[i]);
    std::vector<double> result(lookups.unknowns());
    tbb::parallel_for(std::size_t(0), lookups.cells.size(), [&](std::size_t u) {
        std::array<glm::dvec3, volume::sh_count(volume::sh_max_order)> diagonal{};
        lookups.gather(of_points, u, diagonal.data(), true);
        for (std::size_t k = 0; k < count; ++k) {
            const double whole = diagonal[k].x + hold[u * count + k];
            result[u * count + k] = whole > 0 ? 1 / whole : 0;
        }
    });
    return result;
}

Values solve(const Equations& equations, const Values& lacking, const Values& least,
             const FitSettings& settings, FitReport& report) {
    constexpr int rounds = 6;
    const std::size_t unknowns = equations.lookups.unknowns();
    const std::vector<double> inverse = equations.preconditioner();
    Values x(unknowns, glm::dvec3(0.0)), residual(unknowns);
    Mask free(unknowns, glm::dvec3(1.0));
    glm::dvec3 first(0.0);
    find_residual(equations, lacking, x, residual);
    if (least.empty()) {
        descend(equations, free, inverse, settings.steps, settings.tolerance, x, residual, report,
                first);
        return x;
    }
    for (int round = 0; round < rounds; ++round) {
        descend(equations, free, inverse, settings.steps / rounds, settings.tolerance, x, residual,
                report, first);
        for (std::size_t i = 0; i < unknowns; ++i)
            x[i] = glm::max(x[i], least[i]);
        find_residual(equations, lacking, x, residual);
        for (std::size_t i = 0; i < unknowns; ++i)
            for (int c = 0; c < 3; ++c)
                free[i][c] = x[i][c] > least[i][c] || residual[i][c] > 0 ? 1.0 : 0.0;
    }
    return x;
}

} // namespace lpvbake::readers
