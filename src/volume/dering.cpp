#include "volume/dering.h"

#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cassert>
#include <cmath>
#include <numbers>

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

/// Back.
Bands bands_of(const Quadratic& e) {
    const double a = 2 / double(sh_y2a);
    const glm::dvec3 b = e.b / double(sh_y1);
    return {e.mean / double(sh_y0),
            b.y,
            b.z,
            b.x,
            a * e.q[0][1],
            a * e.q[1][2],
            0.5 * e.q[2][2] / double(sh_y2b),
            a * e.q[0][2],
            0.5 * (e.q[0][0] - e.q[1][1]) / double(sh_y2c)};
}

/// Turns q into a diagonal matrix by Jacobi's rotations; the columns of the result are the axes.
/// What is left beside the diagonal turns axes by a billionth, and eigenvalues by its square.
glm::dmat3 diagonalize(glm::dmat3& q) {
    glm::dmat3 axes(1.0);
    const auto beside = [&] { return q[0][1] * q[0][1] + q[0][2] * q[0][2] + q[1][2] * q[1][2]; };
    const auto turn = [&](int i, int j, int other) {
        const double slant = q[i][j];
        if (slant == 0)
            return;
        const double half = 0.5 * (q[j][j] - q[i][i]);
        const double length = std::sqrt(half * half + slant * slant);
        const double t = (half < 0 ? -slant : slant) / (std::abs(half) + length);
        const double c = 1 / std::sqrt(t * t + 1), s = t * c;
        q[i][i] -= t * slant;
        q[j][j] += t * slant;
        const double at_i = q[other][i], at_j = q[other][j];
        q[i][j] = q[j][i] = 0;
        q[other][i] = q[i][other] = c * at_i - s * at_j;
        q[other][j] = q[j][other] = s * at_i + c * at_j;
        const glm::dvec3 axis = axes[i];
        axes[i] = c * axis - s * axes[j];
        axes[j] = s * axis + c * axes[j];
    };
    const double small =
        1e-18 * (q[0][0] * q[0][0] + q[1][1] * q[1][1] + q[2][2] * q[2][2] + 2 * beside());
    for (int sweep = 0; sweep < 12 && beside() > small; ++sweep) {
        turn(0, 1, 2);
        turn(0, 2, 1);
        turn(1, 2, 0);
    }
    return axes;
}

/// The unit normal towards which there is least: of all points where the gradient is along n, that
/// with the greatest multiplier, n = -(Q + m)^-1 b / 2, m >= -the least eigenvalue. |n| falls as m
/// rises to the multiplier for |n| = 1.
glm::dvec3 darkest_normal(Quadratic e) {
    const glm::dmat3 axes = diagonalize(e.q);
    const glm::dvec3 eigen(e.q[0][0], e.q[1][1], e.q[2][2]);
    const glm::dvec3 half = -0.5 * (e.b * axes);
    const int first =
        eigen.x <= eigen.y ? (eigen.x <= eigen.z ? 0 : 2) : (eigen.y <= eigen.z ? 1 : 2);
    const glm::dvec3 slopes = eigen - eigen[first]; // of the gradient; m counts from there on
    // Newton's method on 1 / |n|, which is concave: from below it never goes too far (More and
    // Sorensen 1983). No part of n is longer than 1.
    double m = 0;
    for (int i = 0; i < 3; ++i)
        m = std::max(m, std::abs(half[i]) - slopes[i]);
    glm::dvec3 n(0.0);
    double square = 0; // of |n|
    for (int step = 0; step < 60; ++step) {
        double change = 0;
        for (int i = 0; i < 3; ++i) {
            const double inverse = slopes[i] + m > 0 ? 1 / (slopes[i] + m) : 0;
            n[i] = half[i] * inverse;
            change += n[i] * n[i] * inverse;
        }
        square = glm::dot(n, n);
        // The least changes by the square of what n lacks.
        if (!(square > 1 + 1e-9))
            break;
        m += (std::sqrt(square) - 1) * square / change;
    }
    if (square
        < 1 - 1e-9) { // even with m = 0: the rest lies along the axis of the least eigenvalue
        n[first] = 0;
        n[first] = std::sqrt(std::max(0.0, 1 - glm::dot(n, n)));
    }
    return axes * glm::normalize(n);
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

/// The nearest without less than `least`: halfspaces E(n) >= least of the normals that were
/// darkest, one more a round, and the projection on all of them (Hildreth 1957: the multipliers one
/// after the other, none below 0). What is left is scaled away. False where it has no less than
/// `good`
/// (<= least) from the start on, and nothing changes.
bool dering_quadratic(Quadratic& e, double least, double good) {
    constexpr int rounds = 12, passes = 40;
    constexpr double settled = 1e-4; // of the mean: a tenth of what is left to scaling
    // What a multiplier of a normal adds towards one at a cosine: bands 1 and 2 of a peak there,
    // the sum of (2 l + 1) / 4 pi times Legendre's polynomials.
    constexpr double band_1 = 3 / (4 * std::numbers::pi), band_2 = 5 / (4 * std::numbers::pi);
    const auto added = [&](double cosine) {
        return band_1 * cosine + band_2 * (1.5 * cosine * cosine - 0.5);
    };
    std::array<glm::dvec3, rounds> normals;
    std::array<double, rounds> multipliers{}, lacking{};
    std::array<std::array<double, rounds>, rounds> adds;
    for (int round = 0;; ++round) {
        const glm::dvec3 n = darkest_normal(e);
        const double darkest = towards(e, n);
        if (darkest >= (round == 0 ? good : least))
            return round > 0;
        if (round == rounds || darkest > least - 1e-3 * e.mean) {
            const double scale = (e.mean - least) / (e.mean - darkest);
            e.b *= scale;
            e.q *= scale;
            return true;
        }
        const auto count = std::size_t(round) + 1;
        normals[count - 1] = n;
        for (std::size_t i = 0; i < count; ++i)
            adds[i][count - 1] = adds[count - 1][i] = added(glm::dot(normals[i], n));
        lacking[count - 1] = least - darkest;
        const std::array<double, rounds> before = multipliers;
        double moved = e.mean; // by the last pass
        for (int pass = 0; pass < passes && moved > settled * e.mean; ++pass) {
            moved = 0;
            for (std::size_t i = 0; i < count; ++i) {
                const double change = std::max(-multipliers[i], lacking[i] / (band_1 + band_2));
                multipliers[i] += change;
                for (std::size_t k = 0; k < count; ++k)
                    lacking[k] -= change * adds[i][k];
                moved = std::max(moved, std::abs(change) * (band_1 + band_2));
            }
        }
        for (std::size_t i = 0; i < count; ++i) {
            const double change = multipliers[i] - before[i];
            e.b += change * band_1 * normals[i];
            e.q += change * band_2
                   * (1.5 * glm::outerProduct(normals[i], normals[i]) - glm::dmat3(0.5));
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
    Quadratic nearest = given;
    if (!dering_quadratic(nearest, least, rounded))
        return false;
    e = bands_of(nearest);
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
