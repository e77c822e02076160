// Reading a field between its cells, against fields whose value is known everywhere.

#include "volume/sampler.h"

#include "volume/sh.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

namespace lpvbake {
namespace {

using std::numbers::pi;

/// A field of the same luminance from all sides in each cell: irradiance is pi times it.
template <class Luminance>
Volume isotropic(glm::ivec3 dims, const Luminance& luminance) {
    Volume volume;
    volume.grid = {{-3.0, 5.0, 0.25}, 0.5, dims};
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    volume.validity.assign(volume.grid.size(), 1.0f);
    glm::ivec3 c;
    for (c.z = 0; c.z < dims.z; ++c.z)
        for (c.y = 0; c.y < dims.y; ++c.y)
            for (c.x = 0; c.x < dims.x; ++c.x)
                volume.sh[0][volume.grid.index(c)] =
                    glm::vec3(luminance(volume.grid.center(c)) / volume::sh_y0);
    return volume;
}

class Points {
public:
    explicit Points(const Grid& grid) : grid_(grid) {}
    /// Anywhere in the grid's box.
    glm::dvec3 point() {
        return grid_.origin
               + grid_.cell * glm::dvec3(grid_.dims)
                     * glm::dvec3(share_(random_), share_(random_), share_(random_));
    }
    glm::dvec3 normal() {
        return glm::normalize(glm::dvec3(bell_(random_), bell_(random_), bell_(random_)));
    }

private:
    Grid grid_;
    std::mt19937 random_{7};
    std::uniform_real_distribution<double> share_;
    std::normal_distribution<double> bell_;
};

TEST(Sampler, AConstantFieldIsReadExactlyEverywhere) {
    Volume volume = isotropic({4, 5, 6}, [](glm::dvec3) { return 2.0; });
    std::mt19937 random(1);
    for (size_t i = 0; i < volume.validity.size(); ++i)
        if (random() % 3 == 0) { // and what lies inside geometry has no say
            volume.validity[i] = 0;
            volume.sh[0][i] = glm::vec3(1e6f);
        }
    Points points(volume.grid);
    for (int i = 0; i < 1000; ++i) {
        const glm::dvec3 e =
            read_irradiance(volume, points.point(), points.normal(), Reading::facing);
        for (int c = 0; c < 3; ++c)
            ASSERT_NEAR(e[c], 2 * pi, 1e-5);
    }
}

TEST(Sampler, TrilinearReadsALinearFieldExactly) {
    const auto linear = [](glm::dvec3 p) { return 20 + p.x - 2 * p.y + 3 * p.z; };
    const Volume volume = isotropic({4, 5, 6}, linear);
    Points points(volume.grid);
    for (int i = 0; i < 1000; ++i) {
        const glm::dvec3 p = points.point();
        const glm::dvec3 hull =
            glm::clamp(p, volume.grid.center({0, 0, 0}), volume.grid.center(volume.grid.dims - 1));
        ASSERT_NEAR(read_irradiance(volume, p, points.normal(), Reading::trilinear).y,
                    pi * linear(hull), 1e-4);
    }
}

TEST(Sampler, FacingReadsWhatLiesBeforeTheSurface) {
    const auto linear = [](glm::dvec3 p) { return 20 + p.x - 2 * p.y + 3 * p.z; };
    const Volume volume = isotropic({4, 4, 4}, linear);
    // Between eight centres the four before the surface count alike, at their middle.
    const glm::dvec3 p = volume.grid.center({1, 1, 1}) + 0.5 * volume.grid.cell;
    for (int axis = 0; axis < 3; ++axis)
        for (const double side : {-1.0, 1.0}) {
            glm::dvec3 n(0);
            n[axis] = side;
            EXPECT_NEAR(read_irradiance(volume, p, n, Reading::facing).x,
                        pi * linear(p + 0.5 * volume.grid.cell * n), 1e-4);
        }
    // Weights by hand: nearer the lower centre along x, normal along the diagonal of x and y.
    const glm::dvec3 q = p - glm::dvec3(0.25 * volume.grid.cell, 0, 0);
    const glm::dvec3 n = glm::normalize(glm::dvec3(1, 1, 0));
    double sum = 0, whole = 0;
    for (const double x : {-0.25, 0.75})
        for (const double y : {-0.5, 0.5})
            for (const double z : {-0.5, 0.5}) {
                const glm::dvec3 way = glm::dvec3(x, y, z) + 0.1 * n; // from below the surface
                const double along = std::max(0.0, glm::dot(way, n));
                const double w = (x < 0 ? 0.75 : 0.25) * along * along / glm::dot(way, way);
                sum += w * linear(q + volume.grid.cell * glm::dvec3(x, y, z));
                whole += w;
            }
    EXPECT_NEAR(read_irradiance(volume, q, n, Reading::facing).x, pi * sum / whole, 1e-4);
}

TEST(Sampler, AWallDoesNotBleed) {
    // Bright beyond x = -2 (layers 2 and 3), dark before it; layer 2 lies inside the wall.
    Volume volume = isotropic({6, 4, 4}, [](glm::dvec3 p) { return p.x > -2 ? 100.0 : 1.0; });
    glm::ivec3 c(2, 0, 0);
    for (c.z = 0; c.z < 4; ++c.z)
        for (c.y = 0; c.y < 4; ++c.y)
            volume.validity[volume.grid.index(c)] = 0;
    const glm::dvec3 wall(-2.0, 6.1, 1.3);
    EXPECT_NEAR(read_irradiance(volume, wall, {-1, 0, 0}, Reading::facing).x, pi, 1e-5);
    EXPECT_GT(read_irradiance(volume, wall, {-1, 0, 0}, Reading::trilinear).x, 10 * pi);
    // A thin wall: no cell is inside it, and the bright ones behind it are not faced.
    volume.validity.assign(volume.validity.size(), 1.0f);
    EXPECT_NEAR(read_irradiance(volume, wall, {-1, 0, 0}, Reading::facing).x, pi, 1e-5);
}

TEST(Sampler, WhatLiesBehindACellsWallsIsNotReadFromIt) {
    const auto linear = [](glm::dvec3 p) { return 20 + p.x - 2 * p.y + 3 * p.z; };
    Volume volume = isotropic({6, 6, 6}, linear);
    volume.walls.assign(2, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    const auto cell = [&](int x, int y, int z) { return volume.grid.index({x, y, z}); };
    const auto value = [&](int x, int y, int z) {
        return pi * linear(volume.grid.center({x, y, z}));
    };
    // Amid eight centres, 0.5 below the four that it faces, and 0.3 once it is lifted: the first
    // and the second stand before a wall that the point is behind, the third is half faded.
    const glm::dvec3 p = volume.grid.center({2, 2, 2}) + 0.5 * volume.grid.cell;
    volume.walls[0][cell(2, 3, 2)] = {0.4f, 0.0f, 0.0f};
    volume.walls[1][cell(2, 3, 3)] = {0.3f, 0.0f, -0.1f};
    volume.walls[1][cell(3, 3, 2)] = {0.0f, 0.0f, 0.6f};
    const double third = value(3, 3, 2), fourth = value(3, 3, 3);
    EXPECT_NEAR(read_irradiance(volume, p, {0, 1, 0}, Reading::facing).x,
                (0.5 * third + fourth) / 1.5, 1e-4);
    // Behind the walls of all four: of those half a cell further the three that do not hide it.
    const glm::dvec3 q =
        volume.grid.center({2, 2, 2}) + volume.grid.cell * glm::dvec3(0.6, 0.8, 0.55);
    volume.walls[0][cell(3, 3, 2)] = volume.walls[0][cell(3, 3, 3)] = {-0.3f, 0.0f, 0.0f};
    volume.walls[0][cell(3, 4, 3)] = {0.0f, -0.5f, 0.0f};
    volume.walls[0][cell(3, 4, 2)] = {0.0f, -1.4f, 0.0f};
    double sum = 0, whole = 0;
    for (const auto& [at, share] :
         {std::pair(glm::ivec3(2, 4, 2), 0.4 * 0.45), std::pair(glm::ivec3(2, 4, 3), 0.4 * 0.55),
          std::pair(glm::ivec3(3, 4, 2), 0.6 * 0.45)}) {
        const glm::dvec3 way = glm::dvec3(at) - glm::dvec3(2.6, 2.7, 2.55); // 0.1 below
        const double w = share * way.y * way.y / glm::dot(way, way);
        sum += w * value(at.x, at.y, at.z);
        whole += w;
    }
    EXPECT_NEAR(read_irradiance(volume, q, {0, 1, 0}, Reading::facing).x, sum / whole, 1e-4);
    // Behind theirs, too: the nearest one further off that is not hidden either.
    for (const size_t each : {cell(2, 4, 2), cell(2, 4, 3), cell(3, 4, 2)})
        volume.walls[0][each] = {0.0f, -0.5f, 0.0f};
    EXPECT_NEAR(read_irradiance(volume, q, {0, 1, 0}, Reading::facing).x, value(4, 3, 3), 1e-4);
    // Behind whatever there is: as if there were no walls.
    for (glm::vec3& wall : volume.walls[0])
        wall = glm::vec3(1e-3f);
    for (glm::vec3& wall : volume.walls[1])
        wall = glm::vec3(-1e-3f);
    const double all = read_irradiance(volume, p, {0, 1, 0}, Reading::facing).x;
    volume.walls.clear();
    EXPECT_EQ(all, read_irradiance(volume, p, {0, 1, 0}, Reading::facing).x);
    EXPECT_NEAR(all, (value(2, 3, 2) + value(2, 3, 3) + third + fourth) / 4, 1e-4);
}

TEST(Sampler, FallsBackToValidThenToNearThenToDark) {
    Volume volume = isotropic({6, 6, 6}, [](glm::dvec3 p) { return p.x + 10; });
    const glm::dvec3 p = volume.grid.center({2, 2, 2}) + 0.25 * volume.grid.cell;
    // Valid, but none is faced: the one behind.
    volume.validity.assign(volume.validity.size(), 0.0f);
    const auto allow = [&](glm::ivec3 cell) { volume.validity[volume.grid.index(cell)] = 1; };
    allow({2, 2, 2});
    const auto value = [&](glm::ivec3 cell) { return pi * (volume.grid.center(cell).x + 10); };
    EXPECT_NEAR(read_irradiance(volume, p, {1, 0, 0}, Reading::facing).x, value({2, 2, 2}), 1e-4);
    // None of the eight: the nearer of two further ones, whatever the normal.
    volume.validity.assign(volume.validity.size(), 0.0f);
    allow({1, 2, 2});
    allow({4, 4, 4});
    EXPECT_NEAR(read_irradiance(volume, p, {1, 0, 0}, Reading::facing).x, value({1, 2, 2}), 1e-4);
    // None near.
    volume.validity.assign(volume.validity.size(), 0.0f);
    allow({5, 5, 5});
    EXPECT_EQ(read_irradiance(volume, p, {1, 0, 0}, Reading::facing), glm::dvec3(0.0));
    const volume::CellWeights weights = volume::weights_at(volume, p, {1, 0, 0}, Reading::facing);
    for (const double weight : weights.weight)
        EXPECT_EQ(weight, 0.0);
}

TEST(Sampler, DirectionsAreReadAsIrradiance) {
    Volume volume = isotropic({1, 1, 1}, [](glm::dvec3) { return 1.0; }); // one cell, clamped
    volume.sh[1][0] = glm::vec3(0.0f, 0.1f, 10.0f);                       // brighter from +y
    const glm::dvec3 p = volume.grid.center({0, 0, 0});
    const glm::dvec3 up = read_irradiance(volume, p, {0, 1, 0}, Reading::facing);
    const glm::dvec3 down = read_irradiance(volume, p, {0, -1, 0}, Reading::facing);
    const double slope = 2 * pi / 3 * std::sqrt(3 / pi) / 2;
    EXPECT_NEAR(up.y, pi + 0.1 * slope, 1e-5);
    EXPECT_NEAR(down.y, pi - 0.1 * slope, 1e-5);
    EXPECT_NEAR(up.z, pi + 10 * slope, 1e-4);
    EXPECT_EQ(down.z, 0.0); // clamped
}

} // namespace
} // namespace lpvbake
