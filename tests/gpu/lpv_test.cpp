// The propagation against an independent oracle and against what physics demands of it.
#include "solver/lpv/lpv.h"

#include "gpu/device.h"
#include "oracles/lpv_oracle.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <numeric>
#include <random>
#include <tuple>

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

/// Links of a grid whose walls are planes: `is_wall` says whether that between a cell and the next
/// towards + of an axis is closed.
template <class IsWall>
std::vector<float> walled(const Grid& grid, const IsWall& is_wall) {
    std::vector<float> links(3 * grid.size());
    for (size_t i = 0; i < grid.size(); ++i)
        for (int axis = 0; axis < 3; ++axis)
            links[3 * i + size_t(axis)] = is_wall(grid.cell_at(i), axis) ? 0.0f : 1.0f;
    return links;
}

/// A closed box, two cells from the grid's sides, with a block in it.
std::vector<float> box_with_block(const Grid& grid) {
    const auto in_block = [&](glm::ivec3 c) {
        return glm::all(glm::greaterThanEqual(c, grid.dims / 3))
               && glm::all(glm::lessThan(c, grid.dims / 2));
    };
    return walled(grid, [&](glm::ivec3 c, int axis) {
        glm::ivec3 next = c;
        ++next[axis];
        return c[axis] == 1 || c[axis] == grid.dims[axis] - 3 || in_block(c) || in_block(next);
    });
}

/// Walls without thickness at every third layer, a hole in each, by turns at either end.
std::vector<float> corridors(const Grid& grid) {
    return walled(grid, [&](glm::ivec3 c, int axis) {
        if (axis != 0 || c.x % 3 != 2)
            return false;
        const int from_end = c.x / 3 % 2 ? c.y : grid.dims.y - 1 - c.y;
        return from_end > 2 || c.z < 3 || c.z > 7;
    });
}

/// A room in four by walls of no thickness, with doors.
std::vector<float> rooms(const Grid& grid) {
    return walled(grid, [&](glm::ivec3 c, int axis) {
        const bool box = c[axis] == 0 || c[axis] == grid.dims[axis] - 2;
        const bool door = c.z > 2 && c.z < 9 && std::abs(c[(axis + 1) % 3] % 12 - 6) < 2;
        return box || (axis < 2 && c[axis] == grid.dims[axis] / 2 && !door);
    });
}

/// Power of the difference over that of `b`.
double missing(const std::vector<float>& a, const std::vector<float>& b) {
    double off = 0.0, sum = 0.0;
    for (size_t i = 0; i < b.size(); i += 4) {
        off += std::abs(double(a[i]) - double(b[i]));
        sum += double(b[i]);
    }
    return off / sum;
}

/// Lights in the middle of cells that are not cut off.
solver::lpv::Injection lamps(const Grid& grid, uint32_t seed) {
    std::array<oracle::Field, 3> fields;
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> both(-1.0, 1.0);
    for (auto& field : fields)
        field.resize(grid.size());
    const auto within = [&](int count) { return 3 + int(random() % uint32_t(count - 6)); };
    for (int i = 0; i < 6; ++i)
        for (auto& field : fields) {
            const glm::ivec3 cell(within(grid.dims.x), within(grid.dims.y), within(grid.dims.z));
            oracle::Lobe& lobe = field[grid.index(cell)];
            lobe.constant += 0.25 / pi;
            lobe.vector +=
                0.5 / pi * glm::normalize(glm::dvec3(both(random), both(random), both(random)));
        }
    return injection_of(fields);
}

TEST_F(Lpv, MissesNoMoreThanTheToleranceInFewSteps) {
    const Grid grid = grid_of({26, 24, 21});
    const solver::lpv::Injection light = lamps(grid, 12);
    const std::vector<float> open(3 * grid.size(), 1.0f);
    for (const auto& [name, links, fronts] :
         {std::tuple("box", box_with_block(grid), 1500), std::tuple("rooms", rooms(grid), 1500),
          std::tuple("corridors", corridors(grid), 500), std::tuple("open", open, 2000)}) {
        const solver::lpv::LpvField all =
            run(grid, light, links, steps(fronts, solver::lpv::Occlusion::face));
        ASSERT_LT(all.residual, 1e-8) << name;
        for (const float tolerance : {0.1f, 1e-2f, 1e-3f, 1e-5f}) {

            solver::lpv::LpvSettings settings = steps(0, solver::lpv::Occlusion::face);
            settings.tolerance = tolerance;
            const solver::lpv::LpvField field = run(grid, light, links, settings);
            EXPECT_TRUE(field.course.linear) << name;
            EXPECT_EQ(field.course.more, 0) << name;
            const double off = missing(field.coefficients, all.coefficients);
            EXPECT_LE(off, field.missing + 2e-6) << name;
            EXPECT_LE(field.missing, tolerance) << name;
            // Fronts alone: 100 to 700 for a hundredth, up to 2000 for the last.
            EXPECT_LE(field.course.iterations(), tolerance < 1e-4f ? 90 : 50) << name;
            for (size_t i = 0; i < field.coefficients.size(); i += 4)
                ASSERT_GE(field.coefficients[i], 0.0f) << name;
        }
    }
}

TEST_F(Lpv, TakesNoMoreStepsInLargerGrids) {
    int least = 1000, most = 0;
    for (const int n : {16, 32, 64}) {
        const Grid grid = grid_of(glm::ivec3(n));
        const solver::lpv::LpvField field = run(grid, lamps(grid, 13), box_with_block(grid),
                                                steps(0, solver::lpv::Occlusion::face));
        least = std::min(least, field.course.iterations());
        most = std::max(most, field.course.iterations());
    }
    EXPECT_LE(most, least + 9);
    EXPECT_LE(most, 40);
}

TEST_F(Lpv, ConvergesInEveryModeAndShape) {
    for (const glm::ivec3 dims : {glm::ivec3(13, 17, 9), glm::ivec3(1, 1, 21), glm::ivec3(20, 1, 7),
                                  glm::ivec3(1, 1, 1), glm::ivec3(2, 3, 2)}) {
        const Grid grid = grid_of(dims);
        const solver::lpv::Injection light = injection_of(random_emitters(grid, 9, 14));
        for (const solver::lpv::Occlusion mode :
             {solver::lpv::Occlusion::none, solver::lpv::Occlusion::face,
              solver::lpv::Occlusion::sh}) {
            const std::vector<float> tau =
                random_transmittance(solver::lpv::planes_of(mode) * grid.size(), 15);
            solver::lpv::LpvSettings settings = steps(0, mode);
            settings.tolerance = 1e-5f;
            const solver::lpv::LpvField field = run(grid, light, tau, settings);
            const solver::lpv::LpvField all = run(grid, light, tau, steps(2000, mode));
            EXPECT_LE(missing(field.coefficients, all.coefficients), 1.2e-5)
                << dims.x << ' ' << int(mode);
            EXPECT_LT(field.course.iterations(), 120) << dims.x << ' ' << int(mode);
        }
    }
}

TEST_F(Lpv, GoesOnByFrontsWherePropagationDoesNotBecomeLinear) {
    // Of all faces a cell shows to another only the far one lets light through: lobes stay as steep
    // as a single face makes them.
    const Grid grid = grid_of({40, 3, 3});
    std::vector<float> tau(30 * grid.size());
    for (size_t i = 0; i < tau.size(); i += 5)
        tau[i] = 1.0f;
    std::array<oracle::Field, 3> fields;
    for (auto& field : fields) {
        field.resize(grid.size());
        field[grid.index({1, 1, 1})] = {0.25 / pi, {0.5 / pi, 0.0, 0.0}};
    }
    const solver::lpv::Injection light = injection_of(fields);
    const solver::lpv::LpvField field = run(grid, light, tau, steps(0, solver::lpv::Occlusion::sh));
    EXPECT_FALSE(field.course.linear);
    EXPECT_EQ(field.course.corrections, 0);
    const solver::lpv::LpvField all = run(grid, light, tau, steps(400, solver::lpv::Occlusion::sh));
    EXPECT_LE(missing(field.coefficients, all.coefficients), 1e-2);
}

TEST_F(Lpv, CorrectionsBringNoLightBehindClosedWalls) {
    const Grid grid = grid_of({24, 20, 20});
    const std::vector<float> links =
        walled(grid, [](glm::ivec3 c, int axis) { return axis == 0 && c.x == 12; });
    std::array<oracle::Field, 3> fields;
    for (auto& field : fields) {
        field.resize(grid.size());
        field[grid.index({11, 9, 9})] = {0.25 / pi, {0.5 / pi, 0.0, 0.0}};
    }
    solver::lpv::LpvSettings settings = steps(0, solver::lpv::Occlusion::face);
    const solver::lpv::LpvField field = run(grid, injection_of(fields), links, settings);
    EXPECT_GT(field.course.corrections, 0);
    for (size_t i = 0; i < field.coefficients.size(); ++i) {
        const bool is_behind = grid.cell_at(i / 12).x > 12;
        ASSERT_TRUE(!is_behind || field.coefficients[i] == 0.0f);
    }
    EXPECT_GT(field.coefficients[12 * grid.index({12, 9, 9})], 0.0f);
}

TEST_F(Lpv, FrontsAloneMissNoMoreThanTheToleranceEither) {
    const Grid grid = grid_of({20, 18, 16});
    const solver::lpv::Injection light = lamps(grid, 16);
    for (const auto& links : {box_with_block(grid), rooms(grid), corridors(grid)}) {
        const solver::lpv::LpvField all =
            run(grid, light, links, steps(1500, solver::lpv::Occlusion::face));
        solver::lpv::LpvSettings settings = steps(0, solver::lpv::Occlusion::face);
        settings.corrections = false;
        const solver::lpv::LpvField field = run(grid, light, links, settings);
        EXPECT_FALSE(field.course.linear);
        EXPECT_LE(missing(field.coefficients, all.coefficients), field.missing);
        EXPECT_LE(field.missing, settings.tolerance);
    }
}

TEST_F(Lpv, DarkInputCostsNoIteration) {
    const Grid grid = grid_of({4, 4, 4});
    solver::lpv::Injection dark;
    dark.coefficients.assign(12 * grid.size(), 0.0f);
    const solver::lpv::LpvField field = run(grid, dark, {}, steps(0));
    EXPECT_EQ(field.course.iterations(), 0);
    EXPECT_EQ(power_of(field.coefficients), 0.0);
}

TEST_F(Lpv, LightThatIsTakenAtOnceEnds) {
    const Grid grid = grid_of({6, 6, 6});
    const std::vector<float> closed(3 * grid.size(), 0.0f);
    const solver::lpv::Injection light = injection_of(random_emitters(grid, 5, 18));
    const solver::lpv::LpvField field =
        run(grid, light, closed, steps(0, solver::lpv::Occlusion::face));
    EXPECT_EQ(field.coefficients, light.coefficients);
    EXPECT_EQ(field.residual, 0.0);
    EXPECT_LE(field.course.iterations(), 8);
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
        // So do corrections.
        solver::lpv::LpvSettings all = steps(0, mode);
        all.tolerance = 1e-6f;
        const solver::lpv::LpvField full = run(grid, injection, tau, all);
        EXPECT_GT(full.course.corrections, 0) << int(mode);
        EXPECT_EQ(run(grid, injection, tau, all).coefficients, full.coefficients);
        EXPECT_EQ(run(grid, injection, tau, all, 300'000).coefficients, full.coefficients);
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
