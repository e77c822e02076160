// Nested levels of a lit scene: each an independent sampling of it.
#include "bake/bake.h"
#include "gpu/device.h"
#include "lpvbake/error.h"
#include "readers/readers.h"
#include "scenes.h"
#include "volume/levels.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

using volume::LevelBox;

class BakedInLevels : public testing::DeviceTest {
protected:
    bake::BakePlan plan_of(const Scene& scene, const bake::BakeSettings& settings) {
        return bake::plan_bake(bake::survey(scene), settings, device().info());
    }
    volume::VolumeSet run(const Scene& scene, const bake::BakePlan& plan) {
        Progress silent;
        return {bake::bake_levels(scene, plan, device(), silent).levels};
    }
    static bake::BakeSettings settings_of(const char* solver, std::vector<LevelBox> levels) {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.levels = std::move(levels);
        return settings;
    }
};

glm::dvec3 random_in(std::mt19937& random, glm::dvec3 lo, glm::dvec3 hi) {
    const auto share = [&] { return std::uniform_real_distribution<double>()(random); };
    return lo + (hi - lo) * glm::dvec3(share(), share(), share());
}

TEST_F(BakedInLevels, AFurnaceIsOneInEveryLevelAndBetweenThem) {
    const Scene scene = scenes::furnace(4.0f, 0.5f, 100.0f);
    const double expected = 200.0 * glm::pi<double>(); // lux
    for (const char* solver : {"sn", "gather"}) {
        const volume::VolumeSet set =
            run(scene, plan_of(scene, settings_of(solver, {{{0.9, 0, 0.9}, {2.2, 1.2, 2.2}, 0.125},
                                                           {{0.5, 0, 0.5}, {3, 2, 3}, 0.25},
                                                           {{0, 0, 0}, {4, 4, 4}, 0.5}})));
        ASSERT_EQ(set.levels.size(), 3u);
        for (const Volume& level : set.levels)
            for (std::size_t i = 0; i < level.grid.size(); ++i)
                ASSERT_NEAR(double(level.sh[0][i].y) / (200.0 * std::sqrt(4 * glm::pi<double>())),
                            1.0, 0.03)
                    << solver << ", cells of " << level.grid.cell;
        std::mt19937 random(1);
        const readers::Reader& facing = *readers::reader_named("lpvbake");
        double worst = 0, twice = 0;
        for (int i = 0; i < 10000; ++i) {
            const Grid& grid = set.levels[random() % 3].grid;
            const glm::dvec3 p =
                random_in(random, grid.center({0, 0, 0}), grid.center(grid.dims - 1));
            const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
            const glm::dvec3 e = readers::irradiance(facing, set, p, n);
            worst = std::max(worst, std::abs(e.y / expected - 1));
            // Levels that were summed by their shares would not do.
            glm::dvec3 sum(0);
            for (std::size_t l = 0; l < 3; ++l)
                sum +=
                    volume::share_of(set, l, p) * readers::irradiance(facing, set.levels[l], p, n);
            twice = std::max(twice, std::abs(sum.y / expected - 1));
        }
        EXPECT_LT(worst, 0.03) << solver;
        EXPECT_GT(twice, 0.5) << solver;
    }
}

/// A small emitter in black air: light that no cluster and no interpolation changes.
Scene one_emitter() {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0), glm::vec3(1000)),
                     {-0.05f, 3, -0.05f}, {0.1f, 0, 0}, {0, 0, 0.1f});
    return scene;
}

TEST_F(BakedInLevels, SamplesInCommonAreEqual) {
    const Scene scene = one_emitter();
    bake::BakeSettings settings = settings_of("gather", {{{-1, 0, -1}, {1, 1, 1}, 0.125},
                                                         {{-2, 0, -2}, {2, 2, 2}, 0.25},
                                                         {{-3, 0, -3}, {3, 2, 3}, 1}});
    settings.solver.set("tolerance", 0);
    settings.solver.set("vpls", 100000);
    const volume::VolumeSet set = run(scene, plan_of(scene, settings));
    std::size_t common = 0;
    for (std::size_t l = 0; l + 1 < set.levels.size(); ++l) {
        const Volume &fine = set.levels[l], &coarse = set.levels[l + 1];
        for (std::size_t i = 0; i < coarse.grid.size(); ++i) {
            const glm::dvec3 p = coarse.grid.center(coarse.grid.cell_at(i));
            const glm::ivec3 cell(glm::round(fine.grid.to_grid(p) - 0.5));
            if (!fine.grid.contains(cell))
                continue;
            ++common;
            const std::size_t own = fine.grid.index(cell);
            EXPECT_LT(glm::length(fine.grid.center(cell) - p), 1e-9);
            for (std::size_t k = 0; k < fine.sh.size(); ++k)
                EXPECT_NEAR(fine.sh[k][own].x, coarse.sh[k][i].x, 1e-5f * coarse.sh[0][i].x) << l;
        }
    }
    EXPECT_EQ(common, 9u * 5 * 9 + 5 * 3 * 5);
}

TEST_F(BakedInLevels, ALevelIsWhatItIsAlone) {
    const Scene scene = scenes::cornell_box_with_point();
    const std::vector<LevelBox> boxes{{{-0.6, 0.2, -0.6}, {0.4, 1, 0.4}, 0.1},
                                      {{-1, 0, -1}, {1, 2, 1}, 0.2}};
    for (const char* solver : {"sn", "gather"}) {
        const bake::BakePlan both = plan_of(scene, settings_of(solver, boxes));
        const volume::VolumeSet set = run(scene, both);
        bake::BakePlan alone = both; // surfaces are cut for both levels still
        alone.coarser.clear();
        const Volume finest = run(scene, alone).levels.front();
        EXPECT_EQ(finest.sh, set.levels[0].sh) << solver;
        EXPECT_EQ(finest.walls, set.levels[0].walls) << solver;
        EXPECT_EQ(finest.validity, set.levels[0].validity) << solver;

        const volume::VolumeSet turned =
            run(scene, plan_of(scene, settings_of(solver, {boxes[1], boxes[0]})));
        for (std::size_t l = 0; l < 2; ++l) {
            EXPECT_EQ(turned.levels[l].grid, set.levels[l].grid);
            EXPECT_EQ(turned.levels[l].sh, set.levels[l].sh);
        }
    }
}

TEST_F(BakedInLevels, ACoarseLevelIsAsABakeOfItsCells) {
    const Scene scene = scenes::cornell_box_with_point();
    const volume::VolumeSet set =
        run(scene, plan_of(scene, settings_of("sn", {{{-0.6, 0.2, -0.6}, {0.4, 1, 0.4}, 0.05},
                                                     {{-1, 0, -1}, {1, 2, 1}, 0.1}})));
    bake::BakeSettings single(*bake::find_solver("sn"));
    single.bounds = Bounds{glm::dvec3(-1.05, -0.05, -1.05), glm::dvec3(1.05, 2.05, 1.05)};
    single.grid = {.cell = 0.1, .margin = 0};
    Progress silent;
    const Volume dense = bake::bake(scene, plan_of(scene, single), device(), silent).volume;
    ASSERT_EQ(dense.grid.dims, set.levels[1].grid.dims);
    double sum = 0, off = 0;
    for (std::size_t i = 0; i < dense.grid.size(); ++i) {
        EXPECT_EQ(dense.validity[i], set.levels[1].validity[i]) << i;
        if (dense.validity[i] == 0)
            continue;
        sum += double(dense.sh[0][i].y);
        off += std::abs(double(dense.sh[0][i].y - set.levels[1].sh[0][i].y));
    }
    EXPECT_LT(off, 0.03 * sum);
}

TEST_F(BakedInLevels, NoStepShowsWhereALevelEnds) {
    const Scene scene = scenes::cornell_box_with_point();
    const volume::VolumeSet set =
        run(scene, plan_of(scene, settings_of("sn", {{{-0.7, 0.8, -0.7}, {0.7, 1.8, 0.7}, 0.1},
                                                     {{-1, 0, -1}, {1, 2, 1}, 0.2}})));
    const Grid& fine = set.levels[0].grid;
    const glm::dvec3 lo = fine.center({0, 0, 0}), hi = fine.center(fine.dims - 1);
    // In the open the lookup is trilinear: the facing sampler steps at walls by itself.
    const readers::Reader trilinear{.name = "trilinear"};
    std::mt19937 random(3);
    struct Step {
        double in, out, sharp;
    };
    std::vector<Step> steps;
    double mean = 0;
    for (int i = 0; i < 10000; ++i) {
        glm::dvec3 p = random_in(random, lo, hi);
        const int axis = int(random() % 3), high = int(random() % 2);
        p[axis] = high ? hi[axis] : lo[axis];
        glm::dvec3 step(0);
        step[axis] = (high ? -1e-4 : 1e-4) * fine.cell;
        const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
        steps.push_back({readers::irradiance(trilinear, set, p + step, n).y,
                         readers::irradiance(trilinear, set, p - step, n).y,
                         // what a reader shows that takes the finest level around
                         readers::irradiance(trilinear, set.levels[0], p + step, n).y});
        mean += steps.back().out / 10000;
    }
    double worst = 0, without = 0;
    for (const auto& [in, out, sharp] : steps)
        if (out > 0.1 * mean) { // what the bands leave of the dark is about 0
            worst = std::max(worst, std::abs(in - out) / out);
            without = std::max(without, std::abs(sharp - out) / out);
        }
    EXPECT_LT(worst, 1e-3);
    EXPECT_GT(without, 1e-2);
}

TEST_F(BakedInLevels, PatchesAreAsFineAsTheLevelsNearThem) {
    Scene scene = scenes::floor_quad(64.0f, glm::vec3(0.5f));
    scene.sky.luminance = glm::vec3(1.0f);
    const std::vector<LevelBox> boxes{{{-2, 0, -2}, {2, 2, 2}, 0.25},
                                      {{-16, 0, -16}, {16, 4, 16}, 1}};
    const bake::BakePlan plan = plan_of(scene, settings_of("sn", boxes));
    ASSERT_EQ(plan.frame.coarser.size(), 1u);
    EXPECT_EQ(plan.frame.coarser[0].cell, 4.0f);
    const visibility::Visibility visibility(scene, plan.frame);
    const auto cover = surface::cover_surfaces(scene, plan.frame, visibility, 1.0f);
    double fine = 0, coarse = 0;
    for (const surface::Patch& patch : cover.patches) {
        const glm::dvec3 at = plan.frame.to_world(glm::dvec3(patch.position));
        const double edge = plan.frame.unit
                            * double(std::max({glm::length(patch.edge_u), glm::length(patch.edge_v),
                                               glm::length(patch.edge_u - patch.edge_v)}));
        const double away = std::max(std::abs(at.x), std::abs(at.z));
        if (away < 1.7)
            fine = std::max(fine, edge);
        else if (away < 15)
            coarse = std::max(coarse, edge);
    }
    EXPECT_LE(fine, 0.251);
    EXPECT_LE(coarse, 1.001);
    EXPECT_GT(coarse, 0.5);
}

} // namespace
} // namespace lpvbake
