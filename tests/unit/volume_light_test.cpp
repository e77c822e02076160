// The passes of VolumeLight, one by one, and its march beside what it stands for.
#include "medium/volume_light.h"

#include "medium/fog.h"
#include "scenes.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>

namespace lpvbake {
namespace {

using medium::Fog;
using medium::Medium;
using medium::StepCount;
using medium::Texture;
using medium::VolumeLight;
using medium::VolumeLightSettings;

const scene::Frame frame{glm::dvec3(0), 0.5, glm::dvec3(20)};

/// 10 x 10 x 10 m with a floor, whose half of smaller x lies at the bottom and the other 8 m above.
/// A map from straight above has the step on the border of two tiles.
Scene step() {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true);
    scenes::add_quad(scene, grey, {0, 0, 0}, {0, 0, 10}, {5, 0, 0});
    scenes::add_box(scene, grey, {5, 0, 0}, {10, 8, 10}, scenes::Facing::outward);
    scene.lights = {scenes::sun({0, -1, 0}, 1000)};
    return scene;
}

Medium air(double scatter, double absorb, double g) {
    return {glm::dvec3(scatter), glm::dvec3(absorb), g, {glm::dvec3(0), glm::dvec3(10)}};
}

VolumeLightSettings settings(bool long_steps, double boost = 0, int size = 128) {
    return {.map_size = size, .boost = boost, .long_steps = long_steps};
}

/// The mean over jitters.
double marched(const VolumeLight& light, glm::dvec3 origin, glm::dvec3 way, double distance,
               StepCount& steps) {
    double sum = 0;
    for (int i = 0; i < 16; ++i)
        sum += light.march(origin, way, distance, (i + 0.5) / 16, steps).x / 16;
    return sum;
}

TEST(VolumeLightPasses, TilesHoldLeastAndMost) {
    Texture<float> map(glm::ivec2(64, 32), 5);
    map[{17, 3}] = 2;
    map[{31, 15}] = 9;
    map[{32, 16}] = HUGE_VALF;
    const Texture<glm::vec2> tiles = medium::tiles_of(map);
    EXPECT_EQ(tiles.size, glm::ivec2(4, 2));
    EXPECT_EQ((tiles[{0, 0}]), glm::vec2(5, 5));
    EXPECT_EQ((tiles[{1, 0}]), glm::vec2(2, 9));
    EXPECT_EQ((tiles[{2, 1}]), glm::vec2(5, HUGE_VALF));
    EXPECT_EQ((tiles[{2, 0}]), glm::vec2(5, 5));
}

TEST(VolumeLightPasses, SmallHolesAreFilledAndRoofsRecede) {
    // A roof from x = 8 on, with a hole of six tiles and one of seven.
    Texture<glm::vec2> tiles(glm::ivec2(64, 32), glm::vec2(1));
    for (int y = 0; y < 32; ++y)
        for (int x = 0; x < 64; ++x)
            if (x < 8 || (y > 11 && y < 18 && x > 23 && x < 30)
                || (y > 11 && y < 19 && x > 45 && x < 53))
                tiles[{x, y}] = glm::vec2(10);
    const Texture<float> filled = medium::with_filled_holes(tiles);
    for (int x = 0; x < 64; ++x) {
        EXPECT_EQ((filled[{x, 15}]), x < 10 || (x > 43 && x < 55) ? 10 : 1) << x;
        EXPECT_EQ((filled[{x, 2}]), x < 10 ? 10 : 1) << x;
    }
}

TEST(VolumeLightPasses, BlursGoAlongEdgesAndThenEverywhere) {
    // Near on the left, twice as far on the right of a vertical edge; light likewise, and striped.
    Texture<float> distances(glm::ivec2(160, 160), 3);
    Texture<glm::dvec3> light(glm::ivec2(40, 40));
    for (int y = 0; y < 160; ++y)
        for (int x = 80; x < 160; ++x)
            distances[{x, y}] = 6;
    for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 40; ++x)
            light[{x, y}] = glm::dvec3((x < 20 ? 1 : 3) + (y % 2 ? 0.5 : -0.5));
    const Texture<glm::dvec2> edges = medium::edges_of(distances);
    EXPECT_EQ(edges.size, light.size);
    EXPECT_EQ((edges[{10, 20}]), glm::dvec2(0));
    for (const int x : {19, 20}) {
        EXPECT_EQ((edges[{x, 20}].x), 0);
        EXPECT_GT(std::abs(edges[{x, 20}].y), 0.1);
        EXPECT_LE(std::abs(edges[{x, 20}].y), 1);
    }
    const Texture<glm::dvec3> along = medium::blurred_along(edges, light);
    EXPECT_EQ((along[{10, 20}]), (light[{10, 20}]));
    EXPECT_NEAR((along[{19, 20}].x), 1, 0.1); // no stripes, and nothing of the other side
    EXPECT_NEAR((along[{20, 20}].x), 3, 0.1);
    const Texture<glm::dvec3> all = medium::blurred(along);
    EXPECT_NEAR((all[{20, 20}].x), (5 * 3 + 4 * 1) / 9.0, 0.1);
    EXPECT_NEAR((all[{5, 20}].x), 1, 0.5 / 9 + 1e-9);
}

TEST(VolumeLight, InTheOpenIsAsExact) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {0, 0, 0}, {0, 0, 10},
                     {10, 0, 0});
    scene.lights = {scenes::sun({0.4, -1, 0.3}, 1000)};
    const visibility::Visibility visibility(scene, frame);
    const Medium medium = air(0.1, 0.05, 0.6);
    const Fog exact(scene, visibility, frame, nullptr, medium, {0, 128});
    const VolumeLight fine(scene, visibility, frame, true, medium, settings(false, 0, 1024));
    const VolumeLight coarse(scene, visibility, frame, true, medium, settings(true, 0, 1024));
    const glm::dvec3 origin(1, 7, 11), way = glm::normalize(glm::dvec3(3, 1, -0.5));
    StepCount steps, leaps;
    const double truth = exact.direct(origin, way, 18).x;
    EXPECT_NEAR(marched(fine, origin, way, 18, steps), truth, 1e-5 * truth);
    EXPECT_NEAR(marched(coarse, origin, way, 18, leaps), truth, 1e-3 * truth);
    EXPECT_EQ(steps.coarse, 0u);
    EXPECT_LT(10 * leaps.all, steps.all);
    EXPECT_EQ(leaps.coarse, leaps.all);
}

TEST(VolumeLight, BesideAMapThatIsMuchSmallerThanTheAirStepsAreLonger) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {5, 0, 5}, {0, 0, 1e-4f},
                     {1e-4f, 0, 0});
    scene.lights = {scenes::sun({0.4, -1, 0.3}, 1000)};
    const visibility::Visibility visibility(scene, frame);
    const Medium medium = air(0.1, 0.05, 0.6);
    const Fog exact(scene, visibility, frame, nullptr, medium, {0, 128});
    const VolumeLight fine(scene, visibility, frame, true, medium, settings(false));
    StepCount steps;
    const double truth = exact.direct({1, 7, 11}, {1, 0, 0}, 18).x;
    EXPECT_NEAR(marched(fine, {1, 7, 11}, {1, 0, 0}, 18, steps), truth, 1e-4 * truth);
    EXPECT_LE(steps.all, 16u * 8192);
}

TEST(VolumeLight, AStepJudgedByOneTileRunsIntoTheNext) {
    // Along +x at a height of 4 m: lit for 5 m, then in the block that is 8 m high. From 2 m on,
    // half a tile is left before the block when a long step begins there, which is all taken as
    // lit. The exact parts end where the block begins, whatever the tree; so do short steps.
    const Scene scene = step();
    const visibility::Visibility visibility(scene, frame);
    const Medium medium = air(1e-6, 0, 0);
    const Fog exact(scene, visibility, frame, nullptr, medium, {0, 128});
    const VolumeLight fine(scene, visibility, frame, true, medium, settings(false));
    const VolumeLight naive(scene, visibility, frame, true, medium, settings(true));
    const double tile = 10.0 * medium::tile_edge / 128, lit = 1000 * 1e-6 / (4 * 3.14159265358979);
    const glm::dvec3 origin(2 * 0.5 * tile, 8, 10), way(1, 0, 0); // frame units: half a metre
    StepCount steps;
    const double half = 0.5 * tile, length = 5 - half;
    EXPECT_NEAR(exact.direct(origin, way, 30).x, lit * length, 1e-5 * lit * length);
    EXPECT_NEAR(marched(fine, origin, way, 30, steps), lit * length, 0.01 * lit * length);
    EXPECT_EQ(steps.coarse, 0u);
    EXPECT_NEAR(marched(naive, origin, way, 30, steps), lit * (length + half), 0.02 * lit * length);
    EXPECT_GT(steps.coarse, 0u);
}

TEST(VolumeLight, BehindFilledHolesLightCountsMore) {
    // A roof at 8 m with a hole of 4 x 4 tiles, which is closed, and a ray below it.
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true);
    scenes::add_quad(scene, grey, {0, 0, 0}, {0, 0, 10}, {10, 0, 0});
    scenes::add_quad(scene, grey, {0, 8, 0}, {0, 0, 10}, {3.75f, 0, 0});
    scenes::add_quad(scene, grey, {6.25f, 8, 0}, {0, 0, 10}, {3.75f, 0, 0});
    scenes::add_quad(scene, grey, {3.75f, 8, 0}, {0, 0, 3.75f}, {2.5f, 0, 0});
    scenes::add_quad(scene, grey, {3.75f, 8, 6.25f}, {0, 0, 3.75f}, {2.5f, 0, 0});
    scene.lights = {scenes::sun({0, -1, 0}, 1000)};
    const visibility::Visibility visibility(scene, frame);
    const Medium medium = air(1e-6, 0, 0);
    const VolumeLight plain(scene, visibility, frame, true, medium, settings(false, 0, 256));
    const VolumeLight boosted(scene, visibility, frame, true, medium, settings(false, 40, 256));
    StepCount steps;
    const auto light = [&](const VolumeLight& by, double height) {
        return marched(by, {0, 2 * height, 10}, {1, 0, 0}, 30, steps);
    };
    EXPECT_GT(light(plain, 4), 0);
    EXPECT_NEAR(light(boosted, 4), 41 * light(plain, 4), 1e-9 * light(boosted, 4));
    EXPECT_EQ(light(boosted, 8.5), light(plain, 8.5)); // above the roof
}

TEST(VolumeLight, PicturesAreTheSameForAnyNumberOfThreads) {
    const Scene scene = step();
    const visibility::Visibility visibility(scene, frame);
    scene::RsmView eye;
    eye.perspective = true;
    eye.origin = {4, 8, 19};
    const Texture<float> distances(glm::ivec2(50, 30), 12.0f);
    StepCount one, many;
    const auto draw = [&](int threads, StepCount& steps) {
        tbb::task_arena arena(threads);
        return arena.execute([&] {
            const VolumeLight light(scene, visibility, frame, true, air(0.1, 0, 0.4),
                                    settings(true, 2));
            return light.scattered(eye, distances, steps);
        });
    };
    const Texture<glm::dvec3> alone = draw(1, one), together = draw(4, many);
    EXPECT_EQ(alone.size, glm::ivec2(13, 8));
    EXPECT_EQ(alone.texels, together.texels);
    EXPECT_EQ(one.all, many.all);
    EXPECT_GT(one.coarse, 0u);
    EXPECT_TRUE(std::ranges::all_of(alone.texels, [](glm::dvec3 c) { return c.x > 0; }));
}

} // namespace
} // namespace lpvbake
