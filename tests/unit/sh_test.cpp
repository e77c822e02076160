// Spherical harmonics against quadrature in double, and closed forms.
#include "volume/sh.h"
#include "volume/volume.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

using namespace lpvbake;
using std::numbers::pi;

namespace {

/// Integral over the sphere: midpoints in z (n rings, equal areas) and in azimuth (2 n). Exact for
/// the azimuth's trigonometric polynomials, second order in z.
double integrate(const std::function<double(glm::dvec3)>& f, int n = 400) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        const double z = (i + 0.5) / n * 2 - 1;
        const double r = std::sqrt(1 - z * z);
        for (int j = 0; j < 2 * n; ++j) {
            const double phi = (j + 0.5) * pi / n;
            sum += f({r * std::cos(phi), r * std::sin(phi), z});
        }
    }
    return sum * 2 * pi / (double(n) * n);
}

glm::vec3 random_direction(std::mt19937& random) {
    std::normal_distribution<float> normal;
    return glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
}

double evaluate(const volume::ShValues& c, int order, glm::vec3 w) {
    const auto y = volume::sh_basis(order, w);
    double sum = 0;
    for (int k = 0; k < volume::sh_count(order); ++k)
        sum += double(c[size_t(k)]) * double(y[size_t(k)]);
    return sum;
}

volume::ShValues random_coefficients(std::mt19937& random) {
    std::normal_distribution<float> normal;
    volume::ShValues c;
    for (float& x : c)
        x = normal(random);
    return c;
}

} // namespace

TEST(Sh, ConstantsAreTheirFormulas) {
    EXPECT_FLOAT_EQ(volume::sh_y0, float(1 / (2 * std::sqrt(pi))));
    EXPECT_FLOAT_EQ(volume::sh_y1, float(std::sqrt(3 / pi) / 2));
    EXPECT_FLOAT_EQ(volume::sh_y2a, float(std::sqrt(15 / pi) / 2));
    EXPECT_FLOAT_EQ(volume::sh_y2b, float(std::sqrt(5 / pi) / 4));
    EXPECT_FLOAT_EQ(volume::sh_y2c, float(std::sqrt(15 / pi) / 4));
}

TEST(Sh, BasisIsOrthonormal) {
    std::array<std::array<double, 25>, 25> products{};
    integrate([&](glm::dvec3 w) {
        const auto y = volume::sh_basis(4, glm::vec3(w));
        for (size_t i = 0; i < 25; ++i)
            for (size_t j = 0; j <= i; ++j)
                products[i][j] += double(y[i]) * double(y[j]) * 2 * pi / (400.0 * 400.0);
        return 0.0;
    });
    for (size_t i = 0; i < 25; ++i)
        for (size_t j = 0; j <= i; ++j)
            EXPECT_NEAR(products[i][j], i == j ? 1.0 : 0.0, 2e-4) << i << ' ' << j;
}

TEST(Sh, OrderOfTheBasis) {
    const glm::vec3 w = glm::normalize(glm::vec3(1, 2, 3));
    const auto y = volume::sh_basis(2, w);
    const std::array<float, 9> polynomials{1,
                                           w.y,
                                           w.z,
                                           w.x,
                                           w.x * w.y,
                                           w.y * w.z,
                                           3 * w.z * w.z - 1,
                                           w.x * w.z,
                                           w.x * w.x - w.y * w.y};
    const std::array<float, 9> scales{volume::sh_y0,  volume::sh_y1,  volume::sh_y1,
                                      volume::sh_y1,  volume::sh_y2a, volume::sh_y2a,
                                      volume::sh_y2b, volume::sh_y2a, volume::sh_y2c};
    for (size_t k = 0; k < 9; ++k)
        EXPECT_FLOAT_EQ(y[k], scales[k] * polynomials[k]) << k;
    // Bands above the order are not evaluated.
    EXPECT_EQ(volume::sh_basis(0, w)[1], 0.0f);
    EXPECT_EQ(volume::sh_basis(1, w)[4], 0.0f);
}

// By the definition over the polar angle from z and the azimuth from x, with the standard library's
// associated Legendre functions, which have no Condon-Shortley sign.
TEST(Sh, HighBandsRunFromMinusLToL) {
    std::mt19937 random(6);
    for (int i = 0; i < 20; ++i) {
        const glm::vec3 w = random_direction(random);
        const auto y = volume::sh_basis(4, w);
        const double phi = std::atan2(double(w.y), double(w.x));
        for (unsigned l = 3; l <= 4; ++l)
            for (int m = -int(l); m <= int(l); ++m) {
                const auto order = unsigned(std::abs(m));
                const double scale = std::sqrt((2 * l + 1) / (4 * pi) * std::tgamma(l - order + 1)
                                               / std::tgamma(l + order + 1) * (m ? 2 : 1));
                const double turn = m < 0 ? std::sin(order * phi) : std::cos(order * phi);
                EXPECT_NEAR(y[size_t(int(l * l + l) + m)],
                            scale * turn * std::assoc_legendre(l, order, double(w.z)), 2e-6)
                    << l << ' ' << m;
            }
        EXPECT_EQ(volume::sh_basis(3, w)[16], 0.0f);
        EXPECT_EQ(volume::sh_basis(2, w)[9], 0.0f);
    }
}

TEST(Sh, OrderFollowsFromTheCount) {
    for (int order = 0; order <= volume::sh_max_order; ++order)
        EXPECT_EQ(volume::sh_order_of(size_t(volume::sh_count(order))), order);
    for (const size_t count : {0u, 2u, 8u, 10u, 36u})
        EXPECT_EQ(volume::sh_order_of(count), -1) << count;
}

TEST(Sh, ProjectionRecoversABandLimitedField) {
    std::mt19937 random(1);
    const auto c = random_coefficients(random);
    std::array<double, 25> projected{};
    integrate([&](glm::dvec3 w) {
        const auto y = volume::sh_basis(4, glm::vec3(w));
        const double value = evaluate(c, 4, glm::vec3(w)) * 2 * pi / (400.0 * 400.0);
        for (size_t k = 0; k < 25; ++k)
            projected[k] += value * double(y[k]);
        return 0.0;
    });
    for (size_t k = 0; k < 25; ++k)
        EXPECT_NEAR(projected[k], c[k], 2e-4) << k;
}

// A convolution with max(0, cos) scales band l by A_l, the integral over the sphere of the
// clamped cosine times the Legendre polynomial P_l (Funk and Hecke).
TEST(Sh, ClampedCosineConstants) {
    const double a[] = {pi, 2 * pi / 3, pi / 4, 0, -pi / 24};
    for (int l = 0; l < 5; ++l) {
        const double integral = integrate(
            [&](glm::dvec3 w) { return std::max(0.0, w.z) * std::legendre(unsigned(l), w.z); });
        EXPECT_NEAR(integral, a[l], 1e-4) << l;
        EXPECT_NEAR(volume::sh_cosine_factor(l), integral, 1e-4) << l;
    }
}

TEST(Sh, IrradianceIsTheCosineIntegral) {
    std::mt19937 random(2);
    for (int order : {0, 1, 2, 3, 4}) {
        const auto c = random_coefficients(random);
        const glm::vec3 n = random_direction(random);
        const double expected = integrate([&](glm::dvec3 w) {
            return std::max(0.0, glm::dot(glm::dvec3(n), w)) * evaluate(c, order, glm::vec3(w));
        });
        EXPECT_NEAR(volume::sh_irradiance(std::span(c).first(size_t(volume::sh_count(order))), n),
                    expected, 2e-4);
    }
}

TEST(Sh, FurnaceGivesPiTimesLuminance) {
    const float luminance = 123.0f;
    volume::ShValues c{};
    c[0] = float(integrate([&](glm::dvec3) { return double(luminance * volume::sh_y0); }));
    std::mt19937 random(3);
    for (int i = 0; i < 10; ++i)
        EXPECT_NEAR(volume::sh_irradiance(c, random_direction(random)), pi * luminance, 1e-3);
}

TEST(Sh, TurnedFieldEqualsFieldAtTurnedDirection) {
    std::mt19937 random(4);
    std::uniform_real_distribution<float> angle(-4, 4);
    const glm::mat4 identity(1.0f);
    for (int i = 0; i < 200; ++i) {
        glm::mat3 m(glm::rotate(identity, angle(random), random_direction(random)));
        if (i % 2) // reflections: one axis, or all three
            m = m
                * glm::mat3(
                    glm::scale(identity, glm::vec3(-1, i % 4 == 1 ? 1 : -1, i % 4 == 1 ? 1 : -1)));
        const auto before = random_coefficients(random);
        for (int order : {0, 1, 2, 3, 4}) {
            auto after = before;
            volume::sh_rotate(m, std::span(after).first(size_t(volume::sh_count(order))));
            const glm::vec3 w = random_direction(random);
            EXPECT_NEAR(evaluate(after, order, m * w), evaluate(before, order, w), 1e-5);
            for (size_t k = size_t(volume::sh_count(order)); k < 25; ++k)
                EXPECT_EQ(after[k], before[k]);
        }
    }
}

TEST(Sh, FlipLooksTheOtherWay) {
    std::mt19937 random(5);
    const auto before = random_coefficients(random);
    auto after = before;
    volume::sh_flip(after);
    for (int i = 0; i < 20; ++i) {
        const glm::vec3 w = random_direction(random);
        EXPECT_NEAR(evaluate(after, 4, -w), evaluate(before, 4, w), 4e-6);
    }
    volume::sh_flip(after);
    EXPECT_EQ(after, before);
}

TEST(Sh, ProductHasTheCoefficientsOfTheProduct) {
    std::mt19937 random(11);
    const volume::ShValues f = random_coefficients(random), all = random_coefficients(random);
    for (const int band : {1, 4}) {
        const std::span<const float> g(all.data(), std::size_t(volume::sh_count(band)));
        const std::vector<double> product = volume::sh_product(4, g);
        ASSERT_EQ(product.size(), 25u * 25u);
        for (std::size_t i = 0; i < 25; ++i) {
            // Bands of g that bands of f beyond its own would count for are left out.
            const int most = volume::sh_max_order - int(std::sqrt(double(i) + 0.5));
            volume::ShValues low{};
            std::copy_n(g.begin(), std::min(g.size(), std::size_t(volume::sh_count(most))),
                        low.begin());
            const double wanted = integrate(
                [&](glm::dvec3 w) {
                    return evaluate(f, 4, w) * evaluate(low, 4, w)
                           * double(volume::sh_basis(4, w)[i]);
                },
                200);
            double sum = 0;
            for (std::size_t k = 0; k < 25; ++k)
                sum += product[25 * i + k] * double(f[k]);
            EXPECT_NEAR(sum, wanted, 1e-3) << band << " " << i;
        }
        const std::vector<double> part = volume::sh_product(1, g);
        EXPECT_TRUE(std::equal(part.begin(), part.end(), product.begin()));
        EXPECT_EQ(part.size(), 4u * 25u);
    }
}

TEST(Sh, ProductWithAConstantIsTheField) {
    const float one = float(std::sqrt(4 * pi));
    const std::vector<double> product = volume::sh_product(4, {&one, 1});
    for (std::size_t i = 0; i < 25; ++i)
        for (std::size_t k = 0; k < 25; ++k)
            EXPECT_NEAR(product[25 * i + k], i == k ? 1.0 : 0.0, 1e-6);
    // <Y20 Y20 Y20> = sqrt(5 / pi) / 7, <Y10 Y10 Y20> = 1 / sqrt(5 pi).
    volume::ShValues z{}, zz{};
    z[2] = zz[6] = 1.0f;
    EXPECT_NEAR(volume::sh_product(2, zz)[25 * 6 + 6], std::sqrt(5 / pi) / 7, 1e-6);
    EXPECT_NEAR(volume::sh_product(2, z)[25 * 2 + 6], 1 / std::sqrt(5 * pi), 1e-6);
    EXPECT_EQ(volume::sh_product(2, z)[25 * 2 + 5], 0.0);
}

TEST(Volume, TotalEnergyIntegratesLuminanceOverTheSphere) {
    Volume volume;
    volume.grid.dims = {3, 1, 1};
    EXPECT_EQ(volume::total_energy(volume), 0.0);
    // A constant luminance L has c_0 = L sqrt(4 pi) and integrates to 4 pi L.
    const float c0 = float(std::sqrt(4 * pi));
    volume.sh = {{glm::vec3(10 * c0), glm::vec3(0), glm::vec3(0, 5 * c0, 0)}};
    EXPECT_NEAR(volume::total_energy(volume), 4 * pi * (10 + 5 * 0.7152), 1e-4);
    volume.validity = {1, 1, 0}; // what stands inside geometry is no light
    EXPECT_NEAR(volume::total_energy(volume), 4 * pi * 10, 1e-4);
}
