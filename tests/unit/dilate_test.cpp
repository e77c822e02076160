// Dilation against means that were worked out by hand.
#include "volume/dilate.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

Volume made(glm::ivec3 dims, float value) {
    Volume volume;
    volume.grid.dims = dims;
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(value)));
    volume.validity.assign(volume.grid.size(), 1.0f);
    return volume;
}

TEST(Dilate, AnEvenFieldStaysEven) {
    Volume volume = made({7, 6, 5}, 3.0f);
    for (const glm::ivec3 hole : {glm::ivec3(3, 3, 2), {3, 2, 2}, {0, 0, 0}, {6, 5, 4}}) {
        volume.validity[volume.grid.index(hole)] = 0.0f;
        for (auto& band : volume.sh)
            band[volume.grid.index(hole)] = glm::vec3(99.0f);
    }
    EXPECT_EQ(volume::dilate(volume, 2), 4u);
    for (const auto& band : volume.sh)
        for (const glm::vec3& c : band)
            EXPECT_NEAR(c.x, 3.0f, 1e-6f);
    EXPECT_EQ(std::count(volume.validity.begin(), volume.validity.end(), 0.0f), 4);
}

TEST(Dilate, WeighsByTheDistance) {
    // A cell with a lit neighbour at its face, one at its edge and one at its corner.
    Volume volume = made({3, 3, 3}, 0.0f);
    std::fill(volume.validity.begin(), volume.validity.end(), 0.0f);
    const auto set = [&](glm::ivec3 cell, float value) {
        volume.validity[volume.grid.index(cell)] = 1.0f;
        volume.sh[2][volume.grid.index(cell)] = glm::vec3(value, 2 * value, 0.0f);
    };
    set({0, 1, 1}, 1.0f);
    set({2, 2, 1}, 10.0f);
    set({2, 0, 0}, 100.0f);
    volume::dilate(volume, 1);
    const double a = 1, b = 1 / std::sqrt(2.0), c = 1 / std::sqrt(3.0);
    const double mean = (a + 10 * b + 100 * c) / (a + b + c);
    EXPECT_NEAR(volume.sh[2][volume.grid.index({1, 1, 1})].x, mean, 1e-5 * mean);
    EXPECT_NEAR(volume.sh[2][volume.grid.index({1, 1, 1})].y, 2 * mean, 1e-5 * mean);
    EXPECT_EQ(volume.sh[2][volume.grid.index({0, 1, 1})].x, 1.0f);
}

TEST(Dilate, GoesOneCellARing) {
    Volume volume = made({6, 1, 1}, 0.0f);
    for (int x = 1; x < 6; ++x)
        volume.validity[size_t(x)] = 0.0f;
    volume.sh[0][0] = glm::vec3(8.0f);
    EXPECT_EQ(volume::dilate(volume, 0), 0u);
    EXPECT_EQ(volume.sh[0][1].x, 0.0f);
    EXPECT_EQ(volume::dilate(volume, 2), 2u);
    for (int x = 0; x < 6; ++x)
        EXPECT_EQ(volume.sh[0][size_t(x)].x, x <= 2 ? 8.0f : 0.0f) << x;
    EXPECT_EQ(volume::dilate(volume, 100), 5u); // ends where nothing is left
}

TEST(Dilate, BothSidesMeetInAWallOfWhichNothingIsKnown) {
    Volume volume = made({3, 1, 1}, 0.0f);
    volume.validity[1] = 0.0f;
    volume.sh[0][0] = glm::vec3(4.0f);
    volume::dilate(volume, 5);
    EXPECT_EQ(volume.sh[0][1].x, 2.0f);
    EXPECT_EQ(volume.sh[0][0].x, 4.0f);
    EXPECT_EQ(volume.sh[0][2].x, 0.0f);
}

TEST(Dilate, ACellInAWallIsOfTheSideThatItIsNearerTo) {
    // Lit cells 0 and 1, dark ones 4 and 5, and a wall from `front` to `back` (cells, from the
    // centre of the first) with cells 2 and 3 in it.
    const auto filled = [](float front, float back) {
        Volume volume = made({6, 1, 1}, 0.0f);
        volume.walls.assign(1, std::vector<glm::vec3>(6, glm::vec3(0.0f)));
        for (const int x : {0, 1, 4, 5}) {
            volume.sh[0][size_t(x)] = glm::vec3(x < 2 ? 4.0f : 0.0f);
            volume.walls[0][size_t(x)].x = (x < 2 ? front : back) - float(x);
        }
        volume.validity[2] = volume.validity[3] = 0.0f;
        EXPECT_EQ(volume::dilate(volume, 1), 2u);
        return glm::vec2(volume.sh[0][2].x, volume.sh[0][3].x);
    };
    EXPECT_EQ(filled(1.5f, 3.5f), glm::vec2(4.0f, 0.0f));
}

TEST(Dilate, WallsOfTheSameDepthMixAndThoseAQuarterDeeperDoNot) {
    // One cell in a wall between 4 and 0; `off` is by how much the lit side is farther away.
    const auto middle = [](float off) {
        Volume volume = made({3, 1, 1}, 0.0f);
        volume.walls.assign(1, std::vector<glm::vec3>(3, glm::vec3(0.0f)));
        volume.validity[1] = 0.0f;
        volume.sh[0][0] = glm::vec3(4.0f);
        volume.walls[0][0].x = 0.7f - off; // the cell is 0.3 + off beyond it
        volume.walls[0][2].x = -0.7f;
        volume::dilate(volume, 1);
        return double(volume.sh[0][1].x);
    };
    EXPECT_NEAR(middle(0.0f), 2.0, 1e-6);
    EXPECT_NEAR(middle(0.125f), 4.0 * 0.5 / 1.5, 1e-5); // 1 - 4 * 0.125 beside 1
    EXPECT_EQ(middle(0.26f), 0.0);
    EXPECT_EQ(middle(-0.26f), 4.0);
}

TEST(Dilate, AFilledCellHandsOnTheWallsOfItsSide) {
    // A thick wall: in the second ring the lit side has 1.9 cells in front of cell 3, the dark side
    // 1.1.
    Volume volume = made({7, 1, 1}, 0.0f);
    volume.walls.assign(1, std::vector<glm::vec3>(7, glm::vec3(0.0f)));
    for (const int x : {2, 3, 4})
        volume.validity[size_t(x)] = 0.0f;
    volume.sh[0][1] = glm::vec3(4.0f);
    volume.walls[0][1].x = 0.1f;
    volume.walls[0][5].x = -0.9f;
    EXPECT_EQ(volume::dilate(volume, 2), 3u);
    EXPECT_EQ(volume.sh[0][2].x, 4.0f);
    EXPECT_EQ(volume.sh[0][3].x, 0.0f);
    EXPECT_EQ(volume.sh[0][4].x, 0.0f);
}

TEST(Dilate, WithoutValidityNothingIsFilled) {
    Volume volume = made({2, 2, 2}, 1.0f);
    volume.validity.clear();
    EXPECT_EQ(volume::dilate(volume, 3), 0u);
}

} // namespace
} // namespace lpvbake
