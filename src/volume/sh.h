// Real orthonormal spherical harmonics without Condon-Shortley signs.
//
// Order of coefficients, and what the canonical field is: as lpvbake/volume.h has them.
#pragma once

#include <glm/glm.hpp>

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace lpvbake::volume {

inline constexpr float sh_y0 = 0.282094792f;  ///< 1 / (2 sqrt(pi))
inline constexpr float sh_y1 = 0.488602512f;  ///< sqrt(3 / pi) / 2
inline constexpr float sh_y2a = 1.092548431f; ///< sqrt(15 / pi) / 2
inline constexpr float sh_y2b = 0.315391565f; ///< sqrt(5 / pi) / 4
inline constexpr float sh_y2c = 0.546274215f; ///< sqrt(15 / pi) / 4

inline constexpr int sh_max_order = 4;

/// Number of coefficients up to band `order`: (order + 1)^2.
constexpr int sh_count(int order) {
    return (order + 1) * (order + 1);
}

/// The order that has so many coefficients; -1: none up to sh_max_order has.
constexpr int sh_order_of(size_t coefficients) {
    for (int order = 0; order <= sh_max_order; ++order)
        if (size_t(sh_count(order)) == coefficients)
            return order;
    return -1;
}

using ShValues = std::array<float, sh_count(sh_max_order)>;

/// Evaluates the first sh_count(order) basis functions (order 0 to 4) in unit direction w; the
/// others are 0.
ShValues sh_basis(int order, glm::vec3 w);

/// What a convolution with the clamped cosine multiplies band l with: pi, 2 pi / 3, pi / 4, 0,
/// -pi / 24 (Ramamoorthi and Hanrahan 2001).
double sh_cosine_factor(int l);

/// Irradiance (lux) on a plane of unit normal n from canonical coefficients (nits), one colour:
/// E(n) = sum A_l c_lm Y_lm(n), A_l = sh_cosine_factor(l).
float sh_irradiance(std::span<const float> coefficients, glm::vec3 n);

/// Turns coefficients (order 0 to 4) with the rotation or reflection `m`, whose columns are the
/// images of the axes: the result evaluated at m*w equals the input evaluated at w.
void sh_rotate(const glm::mat3& m, std::span<float> coefficients);

/// The product f g as a matrix, [sh_count(sh_max_order) * i + k]: what its coefficient i, up to
/// band `order`, has of coefficient k of f, which is the sum over j of g_j times the integral of
/// Y_i Y_j Y_k (Gaunt). Band l takes the bands of g up to sh_max_order - l, with which no band of f
/// beyond sh_max_order counts: it is exact for a g of these alone, whatever f.
std::vector<double> sh_product(int order, std::span<const float> g);

/// Flips the direction of every lobe: multiplies band l with (-1)^l. Turns travel direction into
/// incident direction and back.
void sh_flip(std::span<float> coefficients);

} // namespace lpvbake::volume
