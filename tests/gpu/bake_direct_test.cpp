// Direct light and visibility beside a field.
#include "bake/bake.h"
#include "gpu/device.h"
#include "lpvbake/error.h"
#include "scenes.h"
#include "volume/grids.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace lpvbake {
namespace {

class BakedDirect : public testing::DeviceTest {
protected:
    Volume run(const Scene& scene, const char* solver, const bake::DirectSettings& direct) {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.bounds = Bounds{{-1, 0, -1}, {1, 2, 1}};
        settings.grid.cell = 0.2;
        settings.grid.margin = 0;
        settings.direct = direct;
        const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
        Progress silent;
        Baked baked = bake::bake(scene, plan, device(), silent);
        // What is planned is what comes.
        std::vector<std::string> planned, made;
        for (const volume::GridView& grid : volume::grids_of(planned_ = bake::grids_of(plan)))
            planned.push_back(grid.name());
        for (const volume::GridView& grid : volume::grids_of(baked.volume))
            made.push_back(grid.name());
        EXPECT_EQ(planned, made);
        const auto is_beams = [](const StageReport& stage) { return stage.name == "beams"; };
        EXPECT_EQ(std::ranges::count_if(plan.stages, is_beams),
                  std::ranges::count_if(baked.stages, is_beams));
        warnings_ = baked.warnings;
        return std::move(baked.volume);
    }
    std::span<const float> grid(const Volume& volume, const GridKind& kind, std::size_t k) {
        return volume::grids_of(volume, kind)[k].values();
    }

    std::vector<std::string> warnings_;

private:
    Volume planned_;
};

TEST_F(BakedDirect, TheFieldIsAsWithoutIt) {
    const Scene scene = scenes::cornell_box_with_sun();
    for (const char* solver : {"sn", "gather", "lpv"}) {
        const Volume with = run(scene, solver, {true, true}), without = run(scene, solver, {});
        EXPECT_EQ(with.sh, without.sh) << solver;
        EXPECT_EQ(with.walls, without.walls) << solver;
        EXPECT_TRUE(without.others.empty());
        EXPECT_EQ(volume::grids_of(with, volume::direct_kind()).size(), with.sh.size());
    }
}

TEST_F(BakedDirect, LightsAddUpAndEachHasItsVisibility) {
    Scene both = scenes::cornell_box_with_sun(300);
    both.lights.push_back(scenes::point_light({0.1, 1.7, 0.3}, 20));
    Scene sun = both, lamp = both;
    sun.lights.resize(1);
    lamp.lights.erase(lamp.lights.begin());
    const Volume all = run(both, "gather", {true, true});
    const Volume parts[] = {run(sun, "gather", {true, true}), run(lamp, "gather", {true, true})};
    for (std::size_t i = 0; i < 2; ++i)
        EXPECT_TRUE(std::ranges::equal(grid(all, volume::visibility_kind(), i),
                                       grid(parts[i], volume::visibility_kind(), 0)));
    for (std::size_t k = 0; k < all.sh.size(); ++k) {
        const auto sum = grid(all, volume::direct_kind(), k);
        for (std::size_t i = 0; i < sum.size(); ++i)
            EXPECT_FLOAT_EQ(sum[i], grid(parts[0], volume::direct_kind(), k)[i]
                                        + grid(parts[1], volume::direct_kind(), k)[i]);
    }
    EXPECT_EQ(all.metadata.at("visibility"), R"(["",""])");
    for (Light& light : both.lights)
        light.intensity *= 2;
    const Volume twice = run(both, "gather", {true, true});
    for (std::size_t i = 0; i < 2; ++i)
        EXPECT_TRUE(std::ranges::equal(grid(all, volume::visibility_kind(), i),
                                       grid(twice, volume::visibility_kind(), i)));
    for (std::size_t i = 0; i < 3 * all.grid.size(); ++i)
        EXPECT_EQ(grid(twice, volume::direct_kind(), 0)[i],
                  2 * grid(all, volume::direct_kind(), 0)[i]);
}

TEST_F(BakedDirect, LightsThatReachNoCellInCommonShareAChannel) {
    Scene scene = scenes::cornell_box();
    const auto lamp = [&](const char* name, glm::dvec3 at, double range) {
        scene.lights.push_back(scenes::point_light(at, 20));
        scene.lights.back().name = name;
        scene.lights.back().range = range;
    };
    lamp("left", {-0.7, 1.5, 0.6}, 0.5);
    lamp("all", {0.1, 1.7, 0.3}, 0);
    lamp("right", {0.7, 1.5, 0.6}, 0.5);
    lamp("middle", {0.2, 1.5, 0.6}, 0.4);
    scene.lights.push_back(scenes::sun({0.1, -1, -0.5}, 100));
    scene.lights.back().name = "sun";
    scene.lights.push_back(scenes::sun({0.2, -1, -0.4}, 100));
    scene.lights.back().name = "late";
    const Volume volume = run(scene, "gather", {.visibility = true, .channels = true});
    EXPECT_EQ(volume.metadata.at("shadow_channels"),
              R"([["left","right"],["all"],["middle"],["sun"]])");
    EXPECT_EQ(std::ranges::count_if(
                  warnings_,
                  [](const std::string& w) { return w.find("\"late\" has no channel") != w.npos; }),
              1);
    const auto shadow = [&](std::size_t k) {
        return grid(volume, volume::kind_named("shadow"), k);
    };
    const auto seen = [&](std::size_t k) { return grid(volume, volume::visibility_kind(), k); };
    EXPECT_TRUE(std::ranges::equal(shadow(1), seen(1)));
    EXPECT_TRUE(std::ranges::equal(shadow(3), seen(4)));
    EXPECT_GT(*std::ranges::max_element(seen(0)), 0.0f);
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        EXPECT_EQ(shadow(0)[i], std::max(seen(0)[i], seen(2)[i]));
        EXPECT_EQ(std::min(seen(0)[i], seen(2)[i]), 0.0f);
    }
}

TEST_F(BakedDirect, ShaftsChangeNoOtherGrid) {
    Scene scene = scenes::cornell_box_with_sun(300);
    scene.lights.push_back(scenes::point_light({0.1, 1.7, 0.3}, 20));
    bake::DirectSettings direct{true, true, true};
    direct.lamp_radii = {{"*", 0.02}};
    const Volume without = run(scene, "gather", direct);
    direct.shaft = true;
    direct.shaft_closing = 0.3;
    const Volume with = run(scene, "gather", direct);
    std::size_t same = 0;
    const auto before = volume::grids_of(without);
    for (const volume::ConstGridView& own : volume::grids_of(with)) {
        if (own.name() == "shaft")
            continue;
        EXPECT_EQ(own.name(), before[same].name());
        EXPECT_TRUE(std::ranges::equal(own.values(), before[same++].values())) << own.name();
    }
    EXPECT_EQ(same, before.size());
    EXPECT_EQ(with.metadata.at("shaft_closing"), "0.3");
    EXPECT_FALSE(without.metadata.contains("shaft_closing"));
    const auto shaft = grid(with, volume::kind_named("shaft"), 0);
    for (const float share : shaft)
        EXPECT_TRUE(share >= 0 && share <= 1) << share;
}

TEST_F(BakedDirect, WhatHasNoLightsHasNone) {
    Scene scene = scenes::cornell_box();
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(9)),
                     {-0.3f, 1.9f, -0.3f}, {0.6f, 0, 0}, {0, 0, 0.6f});
    EXPECT_TRUE(run(scene, "gather", {true, true}).others.empty());
    scene.lights.assign(33, scenes::point_light({0, 1, 0}, 1));
    EXPECT_THROW(run(scene, "gather", {true, false}), Error);
    EXPECT_EQ(volume::grids_of(run(scene, "gather", {false, true}), volume::direct_kind()).size(),
              9u);
}

} // namespace
} // namespace lpvbake
