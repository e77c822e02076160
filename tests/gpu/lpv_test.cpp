// The propagation against an independent oracle and against what physics demands of it.
#include "solver/lpv/lpv.h"

#include "gpu/device.h"
#include "oracles/lpv_oracle.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <numeric>
#include <random>

namespace lpvbake {
namespace {

const double pi = glm::pi<double>();

Grid grid_of(glm::ivec3 dims) {
    return {glm::dvec3(0.0), 1.0, dims};
}

/// SH of I(w) = constant + vector.w: divides by the basis functions' factors.
void put(std::vector<float>& coefficients, size_t cell, size_t channel, const oracle::Lobe& lobe) {
    float* c = &coefficients[12 * cell + 4 * channel];
    c[0] = float(lobe.constant * std::sqrt(4.0 * pi));
    c[1] = float(lobe.vector.y * std::sqrt(4.0 * pi / 3.0));
    c[2] = float(lobe.vector.z * std::sqrt(4.0 * pi / 3.0));
    c[3] = float(lobe.vector.x * std::sqrt(4.0 * pi / 3.0));
}

oracle::Lobe get(const std::vector<float>& coefficients, size_t cell, size_t channel) {
    const float* c = &coefficients[12 * cell + 4 * channel];
    return {double(c[0]) / std::sqrt(4.0 * pi),
            glm::dvec3(c[3], c[1], c[2]) / std::sqrt(4.0 * pi / 3.0)};
}

double power_of(const std::vector<float>& coefficients) {
    double sum = 0.0;
    for (size_t i = 0; i < coefficients.size(); i += 4)
        sum += std::sqrt(4.0 * pi) * double(coefficients[i]);
    return sum;
}

/// A few Lambert emitters, each channel its own.
std::array<oracle::Field, 3> random_emitters(const Grid& grid, int count, uint32_t seed) {
    std::array<oracle::Field, 3> fields;
    for (auto& field : fields)
        field.resize(grid.size());
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0), both(-1.0, 1.0);
    for (int i = 0; i < count; ++i)
        for (auto& field : fields) {
            oracle::Lobe& lobe = field[random() % grid.size()];
            const double phi = unit(random);
            lobe.constant += phi / (4.0 * pi);
            lobe.vector += phi / (2.0 * pi)
                           * glm::normalize(glm::dvec3(both(random), both(random), both(random)));
        }
    return fields;
}

solver::lpv::Injection injection_of(const std::array<oracle::Field, 3>& fields) {
    solver::lpv::Injection injection;
    injection.coefficients.resize(12 * fields[0].size());
    for (size_t channel = 0; channel < 3; ++channel) {
        for (size_t cell = 0; cell < fields[channel].size(); ++cell)
            put(injection.coefficients, cell, channel, fields[channel][cell]);
        injection.power += oracle::power(fields[channel]);
    }
    return injection;
}

std::vector<float> random_transmittance(size_t count, uint32_t seed) {
    std::vector<float> values(count);
    std::mt19937 random(seed);
    for (float& value : values) {
        const uint32_t draw = random() % 4;
        value = draw == 0 ? 0.0f : draw == 1 ? 1.0f : float(random() % 1000) / 1000.0f;
    }
    return values;
}

size_t axis_index(glm::ivec3 d) {
    const size_t axis = d.x ? 0 : d.y ? 1 : 2;
    return 2 * axis + (d[int(axis)] < 0);
}

/// Largest difference over the field's largest value.
double difference(const std::vector<float>& ours, const std::array<oracle::Field, 3>& theirs) {
    double largest = 0.0, off = 0.0;
    for (size_t channel = 0; channel < 3; ++channel)
        for (size_t cell = 0; cell < theirs[channel].size(); ++cell) {
            const oracle::Lobe a = get(ours, cell, channel), &b = theirs[channel][cell];
            largest = std::max({largest, std::abs(b.constant), glm::length(b.vector)});
            off = std::max(
                {off, std::abs(a.constant - b.constant), glm::length(a.vector - b.vector)});
        }
    return off / largest;
}

solver::lpv::LpvSettings steps(int iterations,
                               solver::lpv::Occlusion occlusion = solver::lpv::Occlusion::none) {
    solver::lpv::LpvSettings settings;
    settings.iterations = iterations;
    settings.occlusion = occlusion;
    return settings;
}

class Lpv : public testing::DeviceTest {
protected:
    solver::lpv::LpvField run(const Grid& grid, const solver::lpv::Injection& injection,
                              const std::vector<float>& transmittance,
                              const solver::lpv::LpvSettings& settings, uint64_t window = 0) {
        Progress silent;
        return solver::lpv::LpvProgram(device(), grid, settings.occlusion, window)
            .propagate(injection, transmittance, settings, silent);
    }
};

TEST(LpvFaces, SolidAnglesComeFromTheCube) {
    EXPECT_NEAR(oracle::solid_angle({1.5, 0, 0}, {0, 1, 0}, {0, 0, 1}), 0.4006696846, 1e-6);
    EXPECT_NEAR(oracle::solid_angle({1, 0.5, 0}, {1, 0, 0}, {0, 0, 1}), 0.4234313544, 1e-6);
    // The five faces close off a sixth of the sphere around the source.
    EXPECT_NEAR(0.4006696846 + 4 * 0.4234313544, 4.0 * pi / 6.0, 1e-8);
}

TEST_F(Lpv, AgreesWithTheOracleInEveryMode) {
    for (const glm::ivec3 dims :
         {glm::ivec3(13, 7, 5), glm::ivec3(3, 18, 9), glm::ivec3(1, 1, 6)}) {
        const Grid grid = grid_of(dims);
        const auto fields = random_emitters(grid, 9, 1);
        const solver::lpv::Injection injection = injection_of(fields);
        const std::vector<float> links = random_transmittance(3 * grid.size(), 2);
        const std::vector<float> faces = random_transmittance(30 * grid.size(), 3);
        for (const solver::lpv::Occlusion mode :
             {solver::lpv::Occlusion::none, solver::lpv::Occlusion::face,
              solver::lpv::Occlusion::sh}) {
            const oracle::Transmittance tau = [&](glm::ivec3 s, glm::ivec3 d, glm::ivec3 n) {
                if (mode == solver::lpv::Occlusion::none)
                    return 1.0;
                if (mode == solver::lpv::Occlusion::face) {
                    const glm::ivec3 low = glm::min(s, s + d);
                    return double(links[3 * grid.index(low) + axis_index(d) / 2]);
                }
                // Far, then the sides of the two axes that follow in the cycle x, y, z.
                const size_t next = (axis_index(n) / 2 + 3 - axis_index(d) / 2) % 3;
                const size_t face = next == 0 ? 0 : 2 * next - 1 + axis_index(n) % 2;
                return double(faces[30 * grid.index(s) + 5 * axis_index(d) + face]);
            };
            const solver::lpv::LpvField ours =
                run(grid, injection,
                    mode == solver::lpv::Occlusion::none   ? std::vector<float>{}
                    : mode == solver::lpv::Occlusion::face ? links
                                                           : faces,
                    steps(7, mode));
            std::array<oracle::Field, 3> theirs;
            double front = 0.0;
            for (size_t channel = 0; channel < 3; ++channel) {
                const oracle::Propagated p = oracle::propagate(dims, fields[channel], 7, tau,
                                                               mode == solver::lpv::Occlusion::sh);
                theirs[channel] = p.sum;
                front += oracle::power(p.front);
            }
            EXPECT_LT(difference(ours.coefficients, theirs), 1e-5) << dims.x << ' ' << int(mode);
            EXPECT_NEAR(ours.residual, front / injection.power, 1e-5);
        }
    }
}

TEST_F(Lpv, ConservesPowerInEmptySpaceUntilItLeaves) {
    const Grid grid = grid_of(glm::ivec3(25));
    std::array<oracle::Field, 3> fields;
    for (size_t channel = 0; channel < 3; ++channel) {
        fields[channel].resize(grid.size());
        // A cosine lobe (where the clamp acts), a uniform source, and one between.
        const double tilt[3] = {0.5, 0.0, 0.2};
        fields[channel][grid.index({12, 12, 12})] = {
            0.25 / pi, tilt[channel] / pi * glm::normalize(glm::dvec3(1, 2, 3))};
    }
    const solver::lpv::Injection injection = injection_of(fields);
    double before = power_of(injection.coefficients);
    for (int n = 1; n <= 11; ++n) {
        const solver::lpv::LpvField field = run(grid, injection, {}, steps(n));
        EXPECT_NEAR(field.residual, 1.0, 1e-5 * n);
        const double after = power_of(field.coefficients);
        EXPECT_NEAR((after - before) / injection.power, 1.0, 1e-5) << n;
        before = after;
    }
}

TEST_F(Lpv, IsLinearOverEighteenOrdersOfMagnitude) {
    const Grid grid = grid_of({9, 8, 7});
    const solver::lpv::Injection injection = injection_of(random_emitters(grid, 5, 4));
    const std::vector<float> links = random_transmittance(3 * grid.size(), 5);
    const solver::lpv::LpvField one =
        run(grid, injection, links, steps(20, solver::lpv::Occlusion::face));
    for (const float scale : {1e-9f, 1e9f}) {
        solver::lpv::Injection scaled = injection;
        for (float& c : scaled.coefficients)
            c *= scale;
        scaled.power *= double(scale);
        const solver::lpv::LpvField field =
            run(grid, scaled, links, steps(20, solver::lpv::Occlusion::face));
        EXPECT_NEAR(field.residual, one.residual, 1e-5);
        for (size_t i = 0; i < field.coefficients.size(); ++i)
            ASSERT_NEAR(field.coefficients[i] / scale, one.coefficients[i],
                        1e-5 * std::abs(one.coefficients[i]) + 1e-7);
    }
}

TEST_F(Lpv, TurnsWithItsGrid) {
    // A quarter turn about z: (x, y) -> (-y, x).
    const Grid grid = grid_of({9, 6, 5}), turned = grid_of({6, 9, 5});
    const auto fields = random_emitters(grid, 6, 6);
    const auto turn_cell = [&](glm::ivec3 c) { return glm::ivec3(5 - c.y, c.x, c.z); };
    const auto turn = [](glm::dvec3 v) { return glm::dvec3(-v.y, v.x, v.z); };
    const std::vector<float> links = random_transmittance(3 * grid.size(), 7);
    std::vector<float> turned_links(links.size(), 1.0f);
    std::array<oracle::Field, 3> turned_fields;
    for (auto& field : turned_fields)
        field.resize(grid.size());
    for (int z = 0; z < 5; ++z)
        for (int y = 0; y < 6; ++y)
            for (int x = 0; x < 9; ++x) {
                const glm::ivec3 c{x, y, z}, t = turn_cell(c);
                const size_t i = grid.index(c), j = turned.index(t);
                for (size_t channel = 0; channel < 3; ++channel)
                    turned_fields[channel][j] = {fields[channel][i].constant,
                                                 turn(fields[channel][i].vector)};
                turned_links[3 * j + 1] = links[3 * i]; // +x becomes +y
                if (t.x > 0) // +y becomes -x: the link belongs to the neighbour
                    turned_links[3 * turned.index(t - glm::ivec3(1, 0, 0))] = links[3 * i + 1];
                turned_links[3 * j + 2] = links[3 * i + 2];
            }
    const solver::lpv::LpvField a =
        run(grid, injection_of(fields), links, steps(12, solver::lpv::Occlusion::face));
    const solver::lpv::LpvField b = run(turned, injection_of(turned_fields), turned_links,
                                        steps(12, solver::lpv::Occlusion::face));
    std::array<oracle::Field, 3> expected;
    for (size_t channel = 0; channel < 3; ++channel) {
        expected[channel].resize(grid.size());
        for (int z = 0; z < 5; ++z)
            for (int y = 0; y < 6; ++y)
                for (int x = 0; x < 9; ++x) {
                    const oracle::Lobe lobe = get(a.coefficients, grid.index({x, y, z}), channel);
                    expected[channel][turned.index(turn_cell({x, y, z}))] = {lobe.constant,
                                                                             turn(lobe.vector)};
                }
    }
    EXPECT_LT(difference(b.coefficients, expected), 1e-6);
}

TEST_F(Lpv, DecaysOverAThousandIterations) {
    const Grid grid = grid_of({12, 12, 12});
    const solver::lpv::Injection injection = injection_of(random_emitters(grid, 5, 8));
    const solver::lpv::LpvField field = run(grid, injection, {}, steps(1000));
    EXPECT_LT(field.residual, 1e-12);
    for (const float c : field.coefficients)
        ASSERT_TRUE(std::isfinite(c));
    // A closed box without absorption keeps all of it: stable, neither growing nor fading.
    std::vector<float> links(3 * grid.size(), 1.0f);
    for (int z = 0; z < 12; ++z)
        for (int y = 0; y < 12; ++y)
            for (int x = 0; x < 12; ++x)
                for (int axis = 0; axis < 3; ++axis)
                    if (glm::ivec3(x, y, z)[axis] == 5)
                        links[3 * grid.index({x, y, z}) + size_t(axis)] = 0.0f;
    const solver::lpv::LpvField half =
        run(grid, injection, links, steps(1000, solver::lpv::Occlusion::face));
    EXPECT_LT(half.residual, 1e-6);
    EXPECT_TRUE(std::all_of(half.coefficients.begin(), half.coefficients.end(),
                            [](float c) { return std::isfinite(c); }));
}

TEST_F(Lpv, StopsWhenTheFrontIsSpent) {
    const Grid grid = grid_of({10, 10, 10});
    const solver::lpv::Injection injection = injection_of(random_emitters(grid, 5, 9));
    solver::lpv::LpvSettings settings = steps(0);
    settings.tolerance = 1e-2f;
    const solver::lpv::LpvField loose = run(grid, injection, {}, settings);
    settings.tolerance = 1e-5f;
    const solver::lpv::LpvField tight = run(grid, injection, {}, settings);
    EXPECT_LT(loose.residual, 1e-2);
    EXPECT_LT(tight.residual, 1e-5);
    EXPECT_GT(tight.iterations, loose.iterations);
    // A pair of steps less would not have been enough.
    EXPECT_GT(run(grid, injection, {}, steps(tight.iterations - 16)).residual, 1e-5);
}

TEST_F(Lpv, DarkInputCostsNoIteration) {
    const Grid grid = grid_of({4, 4, 4});
    solver::lpv::Injection dark;
    dark.coefficients.assign(12 * grid.size(), 0.0f);
    const solver::lpv::LpvField field = run(grid, dark, {}, steps(0));
    EXPECT_EQ(field.iterations, 0);
    EXPECT_EQ(power_of(field.coefficients), 0.0);
}

TEST_F(Lpv, GivesTheSameBitsRunAfterRunAndWindowByWindow) {
    const Grid grid = grid_of({21, 17, 23});
    const solver::lpv::Injection injection = injection_of(random_emitters(grid, 20, 10));
    for (const solver::lpv::Occlusion mode :
         {solver::lpv::Occlusion::none, solver::lpv::Occlusion::face, solver::lpv::Occlusion::sh}) {
        const std::vector<float> tau = random_transmittance(
            mode == solver::lpv::Occlusion::none
                ? 0
                : (mode == solver::lpv::Occlusion::face ? 3 : 30) * grid.size(),
            11);
        const solver::lpv::LpvField whole = run(grid, injection, tau, steps(9, mode));
        EXPECT_EQ(run(grid, injection, tau, steps(9, mode)).coefficients, whole.coefficients);
        // Windows of a few layers stand for buffers larger than a binding may be.
        const solver::lpv::LpvField slabs = run(grid, injection, tau, steps(9, mode), 300'000);
        EXPECT_EQ(slabs.coefficients, whole.coefficients);
        EXPECT_NEAR(slabs.residual, whole.residual, 1e-6); // its partial sums are cut otherwise
    }
}

TEST(ToLuminance, AUniformCellReadsItsIntensityOverItsMeanProjectedArea) {
    Volume volume;
    volume.grid = {glm::dvec3(0.0), 0.5, {1, 1, 1}};
    solver::lpv::LpvField field;
    field.coefficients.resize(12);
    put(field.coefficients, 0, 0, {3.0, glm::dvec3(0.0)});
    put(field.coefficients, 0, 1, {1.0, {1, 0, 0}}); // travels towards +x
    solver::lpv::to_luminance(field, volume);
    const double area = 1.5 * 0.5 * 0.5;
    EXPECT_NEAR(double(volume.sh[0][0].r) * double(volume::sh_y0), 3.0 / area, 1e-4);
    // It arrives from -x: a plane that faces -x is the brighter one.
    std::array<float, 4> green;
    for (size_t k = 0; k < 4; ++k)
        green[k] = volume.sh[k][0].g;
    EXPECT_GT(volume::sh_irradiance(green, {-1, 0, 0}), volume::sh_irradiance(green, {1, 0, 0}));
    EXPECT_NEAR(double(volume::sh_irradiance(green, {-1, 0, 0})), (pi + 2.0 * pi / 3.0) / area,
                1e-4);
}

} // namespace
} // namespace lpvbake
