// The diffusion that says what light a propagation is missing.
#include "solver/lpv/diffusion.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <random>

namespace lpvbake {
namespace {

Grid grid_of(glm::ivec3 dims) {
    return {glm::dvec3(0.0), 1.0, dims};
}

std::vector<std::uint8_t> lit_at(const Grid& grid, glm::ivec3 cell) {
    std::vector<std::uint8_t> lit(grid.size());
    lit[grid.index(cell)] = 1;
    return lit;
}

std::vector<glm::vec4> random_light(std::size_t count) {
    std::vector<glm::vec4> light(count);
    std::mt19937 random(1);
    for (glm::vec4& block : light)
        for (int k = 0; k < 4; ++k)
            block[k] = float(random() % 1000);
    return light;
}

TEST(Diffusion, TellsTheCellsThatLightReaches) {
    // A wall between the layers x = 2 and 3, and a way around it through one link.
    const Grid grid = grid_of({5, 4, 3});
    for (const bool has_gap : {false, true}) {
        std::vector<float> open(3 * grid.size(), 1.0f);
        for (int y = 0; y < 4; ++y)
            for (int z = 0; z < 3; ++z)
                open[3 * grid.index({2, y, z})] = has_gap && y == 3 && z == 2 ? 0.5f : 0.0f;
        solver::lpv::Diffusion diffusion(grid, open, lit_at(grid, {4, 0, 0}));
        ASSERT_EQ(diffusion.dims(), glm::ivec3(3, 2, 2));
        for (std::size_t i = 0; i < grid.size(); ++i) {
            const glm::ivec3 c = grid.cell_at(i), b = c / 2, k = c % 2;
            const unsigned bits = diffusion.reached()[std::size_t(b.x + 3 * (b.y + 2 * b.z))];
            EXPECT_EQ(bits >> (k.x + 2 * k.y + 4 * k.z) & 1u, has_gap || c.x > 2 ? 1u : 0u);
        }
    }
}

TEST(Diffusion, FindsAllCellsOfAMazeWhateverTheThreads) {
    // Links open by chance, about as many as join cells far apart, over several slabs of layers.
    const Grid grid = grid_of({14, 13, 75});
    std::vector<float> open(3 * grid.size());
    std::mt19937 random(5);
    for (float& link : open)
        link = random() % 100 < 30 ? 0.5f : 0.0f;
    const glm::ivec3 start(7, 6, 37);
    std::vector<bool> joined(grid.size());
    std::vector<glm::ivec3> found{start};
    joined[grid.index(start)] = true;
    while (!found.empty()) {
        const glm::ivec3 cell = found.back();
        found.pop_back();
        for (int side = 0; side < 6; ++side) {
            glm::ivec3 other = cell;
            other[side / 2] += side % 2 ? 1 : -1;
            if (!grid.contains(other) || joined[grid.index(other)]
                || open[3 * grid.index(side % 2 ? cell : other) + std::size_t(side / 2)] == 0.0f)
                continue;
            joined[grid.index(other)] = true;
            found.push_back(other);
        }
    }
    const auto count = std::size_t(std::count(joined.begin(), joined.end(), true));
    ASSERT_GT(count, grid.size() / 5);
    ASSERT_LT(count, grid.size());
    for (const std::size_t threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        solver::lpv::Diffusion diffusion(grid, open, lit_at(grid, start));
        const glm::ivec3 dims = diffusion.dims();
        for (std::size_t i = 0; i < grid.size(); ++i) {
            const glm::ivec3 c = grid.cell_at(i), b = c / 2, k = c % 2;
            const unsigned bits =
                diffusion.reached()[std::size_t(b.x + dims.x * (b.y + dims.y * b.z))];
            ASSERT_EQ((bits >> (k.x + 2 * k.y + 4 * k.z) & 1u) != 0u, joined[i]) << i;
        }
    }
}

TEST(Diffusion, IsThatOfASlabInItsMiddle) {
    // Light q a cell everywhere, all of it taken at two sides: q (n / 2 + b)^2 / (2 D) in the
    // middle of n cells. The other sides are far away. One cycle of multigrid comes that near.
    const Grid grid = grid_of({32, 192, 192});
    solver::lpv::Diffusion diffusion(grid, {}, std::vector<std::uint8_t>(grid.size(), 1));
    const glm::ivec3 dims = diffusion.dims();
    std::vector<glm::vec4> light(diffusion.size(), glm::vec4(8.0f)), all(light.size());
    diffusion.solve(light, all);
    const std::size_t middle =
        std::size_t(dims.x / 2 + dims.x * (dims.y / 2 + dims.y * dims.z / 2));
    const float expected = (16.0f + 0.69f) * (16.0f + 0.69f) / (2.0f * 0.2283f);
    EXPECT_NEAR(all[middle].x, expected, 0.2f * expected);
}

TEST(Diffusion, IsLinearAndTheSameForAnyThreads) {
    const Grid grid = grid_of({70, 71, 73});
    std::vector<float> open(3 * grid.size());
    std::mt19937 random(2);
    for (float& link : open)
        link = float(random() % 4) / 3.0f;
    solver::lpv::Diffusion diffusion(grid, open, lit_at(grid, {30, 30, 30}));
    const std::vector<glm::vec4> light = random_light(diffusion.size());
    std::vector<glm::vec4> all(light.size()), again(light.size()), twice(light);
    diffusion.solve(light, all);
    for (glm::vec4& block : twice)
        block *= 2.0f;
    {
        const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
        diffusion.solve(light, again);
    }
    EXPECT_EQ(again, all);
    diffusion.solve(twice, again);
    for (std::size_t i = 0; i < all.size(); ++i)
        ASSERT_EQ(again[i], 2.0f * all[i]);
}

TEST(Diffusion, IsItsMatrix) {
    const Grid grid = grid_of({13, 12, 9});
    solver::lpv::Diffusion diffusion(grid, std::vector<float>(3 * grid.size(), 0.7f),
                                     lit_at(grid, {3, 3, 3}));
    ASSERT_EQ(diffusion.dims(1), glm::ivec3(4, 3, 3));
    const std::vector<glm::vec4> light = random_light(36);
    std::vector<glm::vec4> all(36);
    diffusion.solve(light, all, 1);
    const std::vector<float> matrix = diffusion.matrix(1);
    for (std::size_t i = 0; i < 36; ++i) {
        glm::vec4 sum(0.0f);
        for (std::size_t j = 0; j < 36; ++j)
            sum += matrix[36 * j + i] * light[j];
        for (int k = 0; k < 4; ++k)
            EXPECT_NEAR(sum[k], all[i][k], 1e-5f * all[i][k]);
    }
}

} // namespace
} // namespace lpvbake
