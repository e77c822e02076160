// Operators of local radiance transfer beside a field.
#include "bake/bake.h"
#include "bake/local_transfer.h"
#include "gpu/device.h"
#include "lpvbake/error.h"
#include "scenes.h"
#include "volume/grids.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace lpvbake {
namespace {

class BakedLocal : public testing::DeviceTest {
protected:
    bake::BakePlan plan(const Scene& scene, const bake::LocalTransferSettings& local) {
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.bounds = Bounds{{-1, 0, -1}, {1, 2, 1}};
        settings.grid.cell = 0.25;
        settings.grid.margin = 0;
        settings.local_transfer = local;
        return bake::plan_bake(bake::survey(scene), settings, device().info());
    }
    Baked run(const Scene& scene, const bake::BakePlan& plan) {
        Progress silent;
        return bake::bake(scene, plan, device(), silent);
    }
};

std::vector<std::string> names_of(const Volume& volume) {
    std::vector<std::string> names;
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        names.push_back(grid.name());
    return names;
}

TEST_F(BakedLocal, TheFieldIsAsWithoutThem) {
    const Scene scene = scenes::cornell_box_with_point();
    const bake::BakePlan with = plan(scene, {true, false, 0.5}), without = plan(scene, {});
    const Baked baked = run(scene, with);
    const Volume plain = run(scene, without).volume;
    EXPECT_EQ(baked.volume.sh, plain.sh);
    EXPECT_EQ(baked.volume.walls, plain.walls);
    EXPECT_TRUE(plain.others.empty());
    // What is planned is what comes.
    EXPECT_EQ(names_of(bake::grids_of(with)), names_of(baked.volume));
    const auto is_local = [](const StageReport& stage) { return stage.name == "local transfer"; };
    EXPECT_EQ(std::ranges::count_if(with.stages, is_local), 1);
    EXPECT_EQ(std::ranges::count_if(baked.stages, is_local), 1);
    EXPECT_EQ(with.host_bytes - without.host_bytes, 512u * 2 * 4 * 57);
    EXPECT_EQ(baked.volume.metadata.at("local_transfer"), "cells");
    EXPECT_EQ(baked.volume.metadata.at("local_radius"), "0.5");
    // Red comes off the red wall alone.
    const auto grids = volume::grids_of(baked.volume, volume::local_transfer_kind());
    const std::size_t at_wall = baked.volume.grid.index({0, 4, 4});
    EXPECT_GT(grids[0].data[3 * at_wall], 2 * grids[0].data[3 * at_wall + 1]);
}

TEST_F(BakedLocal, AnObjectMayBeWithoutLight) {
    const Scene scene = scenes::cornell_box();
    EXPECT_THROW(plan(scene, {true, false, 0.5}), Error);
    const Volume dark = run(scene, plan(scene, {true, true})).volume;
    for (const std::vector<glm::vec3>& grid : dark.sh)
        EXPECT_EQ(std::ranges::count(grid, glm::vec3(0.0f)), std::ptrdiff_t(grid.size()));
    EXPECT_EQ(dark.metadata.at("local_transfer"), "object");
    EXPECT_FALSE(dark.others.empty());
}

TEST(ObjectBox, LiesOnWholeCells) {
    const Bounds box = bake::object_box({{-0.3, 1.1, 7}, {0.3, 1.2, 7}}, 0.5, 0.25);
    EXPECT_EQ(box.lo, glm::dvec3(-1, 0.5, 6.5));
    EXPECT_EQ(box.hi, glm::dvec3(1, 1.75, 7.5));
}

} // namespace
} // namespace lpvbake
