#include "volume/sh.h"

#include <cassert>
#include <cmath>
#include <numbers>

namespace lpvbake {
namespace {

using std::numbers::pi;

/// Products of these with coefficients of band 2 are entries of a symmetric, traceless matrix Q
/// with w^T Q w the band's value in direction w.
const double cross = std::sqrt(15 / pi) / 4; // half of sh_y2a: xy stands in Q twice
const double along_z = std::sqrt(5 / pi) / 4;
const double x_less_y = std::sqrt(15 / pi) / 4;

} // namespace

std::array<float, 9> sh_basis(int order, glm::vec3 w) {
    assert(order >= 0 && order <= 2);
    std::array<float, 9> y{};
    y[0] = sh_y0;
    if (order >= 1) {
        y[1] = sh_y1 * w.y;
        y[2] = sh_y1 * w.z;
        y[3] = sh_y1 * w.x;
    }
    if (order >= 2) {
        y[4] = sh_y2a * w.x * w.y;
        y[5] = sh_y2a * w.y * w.z;
        y[6] = sh_y2b * (3 * w.z * w.z - 1);
        y[7] = sh_y2a * w.x * w.z;
        y[8] = sh_y2c * (w.x * w.x - w.y * w.y);
    }
    return y;
}

float sh_irradiance(std::span<const float> coefficients, glm::vec3 n) {
    assert(coefficients.size() == 1 || coefficients.size() == 4 || coefficients.size() == 9);
    constexpr double a[] = {pi, 2 * pi / 3, pi / 4};
    const int order = coefficients.size() >= 9 ? 2 : coefficients.size() >= 4 ? 1 : 0;
    const std::array<float, 9> y = sh_basis(order, n);
    double sum = 0;
    for (int l = 0, k = 0; l <= order; ++l)
        for (; k < sh_count(l); ++k)
            sum += a[l] * double(coefficients[size_t(k)]) * double(y[size_t(k)]);
    return float(sum);
}

// Band 1 is a vector and band 2 a quadratic form; both turn as such. Substituting w = m^T u:
// v.w = (m v).u and w^T Q w = u^T (m Q m^T) u.
void sh_rotate(const glm::mat3& m, std::span<float> coefficients) {
    assert(coefficients.size() == 1 || coefficients.size() == 4 || coefficients.size() == 9);
    const glm::dmat3 turn(m);
    if (coefficients.size() >= 4) {
        float* c = &coefficients[1];
        const glm::dvec3 v = turn * glm::dvec3(c[2], c[0], c[1]);
        c[0] = float(v.y);
        c[1] = float(v.z);
        c[2] = float(v.x);
    }
    if (coefficients.size() >= 9) {
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
}

void sh_flip(std::span<float> coefficients) {
    for (size_t k = 1; k < coefficients.size() && k < 4; ++k)
        coefficients[k] = -coefficients[k];
}

} // namespace lpvbake
