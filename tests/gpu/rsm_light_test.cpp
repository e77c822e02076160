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

/// Under a thin plate, |x| < 0.64 m and 1.3 m high, light passes at a height of 1 m from x = -2 m
/// to 1.5 m. The eye looks down on the plate from 1.6 m above it.
struct UnderPlate {
    Scene scene = room();
    scene::RsmView view;

    UnderPlate() {
        scenes::add_box(scene, 0, {-0.64f, 1.29f, -0.8f}, {0.64f, 1.3f, 0.8f},
                        scenes::Facing::outward);
        scene.lights = {scenes::spot_light({-1, 1, 1.9}, {-1, 0, -1.9}, 500, 0.003, 0.004)};
    }
    /// Of an eye that is turned by so much towards +x.
    render::SeenPlanes look(const visibility::Visibility& visibility, double angle,
                            glm::ivec2 size) {
        const glm::dvec3 eye(0, 2.9, 0);
        view = render::view_of(
            render::look_at(eye, eye + glm::dvec3(std::sin(angle), -std::cos(angle), 0),
                            glm::radians(90.0)),
            frame, size);
        std::vector<render::SeenPlanes::Plane> planes;
        for (int y = 0; y < size.y; ++y)
            for (int x = 0; x < size.x; ++x) {
                const glm::dvec3 along =
                    view.along(2.0 * (glm::dvec2(x, y) + 0.5) / glm::dvec2(size) - 1.0);
                const visibility::Hit hit =
                    visibility.closest({glm::vec3(view.origin), glm::vec3(along), 0.0f, HUGE_VALF});
                planes.push_back({view.origin + double(hit.t) * along, glm::dvec3(hit.normal)});
            }
        return {view, size, std::move(planes)};
    }
    /// The share of pairs that the planes hide.
    double falsely_dark(const visibility::Visibility& visibility, const render::SeenPlanes& planes,
                        double thickness, int samples) const {
        RsmLightSettings settings;
        settings.seen = Seen::ssdo;
        settings.radius = 100;
        settings.thickness = thickness;
        settings.samples = samples;
        settings.compare = true;
        const RsmLight rsm(scene, frame, visibility, settings);
        render::PairCount count;
        uint64_t rays = 0;
        for (uint32_t key = 0; key < 3000; ++key)
            rsm.illuminance(frame.from_world({1.5, 1, 0}), {-1, 0, 0}, key * 77, &planes, rays,
                            count);
        EXPECT_GT(count.pairs, 20000u);
        EXPECT_EQ(count.hidden, 0u); // by rays
        return double(count.falsely_dark) / double(count.pairs);
    }
};

TEST(RsmLight, UnderAThinPlateLightIsLostByTheOverlap) {
    UnderPlate under;
    const visibility::Visibility visibility(under.scene, frame);
    const render::SeenPlanes planes = under.look(visibility, 0, glm::ivec2(200));
    // Seen by the eye, the plate covers |x| < 0.64 * 1.9 / 1.6 of the way.
    const double from = (1.5 - 0.76) / 3.5, to = (1.5 + 0.76) / 3.5;
    for (const int samples : {1, 2, 3}) {
        double open = 1; // no place, one in each part of the way, falls below the plate
        for (int i = 0; i < samples; ++i) {
            const double begin = double(i) / samples, end = double(i + 1) / samples;
            open *= 1 - samples * std::max(0.0, std::min(end, to) - std::max(begin, from));
        }
        EXPECT_NEAR(under.falsely_dark(visibility, planes, 0.4, samples), 1 - open, 0.01)
            << samples;
    }
    EXPECT_EQ(under.falsely_dark(visibility, planes, 0.25, 3), 0); // 0.3 m lie between
}

TEST(RsmLight, PanningChangesWhatTheFramesEdgeCutsAlone) {
    UnderPlate under;
    const visibility::Visibility visibility(under.scene, frame);
    constexpr double size = 400;
    const auto look = [&](double angle) {
        return under.falsely_dark(visibility, under.look(visibility, angle, glm::ivec2(size)), 0.4,
                                  1);
    };
    const double all = 2 * 0.76 / 3.5;
    const double straight = look(0);
    EXPECT_NEAR(straight, all, 0.01);
    // All of the plate stays in the picture: but for its rim's pixels it is the same.
    for (const double angle : {0.1, 0.2, -0.2})
        EXPECT_NEAR(look(angle), straight, 0.003) << angle;
    // The picture ends 45 degrees from its middle: at x = -1.9 tan(45 - angle) of the way.
    for (const double angle : {0.5, 0.6, 0.7}) {
        const double edge = -1.9 * std::tan(glm::radians(45.0) - angle);
        EXPECT_NEAR(look(angle), (0.76 - edge) / 3.5, 0.01) << angle;
        EXPECT_LT(look(angle), straight - 0.02);
    }
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
