// Bakes of layers of light, by all solvers: linear, and beside bakes that decide by their own
// light.
#include "bake/bake.h"
#include "bake/layers.h"
#include "gpu/device.h"
#include "lit_layers.h"
#include "volume/compare.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

/// A scene of several lights, and the box that is baked, if not all of it.
struct Setting {
    const char* name;
    Scene scene;
    std::optional<Bounds> bounds = {};
};

Setting lamps() {
    Scene scene = scenes::cornell_box();
    scene.lights.push_back(scenes::point_light({0.3, 1.6, 0.4}, 80.0, {1.0f, 0.6f, 0.2f}));
    scene.lights.push_back(scenes::point_light({-0.6, 0.9, -0.5}, 30.0, {0.1f, 0.4f, 1.0f}));
    scene.lights.push_back(scenes::sun({0.3, -1.0, -1.0}, 2000.0));
    return {"lamps", scene};
}

/// A yard with a wall in it, of which a part is baked: most light comes from outside of that.
Setting yard() {
    Scene scene = scenes::floor_quad(8.0f, {0.3f, 0.5f, 0.3f});
    const int stone =
        scenes::add_material(scene, glm::vec3(0.6f, 0.5f, 0.4f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, stone, {-1.0f, 0.0f, 0.6f}, {3.0f, 0.0f, 0.0f}, {0.0f, 1.5f, 0.0f});
    scene.lights.push_back(scenes::sun({0.4, -1.0, -0.5}, 20000.0, {1.0f, 0.9f, 0.8f}));
    scene.lights.push_back(
        scenes::spot_light({-1.0, 2.0, 0.0}, {0.3, -1.0, 0.2}, 4000.0, 0.3, 0.5));
    scene.sky.luminance = {300.0f, 500.0f, 900.0f};
    return {"yard", scene, Bounds{{-1.5, 0.0, -1.5}, {1.5, 2.0, 1.5}}};
}

/// Two rooms beside each other with an opening, a lamp in one and a lit panel in the other.
Setting rooms() {
    Scene scene = scenes::furnace(4.0f, 0.6f, 0.0f);
    const int wall =
        scenes::add_material(scene, glm::vec3(0.7f, 0.3f, 0.3f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, wall, {2.1f, 0.0f, 0.0f}, {0.0f, 0.0f, 2.7f}, {0.0f, 4.0f, 0.0f});
    const int panel = scenes::add_material(scene, glm::vec3(0.2f), {5.0f, 20.0f, 40.0f}, true);
    scenes::add_quad(scene, panel, {3.9f, 1.0f, 1.0f}, {0.0f, 1.0f, 0.0f}, {0.0f, 0.0f, 1.0f});
    scene.lights.push_back(scenes::point_light({0.9, 2.9, 1.1}, 200.0, {1.0f, 0.8f, 0.5f}));
    return {"rooms", scene};
}

Setting glass() {
    Scene scene = scenes::glass_room(true);
    scene.lights.push_back(scenes::point_light({1.9, 2.2, 2.1}, 0.3, {0.2f, 1.0f, 0.6f}));
    return {"glass", scene};
}

/// Of all but the middle, where a lit panel stands beside the box that is baked.
Setting beside() {
    Scene scene = scenes::cornell_box_with_point();
    const int glow = scenes::add_material(scene, glm::vec3(0.3f), {2.0f, 60.0f, 20.0f}, true);
    scenes::add_quad(scene, glow, {-0.9f, 1.4f, 0.7f}, {0.6f, 0.0f, 0.0f}, {0.0f, 0.4f, 0.0f});
    return {"beside", scene, Bounds{{-1.0, 0.0, -1.0}, {0.2, 1.2, 0.4}}};
}

std::vector<Setting> settings() {
    std::vector<Setting> all;
    all.push_back({"all kinds", scenes::lit_by_all()});
    for (const auto& make : {lamps, yard, rooms, glass, beside})
        all.push_back(make());
    return all;
}

std::vector<bake::Layer> named(const std::vector<scene::LightLayer>& lights) {
    std::vector<bake::Layer> layers;
    for (const scene::LightLayer& light : lights)
        layers.push_back({std::to_string(layers.size()), "light", "scene", glm::vec3(1.0f), light});
    return layers;
}

/// Largest difference of a coefficient between a weighted sum and a volume, of the largest of its
/// cell.
double difference(std::span<const Volume> layers, std::span<const glm::vec3> weights,
                  const Volume& wanted) {
    double most = 0.0;
    for (std::size_t cell = 0; cell < wanted.grid.size(); ++cell) {
        double off = 0.0, largest = 0.0;
        for (std::size_t k = 0; k < wanted.sh.size(); ++k) {
            glm::dvec3 sum(0.0);
            for (std::size_t layer = 0; layer < weights.size(); ++layer)
                sum += glm::dvec3(weights[layer]) * glm::dvec3(layers[layer].sh[k][cell]);
            for (int c = 0; c < 3; ++c) {
                off = std::max(off, std::abs(sum[c] - double(wanted.sh[k][cell][c])));
                largest = std::max(largest, std::abs(double(wanted.sh[k][cell][c])));
            }
        }
        if (largest > 0.0)
            most = std::max(most, off / largest);
    }
    return most;
}

class LayeredBakes : public testing::DeviceTest {
protected:
    bake::BakedLevels bake(const Setting& setting, const solver::SolverKind& kind,
                           std::vector<bake::Layer> layers) {
        bake::BakeSettings settings(kind);
        settings.grid.resolution = 10;
        settings.bounds = setting.bounds;
        settings.bounces.reset();
        settings.solver.set_lighting_rays(1 << 14);
        if (solver::find_parameter(kind, "directions"))
            settings.solver.set("directions", 48);
        settings.layers = std::move(layers);
        Progress silent;
        const bake::BakePlan plan =
            bake::plan_bake(bake::survey(setting.scene), settings, device().info());
        return bake::bake_levels(setting.scene, plan, device(), silent);
    }
};

TEST_F(LayeredBakes, SumUpAndAreLinearForEverySolverInSixScenes) {
    uint32_t seed = 0;
    for (const Setting& setting : settings())
        for (const char* name : {"gather", "sn", "lpv"}) {
            const solver::SolverKind& kind = *bake::find_solver(name);
            std::vector<scene::LightLayer> layers = scenes::layers_of(setting.scene);
            const std::size_t parts = layers.size();
            ASSERT_GE(parts, 2u);
            std::vector<glm::vec3> weights = scenes::random_weights(parts, ++seed);
            layers.push_back(scenes::mixed(layers, weights));
            layers.back().beyond = {};
            const Volume plain = bake(setting, kind, {}).levels.front();
            const bake::BakedLevels baked = bake(setting, kind, named(layers));
            const std::vector<Volume>& fields = baked.layers.front();
            EXPECT_EQ(baked.levels.front().sh, plain.sh) << setting.name << ", " << name;
            const std::vector<glm::vec3> ones(parts, glm::vec3(1.0f));
            EXPECT_LT(difference(fields, ones, plain), 1e-5) << setting.name << ", " << name;
            EXPECT_LT(difference(fields, weights, fields.back()), 1e-5)
                << setting.name << ", " << name;
            // Not of one light alone, which the sum would be, too.
            EXPECT_GT(difference(std::span(fields).first(1), std::span(ones).first(1), plain), 1e-2)
                << setting.name << ", " << name;
        }
}

TEST_F(LayeredBakes, AreWithinTheStatedErrorBesideBakesThatDecideForThemselves) {
    for (const Setting& setting : {lamps(), rooms()})
        for (const char* name : {"gather", "sn"}) {
            bake::BakeSettings settings(*bake::find_solver(name));
            settings.grid.resolution = 16;
            const auto run = [&](const Scene& scene) {
                Progress silent;
                return bake::bake_levels(
                    scene, bake::plan_bake(bake::survey(scene), settings, device().info()),
                    device(), silent);
            };
            std::vector<scene::LightLayer> layers = scenes::layers_of(setting.scene);
            const scene::LightLayer mixed =
                scenes::mixed(layers, scenes::random_weights(layers.size(), 11));
            const Volume own = run(scenes::of_layer(setting.scene, mixed)).levels.front();
            settings.layers = named({mixed});
            const bake::BakedLevels baked = run(setting.scene);
            Volume layer = baked.layers.front().front();
            layer.validity = baked.levels.front().validity;
            const volume::Comparison found = volume::compare(layer, own, {});
            EXPECT_LT(found.relative_l1, bake::expected_error(settings)) << setting.name << name;
            EXPECT_GT(found.relative_l1, 1e-5) << setting.name << name;
        }
}

TEST_F(LayeredBakes, OfSunsTellWhatTheyErrBetweenThem) {
    // Nine suns of a day, and eight half-way between those, which are no keys.
    const scene::SunArc arc{48.1, 11.6, 6, 21};
    constexpr int count = 9;
    Setting setting = yard();
    setting.scene.lights = bake::suns_along(arc, count);
    std::vector<double> hours = scene::key_hours(arc, count), middles;
    for (std::size_t i = 0; i + 1 < hours.size(); ++i) {
        middles.push_back(0.5 * (hours[i] + hours[i + 1]));
        const glm::dvec3 towards = scene::towards_sun(arc, middles.back());
        setting.scene.lights.push_back(
            scenes::sun(-towards, scene::sun_illuminance(towards.y) / count));
    }
    const std::vector<bake::LayerWish> wishes{
        {.kind = bake::LayerWish::Kind::suns, .arc = arc, .suns = count},
        {.kind = bake::LayerWish::Kind::lights}};
    std::vector<bake::Layer> layers = bake::make_layers(setting.scene, wishes, true);
    ASSERT_EQ(layers.size(), 18u); // and the sky
    EXPECT_EQ(layers[3].kind, "sun");
    EXPECT_EQ(layers[3].hour, hours[3]);
    const bake::BakedLevels baked = bake(setting, *bake::find_solver("gather"), layers);
    std::vector<const Volume*> fields;
    for (const Volume& field : baked.layers.front())
        fields.push_back(&field);
    const std::vector<float>& validity = baked.levels.front().validity;
    const auto told = bake::hold_out(arc, hours, std::span(fields).first(count), validity);
    ASSERT_TRUE(told);
    EXPECT_GE(told->worst, told->mean);

    // The truth half-way between all neighbours, as it is told of every other.
    std::vector<const Volume*> both;
    std::vector<double> times;
    for (std::size_t i = 0; i < middles.size(); ++i) {
        both.insert(both.end(), {fields[i], fields[count + i]});
        times.insert(times.end(), {hours[i], middles[i]});
    }
    both.push_back(fields[count - 1]);
    times.push_back(hours[count - 1]);
    const auto truth = bake::hold_out(arc, times, both, validity);
    ASSERT_TRUE(truth);
    EXPECT_GT(truth->mean, 0.001);
    EXPECT_LT(truth->mean, 0.6 * told->mean);
    EXPECT_GT(truth->mean, 0.1 * told->mean);
}

} // namespace
} // namespace lpvbake
