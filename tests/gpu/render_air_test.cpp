// Fog of a picture, beside paths that know nothing of how it is found.
#include "gpu/device.h"
#include "render/display.h"
#include "render/render.h"
#include "render/view.h"
#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lpvbake {
namespace {

constexpr double pi = glm::pi<double>();

/// A hall of 4 x 3 x 4 m with a hole of 1 x 1.4 m in its ceiling, and a box in it.
Scene hall() {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.6f), glm::vec3(0), true);
    scenes::add_quad(scene, grey, {-2, 0, -2}, {0, 0, 4}, {4, 0, 0});
    scenes::add_quad(scene, grey, {-2, 0, -2}, {4, 0, 0}, {0, 3, 0});
    scenes::add_quad(scene, grey, {-2, 0, -2}, {0, 3, 0}, {0, 0, 4});
    scenes::add_quad(scene, grey, {2, 0, -2}, {0, 0, 4}, {0, 3, 0});
    scenes::add_quad(scene, grey, {-2, 3, -2}, {1.5f, 0, 0}, {0, 0, 4});
    scenes::add_quad(scene, grey, {0.5f, 3, -2}, {1.5f, 0, 0}, {0, 0, 4});
    scenes::add_quad(scene, grey, {-0.5f, 3, -2}, {1, 0, 0}, {0, 0, 1.3f});
    scenes::add_quad(scene, grey, {-0.5f, 3, 0.7f}, {1, 0, 0}, {0, 0, 1.3f});
    scenes::add_box(scene, grey, {0.3f, 0, -0.8f}, {1.1f, 1.2f, 0}, scenes::Facing::outward);
    return scene;
}

/// A field of the same luminance from everywhere.
Volume constant_volume(double nits) {
    Volume volume;
    volume.grid = {glm::dvec3(-2.5), 0.5, glm::ivec3(10, 12, 10)};
    volume.sh_order = 2;
    volume.sh.assign(9, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0)));
    volume.sh[0].assign(volume.grid.size(), glm::vec3(float(nits * std::sqrt(4 * pi))));
    return volume;
}

class RenderAir : public testing::DeviceTest {
protected:
    struct Both {
        render::Rendering exact, traced;
        render::PictureError error() const {
            return render::compare_pictures(exact.picture, traced.picture);
        }
        double ratio() const {
            return render::mean_luminance(exact.picture) / render::mean_luminance(traced.picture);
        }
    };
    Both draw(const Scene& scene, const Volume& volume, const medium::Medium& air,
              render::Show show, int paths) {
        const scene::Frame frame = scene::frame_of(volume.grid);
        const visibility::Visibility visibility(scene, frame);
        const reference::Paths traces(scene, visibility, frame, {.bounces = std::nullopt});
        const raster::Raster raster(device(), scene, frame);
        const volume::Levels levels(volume);
        const medium::Fog fog(scene, visibility, frame, &levels, air, {0, 2048});
        render::ViewSettings settings;
        settings.camera = render::look_at({0.3, 1.5, 3.4}, {0, 1.3, 0}, glm::radians(60.0));
        settings.size = glm::ivec2(32, 24);
        settings.samples = 16;
        settings.show = show;
        settings.fog = &fog;
        settings.air = &air;
        const render::LitScene lit{scene, frame, visibility, traces};
        Progress silent;
        Both both;
        both.exact = render::render(lit, levels, raster, *readers::reader_named("lpvbake"),
                                    settings, silent);
        settings.samples = paths;
        both.traced = render::trace_picture(lit, settings, silent);
        return both;
    }
};

TEST_F(RenderAir, ShaftsAreAsPathsFindThem) {
    Scene sun = hall(), lamps = hall();
    sun.lights = {scenes::sun({0.25, -1, -0.1}, 20000)};
    lamps.lights = {scenes::point_light({-0.6, 2.2, 0.4}, 150, {1.0f, 0.7f, 0.4f}),
                    scenes::spot_light({1.4, 2.8, 1}, {-0.6, -1, -0.5}, 600, 0.3, 0.5)};
    const Bounds box{{-2, 0, -2}, {2, 3, 2}};
    const medium::Medium thin{glm::dvec3(0.05), glm::dvec3(0.01), 0.5, box};
    const medium::Medium thick{{0.5, 0.4, 0.2}, {0.0, 0.1, 0.3}, 0.0, box};
    medium::Medium low = thick;
    low.height = medium::Falloff{0, 0.8};
    medium::Medium smoke{glm::dvec3(0.5), glm::dvec3(0.1), 0.3, box};
    auto density = std::make_shared<volume::Density>();
    density->dims = glm::ivec3(6);
    density->to_voxels = glm::inverse(
        glm::scale(glm::rotate(glm::translate(glm::dmat4(1.0), glm::dvec3(-1.5, 0, -1.5)), 0.2,
                               glm::dvec3(0, 1, 0)),
                   glm::dvec3(0.5, 0.4, 0.6)));
    std::mt19937 random(4);
    for (int i = 0; i < 216; ++i)
        density->values.push_back(float(random() % 1000) / 500.0f);
    density->most = 2;
    smoke.density = density;
    for (const Scene& scene : {sun, lamps})
        for (const medium::Medium& air : {thin, thick, low, smoke}) {
            SCOPED_TRACE(medium::text_of(air) + (scene.lights.size() == 1 ? " sun" : " lamps"));
            const Both both = draw(scene, constant_volume(0), air, render::Show::direct, 256);
            EXPECT_GT(render::mean_luminance(both.traced.picture), 1);
            const double noise = both.traced.noise / std::sqrt(32.0 * 24);
            EXPECT_NEAR(both.ratio(), 1,
                        0.01 + 3 * noise / render::mean_luminance(both.traced.picture));
            EXPECT_LT(both.error().rmse, 1.5 * both.traced.noise);
        }
}

TEST_F(RenderAir, VolumeLightIsNearWhatItStandsFor) {
    // The air's own light of a picture with nothing else in it, by the chain and exactly.
    Scene scene = hall();
    scene.lights = {scenes::sun({0.25, -1, -0.1}, 20000)};
    const medium::Medium air{glm::dvec3(0.2), glm::dvec3(0.05), 0.5, {{-2, 0, -2}, {2, 3, 2}}};
    const Volume volume = constant_volume(0);
    const scene::Frame frame = scene::frame_of(volume.grid);
    const visibility::Visibility visibility(scene, frame);
    const reference::Paths traces(scene, visibility, frame, {.bounces = std::nullopt});
    const raster::Raster raster(device(), scene, frame);
    const volume::Levels levels(volume);
    const medium::Fog exact(scene, visibility, frame, &levels, air, {0, 1024});
    const medium::Fog rest(scene, visibility, frame, &levels, air, {0, 1024, false});
    const medium::VolumeLight chain(scene, visibility, frame, false, air, {});
    render::ViewSettings settings;
    settings.camera = render::look_at({0.3, 1.5, 3.4}, {0, 1.3, 0}, glm::radians(60.0));
    settings.size = glm::ivec2(160, 120);
    settings.samples = 4;
    settings.show = render::Show::direct;
    const auto draw = [&](const medium::Fog* fog, const medium::VolumeLight* volume_light) {
        settings.fog = fog;
        settings.volume_light = volume_light;
        Progress silent;
        return render::render({scene, frame, visibility, traces}, levels, raster,
                              *readers::reader_named("lpvbake"), settings, silent);
    };
    const render::Rendering truth = draw(&exact, nullptr), without = draw(&rest, nullptr),
                            shown = draw(&rest, &chain);
    const double added =
        render::mean_luminance(truth.picture) - render::mean_luminance(without.picture);
    EXPECT_GT(added, 1);
    EXPECT_NEAR(render::mean_luminance(shown.picture) - render::mean_luminance(without.picture),
                added, 0.1 * added);
    EXPECT_GT(shown.steps.coarse, 0u);
    EXPECT_EQ(truth.steps.all, 0u);
    const double error = render::compare_pictures(shown.picture, truth.picture).rmse;
    EXPECT_GT(error, 0.01 * added);
    EXPECT_LT(error, 0.5 * added);
    // Where no light is on its way to the eye nothing is added.
    settings.show = render::Show::indirect;
    EXPECT_EQ(draw(&rest, &chain).picture.samples, draw(&rest, nullptr).picture.samples);
}

TEST_F(RenderAir, InAFurnaceNothingIsSeenOfAirThatOnlyScatters) {
    // Luminance 6 from everywhere stays 6, whatever the phase; what is absorbed is missing.
    const Scene scene = scenes::furnace(2, 0.5f, 3.0f);
    Volume volume = constant_volume(6);
    volume.grid.origin = glm::dvec3(-1.5);
    const Bounds box{glm::dvec3(0), glm::dvec3(2)};
    for (const double g : {0.0, 0.6}) {
        const Both both =
            draw(scene, volume, {{0.2, 0.5, 2}, glm::dvec3(0), g, box}, render::Show::final, 64);
        EXPECT_NEAR(both.ratio(), 1, 0.01);
    }
    const Both absorbed =
        draw(scene, volume, {{0.2, 0.5, 2}, {0.5, 0.4, 0.1}, 0.2, box}, render::Show::final, 64);
    EXPECT_NEAR(absorbed.ratio(), 1, 0.01);
    EXPECT_LT(render::mean_luminance(absorbed.exact.picture), 5);
}

} // namespace
} // namespace lpvbake
