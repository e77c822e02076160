// Cascades of the classic solver: nested grids that light flows into from the ones around.
#include "bake/bake.h"
#include "gpu/device.h"
#include "scenes.h"
#include "volume/levels.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

namespace lpvbake {
namespace {

using volume::LevelBox;

class LpvLevels : public testing::DeviceTest {
protected:
    static bake::BakeSettings settings_of(std::vector<LevelBox> levels,
                                          std::optional<int> bounces = 1) {
        bake::BakeSettings settings(*bake::find_solver("lpv"));
        settings.levels = std::move(levels);
        settings.bounces = bounces;
        settings.solver.set("tolerance", 1e-3);
        return settings;
    }
    volume::VolumeSet run(const Scene& scene, const bake::BakeSettings& settings) {
        Progress silent;
        const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
        return {bake::bake_levels(scene, plan, device(), silent).levels};
    }
    /// One of them alone.
    Volume alone(const Scene& scene, bake::BakeSettings settings, const Grid& grid) {
        settings.levels.clear();
        settings.bounds = Bounds{grid.origin, grid.origin + grid.cell * glm::dvec3(grid.dims)};
        settings.grid = {.cell = grid.cell, .margin = 0};
        return run(scene, settings).levels.front();
    }
};

/// Mean luminance of the valid cells with centres in a box.
double mean(const Volume& volume, glm::dvec3 lo = glm::dvec3(-1e9),
            glm::dvec3 hi = glm::dvec3(1e9)) {
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        const glm::dvec3 p = volume.grid.center(volume.grid.cell_at(i));
        if (!volume.is_valid(i) || glm::any(glm::lessThan(p, lo - 1e-6))
            || glm::any(glm::greaterThan(p, hi + 1e-6)))
            continue;
        sum += double(volume.sh[0][i].y);
        ++count;
    }
    return sum / count / std::sqrt(4 * glm::pi<double>());
}

/// The same of the part of a level that lies in a finer one.
double mean_in(const Volume& finer, const Volume& volume) {
    return mean(volume, finer.grid.center(glm::ivec3(0)), finer.grid.center(finer.grid.dims - 1));
}

double number(const Volume& volume, const char* name) {
    return std::stod(volume.metadata.at(name));
}

TEST_F(LpvLevels, AFurnaceIsAsBrightInEveryLevel) {
    const Scene scene = scenes::furnace(4.0f, 0.5f, 100.0f);
    const bake::BakeSettings settings =
        settings_of({{{0.9, 0.6, 0.9}, {2.2, 1.8, 2.2}, 0.125},
                     {{0.5, 0.5, 0.5}, {3, 3, 3}, 0.25},
                     {{-0.25, -0.25, -0.25}, {4.25, 4.25, 4.25}, 0.5}},
                    std::nullopt);
    const volume::VolumeSet set = run(scene, settings);
    ASSERT_EQ(set.levels.size(), 3u);
    for (std::size_t l = 0; l < 2; ++l) {
        // It reads 1.2 to 1.5 by its nature (tests/hard_cases); levels bring no more to it.
        EXPECT_GT(mean(set.levels[l]), 1.2 * 200);
        EXPECT_LT(mean(set.levels[l]), 1.5 * 200);
        EXPECT_NEAR(mean(set.levels[l]), mean_in(set.levels[l], set.levels[l + 1]), 0.04 * 200);
    }
}

/// A lamp over a small sheet, in the open.
Scene lamp_over_sheet(glm::vec3 at) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), at, {0, 0, 0.5f},
                     {0.5f, 0, 0});
    scene.lights.push_back(scenes::point_light(glm::dvec3(at) + glm::dvec3(0.25, 1, 0.25), 100));
    return scene;
}

TEST_F(LpvLevels, EachLevelHasTheLightOfItsBoxOnce) {
    const Scene scene = lamp_over_sheet({-0.25f, -0.3f, -0.25f});
    const bake::BakeSettings settings =
        settings_of({{{-1, -1, -1}, {1, 1, 1}, 0.125}, {{-3, -3, -3}, {3, 3, 3}, 0.25}});
    const volume::VolumeSet set = run(scene, settings);
    const Volume &fine = set.levels[0], &coarse = set.levels[1];
    const double all = number(coarse, "injected_lm");
    EXPECT_NEAR(number(fine, "injected_lm") - number(fine, "inflow_lm"), all, 1e-5 * all);
    // What else there is comes back from around: smaller cells keep more of it.
    EXPECT_GT(mean(fine), mean_in(fine, coarse));
    EXPECT_LT(mean(fine), 1.4 * mean_in(fine, coarse)); // 1.23; dense cells of the same size: 1.80
    EXPECT_LT(mean(alone(scene, settings, fine.grid)), 0.8 * mean_in(fine, coarse));
}

TEST_F(LpvLevels, LightFromBesideTheFinestLevelComesIn) {
    const Scene scene = lamp_over_sheet({-2.5f, -0.6f, -0.25f});
    const bake::BakeSettings settings =
        settings_of({{{-1, -1, -1}, {1, 1, 1}, 0.125}, {{-4, -3, -3}, {4, 3, 3}, 0.25}});
    const volume::VolumeSet set = run(scene, settings);
    const Volume& fine = set.levels.front();
    const double around = mean_in(fine, set.levels.back());
    EXPECT_NEAR(mean(fine), around, 0.05 * around);
    EXPECT_NEAR(number(fine, "inflow_lm"), number(fine, "injected_lm"),
                1e-9 * number(fine, "injected_lm"));
}

TEST_F(LpvLevels, ASealedBoxAcrossALevelsSideIsDarkInAll) {
    Scene scene = scenes::furnace(4.0f, 0.0f, 100.0f);
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true),
                    {1.05f, 1.05f, 1.05f}, {2.95f, 2.95f, 2.95f}, scenes::Facing::outward);
    const volume::VolumeSet set =
        run(scene, settings_of({{{0.5, 0.5, 0.5}, {2, 2, 2}, 0.125}, {{0, 0, 0}, {4, 4, 4}, 0.25}},
                               std::nullopt));
    for (const Volume& level : set.levels) {
        double inside = 0, outside = 0;
        for (std::size_t i = 0; i < level.grid.size(); ++i) {
            const glm::dvec3 p = level.grid.center(level.grid.cell_at(i));
            double& most = glm::all(glm::greaterThan(p, glm::dvec3(1.05)))
                                   && glm::all(glm::lessThan(p, glm::dvec3(2.95)))
                               ? inside
                               : outside;
            most = std::max(most, double(level.sh[0][i].y));
        }
        EXPECT_EQ(inside, 0.0);
        EXPECT_GT(outside, 10.0);
    }
}

TEST_F(LpvLevels, OrderAndThreadsChangeNothing) {
    Scene scene = scenes::cornell_box_with_point();
    scene.sky.luminance = glm::vec3(100.0f);
    const LevelBox boxes[] = {{{-0.6, 0.2, -0.6}, {0.4, 1, 0.4}, 0.1},
                              {{-1, 0, -1}, {1, 2, 1}, 0.2}};
    const volume::VolumeSet set = run(scene, settings_of({boxes[0], boxes[1]}, 2));
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const volume::VolumeSet turned = run(scene, settings_of({boxes[1], boxes[0]}, 2));
    for (std::size_t l = 0; l < 2; ++l) {
        EXPECT_EQ(turned.levels[l].grid, set.levels[l].grid);
        EXPECT_EQ(turned.levels[l].sh, set.levels[l].sh);
        EXPECT_GT(mean(set.levels[l]), 0);
    }
    // Twice the light is twice the field.
    Scene brighter = scene;
    brighter.lights[0].intensity *= 2;
    brighter.sky.luminance *= 2;
    const volume::VolumeSet twice = run(brighter, settings_of({boxes[0], boxes[1]}, 2));
    for (std::size_t l = 0; l < 2; ++l)
        EXPECT_NEAR(mean(twice.levels[l]), 2 * mean(set.levels[l]), 1e-4 * mean(set.levels[l]));
}

TEST_F(LpvLevels, WhereLevelsEndTogetherLightComesFromOutside) {
    // A glowing floor below both boxes, which end on the same plane, and one inside of the outer's
    // cells beside it alone.
    for (const float y : {-1.0f, -0.1f}) {
        Scene scene;
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0), glm::vec3(100)),
                         {-3, y, -3}, {0, 0, 6}, {6, 0, 0});
        const bake::BakeSettings settings = settings_of(
            {{{-0.5, 0, -0.5}, {0.5, 1, 0.5}, 0.125}, {{-2, 0, -2}, {2, 3, 2}, 0.25}}, 0);
        const volume::VolumeSet set = run(scene, settings);
        const double around = mean_in(set.levels[0], set.levels[1]);
        EXPECT_NEAR(mean(set.levels[0]), around, 0.06 * around) << y;
        // What comes by the side that has no level beyond it.
        const double injected = number(set.levels[0], "injected_lm");
        EXPECT_GT(injected - number(set.levels[0], "inflow_lm"), 0.15 * injected) << y;
    }
}

} // namespace
} // namespace lpvbake
