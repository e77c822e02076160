// Virtual point lights beside the grid.
#include "solver/vpl/entering.h"

#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

namespace lpvbake {
namespace {

const scene::Frame frame{glm::dvec3(0.0), 1.0, glm::dvec3(8.0)};

std::vector<solver::vpl::Vpl> let_in(std::vector<solver::vpl::Vpl> vpls, const Scene& scene = {}) {
    const visibility::Visibility visibility(scene, frame);
    solver::vpl::let_in(vpls, visibility, frame);
    return vpls;
}

double power_of(const std::vector<solver::vpl::Vpl>& vpls) {
    double sum = 0.0;
    for (const solver::vpl::Vpl& vpl : vpls)
        sum += double(vpl.power.y);
    return sum;
}

/// Share of a small surface's light that meets a parallel rectangle before it, whose corner lies
/// straight above (view factor of Howell's catalogue, B-3).
double corner_share(double a, double b, double height) {
    const double x = a / height, y = b / height, p = std::sqrt(1 + x * x), q = std::sqrt(1 + y * y);
    return (x / p * std::atan(y / p) + y / q * std::atan(x / q)) / glm::two_pi<double>();
}

TEST(Entering, WhatComesInIsTheShareThatTheGridIsSeenBy) {
    for (const float away : {0.5f, 3.0f, 20.0f}) {
        // Below the grid's middle, and beside it.
        const auto in = let_in({{{4.0f, -away, 4.0f}, {0, 1, 0}, glm::vec3(7.0f)}});
        EXPECT_NEAR(power_of(in) / (7.0 * 4.0 * corner_share(4, 4, away)), 1.0, 0.03) << away;
        for (const solver::vpl::Vpl& vpl : in) {
            EXPECT_EQ(vpl.position.y, 0.0f);
            EXPECT_GT(vpl.normal.y, 0.0f);
            EXPECT_NEAR(glm::length(vpl.normal), 1.0f, 1e-5f);
        }
    }
    EXPECT_TRUE(let_in({{{4, -2, 4}, {0, -1, 0}, glm::vec3(1.0f)}}).empty());
    EXPECT_TRUE(let_in({{{9, 4, 4}, {1, 0, 0}, glm::vec3(1.0f)}}).empty());
}

TEST(Entering, AllOfAClosedRoomsLightComesIn) {
    // As from the inner side of a sphere around the grid, of which it takes a share that its area
    // says: a convex body meets area / (4 pi R^2) of rays that are everywhere alike.
    std::mt19937 random(3);
    std::normal_distribution<float> normal;
    std::vector<solver::vpl::Vpl> sphere;
    const double radius = 20.0;
    for (int i = 0; i < 4000; ++i) {
        const glm::vec3 way =
            glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
        sphere.push_back({glm::vec3(4.0f) + float(radius) * way, -way, glm::vec3(1.0f)});
    }
    const double area = 6.0 * 64.0;
    EXPECT_NEAR(power_of(let_in(sphere)) / 4000.0,
                area / (4.0 * glm::pi<double>() * radius * radius), 0.0015);
}

TEST(Entering, WhatLiesInTheGridStaysAsItIs) {
    const std::vector<solver::vpl::Vpl> inside{{{0, 4, 4}, {1, 0, 0}, glm::vec3(1.0f)},
                                               {{8, 8, 8}, {0, -1, 0}, glm::vec3(2.0f)},
                                               {{3, 2, 1}, {0, 1, 0}, glm::vec3(3.0f)}};
    const auto in = let_in(inside);
    ASSERT_EQ(in.size(), 3u);
    for (size_t i = 0; i < in.size(); ++i) {
        EXPECT_EQ(in[i].position, inside[i].position);
        EXPECT_EQ(in[i].power, inside[i].power);
    }
}

TEST(Entering, WallsStopIt) {
    Scene scene;
    const int wall = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, wall, {-50, -1, -50}, {0, 0, 100}, {54, 0, 0}); // up to x = 4
    const solver::vpl::Vpl below{{4, -2, 4}, {0, 1, 0}, glm::vec3(1.0f)};
    const auto in = let_in({below}, scene);
    EXPECT_NEAR(power_of(in) / power_of(let_in({below})), 0.5, 0.02);
    for (const solver::vpl::Vpl& vpl : in)
        EXPECT_GT(vpl.position.x, 4.0f);
}

TEST(Entering, SameBitsForAnyNumberOfThreads) {
    std::mt19937 random(4);
    std::uniform_real_distribution<float> place(-9.0f, -1.0f);
    std::vector<solver::vpl::Vpl> vpls;
    for (int i = 0; i < 9000; ++i)
        vpls.push_back(
            {{4 + place(random), place(random), 4 + place(random)}, {0, 1, 0}, glm::vec3(1.0f)});
    const auto many = let_in(vpls);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const auto single = let_in(vpls);
    ASSERT_EQ(many.size(), single.size());
    ASSERT_FALSE(many.empty());
    for (size_t i = 0; i < many.size(); ++i) {
        EXPECT_EQ(many[i].power, single[i].power);
        EXPECT_EQ(many[i].normal, single[i].normal);
    }
}

} // namespace
} // namespace lpvbake
