// Light by texels of maps, and what a picture's depths know of what hides them.
#include "gpu/device.h"
#include "render/display.h"
#include "render/render.h"
#include "render/view.h"
#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <cmath>

namespace lpvbake {
namespace {

using render::RsmLight;
using render::RsmLightSettings;
using Seen = RsmLightSettings::Seen;

const scene::Frame frame{glm::dvec3(-2, 0, -2), 0.5, glm::dvec3(8, 8, 8)};

/// A room of 4 x 3 x 4 m that a spot below its ceiling lights on the left.
Scene room() {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, {0.7f, 0.5f, 0.3f}), {-2, 0, -2}, {2, 3, 2},
                    scenes::Facing::inward);
    scene.lights = {scenes::spot_light({-1, 2.9, 0}, {-0.4, -1, 0}, 500, 0.4, 0.7)};
    return scene;
}

class RsmPictures : public testing::DeviceTest {
protected:
    render::Rendering draw(const Scene& scene, const RsmLightSettings& settings,
                           glm::dvec3 eye = {1.2, 2.4, 1.7}, glm::dvec3 target = {0.3, 0, -0.4},
                           glm::ivec2 size = glm::ivec2(48, 36)) {
        const visibility::Visibility visibility(scene, frame);
        const reference::Paths paths(scene, visibility, frame, {});
        const raster::Raster raster(device(), scene, frame);
        Volume volume; // that nobody asks
        volume.grid = {glm::dvec3(-2), 4, glm::ivec3(1)};
        volume.sh.assign(1, {glm::vec3(0)});
        volume.sh_order = 0;
        const RsmLight rsm(scene, frame, visibility, settings);
        render::ViewSettings view;
        view.camera = render::look_at(eye, target, glm::radians(60.0));
        view.size = size;
        view.samples = 1;
        view.show = render::Show::indirect;
        view.rsm = &rsm;
        Progress silent;
        return render::render({scene, frame, visibility, paths}, volume::Levels(volume), raster,
                              *readers::reader_named("lpvbake"), view, silent);
    }
    static RsmLightSettings by(Seen seen, double radius = 100, double thickness = 0.1,
                               int samples = 16) {
        RsmLightSettings settings;
        settings.seen = seen;
        settings.radius = radius;
        settings.thickness = thickness;
        settings.samples = samples;
        settings.compare = true;
        return settings;
    }
};

TEST_F(RsmPictures, InAnEmptyRoomAllAgreeBitForBit) {
    const Scene scene = room();
    const render::Rendering none = draw(scene, by(Seen::none)), ssdo = draw(scene, by(Seen::ssdo)),
                            rays = draw(scene, by(Seen::rays));
    EXPECT_GT(render::mean_luminance(none.picture), 0.1);
    EXPECT_EQ(none.picture.samples, ssdo.picture.samples);
    EXPECT_EQ(none.picture.samples, rays.picture.samples);
    EXPECT_GT(none.pairs.pairs, 1000u);
    EXPECT_EQ(none.pairs.hidden, 0u);
}

TEST_F(RsmPictures, APlateInViewHidesAsMuchAsItShould) {
    // A thick wall between the lit left half and the right, seen from the right.
    Scene scene = room();
    scenes::add_box(scene, 0, {-0.15f, 0, -2}, {0.15f, 1.4f, 2}, scenes::Facing::outward);
    const glm::dvec3 eye(1.9, 2.7, 0), target(-0.4, 0.6, 0);
    const render::Rendering rays = draw(scene, by(Seen::rays), eye, target);
    EXPECT_GT(double(rays.pairs.hidden), 0.1 * double(rays.pairs.pairs));
    double before = 1;
    for (const int samples : {4, 16, 64}) {
        const render::Rendering ssdo = draw(scene, by(Seen::ssdo, 100, 0.4, samples), eye, target);
        const double lit = double(ssdo.pairs.falsely_lit) / double(ssdo.pairs.hidden);
        EXPECT_LT(lit, before); // the more places, the less slips through
        before = lit;
        EXPECT_EQ(ssdo.pairs.hidden, rays.pairs.hidden);
    }
    EXPECT_LT(before, 0.35);
}

TEST_F(RsmPictures, WhatIsBehindTheCameraHidesNothing) {
    // The lamp's spot lies behind the eye, and a wall before it.
    Scene scene = room();
    scenes::add_box(scene, 0, {-0.5f, 0, -2}, {-0.3f, 2.2f, 2}, scenes::Facing::outward);
    const glm::dvec3 eye(0.2, 1.5, 0), target(2, 0.8, 0);
    const render::Rendering none = draw(scene, by(Seen::none), eye, target),
                            ssdo = draw(scene, by(Seen::ssdo, 100, 5), eye, target),
                            rays = draw(scene, by(Seen::rays), eye, target);
    EXPECT_EQ(none.picture.samples, ssdo.picture.samples);
    EXPECT_GT(rays.pairs.hidden, 100u);
    EXPECT_EQ(ssdo.pairs.falsely_lit, rays.pairs.hidden); // all of them
    EXPECT_EQ(ssdo.pairs.falsely_dark, 0u);
    EXPECT_LT(render::mean_luminance(rays.picture), 0.8 * render::mean_luminance(none.picture));
}

TEST_F(RsmPictures, WithoutReachOrThicknessNothingIsHidden) {
    Scene scene = room();
    scenes::add_box(scene, 0, {-0.15f, 0, -2}, {0.15f, 1.4f, 2}, scenes::Facing::outward);
    const render::Rendering none = draw(scene, by(Seen::none));
    EXPECT_EQ(none.picture.samples, draw(scene, by(Seen::ssdo, 0)).picture.samples);
    EXPECT_EQ(none.picture.samples, draw(scene, by(Seen::ssdo, 100, 0)).picture.samples);
    EXPECT_NE(none.picture.samples, draw(scene, by(Seen::ssdo)).picture.samples);
}

TEST_F(RsmPictures, WhatIsTakenToBeTooThickDarkensWhatIsLitBehindIt) {
    // A thin board seen from above, and light that passes below it.
    Scene scene = room();
    scenes::add_box(scene, 0, {-0.6f, 1.2f, -0.8f}, {0.9f, 1.25f, 0.8f}, scenes::Facing::outward);
    const glm::dvec3 eye(0.4, 2.8, 0.1), target(0.2, 0, 0);
    const render::Rendering thin = draw(scene, by(Seen::ssdo, 100, 0.05), eye, target),
                            thick = draw(scene, by(Seen::ssdo, 100, 5), eye, target);
    EXPECT_LT(thin.pairs.falsely_dark, thick.pairs.falsely_dark);
    EXPECT_LT(render::mean_luminance(thick.picture), render::mean_luminance(thin.picture));
    // None is darker than with nothing hidden.
    EXPECT_LE(render::mean_luminance(thin.picture),
              render::mean_luminance(draw(scene, by(Seen::none), eye, target).picture));
}

TEST(RsmLight, TheMeanOverKeysIsTheSumOfAllTexels) {
    Scene scene = room();
    scenes::add_box(scene, 0, {-0.15f, 0, -2}, {0.15f, 1.0f, 2}, scenes::Facing::outward);
    scene.lights.push_back(scenes::sun({-0.3, -1, 0.1}, 100)); // does not come in
    const visibility::Visibility visibility(scene, frame);
    RsmLightSettings settings;
    settings.texels = 256;
    const RsmLight rsm(scene, frame, visibility, settings);
    for (const glm::dvec3 point : {glm::dvec3(6.5, 2.0, 4), glm::dvec3(5, 5.0, 6)}) {
        const glm::dvec3 n = glm::normalize(glm::dvec3(-1, 0.2, -0.1));
        uint64_t rays = 0;
        render::PairCount count;
        glm::dvec3 sum(0.0);
        constexpr int keys = 400;
        for (uint32_t key = 0; key < keys; ++key)
            sum += rsm.illuminance(point, n, key * 77, nullptr, rays, count) / double(keys);
        const glm::dvec3 all = rsm.all_texels(point, n, rays);
        EXPECT_GT(all.r, 0);
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(sum[c], all[c], 0.01 * all[c]);
        EXPECT_EQ(count.hidden, 0u); // nobody counts
    }
}

TEST(RsmLight, SendsWhatTheFloorReflects) {
    // A sun on a floor of albedo 0.4 far below: luminance 0.4 E / pi over half the sphere.
    Scene scene = scenes::floor_quad(400, glm::vec3(0.4f));
    scene.lights = {scenes::sun({0, -1, 0}, 1000)};
    const scene::Frame wide{glm::dvec3(-200, -1, -200), 1, glm::dvec3(400, 10, 400)};
    const visibility::Visibility visibility(scene, wide);
    const RsmLight rsm(scene, wide, visibility, {});
    uint64_t rays = 0;
    EXPECT_NEAR(rsm.all_texels({200, 7, 200}, {0, -1, 0}, rays).g, 400, 6);
}

} // namespace
} // namespace lpvbake
