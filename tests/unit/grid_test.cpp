// Fitting grids to boxes of every size and place.
#include "volume/grid.h"

#include "lpvbake/error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

using namespace lpvbake;

namespace {

void expect_fits(const Grid& grid, glm::dvec3 lo, glm::dvec3 hi, int margin) {
    for (int a = 0; a < 3; ++a) {
        const double slack = 1e-6 * grid.cell + 1e-15 * (std::abs(lo[a]) + std::abs(hi[a]));
        const double below = lo[a] - grid.origin[a];
        const double above = grid.origin[a] + grid.cell * grid.dims[a] - hi[a];
        EXPECT_GE(below, margin * grid.cell - slack);
        EXPECT_GE(above, margin * grid.cell - slack);
        EXPECT_NEAR(below, above, slack) << "not centred";
        // No layer more than needed, but one for an axis without extent.
        EXPECT_LE(below, (margin + 0.5) * grid.cell + slack);
    }
}

std::string rejection(glm::dvec3 lo, glm::dvec3 hi, const volume::GridSettings& settings = {}) {
    try {
        volume::fit_grid(lo, hi, settings);
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::invalid);
        return error.what();
    }
    ADD_FAILURE() << "accepted";
    return {};
}

} // namespace

TEST(Grid, IndexRunsAlongXFirst) {
    const Grid grid{{1, 2, 3}, 0.5, {3, 4, 5}};
    EXPECT_EQ(grid.size(), 60u);
    EXPECT_EQ(grid.index({1, 0, 0}), 1u);
    EXPECT_EQ(grid.index({0, 1, 0}), 3u);
    EXPECT_EQ(grid.index({0, 0, 1}), 12u);
    EXPECT_EQ(grid.index({2, 3, 4}), 59u);
    EXPECT_EQ(grid.center({0, 1, 2}), glm::dvec3(1.25, 2.75, 4.25));
    EXPECT_EQ(grid.to_grid({1.25, 2.75, 4.25}), glm::dvec3(0.5, 1.5, 2.5));
    EXPECT_TRUE(grid.contains({2, 3, 4}));
    EXPECT_FALSE(grid.contains({3, 0, 0}));
    EXPECT_FALSE(grid.contains({0, -1, 0}));
}

TEST(Grid, ResolutionCountsCellsWithMargins) {
    const Grid grid = volume::fit_grid({-1, 0, -2}, {1, 1, 4}, {.resolution = 32, .margin = 1});
    EXPECT_DOUBLE_EQ(grid.cell, 6.0 / 30);
    EXPECT_EQ(grid.dims, glm::ivec3(12, 7, 32));
    expect_fits(grid, {-1, 0, -2}, {1, 1, 4}, 1);
}

TEST(Grid, CellSizeOverridesResolution) {
    const Grid grid =
        volume::fit_grid({0, 0, 0}, {1, 2, 3.01}, {.resolution = 99, .cell = 0.5, .margin = 2});
    EXPECT_EQ(grid.cell, 0.5);
    EXPECT_EQ(grid.dims, glm::ivec3(6, 8, 11));
    expect_fits(grid, {0, 0, 0}, {1, 2, 3.01}, 2);
}

TEST(Grid, RoundingBuysNoExtraLayer) {
    for (int n = 3; n < 300; ++n) {
        const Grid cube = volume::fit_grid(
            {-0.1, 0.7, 3}, {-0.1 + 1.0 / 3, 0.7 + 1.0 / 3, 3 + 1.0 / 3}, {.resolution = n});
        EXPECT_EQ(cube.dims, glm::ivec3(n));
    }
}

TEST(Grid, EveryScaleGivesTheSameLattice) {
    for (double scale : {1e-4, 1.0, 1e6})
        for (double away : {0.0, 1e3, 1e6}) {
            const glm::dvec3 lo = away + scale * glm::dvec3(-1, -0.3, 0);
            const glm::dvec3 hi = away + scale * glm::dvec3(1, 0.4, 0.77);
            const Grid grid = volume::fit_grid(lo, hi, {.resolution = 20});
            EXPECT_EQ(grid.dims, glm::ivec3(20, 9, 9)) << scale << ' ' << away;
            expect_fits(grid, lo, hi, 1);
        }
}

TEST(Grid, FlatBoxesGetOneCellAcross) {
    const Grid plane = volume::fit_grid({0, 5, 0}, {8, 5, 4}, {.resolution = 10, .margin = 1});
    EXPECT_EQ(plane.dims, glm::ivec3(10, 3, 6));
    EXPECT_DOUBLE_EQ(plane.center({0, 1, 0}).y, 5.0);
    const Grid line = volume::fit_grid({0, 5, 0}, {8, 5, 0}, {.resolution = 10, .margin = 0});
    EXPECT_EQ(line.dims, glm::ivec3(10, 1, 1));
}

TEST(Grid, Rejections) {
    const double inf = std::numeric_limits<double>::infinity();
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_NE(rejection({0, 0, 0}, {1, inf, 1}).find("not finite"), std::string::npos);
    EXPECT_NE(rejection({nan, 0, 0}, {1, 1, 1}).find("not finite"), std::string::npos);
    EXPECT_NE(rejection({-1.7e308, 0, 0}, {1.7e308, 1, 1}).find("not finite"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 1}, {1, 1, 0}).find("inside out"), std::string::npos);
    EXPECT_NE(rejection({1, 2, 3}, {1, 2, 3}).find("single point (1, 2, 3)"), std::string::npos);
    EXPECT_NE(rejection({1e16, 0, 0}, {1e16 + 4, 1, 1}).find("told apart"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1e-310, 0, 0}).find("told apart"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.resolution = 2}).find("use 3 or more"),
              std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.resolution = 8, .margin = 4}).find("use 9 or more"),
              std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.margin = -1}).find("negative"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.cell = -1}).find("cell size"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.cell = nan}).find("cell size"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.cell = 1e-6}).find("2^31 - 1"), std::string::npos);
    EXPECT_NE(rejection({0, 0, 0}, {1, 1, 1}, {.resolution = 1291}).find("2^31 - 1"),
              std::string::npos);
    EXPECT_EQ(volume::fit_grid({0, 0, 0}, {1, 1, 1}, {.resolution = 1290}).size(), 2146689000u);
}
