#include "volume/sh.h"

#include <cassert>
#include <cmath>
#include <numbers>

namespace lpvbake::volume {
namespace {

using std::numbers::pi;

/// Products of these with coefficients of band 2 are entries of a symmetric, traceless matrix Q
/// with w^T Q w the band's value in direction w.
const double cross = std::sqrt(15 / pi) / 4; // half of sh_y2a: xy stands in Q twice
const double along_z = std::sqrt(5 / pi) / 4;
const double x_less_y = std::sqrt(15 / pi) / 4;

const double k30 = std::sqrt(7 / pi) / 4;
const double k31 = std::sqrt(21 / (2 * pi)) / 4;
const double k32 = std::sqrt(105 / pi) / 4;
const double k33 = std::sqrt(35 / (2 * pi)) / 4;
const double k40 = std::sqrt(1 / pi) * 3 / 16;
const double k41 = std::sqrt(5 / (2 * pi)) * 3 / 4;
const double k42 = std::sqrt(5 / pi) * 3 / 8;
const double k43 = std::sqrt(35 / (2 * pi)) * 3 / 4;
const double k44 = std::sqrt(35 / pi) * 3 / 16;

/// Bands 0 to 2 in unit direction w.
template <typename Number>
void evaluate_low(int order, const glm::vec<3, Number>& w, Number* y) {
    y[0] = Number(sh_y0);
    if (order >= 1) {
        y[1] = Number(sh_y1) * w.y;
        y[2] = Number(sh_y1) * w.z;
        y[3] = Number(sh_y1) * w.x;
    }
    if (order >= 2) {
        y[4] = Number(sh_y2a) * w.x * w.y;
        y[5] = Number(sh_y2a) * w.y * w.z;
        y[6] = Number(sh_y2b) * (3 * w.z * w.z - 1);
        y[7] = Number(sh_y2a) * w.x * w.z;
        y[8] = Number(sh_y2c) * (w.x * w.x - w.y * w.y);
    }
}

/// Bands 3 and 4 in unit direction w, the coefficients from the ninth on.
template <typename Number>
void evaluate_high(int order, const glm::vec<3, Number>& w, Number* y) {
    const Number xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
    // r^m sin(m phi) and r^m cos(m phi) of the azimuth phi, r the distance from the polar axis
    const Number sin2 = 2 * w.x * w.y, cos2 = xx - yy;
    const Number sin3 = w.y * (3 * xx - yy), cos3 = w.x * (xx - 3 * yy);
    y[0] = Number(k33) * sin3;
    y[1] = Number(k32) * w.z * sin2;
    y[2] = Number(k31) * (5 * zz - 1) * w.y;
    y[3] = Number(k30) * (5 * zz - 3) * w.z;
    y[4] = Number(k31) * (5 * zz - 1) * w.x;
    y[5] = Number(k32) * w.z * cos2;
    y[6] = Number(k33) * cos3;
    if (order < 4)
        return;
    y[7] = Number(k44) * 2 * sin2 * cos2;
    y[8] = Number(k43) * w.z * sin3;
    y[9] = Number(k42) * (7 * zz - 1) * sin2;
    y[10] = Number(k41) * (7 * zz - 3) * w.z * w.y;
    y[11] = Number(k40) * ((35 * zz - 30) * zz + 3);
    y[12] = Number(k41) * (7 * zz - 3) * w.z * w.x;
    y[13] = Number(k42) * (7 * zz - 1) * cos2;
    y[14] = Number(k43) * w.z * cos3;
    y[15] = Number(k44) * (cos2 * cos2 - sin2 * sin2);
}

struct Node {
    glm::dvec3 direction;
    double weight;
};

/// A rule that is exact for polynomials of degree 8 on the sphere: Gauss and Legendre's five points
/// in z, nine equal steps in azimuth.
const std::array<Node, 45>& product_rule() {
    static const std::array<Node, 45> rule = [] {
        const double near = std::sqrt(5 - 2 * std::sqrt(10.0 / 7)) / 3;
        const double far = std::sqrt(5 + 2 * std::sqrt(10.0 / 7)) / 3;
        const double near_weight = (322 + 13 * std::sqrt(70.0)) / 900;
        const double far_weight = (322 - 13 * std::sqrt(70.0)) / 900;
        const std::array<std::array<double, 2>, 5> heights{{{0.0, 128.0 / 225},
                                                            {near, near_weight},
                                                            {-near, near_weight},
                                                            {far, far_weight},
                                                            {-far, far_weight}}};
        std::array<Node, 45> made;
        size_t n = 0;
        for (const auto& [z, weight] : heights)
            for (int step = 0; step < 9; ++step) {
                const double phi = 2 * pi * step / 9, r = std::sqrt(1 - z * z);
                made[n++] = {{r * std::cos(phi), r * std::sin(phi), z}, weight * 2 * pi / 9};
            }
        return made;
    }();
    return rule;
}

/// The integral of three harmonics, Y_i Y_j Y_k, that is not 0.
struct Triple {
    size_t i, j, k;
    double integral;
};

int band_of(size_t k) {
    return int(std::sqrt(double(k) + 0.5));
}

/// All of them where the bands of i and j sum to sh_max_order at most: polynomials of degree 8.
const std::vector<Triple>& triples() {
    static const std::vector<Triple> all = [] {
        constexpr size_t count = sh_count(sh_max_order);
        std::vector<std::array<double, count>> values;
        for (const Node& node : product_rule()) {
            double* y = values.emplace_back().data();
            evaluate_low(sh_max_order, node.direction, y);
            evaluate_high(sh_max_order, node.direction, y + sh_count(2));
        }
        std::vector<Triple> made;
        for (size_t i = 0; i < count; ++i)
            for (size_t j = 0; j < size_t(sh_count(sh_max_order - band_of(i))); ++j)
                for (size_t k = 0; k < count; ++k) {
                    double sum = 0;
                    for (size_t node = 0; node < values.size(); ++node)
                        sum += product_rule()[node].weight * values[node][i] * values[node][j]
                               * values[node][k];
                    if (std::abs(sum) > 1e-12)
                        made.push_back({i, j, k, sum});
                }
        return made;
    }();
    return all;
}

/// Turns bands 3 and 4 by projecting the turned field anew: coefficient i becomes the integral of
/// Y_i(w) f(m^T w), a polynomial of degree 8 at most.
void rotate_high(const glm::dmat3& turn, int order, float* c) {
    const size_t count = size_t(sh_count(order) - sh_count(2));
    std::array<double, 16> before{}, after{}, turned{};
    for (const auto& [w, weight] : product_rule()) {
        evaluate_high(order, glm::transpose(turn) * w, before.data());
        evaluate_high(order, w, after.data());
        // Bands are orthogonal, but one sum for both would mix their rounding errors.
        double f3 = 0, f4 = 0;
        for (size_t k = 0; k < count; ++k)
            (k < 7 ? f3 : f4) += double(c[k]) * before[k];
        for (size_t k = 0; k < count; ++k)
            turned[k] += weight * (k < 7 ? f3 : f4) * after[k];
    }
    for (size_t k = 0; k < count; ++k)
        c[k] = float(turned[k]);
}

} // namespace

ShValues sh_basis(int order, glm::vec3 w) {
    assert(order >= 0 && order <= sh_max_order);
    ShValues y{};
    evaluate_low(order, w, y.data());
    if (order >= 3)
        evaluate_high(order, w, &y[9]);
    return y;
}

double sh_cosine_factor(int l) {
    constexpr double factors[] = {pi, 2 * pi / 3, pi / 4, 0, -pi / 24};
    assert(l >= 0 && l <= sh_max_order);
    return factors[l];
}

std::vector<double> sh_product(int order, std::span<const float> g) {
    constexpr size_t count = sh_count(sh_max_order);
    assert(order >= 0 && order <= sh_max_order && g.size() <= count);
    std::vector<double> of(size_t(sh_count(order)) * count, 0.0);
    for (const auto& [i, j, k, integral] : triples())
        if (i < size_t(sh_count(order)) && j < g.size())
            of[count * i + k] += integral * double(g[j]);
    return of;
}

float sh_irradiance(std::span<const float> coefficients, glm::vec3 n) {
    const int order = sh_order_of(coefficients.size());
    const ShValues y = sh_basis(order, n);
    double sum = 0;
    for (int l = 0, k = 0; l <= order; ++l)
        for (; k < sh_count(l); ++k)
            sum += sh_cosine_factor(l) * double(coefficients[size_t(k)]) * double(y[size_t(k)]);
    return float(sum);
}

// Band 1 is a vector and band 2 a quadratic form; both turn as such. Substituting w = m^T u:
// v.w = (m v).u and w^T Q w = u^T (m Q m^T) u.
void sh_rotate(const glm::mat3& m, std::span<float> coefficients) {
    const int order = sh_order_of(coefficients.size());
    assert(order >= 0);
    const glm::dmat3 turn(m);
    if (order >= 1) {
        float* c = &coefficients[1];
        const glm::dvec3 v = turn * glm::dvec3(c[2], c[0], c[1]);
        c[0] = float(v.y);
        c[1] = float(v.z);
        c[2] = float(v.x);
    }
    if (order >= 2) {
        float* c = &coefficients[4];
        const double xy = cross * c[0], yz = cross * c[1], xz = cross * c[3];
        const double zz = along_z * c[2], xx = x_less_y * c[4];
        const glm::dmat3 q(xx - zz, xy, xz, xy, -xx - zz, yz, xz, yz, 2 * zz);
        const glm::dmat3 turned = turn * q * glm::transpose(turn);
        c[0] = float(turned[0][1] / cross);
        c[1] = float(turned[1][2] / cross);
        c[2] = float(turned[2][2] / (2 * along_z));
        c[3] = float(turned[0][2] / cross);
        c[4] = float((turned[0][0] - turned[1][1]) / (2 * x_less_y));
    }
    if (order >= 3)
        rotate_high(turn, order, &coefficients[9]);
}

void sh_flip(std::span<float> coefficients) {
    for (int l = 1; l <= sh_order_of(coefficients.size()); l += 2)
        for (float& c : coefficients.subspan(size_t(sh_count(l - 1)), size_t(2 * l + 1)))
            c = -c;
}

} // namespace lpvbake::volume
