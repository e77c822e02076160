// Static lights: their direct light in the field, beside paths that have it too.
#include "bake/bake.h"
#include "bake/pilot.h"
#include "gpu/device.h"
#include "reference/reference.h"
#include "scenes.h"
#include "volume/grids.h"
#include "volume/light_content.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace lpvbake {
namespace {

constexpr double cell = 0.125;

class StaticLights : public testing::DeviceTest {
protected:
    Volume bake(const Scene& scene, const bake::DirectSettings& direct = {}) {
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.bounds = Bounds{{-1, 0, -1}, {1, 2, 1}};
        settings.grid.cell = cell;
        settings.grid.margin = 0;
        settings.direct = direct;
        const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
        Progress silent;
        return std::move(bake::bake(scene, plan, device(), silent).volume);
    }
    /// By the same paths whatever is static.
    reference::Reference traced(const Scene& scene, const Grid& grid, uint64_t rays = 64) {
        reference::ReferenceSettings settings;
        settings.paths.bounces = std::nullopt;
        settings.sh_order = 2;
        settings.probes = 500;
        settings.rays = scene.lights.size() > 1 ? 16 * rays : rays; // of several one is drawn
        Progress silent;
        return reference::make_reference(scene, grid, settings, silent);
    }
    static Scene with_static(Scene scene, bool is_static = true) {
        for (Light& light : scene.lights)
            light.is_static = is_static;
        return scene;
    }
    static std::vector<Scene> scenes_of_all_kinds() {
        const Scene box = scenes::cornell_box();
        std::vector<Scene> all(5, box);
        all[0].lights = {scenes::sun({0.4, -0.6, -0.7}, 900)};
        all[1].lights = {scenes::point_light({0.1, 1.9, 0.2}, 70, {1.0f, 0.8f, 0.5f})};
        all[2].lights = {scenes::spot_light({0.0, 1.8, 0.9}, {0, -0.7, -1}, 300, 0.3, 0.5)};
        all[3].lights = {scenes::sun({-0.2, -0.5, -0.9}, 300, {0.4f, 0.7f, 1.0f}),
                         scenes::point_light({-0.6, 1.7, 0.5}, 40)};
        all[4].lights = {scenes::point_light({0.7, 1.0, 0.9}, 60)};
        all[4].lights[0].range = 2.5;
        return all;
    }
};

TEST_F(StaticLights, DirectAndIndirectAreWhatPathsFind) {
    for (std::size_t number = 0; const Scene& scene : scenes_of_all_kinds()) {
        SCOPED_TRACE(number++);
        const Scene fixed = with_static(scene);
        const Volume field = bake(fixed, {.visibility = true}), without = bake(scene);
        const reference::Reference all = traced(fixed, field.grid),
                                   reflected = traced(scene, field.grid);
        const auto seen = volume::grids_of(field, volume::visibility_kind());
        double difference = 0, whole = 0;
        int compared = 0;
        for (std::size_t i = 0; i < field.grid.size(); ++i) {
            if (field.validity[i] == 0 || all.volume.validity[i] == 0)
                continue;
            bool even = true; // cells are means, paths start in their middle
            double nearest = 1e9;
            for (std::size_t l = 0; l < scene.lights.size(); ++l) {
                even &= seen[l].values()[i] == 0 || seen[l].values()[i] == 1;
                const Light& light = scene.lights[l];
                if (light.type == LightType::directional)
                    continue;
                const glm::dvec3 centre = field.grid.center(field.grid.cell_at(i));
                nearest = std::min(nearest, glm::length(light.position - centre));
                const double aside = std::acos(std::clamp(
                    glm::dot(glm::normalize(centre - light.position), light.direction), -1.0, 1.0));
                const double wide = cell / glm::length(centre - light.position);
                if (light.type == LightType::spot)
                    even &= std::abs(aside - light.outer_cone) > wide
                            && std::abs(aside - light.inner_cone) > wide;
            }
            if (!even || nearest < 6 * cell)
                continue;
            ++compared;
            for (std::size_t k = 0; k < 9; ++k) {
                const glm::dvec3 off(field.sh[k][i] - without.sh[k][i] - all.volume.sh[k][i]
                                     + reflected.volume.sh[k][i]);
                difference += glm::dot(off, off);
                const glm::dvec3 own(all.volume.sh[k][i] - reflected.volume.sh[k][i]);
                whole += glm::dot(own, own);
            }
        }
        EXPECT_GT(compared, 60);
        EXPECT_LT(std::sqrt(difference / whole), scene.lights.size() > 1 ? 0.06 : 0.012);
    }
}

/// Rooms and places whose lights are all static: the sun in the box, a lamp beside a pane of glass,
/// a spot beside a lit panel, the sun and a blue sky outdoors, a lamp and a sun in the box.
std::vector<Scene> scenes_of_all_light() {
    std::vector<Scene> all(5, scenes::cornell_box());
    all[0].lights = {scenes::sun({0.4, -0.6, -0.7}, 900)};
    const int glass = scenes::add_material(all[1], {0.9f, 0.7f, 0.4f}, glm::vec3(0), true);
    all[1].materials[std::size_t(glass)].transmission = 0.8f;
    scenes::add_quad(all[1], glass, {0.75f, 0, -1}, {0, 0, 2}, {0, 2, 0});
    all[1].lights = {scenes::point_light({-0.3, 1.7, 1.6}, 120)};
    scenes::add_quad(all[2], scenes::add_material(all[2], glm::vec3(0.5f), glm::vec3(20)),
                     {-0.4f, 1.98f, -0.6f}, {0.8f, 0, 0}, {0, 0, 0.4f});
    all[2].lights = {scenes::spot_light({0.0, 1.8, 0.9}, {0, -0.7, -1}, 300, 0.3, 0.5)};
    all[3] = scenes::floor_quad(8, {0.3f, 0.4f, 0.2f});
    scenes::add_box(all[3], scenes::add_material(all[3], {0.7f, 0.5f, 0.4f}), {-0.9f, 0, -0.6f},
                    {-0.3f, 1.1f, 0.4f}, scenes::Facing::outward);
    scenes::add_box(all[3], scenes::add_material(all[3], {0.5f, 0.5f, 0.6f}), {0.2f, 0, -0.8f},
                    {0.8f, 1.6f, -0.1f}, scenes::Facing::outward);
    all[3].sky.luminance = {20, 40, 80};
    all[3].lights = {scenes::sun({-0.5, -0.8, 0.3}, 900)};
    all[4].lights = {scenes::sun({-0.2, -0.5, -0.9}, 300, {0.4f, 0.7f, 1.0f}),
                     scenes::point_light({-0.6, 1.7, 1.5}, 40)};
    for (Scene& scene : all)
        for (Light& light : scene.lights)
            light.is_static = true;
    return all;
}

/// Whether cells around have as much of each light, so that the mean over the cell is what arrives
/// in its middle; none for which a lamp is near, or the rim of a cone.
bool is_even_at(const Scene& scene, const Volume& field, glm::ivec3 at) {
    const auto seen = volume::grids_of(field, volume::visibility_kind());
    for (std::size_t l = 0; l < scene.lights.size(); ++l) {
        const Light& light = scene.lights[l];
        const float own = seen[l].values()[field.grid.index(at)];
        for (int axis = 0; axis < 3; ++axis)
            for (const int step : {-1, 1}) {
                glm::ivec3 beside = at;
                beside[axis] = std::clamp(at[axis] + step, 0, field.grid.dims[axis] - 1);
                if (std::abs(seen[l].values()[field.grid.index(beside)] - own) > 1e-4f)
                    return false;
            }
        if (light.type == LightType::directional)
            continue;
        const glm::dvec3 way = field.grid.center(at) - light.position;
        const double away = glm::length(way);
        const double aside =
            std::acos(std::clamp(glm::dot(way / away, light.direction), -1.0, 1.0));
        if (away < 6 * cell
            || (light.type == LightType::spot
                && (std::abs(aside - light.outer_cone) < cell / away
                    || std::abs(aside - light.inner_cone) < cell / away)))
            return false;
    }
    return true;
}

TEST_F(StaticLights, AllLightIsWhatPathsFind) {
    for (std::size_t number = 0; const Scene& scene : scenes_of_all_light()) {
        SCOPED_TRACE(number++);
        const Volume field = bake(scene, {.visibility = true});
        const reference::Reference all =
            traced(scene, field.grid, scene.lights.size() > 1 ? 128 : 1024);
        double off = 0, noise = 0, whole = 0, sum = 0, sum_of_paths = 0;
        int compared = 0;
        for (std::size_t i = 0; i < field.grid.size(); ++i) {
            if (field.validity[i] == 0 || all.volume.validity[i] == 0
                || !is_even_at(scene, field, field.grid.cell_at(i)))
                continue;
            ++compared;
            for (std::size_t k = 0; k < 9; ++k) {
                const glm::dvec3 difference(field.sh[k][i] - all.volume.sh[k][i]);
                off += glm::dot(difference, difference);
                const glm::dvec3 error(all.error.sh[k][i]), paths(all.volume.sh[k][i]);
                noise += glm::dot(error, error);
                whole += glm::dot(paths, paths);
            }
            sum += double(field.sh[0][i].g);
            sum_of_paths += double(all.volume.sh[0][i].g);
        }
        // What gathering itself loses stands beside the noise of the paths.
        EXPECT_LT(std::sqrt(off / whole), std::hypot(std::sqrt(noise / whole), 0.015));
        EXPECT_LT(std::sqrt(noise / whole), 0.04);
        EXPECT_NEAR(sum / sum_of_paths, 1, 0.006);
        EXPECT_GT(compared, 60);
    }
}

TEST_F(StaticLights, APilotLooksAtTheLightThatIsThereWithoutStaticsAndAir) {
    const Scene scene = scenes_of_all_kinds()[1], fixed = with_static(scene);
    bake::BakeSettings settings(*bake::find_solver("gather"));
    settings.bounds = bounds_of(scene);
    settings.grid.resolution = 12;
    const auto look = [&](const Scene& at, const bake::BakeSettings& by) {
        bake::Wish wish;
        wish.error = 0.05;
        Progress silent;
        bake::add_pilot(at, bake::survey(at), by, device(), silent, wish);
        EXPECT_TRUE(wish.pilot);
        EXPECT_GT(wish.pilot_seconds, 0);
        return wish;
    };
    const bake::Wish plain = look(scene, settings);
    settings.direct = {.visibility = true, .sh = true};
    settings.medium = medium::Medium{glm::dvec3(0.1), glm::dvec3(0), 0.3, bounds_of(scene)};
    const bake::Wish wish = look(fixed, settings);
    EXPECT_EQ(wish.pilot_seconds, plain.pilot_seconds);
    EXPECT_EQ(wish.pilot->bands, plain.pilot->bands);
    EXPECT_EQ(wish.pilot->clusters, plain.pilot->clusters);
    EXPECT_GT(wish.pilot->bands[0], 0);
}

TEST_F(StaticLights, NoneComesIntoASealedRoom) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_box(scene, grey, {-0.9f, 0.1f, -0.9f}, {0.9f, 1.9f, 0.9f}, scenes::Facing::inward);
    scenes::add_box(scene, grey, {-0.95f, 0.05f, -0.95f}, {0.95f, 1.95f, 0.95f},
                    scenes::Facing::outward);
    scene.lights = {scenes::sun({0.3, -1, 0.2}, 1000), scenes::point_light({0, 1, 0}, 1e-6)};
    scene.lights[0].is_static = true;
    const Volume field = bake(scene);
    for (std::size_t i = 0; i < field.grid.size(); ++i) {
        const glm::dvec3 centre = field.grid.center(field.grid.cell_at(i));
        if (glm::all(glm::lessThan(glm::abs(centre - glm::dvec3(0, 1, 0)), glm::dvec3(0.85)))) {
            EXPECT_LT(field.sh[0][i].g, 1e-4f);
        }
    }
}

TEST_F(StaticLights, AreToldAndNotKeptTwice) {
    Scene scene = scenes::cornell_box_with_sun(300);
    scene.lights[0].name = "sun \"1\"";
    scene.lights.push_back(scenes::point_light({0.1, 1.7, 0.3}, 20));
    Scene one = scene;
    one.lights[0].is_static = true;
    const Volume field = bake(one, {.sh = true}), without = bake(scene, {.sh = true});
    EXPECT_EQ(field.metadata.at("static_lights"), "[\"sun \\u00221\\u0022\"]");
    EXPECT_EQ(field.metadata.at("punctual_reflections"), "1..inf");
    EXPECT_EQ(field.metadata.at("content"),
              "punctual lights after one reflection and more; static lights direct");
    EXPECT_FALSE(without.metadata.contains("static_lights"));
    // The sum of field and direct light is the same.
    const auto apart = volume::grids_of(field, volume::direct_kind());
    const auto together = volume::grids_of(without, volume::direct_kind());
    for (std::size_t k = 0; k < field.sh.size(); ++k)
        for (std::size_t i = 0; i < field.grid.size(); ++i)
            for (std::size_t c = 0; c < 3; ++c)
                EXPECT_NEAR(field.sh[k][i][int(c)] + apart[k].values()[3 * i + c],
                            without.sh[k][i][int(c)] + together[k].values()[3 * i + c], 1e-3);
    const Volume all = bake(with_static(scene));
    EXPECT_EQ(all.metadata.at("punctual_reflections"), "0..inf");
    EXPECT_EQ(all.metadata.at("content"),
              "punctual lights direct and after any number of reflections");
    EXPECT_TRUE(all.others.empty());
}

TEST_F(StaticLights, GiveLightWithoutReflections) {
    Scene scene = with_static(scenes::cornell_box_with_sun(300));
    bake::BakeSettings settings(*bake::find_solver("gather"));
    settings.grid.resolution = 8;
    settings.bounces = 0;
    Progress silent;
    const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
    const Baked baked = bake::bake(scene, plan, device(), silent);
    EXPECT_EQ(baked.volume.metadata.at("content"), "punctual lights direct");
    EXPECT_EQ(::testing::PrintToString(baked.warnings).find("holds no light"), std::string::npos);
    settings.layers.emplace_back();
    EXPECT_THROW(bake::plan_bake(bake::survey(scene), settings, device().info()), Error);
}

TEST(StaticLightsInPaths, CountInTheFieldOrBesideIt) {
    Scene scene = scenes::cornell_box_with_sun(300);
    scene.lights.push_back(scenes::point_light({0.1, 1.7, 0.3}, 20));
    scene.lights[1].is_static = true;
    const scene::Frame frame{{-1, 0, -1}, 1.0, {2, 2, 2}};
    const visibility::Visibility visibility(scene, frame);
    const reference::Paths paths(scene, visibility, frame, {});
    uint64_t rays = 0;
    const auto lux = [&](reference::Paths::Lights which) {
        return paths.illuminance({1.0, 1e-4, 1.9}, {0, 1, 0}, rays, which).g;
    };
    using Lights = reference::Paths::Lights;
    EXPECT_GT(lux(Lights::statics), 1);
    EXPECT_GT(lux(Lights::others), 1);
    EXPECT_DOUBLE_EQ(lux(Lights::all), lux(Lights::statics) + lux(Lights::others));
}

} // namespace
} // namespace lpvbake
