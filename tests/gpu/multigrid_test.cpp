// The cycle of the diffusion on the device against that on the host.
#include "solver/lpv/multigrid.h"

#include "gpu/device.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace lpvbake {
namespace {

using solver::lpv::Diffusion;

Grid grid_of(glm::ivec3 dims) {
    return {glm::dvec3(0.0), 1.0, dims};
}

Diffusion diffusion_of(const Grid& grid, int closed_of_four) {
    std::vector<float> open(3 * grid.size());
    std::mt19937 random(2);
    for (float& link : open)
        link = int(random() % 4) < closed_of_four ? 0.0f : float(random() % 1000) / 999.0f;
    std::vector<std::uint8_t> lit(grid.size());
    lit[grid.index(grid.dims / 2)] = 1;
    return Diffusion(grid, open, lit);
}

std::vector<glm::vec4> random_light(std::size_t count) {
    std::vector<glm::vec4> light(count);
    std::mt19937 random(1);
    for (glm::vec4& block : light)
        for (int k = 0; k < 4; ++k)
            block[k] = float(int(random() % 2000) - 700);
    return light;
}

class Multigrid : public testing::DeviceTest {
protected:
    /// What the device makes of a light, `times` one after the other.
    std::vector<glm::vec4> solve(Diffusion& diffusion, const std::vector<glm::vec4>& light,
                                 uint64_t window, int times = 1) {
        const auto programs = solver::lpv::compile_multigrid(device());
        solver::lpv::Multigrid multigrid(device(), programs, diffusion, window, false);
        gpu::upload(device(), multigrid.light(), 0, std::as_bytes(std::span(light)));
        gpu::Batch batch(device());
        for (int i = 0; i < times; ++i)
            multigrid.solve(batch);
        batch.run();
        std::vector<glm::vec4> all(light.size());
        gpu::download(device(), multigrid.all(), 0, std::as_writable_bytes(std::span(all)));
        return all;
    }
};

constexpr uint64_t large = 1 << 24;

TEST_F(Multigrid, SaysWhatTheHostSays) {
    for (const glm::ivec3 dims :
         {glm::ivec3(1), glm::ivec3(8, 7, 8), glm::ivec3(33, 9, 21), glm::ivec3(20, 41, 58),
          glm::ivec3(1, 1, 301), glm::ivec3(150, 2, 3)})
        for (const int closed : {0, 1, 3}) {
            SCOPED_TRACE(std::to_string(dims.x) + ", closed " + std::to_string(closed));
            Diffusion diffusion = diffusion_of(grid_of(dims), closed);
            const std::vector<glm::vec4> light = random_light(diffusion.size());
            std::vector<glm::vec4> host(light.size());
            diffusion.solve(light, host);
            const std::vector<glm::vec4> ours = solve(diffusion, light, large);
            float largest = 0.0f, off = 0.0f;
            for (std::size_t i = 0; i < host.size(); ++i)
                for (int k = 0; k < 4; ++k) {
                    largest = std::max(largest, std::abs(host[i][k]));
                    off = std::max(off, std::abs(ours[i][k] - host[i][k]));
                }
            EXPECT_LE(off, 1e-5f * largest);
            EXPECT_TRUE(closed == 3 || largest > 0.0f);
        }
}

TEST_F(Multigrid, GivesTheSameBitsTimeAfterTimeAndWindowByWindow) {
    Diffusion diffusion = diffusion_of(grid_of({45, 38, 51}), 1);
    const std::vector<glm::vec4> light = random_light(diffusion.size());
    const std::vector<glm::vec4> all = solve(diffusion, light, large);
    EXPECT_EQ(solve(diffusion, light, large), all);
    EXPECT_EQ(solve(diffusion, light, large, 2), all); // nothing of the first is left
    for (const uint64_t layers : {5, 6, 9})
        EXPECT_EQ(solve(diffusion, light, layers * 23 * 19 * sizeof(glm::vec4)), all) << layers;
}

} // namespace
} // namespace lpvbake
