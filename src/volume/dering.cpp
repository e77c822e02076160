#include "volume/dering.h"

#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cassert>
#include <cmath>
#include <vector>

namespace lpvbake::volume {
namespace {

constexpr int most = sh_count(2);

/// Irradiance towards n as mean + b.n + n.Qn.
struct Quadratic {
    double mean = 0;
    glm::dvec3 b{0.0};
    glm::dmat3 q{0.0}; ///< symmetric, and without a trace
};

/// Coefficients times sh_cosine_factor of their bands.
using Bands = std::array<double, most>;

Quadratic quadratic_of(const Bands& e) {
    Quadratic result;
    result.mean = double(sh_y0) * e[0];
    result.b = double(sh_y1) * glm::dvec3(e[3], e[1], e[2]);
    const double xy = 0.5 * double(sh_y2a) * e[4], yz = 0.5 * double(sh_y2a) * e[5],
                 xz = 0.5 * double(sh_y2a) * e[7], z2 = double(sh_y2b) * e[6],
                 x2y2 = double(sh_y2c) * e[8];
    result.q = {{x2y2 - z2, xy, xz}, {xy, -x2y2 - z2, yz}, {xz, yz, 2 * z2}};
    return result;
}

/// Turns q into a diagonal matrix by Jacobi's rotations; the columns of the result are the axes.
glm::dmat3 diagonalize(glm::dmat3& q) {
    glm::dmat3 axes(1.0);
    for (int sweep = 0; sweep < 12; ++sweep)
        for (const auto& [i, j] : {std::pair(0, 1), {0, 2}, {1, 2}}) {
            if (q[j][i] == 0)
                continue;
            const double theta = (q[j][j] - q[i][i]) / (2 * q[j][i]);
            const double t =
                (theta < 0 ? -1 : 1) / (std::abs(theta) + std::sqrt(theta * theta + 1));
            const double c = 1 / std::sqrt(t * t + 1), s = t * c;
            glm::dmat3 turn(1.0);
            turn[i][i] = turn[j][j] = c;
            turn[j][i] = s;
            turn[i][j] = -s;
            q = glm::transpose(turn) * q * turn;
            axes = axes * turn;
        }
    return axes;
}

/// The unit normal towards which there is least: of all points where the gradient is along n, that
/// with the greatest multiplier, n = -(Q + m)^-1 b / 2, m >= -the least eigenvalue. |n| falls as m
/// rises to the multiplier for |n| = 1.
glm::dvec3 darkest_normal(Quadratic e) {
    const glm::dmat3 axes = diagonalize(e.q);
    const glm::dvec3 eigen(e.q[0][0], e.q[1][1], e.q[2][2]), b = glm::transpose(axes) * e.b;
    const int first =
        eigen.x <= eigen.y ? (eigen.x <= eigen.z ? 0 : 2) : (eigen.y <= eigen.z ? 1 : 2);
    const auto normal_at = [&](double m) { // m counts from minus the least eigenvalue on
        glm::dvec3 n(0.0);
        for (int i = 0; i < 3; ++i)
            if (const double slope = eigen[i] - eigen[first] + m; b[i] != 0)
                n[i] = slope > 0 ? -0.5 * b[i] / slope : std::copysign(1e300, -b[i]);
        return n;
    };
    double lo = 0, hi = 0.5 * glm::length(b);
    if (!(hi > 0) || glm::dot(normal_at(lo), normal_at(lo)) <= 1) {
        // Too short even there: the rest lies along the axis of the least eigenvalue.
        glm::dvec3 n = normal_at(lo);
        n[first] = 0;
        n[first] = std::sqrt(std::max(0.0, 1 - glm::dot(n, n)));
        return axes * n;
    }
    // Newton's method on 1 / |n|, which is concave: from below it never goes too far (More and
    // Sorensen 1983).
    for (int i = 0; i < 3; ++i)
        lo = std::max(lo, 0.5 * std::abs(b[i]) - (eigen[i] - eigen[first]));
    for (int step = 0; step < 60; ++step) {
        const glm::dvec3 n = normal_at(lo);
        const double length = glm::length(n);
        double slope = 0;
        for (int i = 0; i < 3; ++i)
            if (b[i] != 0)
                slope += n[i] * n[i] / (eigen[i] - eigen[first] + lo);
        const double next = lo + (length - 1) * length * length / slope;
        if (!(next > lo * (1 + 1e-15)) || !(next <= hi))
            break;
        lo = next;
    }
    return axes * glm::normalize(normal_at(lo));
}

double towards(const Quadratic& e, glm::dvec3 n) {
    return e.mean + glm::dot(e.b, n) + glm::dot(n, e.q * n);
}

/// Surely not above the least irradiance: a matrix without a trace has no eigenvalue below
/// -sqrt(2/3) times its Frobenius norm.
double bound_below(const Quadratic& e) {
    double square = 0;
    for (int i = 0; i < 3; ++i)
        square += glm::dot(e.q[i], e.q[i]);
    return e.mean - glm::length(e.b) - std::sqrt(2.0 / 3 * square);
}

Bands bands_towards(glm::dvec3 n) {
    const ShValues basis = sh_basis(2, glm::vec3(n));
    Bands result{};
    std::copy_n(basis.begin(), most, result.begin());
    return result;
}

double dot_of_rest(const Bands& a, const Bands& b) {
    double sum = 0;
    for (std::size_t k = 1; k < most; ++k)
        sum += a[k] * b[k];
    return sum;
}

/// The nearest of order 2 whose least irradiance is `least`: halfspaces E(n) >= least of the
/// normals that were darkest, one more a round, and the projection on all of them (Hildreth 1957:
/// the multipliers one after the other, none below 0). What is left is scaled away.
void dering_quadratic(Bands& e, double least) {
    constexpr int rounds = 12, passes = 40;
    constexpr double settled = 1e-4; // of the mean: a tenth of what is left to scaling
    // Of the basis towards any normal, but for band 0: (2 l + 1) / 4 pi a band.
    constexpr double rest_of_square = 8 / (4 * std::numbers::pi);
    std::vector<Bands> towards_normals;
    std::vector<double> multipliers;
    const double mean = double(sh_y0) * e[0];
    for (int round = 0;; ++round) {
        const Quadratic now = quadratic_of(e);
        const glm::dvec3 n = darkest_normal(now);
        const double darkest = towards(now, n);
        if (darkest >= least)
            return;
        if (round == rounds || darkest > least - 1e-3 * mean) {
            const double scale = (mean - least) / (mean - darkest);
            for (std::size_t k = 1; k < most; ++k)
                e[k] *= scale;
            return;
        }
        towards_normals.push_back(bands_towards(n));
        multipliers.push_back(0);
        double moved = mean; // by the last pass
        for (int pass = 0; pass < passes && moved > settled * mean; ++pass) {
            moved = 0;
            for (std::size_t i = 0; i < multipliers.size(); ++i) {
                const Bands& y = towards_normals[i];
                const double lacking = least - mean - dot_of_rest(e, y);
                const double before = multipliers[i];
                multipliers[i] = std::max(0.0, before + lacking / rest_of_square);
                for (std::size_t k = 1; k < most; ++k)
                    e[k] += (multipliers[i] - before) * y[k];
                moved = std::max(moved, std::abs(multipliers[i] - before) * rest_of_square);
            }
        }
    }
}

/// Of coefficient k.
int band_of(std::size_t k) {
    return k < 1 ? 0 : k < 4 ? 1 : 2;
}

Bands bands_of(std::span<const float> coefficients) {
    Bands e{};
    for (std::size_t k = 0; k < coefficients.size(); ++k)
        e[k] = sh_cosine_factor(band_of(k)) * double(coefficients[k]);
    return e;
}

/// True where something changed.
bool dering_colour(std::span<float> coefficients) {
    Bands e = bands_of(coefficients);
    if (e[0] <= 0) {
        const bool dark = std::ranges::all_of(coefficients, [](float c) { return c == 0; });
        std::ranges::fill(coefficients, 0.0f);
        return !dark;
    }
    const Quadratic given = quadratic_of(e);
    const double least = dering_margin * given.mean;
    const double rounded = 0.99 * least; // what was brought to it stays as it is
    if (bound_below(given) >= rounded)
        return false;
    if (coefficients.size() <= 4) {
        const double scale = (given.mean - least) / glm::length(given.b);
        for (std::size_t k = 1; k < coefficients.size(); ++k)
            coefficients[k] = float(scale * double(coefficients[k]));
        return true;
    }
    if (towards(given, darkest_normal(given)) >= rounded)
        return false;
    dering_quadratic(e, least);
    for (std::size_t k = 1; k < coefficients.size(); ++k)
        coefficients[k] = float(e[k] / sh_cosine_factor(band_of(k)));
    return true;
}

} // namespace

double least_irradiance(std::span<const float> coefficients) {
    assert(coefficients.size() <= most);
    const Quadratic quadratic = quadratic_of(bands_of(coefficients));
    return towards(quadratic, darkest_normal(quadratic));
}

std::size_t dering(Volume& volume, int order) {
    assert(order <= std::min(2, volume.sh_order));
    std::atomic<std::size_t> changed = 0;
    tbb::parallel_for(std::size_t(0), volume.grid.size(), [&](std::size_t cell) {
        bool any = false;
        for (int colour = 0; colour < 3; ++colour) {
            std::array<float, most> values;
            const std::span coefficients(values.data(), std::size_t(sh_count(order)));
            for (std::size_t k = 0; k < coefficients.size(); ++k)
                coefficients[k] = volume.sh[k][cell][colour];
            if (!dering_colour(coefficients))
                continue;
            any = true;
            for (std::size_t k = 0; k < coefficients.size(); ++k)
                volume.sh[k][cell][colour] = coefficients[k];
        }
        changed += any;
    });
    return changed;
}

} // namespace lpvbake::volume
