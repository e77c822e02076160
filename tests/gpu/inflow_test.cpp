// Light of a level into a finer one in it: what is carried over the links between them.
#include "solver/lpv/inflow.h"

#include "gpu/device.h"
#include "oracles/lpv_oracle.h"
#include "scenes.h"
#include "solver/lpv/lpv.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <random>

namespace lpvbake {
namespace {

using solver::lpv::Injection;
using solver::lpv::SolvedLevel;

const double pi = glm::pi<double>();

/// Cells of 1 m, and one of their halves or quarters from sample (2, 3, 2) to (6, 5, 7).
const Grid coarse_grid{glm::dvec3(0.0), 1.0, {10, 9, 11}};
Grid fine_grid(int ratio) {
    const double cell = 1.0 / ratio;
    return {glm::dvec3(2.5, 3.5, 2.5) - 0.5 * cell,
            cell,
            {4 * ratio + 1, 2 * ratio + 1, 5 * ratio + 1}};
}

void put(std::vector<float>& coefficients, std::size_t cell, std::size_t channel,
         const oracle::Lobe& lobe) {
    float* c = &coefficients[12 * cell + 4 * channel];
    c[0] = float(lobe.constant * std::sqrt(4.0 * pi));
    c[1] = float(lobe.vector.y * std::sqrt(4.0 * pi / 3.0));
    c[2] = float(lobe.vector.z * std::sqrt(4.0 * pi / 3.0));
    c[3] = float(lobe.vector.x * std::sqrt(4.0 * pi / 3.0));
}

SolvedLevel dark() {
    return {coarse_grid, std::vector<float>(12 * coarse_grid.size()),
            std::vector<float>(3 * coarse_grid.size(), 1.0f), solver::lpv::Occlusion::face};
}

/// Lobes in all cells; `tilt` 1 is where they begin to be clamped.
SolvedLevel random_field(std::uint32_t seed, double tilt) {
    SolvedLevel level = dark();
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0, 1), both(-1, 1);
    for (std::size_t cell = 0; cell < coarse_grid.size(); ++cell)
        for (std::size_t channel = 0; channel < 3; ++channel) {
            const double size = unit(random);
            const glm::dvec3 way(both(random), both(random), both(random));
            put(level.coefficients, cell, channel,
                {size, tilt * size * unit(random) * glm::normalize(way)});
        }
    return level;
}

Injection empty(const Grid& grid) {
    Injection injection;
    injection.coefficients.resize(12 * grid.size());
    return injection;
}

glm::dvec3 power_of(const Injection& injection) {
    glm::dvec3 sum(0);
    for (std::size_t i = 0; i < injection.coefficients.size(); i += 4)
        sum[int(i / 4 % 3)] += std::sqrt(4.0 * pi) * double(injection.coefficients[i]);
    return sum;
}

/// By the oracle's one step from a cell: what its neighbour in that direction gets.
double flux_from(const oracle::Lobe& lobe, glm::ivec3 direction) {
    const glm::ivec3 dims(3);
    oracle::Field field(27);
    field[13] = lobe;
    const auto open = [](glm::ivec3, glm::ivec3, glm::ivec3) { return 1.0; };
    const oracle::Propagated step = oracle::propagate(dims, field, 1, open);
    const glm::ivec3 at = glm::ivec3(1) + direction;
    return 4 * pi * step.front[std::size_t(at.x + 3 * at.y + 9 * at.z)].constant;
}

TEST(Inflow, ItsPowerIsTheFluxOverTheLinksOfTheSide) {
    for (const int ratio : {2, 4})
        for (int side = 0; side < 6; ++side) {
            const SolvedLevel level = random_field(7, 1.5);
            const Grid fine = fine_grid(ratio);
            Injection injection = empty(fine);
            const auto in = solver::lpv::let_flow(level, fine, side, nullptr, injection);
            const glm::ivec3 lo(2, 3, 2), hi(6, 5, 7);
            const int axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
            glm::ivec3 inward(0);
            inward[axis] = side % 2 ? -1 : 1;
            double expected = 0;
            for (int j = lo[v]; j <= hi[v]; ++j)
                for (int i = lo[u]; i <= hi[u]; ++i) {
                    glm::ivec3 c;
                    c[axis] = side % 2 ? hi[axis] + 1 : lo[axis] - 1;
                    c[u] = i;
                    c[v] = j;
                    // On the rim, the part of the link's area that lies before the finer grid.
                    const double rim = 0.5 + 0.5 / ratio;
                    const double area = (i == lo[u] || i == hi[u] ? rim : 1.0)
                                        * (j == lo[v] || j == hi[v] ? rim : 1.0);
                    const float* own = &level.coefficients[12 * coarse_grid.index(c)];
                    const oracle::Lobe lobe{double(own[0]) / std::sqrt(4.0 * pi),
                                            glm::dvec3(own[3], own[1], own[2])
                                                / std::sqrt(4.0 * pi / 3.0)};
                    expected += area * flux_from(lobe, inward);
                }
            EXPECT_NEAR(in.power.x, expected, 1e-5 * expected) << side;
            EXPECT_NEAR(power_of(injection).x, expected, 1e-5 * expected) << side;
            EXPECT_NEAR(injection.power, in.power.x + in.power.y + in.power.z, 1e-9 * expected);
            EXPECT_EQ(in.shut, glm::dvec3(0));
        }
}

TEST(Inflow, AnEvenFieldIsAsBrightInTheFinerGrid) {
    SolvedLevel level = dark();
    for (std::size_t cell = 0; cell < coarse_grid.size(); ++cell)
        put(level.coefficients, cell, 0, {1.5, glm::dvec3(0)}); // luminance 1
    const Grid fine = fine_grid(2);
    Injection injection = empty(fine);
    solver::lpv::let_flow(level, fine, 0, nullptr, injection);
    for (int z = 0; z < fine.dims.z; ++z)
        for (int y = 0; y < fine.dims.y; ++y) // pi lx on each face
            EXPECT_NEAR(std::sqrt(4 * pi)
                            * double(injection.coefficients[12 * fine.index({0, y, z})]),
                        pi * fine.cell * fine.cell, 1e-5);
}

TEST(Inflow, IsLinear) {
    const Grid fine = fine_grid(2);
    const auto flow = [&](const SolvedLevel& level) {
        Injection injection = empty(fine);
        for (int side = 0; side < 6; ++side)
            solver::lpv::let_flow(level, fine, side, nullptr, injection);
        return injection.coefficients;
    };
    // Where no lobe is clamped two fields add; by the clamp propagation itself is not linear.
    for (const double tilt : {0.9, 2.0}) {
        const SolvedLevel a = random_field(1, tilt), b = random_field(2, tilt);
        SolvedLevel both = a, scaled = a;
        for (std::size_t i = 0; i < both.coefficients.size(); ++i) {
            both.coefficients[i] += b.coefficients[i];
            scaled.coefficients[i] *= 8;
        }
        const std::vector<float> of_a = flow(a), of_b = flow(b), of_both = flow(both),
                                 of_scaled = flow(scaled);
        double most = 0, largest = 0;
        for (std::size_t i = 0; i < of_a.size(); ++i) {
            ASSERT_EQ(of_scaled[i], 8 * of_a[i]);
            most = std::max(most, double(std::abs(of_a[i] + of_b[i] - of_both[i])));
            largest = std::max(largest, double(of_both[i]));
        }
        if (tilt < 1)
            EXPECT_LT(most, 1e-5 * largest);
        else
            EXPECT_GT(most, 1e-3 * largest);
    }
}

TEST(Inflow, WallsPartIt) {
    const SolvedLevel bright = random_field(5, 0.5);
    const Grid fine = fine_grid(2);
    // A wall before half of the side -x, between the links' ends.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true),
                     {2.1f, -50, -50}, {0, 0, 55}, {0, 100, 0});
    const visibility::Visibility visibility(scene, scene::frame_of(fine));
    Injection injection = empty(fine), open = injection;
    const auto in = solver::lpv::let_flow(bright, fine, 0, &visibility, injection);
    const auto all = solver::lpv::let_flow(bright, fine, 0, nullptr, open);
    EXPECT_GT(in.shut.x, 0.2 * all.power.x);
    EXPECT_NEAR(in.power.x + in.shut.x, all.power.x, 1e-9 * all.power.x);
    for (int z = 0; z < fine.dims.z; ++z)
        for (int y = 0; y < fine.dims.y; ++y) {
            const bool behind = fine.center({0, y, z}).z < 4.9;
            EXPECT_EQ(injection.coefficients[12 * fine.index({0, y, z})] == 0.0f, behind) << z;
        }
    // A link that is closed carries nothing.
    SolvedLevel closed = bright;
    std::ranges::fill(closed.transmittance, 0.0f);
    Injection none = empty(fine);
    EXPECT_EQ(solver::lpv::let_flow(closed, fine, 0, nullptr, none).power, glm::dvec3(0));
}

TEST(Inflow, IsTheSameForAnyNumberOfThreads) {
    const SolvedLevel level = random_field(3, 2);
    const Grid fine = fine_grid(4);
    Injection many = empty(fine), one = many;
    solver::lpv::let_flow(level, fine, 3, nullptr, many);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    solver::lpv::let_flow(level, fine, 3, nullptr, one);
    EXPECT_EQ(one.coefficients, many.coefficients);
}

class InflowOf : public testing::DeviceTest {
protected:
    std::vector<float> run(const Grid& grid, const Injection& injection) {
        Progress silent;
        return solver::lpv::LpvProgram(device(), grid, solver::lpv::Occlusion::none)
            .propagate(injection, {}, {.tolerance = 1e-5f}, silent)
            .coefficients;
    }
};

TEST_F(InflowOf, APartOfAGridAloneIsAsInAllOfIt) {
    // Lamps inside the part and beside it; the same cells, so that nothing else differs.
    const Grid part{glm::dvec3(2, 3, 2), 1.0, {5, 3, 6}};
    for (const bool beside : {true, false}) {
        Injection lamps = empty(coarse_grid), own = empty(part);
        const auto add = [&](glm::ivec3 cell, glm::dvec3 towards) {
            const oracle::Lobe lobe{1 / (4 * pi), glm::normalize(towards) / (2 * pi)};
            put(lamps.coefficients, coarse_grid.index(cell), 0, lobe);
            lamps.power += 1;
            const glm::ivec3 inside = cell - glm::ivec3(2, 3, 2);
            if (part.contains(inside)) {
                put(own.coefficients, part.index(inside), 0, lobe);
                own.power += 1;
            }
        };
        add({4, 4, 4}, {1, 2, 3});
        if (beside) {
            add({0, 7, 1}, {1, -1, 1});
            add({8, 1, 8}, {-1, 1, 0});
        }
        SolvedLevel all = dark();
        all.coefficients = run(coarse_grid, lamps);
        const Injection shut = own;
        for (int side = 0; side < 6; ++side)
            solver::lpv::let_flow(all, part, side, nullptr, own);
        const std::vector<float> field = run(part, own), without = run(part, shut);
        double sum = 0, off = 0, dark = 0;
        for (std::size_t i = 0; i < part.size(); ++i) {
            const double all_of_it = double(
                all.coefficients[12 * coarse_grid.index(part.cell_at(i) + glm::ivec3(2, 3, 2))]);
            sum += all_of_it;
            off += std::abs(double(field[12 * i]) - all_of_it);
            dark += std::abs(double(without[12 * i]) - all_of_it);
        }
        EXPECT_LT(off, 2e-3 * sum) << beside; // of clamps, which do not act on sums as on parts
        EXPECT_GT(dark, 0.2 * sum) << beside;
    }
}

} // namespace
} // namespace lpvbake
