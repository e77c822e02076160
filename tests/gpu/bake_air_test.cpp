// What air scatters, as grids beside a field.
#include "bake/bake.h"
#include "gpu/device.h"
#include "lpvbake/error.h"
#include "scenes.h"
#include "volume/grids.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lpvbake {
namespace {

class BakedAir : public testing::DeviceTest {
protected:
    Volume run(const Scene& scene, const medium::Medium& air,
               const bake::DirectSettings& direct = {}) {
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.bounds = bounds_of(scene);
        settings.grid.resolution = 10;
        settings.grid.margin = 0;
        settings.medium = air;
        settings.medium->box = bounds_of(scene);
        settings.direct = direct;
        const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
        Progress silent;
        Baked baked = bake::bake(scene, plan, device(), silent);
        planned_ = bake::grids_of(plan);
        std::vector<std::string> planned, made;
        for (const volume::GridView& grid : volume::grids_of(planned_))
            planned.push_back(grid.name());
        for (const volume::GridView& grid : volume::grids_of(baked.volume))
            made.push_back(grid.name());
        EXPECT_EQ(planned, made);
        return std::move(baked.volume);
    }
    static std::span<const float> grid(const Volume& volume, const char* kind, std::size_t k = 0) {
        return volume::grids_of(volume, volume::kind_named(kind))[k].values();
    }

private:
    Volume planned_;
};

TEST_F(BakedAir, AnEvenFieldIsScatteredAsMuchAsItIsForAnyPhase) {
    const Scene scene = scenes::furnace(2, 0.5f, 3.0f); // luminance 6
    for (const double g : {0.0, 0.6}) {
        const Volume volume = run(scene, {{0.1, 0.2, 0.4}, {0, 0.3, 0}, g, {}});
        for (std::size_t i = 0; i < volume.grid.size(); ++i)
            for (std::size_t c = 0; c < 3; ++c) {
                const double s = glm::dvec3(0.1, 0.2, 0.4)[int(c)];
                EXPECT_NEAR(grid(volume, "scatter")[3 * i + c], s * 6, 0.02 * s * 6);
                EXPECT_FLOAT_EQ(grid(volume, "extinction")[3 * i + c], float(c == 1 ? 0.5 : s));
                if (g == 0)
                    continue;
                for (std::size_t k = 0; k < 9; ++k)
                    EXPECT_NEAR(grid(volume, "scattered", k)[3 * i + c],
                                s
                                    * std::pow(g, k == 0  ? 0
                                                  : k < 4 ? 1
                                                          : 2)
                                    * double(volume.sh[k][i][int(c)]),
                                1e-5);
            }
        EXPECT_EQ(volume::grids_of(volume, volume::kind_named("scattered")).size(),
                  g == 0 ? 0u : 9u);
        EXPECT_EQ(volume.metadata.at("medium").substr(0, 20), "scatter=0.1/0.2/0.4,");
    }
}

TEST_F(BakedAir, DirectLightCountsOnceAndTheFieldStays) {
    Scene scene = scenes::cornell_box_with_sun(300);
    scene.lights.push_back(scenes::point_light({0.1, 1.7, 0.3}, 20));
    const medium::Medium thin{glm::dvec3(1e-4), glm::dvec3(0), 0.0, {}};
    const bake::DirectSettings sh{.sh = true};
    const Volume plain = run(scene, thin, sh);
    const auto direct = volume::grids_of(plain, volume::direct_kind());
    for (std::size_t i = 0; i < 3 * plain.grid.size(); ++i) {
        const double field = double(plain.sh[0][i / 3][int(i % 3)]);
        const double expected =
            1e-4 * 0.28209479177387814 * (field + double(direct[0].values()[i]));
        EXPECT_NEAR(grid(plain, "scatter")[i], std::max(0.0, expected), 1e-3 * expected + 1e-9);
    }
    // Static lights are in the field, and not twice in the air.
    Scene fixed = scene;
    fixed.lights[1].is_static = true;
    const Volume other = run(fixed, thin);
    for (std::size_t i = 0; i < 3 * plain.grid.size(); ++i)
        EXPECT_FLOAT_EQ(grid(other, "scatter")[i], grid(plain, "scatter")[i]);
    // Twice the light, twice the scattering; lights add up.
    for (Light& light : scene.lights)
        light.intensity *= 2;
    const Volume twice = run(scene, thin);
    for (std::size_t i = 0; i < 3 * plain.grid.size(); ++i)
        EXPECT_NEAR(grid(twice, "scatter")[i], 2 * grid(plain, "scatter")[i],
                    2e-4 * grid(plain, "scatter")[i] + 1e-9);
}

TEST_F(BakedAir, IsRefusedWhereThereAreNoGrids) {
    bake::BakeSettings settings(*bake::find_solver("gather"));
    settings.medium = medium::Medium{glm::dvec3(1), glm::dvec3(0), 0, {{-1, 0, -1}, {1, 2, 1}}};
    settings.layers.emplace_back();
    const Scene scene = scenes::cornell_box_with_sun(300);
    EXPECT_THROW(bake::plan_bake(bake::survey(scene), settings, device().info()), Error);
}

} // namespace
} // namespace lpvbake
