// Volumes of one lit scene beside each other: each is what it is alone.
#include "bake/bake.h"
#include "gpu/device.h"
#include "readers/readers.h"
#include "scenes.h"
#include "volume/compare.h"
#include "volume/convention.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

class BakedVolumes : public testing::DeviceTest {
protected:
    std::vector<Volume> run(const Scene& scene, const bake::BakePlan& plan) {
        Progress silent;
        return bake::bake_levels(scene, plan, device(), silent).levels;
    }
};

TEST_F(BakedVolumes, EachIsWhatItIsAlone) {
    const Scene scene = scenes::cornell_box_with_point();
    for (const char* solver : {"sn", "gather"}) {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.volumes = {{{"left", 0, 0.2}, {-1, 0, -1}, {0, 2, 1}, 0.2},
                            {{"right", 1, 0.1}, {0, 0, -1}, {1, 1, 1}, 0.15},
                            {{"top", 0, 0.1}, {-0.5, 1.2, -0.5}, {0.5, 2, 0.5}, 0.1}};
        settings.fit = readers::reader_named("threejs");
        const bake::BakePlan all = bake::plan_bake(bake::survey(scene), settings, device().info());
        const std::vector<Grid> grids = bake::grids_in(all);
        ASSERT_EQ(all.settings.volumes[0].place.name, "top");
        const std::vector<Volume> together = run(scene, all);
        for (std::size_t i = 0; i < 3; ++i) {
            bake::BakePlan alone = all; // surfaces are cut for all of them still
            alone.grid = grids[i];
            alone.coarser.clear();
            alone.settings.volumes = {all.settings.volumes[i]};
            const Volume volume = run(scene, alone).front();
            EXPECT_EQ(volume.sh, together[i].sh) << solver << " " << i;
            EXPECT_EQ(volume.validity, together[i].validity) << solver << " " << i;
            EXPECT_EQ(volume.walls, together[i].walls) << solver << " " << i;
            EXPECT_GT(volume::total_energy(volume), 0);
        }
        // What is told names them.
        bool named = false;
        for (const StageReport& stage : all.stages)
            named = named || stage.detail.starts_with("volume right: ");
        EXPECT_TRUE(named);
    }
}

/// The largest difference of irradiance over its mean, in cells that both have valid.
double difference(const Volume& a, const Volume& b) {
    return volume::compare(a, b, {}).relative_l1;
}

/// Turned by the rotation, with its directions.
Volume turned(Volume volume, glm::dquat turn) {
    volume.grid.origin = turn * volume.grid.origin;
    volume.grid.turn = turn;
    volume::turn_directions(glm::mat3_cast(turn), volume);
    return volume;
}

/// A room with walls of two colours and a lamp on its ceiling, and nothing that casts a shadow.
Scene empty_room() {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.6f)),
              red = scenes::add_material(scene, glm::vec3(0.5f, 0.1f, 0.1f)),
              lamp = scenes::add_material(scene, glm::vec3(0), glm::vec3(100, 90, 70));
    scenes::add_box(scene, white, {-1, 0, -1}, {1, 2, 1}, scenes::Facing::inward);
    scenes::add_quad(scene, red, {-0.99f, 0.01f, -0.99f}, {0, 0, 1.98f}, {0, 1.98f, 0});
    scenes::add_quad(scene, lamp, {-0.2f, 1.95f, -0.5f}, {0.9f, 0, 0}, {0, 0, 0.6f});
    return scene;
}

TEST_F(BakedVolumes, ATurnedBoxOfATurnedSceneIsWhatItWas) {
    const glm::dquat turn = glm::normalize(glm::dquat(0.9, 0.1, 0.4, -0.1));
    const Scene scene = empty_room();
    const Scene other = scene::turned(scene, glm::mat3_cast(turn), glm::dvec3(0));
    for (const char* solver : {"sn", "gather"}) {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.volumes = {{{"room", 0, 0.2}, {-1.07, -0.07, -1.07}, {1.13, 2.13, 1.13}, 0.2}};
        bake::BakeSettings settings_turned = settings;
        const glm::dvec3 middle = 0.5 * (settings.volumes[0].lo + settings.volumes[0].hi);
        const glm::dvec3 moved = turn * middle;
        settings_turned.volumes[0].lo += moved - middle;
        settings_turned.volumes[0].hi += moved - middle;
        settings_turned.volumes[0].turn = turn;
        // Without reflections nothing is drawn by rays of the world's axes; with them lighting has
        // other rays, and their noise.
        for (const int bounces : {0, 1}) {
            settings.bounces = settings_turned.bounces = bounces;
            for (const char* fit : {"", "threejs"}) {
                settings.fit = settings_turned.fit = *fit ? readers::reader_named(fit) : nullptr;
                const Volume one =
                    run(scene, bake::plan_bake(bake::survey(scene), settings, device().info()))[0];
                const Volume two = run(other, bake::plan_bake(bake::survey(other), settings_turned,
                                                              device().info()))[0];
                ASSERT_TRUE(two.grid.is_turned());
                EXPECT_LT(glm::length(two.grid.origin - turn * one.grid.origin), 1e-9);
                Volume untouched = one, expected = turned(one, turn);
                untouched.grid = expected.grid = two.grid; // but for rounding
                const double most = bounces == 0 && !*fit ? 2e-6 : 0.02;
                EXPECT_LT(difference(two, expected), most) << solver << " " << bounces << fit;
                EXPECT_GT(difference(two, untouched), 0.1) << "directions matter";
                std::size_t walls = 0;
                for (std::size_t i = 0; i < one.grid.size(); ++i)
                    walls += glm::distance(one.walls[0][i], two.walls[0][i]) > 1e-3f;
                EXPECT_LT(walls, one.grid.size() / 20) << "walls are in the lattice's axes";
            }
        }
    }
}

TEST_F(BakedVolumes, ATurnedBoxShowsWhatOneAlongTheAxesDoes) {
    const Scene scene = scenes::cornell_box_with_sun();
    bake::BakeSettings settings(*bake::find_solver("gather"));
    settings.volumes = {{{"whole", 0, 0.1}, {-1, 0, -1}, {1, 2, 1}, 0.1},
                        {{"turned", 0, 0.1},
                         {-0.5, 0.5, -0.5},
                         {0.5, 1.5, 0.5},
                         0.1,
                         glm::angleAxis(0.6, glm::dvec3(0, 1, 0))}};
    settings.adjust = {{{-9, 1.2, -9}, {9, 9, 9}, {}, 2, {}}};
    const std::vector<Volume> volumes =
        run(scene, bake::plan_bake(bake::survey(scene), settings, device().info()));
    const readers::Reader& reader = *readers::reader_named("lpvbake");
    const bool first = volumes[0].grid.is_turned();
    double off = 0, sum = 0;
    for (double x = -0.3; x < 0.31; x += 0.1)
        for (double y = 0.7; y < 1.45; y += 0.1)
            for (const glm::dvec3 n :
                 {glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, -1)}) {
                if (std::abs(y - 1.2) < 0.12)
                    continue;
                const glm::dvec3 at(x, y, 0.5 * x);
                const double a = readers::irradiance(reader, volumes[first ? 0 : 1], at, n).x,
                             b = readers::irradiance(reader, volumes[first ? 1 : 0], at, n).x;
                off += std::abs(a - b);
                sum += b;
            }
    EXPECT_LT(off / sum, 0.05);
    EXPECT_GT(sum, 0);
}

} // namespace
} // namespace lpvbake
