#include "solver/lpv/inject.h"

#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

const Grid grid{glm::dvec3(0.0), 1.0, {8, 8, 8}};
const scene::Frame frame{glm::dvec3(0.0), 1.0, glm::dvec3(8.0)};

solver::lpv::Injection inject_one(const solver::vpl::Vpl& vpl, const Scene& scene = {}) {
    const visibility::Visibility visibility(scene, frame);
    return solver::lpv::inject(std::span(&vpl, 1), visibility, grid);
}

/// The one cell that holds light; fails if there are more.
glm::ivec3 lit_cell(const solver::lpv::Injection& injection) {
    glm::ivec3 found{-1};
    for (int z = 0; z < 8; ++z)
        for (int y = 0; y < 8; ++y)
            for (int x = 0; x < 8; ++x)
                if (injection.coefficients[12 * grid.index({x, y, z})] != 0.0f) {
                    EXPECT_EQ(found, glm::ivec3(-1));
                    found = {x, y, z};
                }
    return found;
}

TEST(Inject, ALobeHoldsItsPowerAndItsDirection) {
    const glm::vec3 n = glm::normalize(glm::vec3(1, -2, 3));
    const solver::lpv::Injection injection = inject_one({glm::vec3(4.2f), n, {2, 4, 8}});
    EXPECT_DOUBLE_EQ(injection.power, 14.0);
    EXPECT_EQ(injection.lost, 0.0);
    const glm::ivec3 cell = lit_cell(injection);
    for (size_t channel = 0; channel < 3; ++channel) {
        const float* c = &injection.coefficients[12 * grid.index(cell) + 4 * channel];
        const double phi = 2.0 * double(1 << channel), pi = glm::pi<double>();
        EXPECT_NEAR(std::sqrt(4.0 * pi) * double(c[0]), phi, 1e-5 * phi);
        // The clamped cosine's linear part by quadrature over the sphere.
        double y = 0.0;
        const int m = 400;
        for (int i = 0; i < m; ++i)
            for (int j = 0; j < 2 * m; ++j) {
                const double z = 1.0 - 2.0 * (i + 0.5) / m, r = std::sqrt(1.0 - z * z);
                const double a = pi * (j + 0.5) / m;
                const glm::dvec3 w{r * std::cos(a), r * std::sin(a), z};
                y += phi / pi * std::max(0.0, glm::dot(w, glm::dvec3(n))) * w.y
                     * std::sqrt(3.0 / (4.0 * pi)) * (4.0 * pi / (2.0 * m * m));
            }
        EXPECT_NEAR(double(c[1]), y, 1e-3 * phi);
        EXPECT_NEAR(double(c[2] / c[1]), double(n.z / n.y), 1e-5);
        EXPECT_NEAR(double(c[3] / c[1]), double(n.x / n.y), 1e-5);
    }
}

TEST(Inject, GoesHalfACellAlongTheNormal) {
    EXPECT_EQ(lit_cell(inject_one({{4.0f, 4.5f, 4.5f}, {1, 0, 0}, glm::vec3(1)})),
              glm::ivec3(4, 4, 4));
    EXPECT_EQ(lit_cell(inject_one({{4.0f, 4.5f, 4.5f}, {-1, 0, 0}, glm::vec3(1)})),
              glm::ivec3(3, 4, 4));
}

TEST(Inject, LightThatLeavesTheGridIsCountedAsLost) {
    for (const solver::vpl::Vpl& vpl : {solver::vpl::Vpl{{0.0f, 4, 4}, {-1, 0, 0}, glm::vec3(1)},
                                        solver::vpl::Vpl{{-3.0f, 4, 4}, {1, 0, 0}, glm::vec3(1)},
                                        solver::vpl::Vpl{{20.0f, 4, 4}, {1, 0, 0}, glm::vec3(1)}}) {
        const solver::lpv::Injection injection = inject_one(vpl);
        EXPECT_EQ(injection.power, 0.0);
        EXPECT_DOUBLE_EQ(injection.lost, 3.0);
        EXPECT_EQ(injection.shut, 0.0);
        for (const float c : injection.coefficients)
            ASSERT_EQ(c, 0.0f);
    }
}

TEST(Inject, NeverStartsBehindItsSurface) {
    std::mt19937 random(1);
    std::normal_distribution<float> normal;
    std::uniform_real_distribution<float> at(2.0f, 6.0f);
    for (int i = 0; i < 500; ++i) {
        const glm::vec3 n =
            glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
        const glm::vec3 p{at(random), at(random), at(random)};
        const glm::ivec3 cell = lit_cell(inject_one({p, n, glm::vec3(1)}));
        ASSERT_TRUE(grid.contains(cell));
        EXPECT_GT(glm::dot(glm::vec3(cell) + 0.5f - p, n), 0.0f);
    }
}

TEST(Inject, NeverStartsBehindAnotherWall) {
    // A corridor half a cell wide between x = 4.0 and x = 4.4: no centre lies in it along x, so
    // light from its left wall finds no cell.
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    for (const float x : {4.0f, 4.4f})
        scenes::add_quad(scene, material, {x, -20, -20}, {0, 50, 0}, {0, 0, 50});
    const solver::lpv::Injection injection =
        inject_one({{4.0f, 4.5f, 4.5f}, {1, 0, 0}, glm::vec3(1)}, scene);
    EXPECT_EQ(injection.power, 0.0);
    EXPECT_DOUBLE_EQ(injection.lost, 3.0);
    EXPECT_DOUBLE_EQ(injection.shut, 3.0); // and told
}

} // namespace
} // namespace lpvbake
