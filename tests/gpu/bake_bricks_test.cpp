// Bricks of a lit scene: each sample an evaluation of its own, however they are divided.
#include "bake/bricks.h"
#include "gpu/device.h"
#include "lpvbake/error.h"
#include "readers/readers.h"
#include "scenes.h"
#include "unit/volumes.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <map>
#include <random>

namespace lpvbake {
namespace {

using volume::Brick;
using volume::VolumeSet;

class BakedInBricks : public testing::DeviceTest {
protected:
    static bake::BakeSettings settings_of(double fine, double coarse, double error) {
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.adaptive = {fine, coarse, error, {}, 4};
        return settings;
    }
    bake::BakedBricks run(const Scene& scene, const bake::BakeSettings& settings) {
        Progress silent;
        return bake::bake_bricks(scene,
                                 bake::plan_bake(bake::survey(scene), settings, device().info()),
                                 device(), silent);
    }
};

glm::dvec3 random_in(std::mt19937& random, glm::dvec3 lo, glm::dvec3 hi) {
    const auto share = [&] { return std::uniform_real_distribution<double>()(random); };
    return lo + (hi - lo) * glm::dvec3(share(), share(), share());
}

/// How many bricks of each level there are.
std::map<int, int> counted_by_level(const VolumeSet& set) {
    std::map<int, int> count;
    for (const Brick& brick : set.bricks->bricks())
        ++count[brick.level];
    return count;
}

/// A grid with the samples of bricks of its cells, every one solved.
Volume baked_dense(const gpu::Device& device, const Scene& scene, const Bounds& box, double cell,
                   double vpls) {
    bake::BakeSettings grid(*bake::find_solver("gather"));
    grid.solver.set("vpls", vpls);
    grid.solver.set("tolerance", 0);
    grid.bounds = Bounds{box.lo - 0.5 * cell, box.hi + 0.5 * cell};
    grid.grid = {.cell = cell, .margin = 0};
    Progress silent;
    return bake::bake(scene, bake::plan_bake(bake::survey(scene), grid, device.info()), device,
                      silent)
        .volume;
}

/// Of shares by which something is off.
struct Off {
    double worst = 0, square = 0;
    int count = 0;
    void add(double off) {
        worst = std::max(worst, std::abs(off));
        square += off * off;
        ++count;
    }
    double rms() const { return std::sqrt(square / count); }
};

TEST_F(BakedInBricks, AFurnaceIsOneInAllBricks) {
    Scene scene = scenes::furnace(4.0f, 0.5f, 100.0f);
    // Something to refine at that is of the furnace, too.
    const glm::dvec3 lo(0.4, 1.1, 0.6), hi(1.3, 1.4, 1.5);
    scenes::add_box(scene, 0, glm::vec3(lo), glm::vec3(hi), scenes::Facing::outward);
    bake::BakeSettings settings = settings_of(0.125, 0.5, 0);
    settings.bounds = Bounds{glm::dvec3(0), glm::dvec3(4)};
    const VolumeSet set = run(scene, settings).set;
    ASSERT_EQ(counted_by_level(set).size(), 3u) << "bricks of all levels";
    const Volume dense = baked_dense(device(), scene, *settings.bounds, 0.125, 192);
    const double expected = 200.0 * glm::pi<double>(); // lux
    std::mt19937 random(1);
    const readers::Reader& facing = *readers::reader_named("lpvbake");
    Off bricks, grid;
    double twice = 0;
    for (int i = 0; i < 10000; ++i) {
        const glm::dvec3 p = random_in(random, glm::dvec3(0.05), glm::dvec3(3.95));
        const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
        if (glm::all(glm::greaterThan(p, lo - 0.01)) && glm::all(glm::lessThan(p, hi + 0.01)))
            continue;
        bricks.add(readers::irradiance(facing, set, p, n).y / expected - 1);
        grid.add(readers::irradiance(facing, dense, p, n).y / expected - 1);
        // Bricks that were summed would not do.
        const std::size_t brick = set.bricks->at(p);
        if (const auto up = set.bricks->parent(brick))
            twice = std::max(twice, (readers::irradiance(facing, set.levels[brick], p, n)
                                     + readers::irradiance(facing, set.levels[*up], p, n))
                                            .y
                                        / expected);
    }
    // The solver errs beside what stands there; bricks and reading them add nothing to it.
    EXPECT_LT(bricks.worst, 0.1);
    EXPECT_LT(bricks.rms(), 0.009);
    EXPECT_LT(bricks.rms(), 1.02 * grid.rms()) << grid.rms();
    EXPECT_GT(twice, 1.9);
}

TEST_F(BakedInBricks, BricksStandWhereGeometryDoesAndLightChanges) {
    // A small floor in one corner of the box, and light that falls off over it.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(100)),
                     {0.2f, 0.3f, 0.2f}, {0, 0, 0.6f}, {0.6f, 0, 0});
    bake::BakeSettings settings = settings_of(0.125, 1, 0.05);
    settings.bounds = Bounds{glm::dvec3(0), glm::dvec3(16, 8, 16)};
    const VolumeSet set = run(scene, settings).set;
    const auto count = counted_by_level(set);
    EXPECT_EQ(count.at(3), 4);
    EXPECT_LT(count.at(0), 30) << "of 2048 places";
    EXPECT_EQ(set.bricks->bricks()[set.bricks->at({0.5, 0.35, 0.5})].level, 0);
    EXPECT_EQ(set.bricks->bricks()[set.bricks->at({14, 6, 14})].level, 3);
    // Light changes in free air beside it, where no surface is.
    EXPECT_LT(set.bricks->bricks()[set.bricks->at({0.5, 1.6, 0.5})].level, 3);
}

/// A small emitter in black air: light that no cluster changes.
Scene one_emitter() {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0), glm::vec3(1000)),
                     {0.55f, 0.6f, 0.55f}, {0.1f, 0, 0}, {0, 0, 0.1f});
    return scene;
}

TEST_F(BakedInBricks, SamplesInCommonAreEqual) {
    bake::BakeSettings settings = settings_of(0.125, 0.5, 1e-9);
    settings.solver.set("vpls", 100000);
    settings.bounds = Bounds{glm::dvec3(0), glm::dvec3(4)};
    const VolumeSet set = run(one_emitter(), settings).set;
    std::size_t common = 0;
    for (std::size_t i = 0; i < set.levels.size(); ++i) {
        const auto up = set.bricks->parent(i);
        if (!up)
            continue;
        const Volume &fine = set.levels[i], &coarse = set.levels[*up];
        for (std::size_t s = 0; s < coarse.grid.size(); ++s) {
            const glm::dvec3 p = coarse.grid.center(coarse.grid.cell_at(s));
            const glm::ivec3 cell(glm::round(fine.grid.to_grid(p) - 0.5));
            if (!fine.grid.contains(cell))
                continue;
            ++common;
            for (std::size_t k = 0; k < fine.sh.size(); ++k)
                EXPECT_EQ(fine.sh[k][fine.grid.index(cell)], coarse.sh[k][s]);
        }
    }
    EXPECT_GT(common, 1000u);
}

TEST_F(BakedInBricks, ASampleIsWhatAGridHasThere) {
    bake::BakeSettings settings = settings_of(0.25, 0.5, 0.5);
    settings.solver.set("vpls", 100000);
    settings.bounds = Bounds{glm::dvec3(0), glm::dvec3(4)};
    const Scene scene = one_emitter();
    const VolumeSet set = run(scene, settings).set;
    const Volume dense = baked_dense(device(), scene, *settings.bounds, 0.25, 100000);
    const Volume& root = set.levels.back();
    double off = 0, sum = 0;
    std::size_t equal = 0;
    for (std::size_t s = 0; s < volume::brick_samples; ++s) {
        const glm::ivec3 cell(
            glm::round(dense.grid.to_grid(root.grid.center(root.grid.cell_at(s))) - 0.5));
        ASSERT_TRUE(dense.grid.contains(cell));
        const float expected = dense.sh[0][dense.grid.index(cell)].x;
        const double one = std::abs(double(root.sh[0][s].x - expected));
        off += one;
        sum += double(expected);
        equal += one <= 1e-5 * double(expected);
    }
    // A place by itself tests other points of what it sees than a cell among others.
    EXPECT_LT(off, 0.05 * sum);
    EXPECT_GE(equal, volume::brick_samples - 5);
}

TEST_F(BakedInBricks, TheBytesAreThoseOfAnyNumberOfThreads) {
    const Scene scene = scenes::cornell_box_with_point();
    const bake::BakeSettings settings = settings_of(0.1, 0.2, 0.02);
    const VolumeSet many = run(scene, settings).set;
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const VolumeSet alone = run(scene, settings).set;
    ASSERT_TRUE(*many.bricks == *alone.bricks);
    for (std::size_t i = 0; i < many.levels.size(); ++i) {
        EXPECT_EQ(many.levels[i].sh, alone.levels[i].sh);
        EXPECT_EQ(many.levels[i].validity, alone.levels[i].validity);
        EXPECT_EQ(many.levels[i].walls, alone.levels[i].walls);
    }
}

TEST_F(BakedInBricks, ASealedBoxIsDarkOnAllLevels) {
    // Six sides around an unlit room, in the light of a sky.
    Scene scene = scenes::furnace(2.0f, 0.5f, 0.0f);
    for (Material& material : scene.materials)
        material.double_sided = true;
    scene.sky.luminance = glm::vec3(1000);
    bake::BakeSettings settings = settings_of(0.125, 0.5, 0.02);
    settings.bounds = Bounds{glm::dvec3(-1), glm::dvec3(3)};
    const VolumeSet set = run(scene, settings).set;
    const readers::Reader& facing = *readers::reader_named("lpvbake");
    std::mt19937 random(4);
    double inside = 0, outside = 0;
    for (int i = 0; i < 4000; ++i) {
        const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
        inside = std::max(
            inside, readers::irradiance(facing, set,
                                        random_in(random, glm::dvec3(0.25), glm::dvec3(1.75)), n)
                        .y);
        outside = std::max(
            outside,
            readers::irradiance(facing, set, random_in(random, glm::dvec3(2.1), glm::dvec3(3)), n)
                .y);
    }
    EXPECT_GT(outside, 1000.0);
    EXPECT_LT(inside, 1e-6 * outside);
    for (std::size_t i = 0; i < set.levels.size(); ++i)
        for (std::size_t s = 0; s < volume::brick_samples; ++s) {
            const Grid& grid = set.levels[i].grid;
            const glm::dvec3 p = grid.center(grid.cell_at(s));
            // But for those that stitching made of coarser ones: they are not valid then.
            if (glm::all(glm::greaterThan(p, glm::dvec3(0.01)))
                && glm::all(glm::lessThan(p, glm::dvec3(1.99))) && set.levels[i].is_valid(s)) {
                EXPECT_EQ(set.levels[i].sh[0][s], glm::vec3(0)) << i << ' ' << s;
            }
        }
}

TEST_F(BakedInBricks, SizeIsObeyedAndErrorFallsWithIt) {
    const Scene scene = scenes::cornell_box_with_point();
    bake::BakeSettings settings = settings_of(0.0625, 0.25, 0);
    const uint64_t bytes = bake::brick_numbers(settings.solver.order()) * 4;
    double last = 1e9;
    for (const std::size_t most : {8u, 20u, 60u}) {
        settings.adaptive->size = most * bytes + 17;
        const bake::BakedBricks baked = run(scene, settings);
        EXPECT_LE(baked.set.levels.size(), most);
        EXPECT_GT(2 * baked.set.levels.size(), most) << "the size is used";
        EXPECT_LT(baked.error, last);
        last = baked.error;
    }
    settings.adaptive->error = 0.001;
    settings.adaptive->size = 10 * bytes;
    const bake::BakedBricks baked = run(scene, settings);
    ASSERT_EQ(baked.warnings.size(), 1u);
    EXPECT_NE(baked.warnings[0].find("more than the `error` of 0.1 %"), std::string::npos)
        << baked.warnings[0];
    settings.adaptive->size = 5;
    EXPECT_EQ(error_of("`max_size`", [&] { run(scene, settings); }).kind, ErrorKind::argument);
}

TEST_F(BakedInBricks, BoxesMakeThemFinerOrCoarser) {
    // An emitter in the middle, whose bricks are the finest; a corner of air, whose are not.
    bake::BakeSettings settings = settings_of(0.125, 0.25, 0.5);
    settings.bounds = Bounds{glm::dvec3(-1), glm::dvec3(3)};
    const Scene scene = one_emitter();
    const glm::dvec3 air(2.4, 2.4, 2.4), emitter(0.6, 0.6, 0.6);
    const auto level_at = [](const VolumeSet& set, glm::dvec3 p) {
        return set.bricks->bricks()[set.bricks->at(p)].level;
    };
    const VolumeSet plain = run(scene, settings).set;
    ASSERT_EQ(level_at(plain, air), 1);
    ASSERT_EQ(level_at(plain, emitter), 0);

    settings.adjust = {{air - 0.2, air + 0.2, {}, 1, true}};
    EXPECT_EQ(level_at(run(scene, settings).set, air), 0) << "though nothing is lost without";
    settings.adjust = {{glm::dvec3(-1), glm::dvec3(3), {}, 1, false}};
    EXPECT_EQ(counted_by_level(run(scene, settings).set).size(), 1u);
    // The last box counts, for bricks as for cells.
    settings.adjust.push_back({emitter - 0.1, emitter + 0.1, {}, 1, true});
    EXPECT_EQ(level_at(run(scene, settings).set, emitter), 0);

    settings.adjust = {{glm::dvec3(-1), glm::dvec3(3), {}, 3, {}}};
    const VolumeSet bright = run(scene, settings).set;
    ASSERT_TRUE(*bright.bricks == *plain.bricks);
    EXPECT_NEAR(bright.levels.back().sh[0][0].x, 3 * plain.levels.back().sh[0][0].x,
                1e-5f * bright.levels.back().sh[0][0].x);
    settings.adjust = {{air - 0.2, air + 0.2, false, 1, {}}};
    const VolumeSet closed = run(scene, settings).set;
    const Volume& brick = closed.levels[closed.bricks->at(air)];
    EXPECT_FALSE(brick.is_valid(brick.grid.index(glm::ivec3(brick.grid.to_grid(air)))));
    EXPECT_EQ(closed.levels.front().metadata.at("adjust"), "2.2,2.2,2.2,2.6,2.6,2.6 invalid");
}

TEST_F(BakedInBricks, NoiseMakesNoBricks) {
    // A room whose light is even: what samples differ by is what the solver errs by.
    const Scene scene = scenes::furnace(20.0f, 0.5f, 100.0f);
    bake::BakeSettings settings = settings_of(0.25, 1, 0.02);
    settings.solver.set("vpls", 24);
    settings.bounds = Bounds{glm::dvec3(2), glm::dvec3(18)};
    const bake::BakedBricks baked = run(scene, settings);
    EXPECT_EQ(counted_by_level(baked.set)[0], 0);
    EXPECT_LE(baked.error, 0.02);
}

TEST_F(BakedInBricks, AnErrorLeavesNoMoreThanItAllows) {
    const Scene scene = scenes::cornell_box_with_point();
    std::size_t last = 1u << 30;
    for (const double error : {0.005, 0.03, 0.2}) {
        const bake::BakedBricks baked = run(scene, settings_of(0.0625, 0.25, error));
        EXPECT_LE(baked.error, error);
        EXPECT_LT(baked.set.levels.size(), last);
        last = baked.set.levels.size();
    }
}

} // namespace
} // namespace lpvbake
