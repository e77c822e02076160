// Volumes without negative irradiance, against closed forms and a search over directions.
#include "volume/dering.h"

#include "unit/volumes.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <numbers>

namespace lpvbake::volume {
namespace {

using std::numbers::pi;
using Colour = std::vector<float>; // coefficients of one

Colour colour_of(const Volume& volume, std::size_t cell, int colour = 0) {
    Colour result;
    for (const auto& cells : volume.sh)
        result.push_back(cells[cell][colour]);
    return result;
}

/// One cell, whose colours are alike.
Volume one_cell(const Colour& coefficients) {
    Volume volume;
    volume.grid.dims = {1, 1, 1};
    volume.sh_order = sh_order_of(coefficients.size());
    for (const float c : coefficients)
        volume.sh.push_back({glm::vec3(c)});
    return volume;
}

/// Of irradiance over a fine lattice of normals.
double least_of_many(const Colour& coefficients) {
    double least = 1e30;
    for (int i = 0; i <= 400; ++i)
        for (int j = 0; j < 400; ++j) {
            const double z = i / 200.0 - 1, phi = 2 * pi * j / 400, r = std::sqrt(1 - z * z);
            const glm::vec3 n(r * std::cos(phi), r * std::sin(phi), z);
            least = std::min(least, double(sh_irradiance(coefficients, n)));
        }
    return least;
}

/// Mean square of the difference of irradiance over normals.
double distance(const Colour& a, const Colour& b) {
    double sum = 0;
    for (std::size_t k = 0; k < a.size(); ++k) {
        const double factor = sh_cosine_factor(k < 1 ? 0 : k < 4 ? 1 : 2);
        sum += std::pow(factor * (double(a[k]) - double(b[k])), 2);
    }
    return sum / (4 * pi);
}

TEST(Dering, LeastIrradianceIsThatOfASearch) {
    const Volume volume = random_volume({6, 5, 4}, 2, false, 3, 1);
    for (std::size_t cell = 0; cell < volume.grid.size(); cell += 3) {
        const Colour c = colour_of(volume, cell);
        const double least = least_irradiance(c), found = least_of_many(c);
        EXPECT_LE(least, found + 1e-5);
        EXPECT_NEAR(least, found, 2e-3) << cell;
    }
    // Where no direction is singled out: a zonal band 2, whose least is a circle, or two poles;
    // with the gradient of band 1 across the axis; a constant.
    const double a2 = pi / 4 * double(sh_y2b), a1 = 2 * pi / 3 * double(sh_y1);
    EXPECT_NEAR(least_irradiance(Colour{0, 0, 0, 0, 0, 0, 1, 0, 0}), -a2, 1e-6);
    EXPECT_NEAR(least_irradiance(Colour{0, 0, 0, 0, 0, 0, -1, 0, 0}), -2 * a2, 1e-6);
    const Colour across{0, 0.1f, 0, 0, 0, 0, -1, 0, 0}; // least of -a2 (3 z^2 - 1) + 0.1 a1 y
    const double y = -0.1 * a1 / (6 * a2);
    EXPECT_NEAR(least_irradiance(across), -a2 * (2 - 3 * y * y) + 0.1 * a1 * y, 1e-6);
    EXPECT_NEAR(least_irradiance(Colour{2}), 2 * pi * double(sh_y0), 1e-5);
    EXPECT_NEAR(least_irradiance(Colour{0, 3, 4, 12}), -13 * a1, 1e-4);
}

TEST(Dering, ShortensBandOneInClosedForm) {
    // Irradiance is pi y0 c0 + 2 pi / 3 y1 |c1| cos: never below 0 up to |c1| = sqrt(3) c0 / 2
    // times ... the ratio of the two factors.
    const double most = pi * double(sh_y0) / (2 * pi / 3 * double(sh_y1)) * (1 - dering_margin);
    EXPECT_NEAR(most / (1 - dering_margin), std::sqrt(3.0) / 2, 1e-6);
    const glm::dvec3 way = glm::normalize(glm::dvec3(2, -3, 6));
    for (const double length : {0.5, 0.99 * most, 1.01 * most, 3.0}) {
        const glm::vec3 c(2 * length * way);
        Volume volume = one_cell({2, c.y, c.z, c.x});
        EXPECT_EQ(dering(volume, volume.sh_order), length > most ? 1u : 0u);
        const glm::vec3 expected(2 * std::min(length, most) * way);
        const Colour got = colour_of(volume, 0);
        EXPECT_EQ(got[0], 2.0f);
        EXPECT_NEAR(got[1], expected.y, 1e-6);
        EXPECT_NEAR(got[2], expected.z, 1e-6);
        EXPECT_NEAR(got[3], expected.x, 1e-6);
    }
}

TEST(Dering, LeavesNoNegativeIrradianceAndBandZero) {
    for (const int order : {0, 1, 2}) {
        Volume volume = random_volume({9, 8, 7}, order, false, 5, 100);
        for (glm::vec3& l0 : volume.sh[0])
            l0 += 60.0f; // some negative, some that do not ring
        const Volume given = volume;
        const std::size_t changed = dering(volume, volume.sh_order);
        std::size_t counted = 0;
        for (std::size_t cell = 0; cell < volume.grid.size(); ++cell) {
            bool differs = false;
            for (int c = 0; c < 3; ++c) {
                const Colour before = colour_of(given, cell, c), now = colour_of(volume, cell, c);
                differs |= before != now;
                EXPECT_EQ(now[0], std::max(before[0], 0.0f));
                const double mean = pi * double(sh_y0) * double(now[0]);
                EXPECT_GE(least_irradiance(now), 0.98 * dering_margin * mean);
                if (least_irradiance(before) >= dering_margin * mean && mean > 0) {
                    EXPECT_EQ(before, now);
                }
            }
            counted += differs;
        }
        EXPECT_EQ(changed, counted);
        EXPECT_GT(changed, 0u);
        EXPECT_EQ(dering(volume, volume.sh_order), 0u) << "once is enough";
    }
}

TEST(Dering, ChangesTheLeastOfOrderTwo) {
    // Light from one point: c_lm = Y_lm. With the zonal axis z the nearest is zonal too, of two
    // numbers, b along z and q of 3 z^2 - 1, and is found by a search.
    Colour c(9);
    const ShValues basis = sh_basis(2, {0, 0, 1});
    std::copy_n(basis.begin(), 9, c.begin());
    c[2] *= 1.5f;
    ASSERT_LT(least_irradiance(c), -0.05);
    double least = 1e30;
    const double mean = pi * double(sh_y0) * double(c[0]);
    for (int i = 0; i <= 400; ++i)
        for (int j = 0; j <= 400; ++j) {
            Colour other = c;
            other[2] *= float(i) / 400;
            other[6] *= float(j) / 200;
            if (least_irradiance(other) >= dering_margin * mean)
                least = std::min(least, distance(other, c));
        }
    Volume volume = one_cell(c);
    dering(volume, volume.sh_order);
    const double moved = distance(colour_of(volume, 0), c);
    EXPECT_LT(moved, 1.01 * least);
    EXPECT_GT(moved, 0.97 * least); // of a search in steps
    // And of any: no other of many that do not ring is nearer, the common scale among them.
    const Volume field = random_volume({5, 5, 5}, 2, false, 11, 1);
    for (std::size_t cell = 0; cell < field.grid.size(); ++cell) {
        Colour given = colour_of(field, cell);
        given[0] = 2;
        Volume own = one_cell(given);
        if (!dering(own, 2))
            continue;
        Colour scaled = given;
        const double all = pi * double(sh_y0) * double(given[0]);
        const double scale = all * (1 - dering_margin) / (all - least_irradiance(given));
        for (std::size_t k = 1; k < 9; ++k)
            scaled[k] *= float(scale);
        EXPECT_LT(distance(colour_of(own, 0), given), distance(scaled, given) * (1 + 1e-5));
    }
}

TEST(Dering, LeavesHigherBands) {
    Volume volume = random_volume({4, 4, 4}, 2, false, 3, 100);
    const Volume given = volume;
    dering(volume, 1);
    for (std::size_t k = 4; k < 9; ++k)
        EXPECT_EQ(volume.sh[k], given.sh[k]);
    EXPECT_NE(volume.sh[1], given.sh[1]);
}

TEST(Dering, BitsDoNotDependOnThreads) {
    Volume first;
    for (const std::size_t threads : {1, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Volume volume = random_volume({9, 8, 7}, 2, false, 5, 100);
        dering(volume, volume.sh_order);
        if (threads == 1)
            first = volume;
        else
            EXPECT_EQ(volume.sh, first.sh);
    }
}

} // namespace
} // namespace lpvbake::volume
