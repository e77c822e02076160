// From texels to virtual point lights: nothing is lost, and nothing joins that should not.
#include "solver/vpl/rsm.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

namespace lpvbake {
namespace {

solver::vpl::Rsm map_of(int width, int height) {
    solver::vpl::Rsm rsm;
    rsm.width = width;
    rsm.height = height;
    rsm.position.assign(std::size_t(width) * height, glm::vec3(0.5f));
    rsm.normal.assign(std::size_t(width) * height, glm::vec3(0, 1, 0));
    rsm.power.assign(std::size_t(width) * height, glm::vec3(0));
    return rsm;
}

std::vector<solver::vpl::Vpl> clusters(const solver::vpl::Rsm& rsm, int kernel) {
    std::vector<solver::vpl::Vpl> vpls;
    solver::vpl::cluster_vpls(rsm, {}, kernel, vpls);
    return vpls;
}

glm::dvec3 total(const std::vector<solver::vpl::Vpl>& vpls) {
    glm::dvec3 sum(0);
    for (const solver::vpl::Vpl& vpl : vpls)
        sum += glm::dvec3(vpl.power);
    return sum;
}

solver::vpl::Rsm random_map(int width, int height) {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> unit(0, 1);
    solver::vpl::Rsm rsm = map_of(width, height);
    for (std::size_t i = 0; i < rsm.power.size(); ++i) {
        rsm.position[i] = 6.0f * glm::vec3(unit(random), unit(random), unit(random)) - 3.0f;
        rsm.normal[i] = glm::normalize(glm::vec3(unit(random), unit(random), unit(random)) - 0.5f);
        if (unit(random) < 0.7f)
            rsm.power[i] = glm::vec3(unit(random), unit(random), 1e-3f * unit(random));
    }
    return rsm;
}

TEST(Cluster, PowerIsKept) {
    const solver::vpl::Rsm rsm = random_map(37, 23); // no whole number of blocks
    glm::dvec3 expected(0);
    std::size_t lit = 0;
    for (const glm::vec3 power : rsm.power) {
        expected += glm::dvec3(power);
        lit += power != glm::vec3(0);
    }
    for (const int kernel : {1, 2, 4, 8, 64}) {
        const std::vector<solver::vpl::Vpl> vpls = clusters(rsm, kernel);
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(total(vpls)[c], expected[c], 1e-6 * expected[c]) << kernel;
        if (kernel == 1) {
            EXPECT_EQ(vpls.size(), lit);
        } else {
            EXPECT_LT(vpls.size(), lit);
        }
        for (const solver::vpl::Vpl& vpl : vpls)
            EXPECT_NEAR(glm::length(vpl.normal), 1, 1e-5);
    }
}

TEST(Cluster, KernelOneKeepsTexels) {
    solver::vpl::Rsm rsm = map_of(2, 2);
    rsm.power[2] = {1, 2, 3};
    rsm.position[2] = {-4, 5, 6};
    rsm.normal[2] = {0, 0, -1};
    const std::vector<solver::vpl::Vpl> vpls = clusters(rsm, 1);
    ASSERT_EQ(vpls.size(), 1u);
    EXPECT_EQ(vpls[0].position, glm::vec3(-4, 5, 6));
    EXPECT_EQ(vpls[0].normal, glm::vec3(0, 0, -1));
    EXPECT_EQ(vpls[0].power, glm::vec3(1, 2, 3));
}

TEST(Cluster, EighteenOfTheNeighbouringCellsJoin) {
    // Squared distances: 0, 1 (6 cells), 2 (12), 3 (8 corners), 4.
    int joined = 0;
    for (int x = -2; x <= 2; ++x)
        for (int y = -2; y <= 2; ++y)
            for (int z = -2; z <= 2; ++z) {
                solver::vpl::Rsm rsm = map_of(2, 1);
                rsm.power[0] = glm::vec3(2);
                rsm.power[1] = glm::vec3(1);
                rsm.position[0] = {-0.1f, 0.9f, 0.0f}; // cell (-1, 0, 0): floor, not truncation
                rsm.position[1] = glm::vec3(x - 1, y, z) + 0.5f;
                const std::size_t count = clusters(rsm, 2).size();
                EXPECT_EQ(count, x * x + y * y + z * z < 3 ? 1u : 2u) << x << y << z;
                joined += count == 1;
            }
    EXPECT_EQ(joined, 19); // its own and 18
}

TEST(Cluster, TheNormalIsTheMeanAndThePositionATexelsNearIt) {
    solver::vpl::Rsm rsm = map_of(2, 2);
    rsm.power = {glm::vec3(3), glm::vec3(1), glm::vec3(0), glm::vec3(0)};
    rsm.position = {{0, 0, 0}, {1, 0, 0}, {100, 0, 0}, {100, 0, 0}};
    rsm.normal[1] = glm::normalize(glm::vec3(0.1f, 1, 0));
    const std::vector<solver::vpl::Vpl> vpls = clusters(rsm, 2);
    ASSERT_EQ(vpls.size(), 1u);
    EXPECT_EQ(vpls[0].power, glm::vec3(4));
    EXPECT_EQ(vpls[0].position, rsm.position[0]); // the mean lies at x = 0.25
    const glm::vec3 mean = glm::normalize(3.0f * glm::vec3(0, 1, 0) + rsm.normal[1]);
    EXPECT_NEAR(glm::distance(vpls[0].normal, mean), 0, 1e-6);
}

TEST(Cluster, TheBrightestTexelDecidesAndWhatIsLeftFormsItsOwn) {
    solver::vpl::Rsm rsm = map_of(4, 1);
    rsm.position = {{0.5, 0, 0}, {2.5, 0, 0}, {4.5, 0, 0}, {3.5, 0, 0}};
    rsm.power = {glm::vec3(1), glm::vec3(2), glm::vec3(1), glm::vec3(4)};
    // Brightest at 3.5 takes 2.5 and 4.5; 0.5 stays alone.
    const std::vector<solver::vpl::Vpl> vpls = clusters(rsm, 4);
    ASSERT_EQ(vpls.size(), 2u);
    EXPECT_EQ(vpls[0].power, glm::vec3(7));
    EXPECT_EQ(vpls[1].power, glm::vec3(1));
    EXPECT_EQ(vpls[1].position, rsm.position[0]);
}

TEST(Cluster, WallsOfACornerStayApart) {
    for (const glm::vec3 other : {glm::vec3(1, 0, 0), glm::vec3(0, -1, 0)}) {
        solver::vpl::Rsm rsm = map_of(2, 1);
        rsm.power = {glm::vec3(1), glm::vec3(1)};
        rsm.normal[1] = other;
        EXPECT_EQ(clusters(rsm, 4).size(), 2u);
    }
}

TEST(Cluster, BlocksDoNotMix) {
    solver::vpl::Rsm rsm = map_of(6, 5);
    for (glm::vec3& power : rsm.power)
        power = glm::vec3(1);
    const std::vector<solver::vpl::Vpl> vpls = clusters(rsm, 4);
    ASSERT_EQ(vpls.size(), 4u);
    const float powers[] = {16, 8, 4, 2};
    for (int i = 0; i < 4; ++i)
        EXPECT_EQ(vpls[i].power, glm::vec3(powers[i]));
}

TEST(Cluster, OutputIsAppendedAndAlikeToTheBit) {
    const solver::vpl::Rsm rsm = random_map(64, 64);
    const std::vector<solver::vpl::Vpl> once = clusters(rsm, 4);
    std::vector<solver::vpl::Vpl> both = clusters(rsm, 4);
    solver::vpl::cluster_vpls(rsm, {}, 4, both);
    ASSERT_EQ(both.size(), 2 * once.size());
    EXPECT_EQ(std::memcmp(both.data(), once.data(), once.size() * sizeof(solver::vpl::Vpl)), 0);
    EXPECT_EQ(std::memcmp(&both[once.size()], once.data(), once.size() * sizeof(solver::vpl::Vpl)),
              0);
}

} // namespace
} // namespace lpvbake
