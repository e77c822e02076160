// Fields of layers of light: linear beside the field of the scene's light, whatever the solver.
#include "gpu/device.h"
#include "lit_layers.h"
#include "scenes.h"
#include "solver/gather/gather.h"
#include "solver/sn/sn.h"
#include "visibility/validity.h"
#include "volume/grid.h"
#include "volume/sh.h"

#include <gtest/gtest.h>

namespace lpvbake {
namespace {

/// A scene in its grid.
struct Setting {
    Scene scene;
    Grid grid;
    scene::Frame frame;
    visibility::Visibility visibility;

    explicit Setting(Scene scene_in, int resolution = 16)
        : scene(std::move(scene_in)),
          grid(volume::fit_grid(bounds_of(scene).lo, bounds_of(scene).hi, {resolution})),
          frame{grid.origin, grid.cell, glm::dvec3(grid.dims)},
          visibility(scene, frame) {}

    Volume volume() const {
        Volume v;
        v.grid = grid;
        v.validity = visibility::trace_validity(visibility, grid.dims);
        return v;
    }
};

/// Largest difference of a coefficient, of the largest in its cell.
double difference(const std::vector<std::vector<glm::vec3>>& sum,
                  const std::vector<std::vector<glm::vec3>>& wanted) {
    double most = 0.0;
    for (std::size_t cell = 0; cell < wanted[0].size(); ++cell) {
        double off = 0.0, largest = 0.0;
        for (std::size_t k = 0; k < wanted.size(); ++k)
            for (int c = 0; c < 3; ++c) {
                off = std::max(off, std::abs(double(sum[k][cell][c]) - double(wanted[k][cell][c])));
                largest = std::max(largest, std::abs(double(wanted[k][cell][c])));
            }
        if (largest > 0.0)
            most = std::max(most, off / largest);
    }
    return most;
}

std::vector<std::vector<glm::vec3>> sum_of(std::span<const Volume> layers,
                                           std::span<const glm::vec3> weights) {
    std::vector<std::vector<glm::vec3>> sum = layers.front().sh;
    for (std::size_t k = 0; k < sum.size(); ++k)
        for (std::size_t cell = 0; cell < sum[k].size(); ++cell) {
            sum[k][cell] *= weights[0];
            for (std::size_t layer = 1; layer < layers.size(); ++layer)
                sum[k][cell] += weights[layer] * layers[layer].sh[k][cell];
        }
    return sum;
}

/// A layer of each light, and of the sky a harmonic each up to order 1 besides.
std::vector<scene::LightLayer> layers_with_modes(const Scene& scene) {
    std::vector<scene::LightLayer> layers = scenes::layers_of(scene);
    for (std::size_t k = 0; k < 4; ++k) {
        scene::LightLayer& mode = layers.emplace_back(scenes::no_light(scene));
        mode.beyond = [k](glm::vec3 towards) { return glm::vec3(volume::sh_basis(1, towards)[k]); };
    }
    return layers;
}

class Layers : public testing::DeviceTest {
protected:
    struct Fields {
        Volume volume;
        std::vector<Volume> layers;
        solver::gather::GatherReport report;
    };

    /// The first layers make up the field; all but the last, weighted, make up the last.
    static void expect_sums(const Fields& fields, const Fields& plain, std::size_t parts,
                            const std::vector<glm::vec3>& weights, int order) {
        std::vector<glm::vec3> ones(fields.layers.size(), glm::vec3(0.0f)), mixture = weights;
        std::fill_n(ones.begin(), parts, glm::vec3(1.0f));
        mixture.push_back(glm::vec3(0.0f));
        EXPECT_LT(difference(sum_of(fields.layers, ones), plain.volume.sh), 1e-5) << order;
        EXPECT_LT(difference(sum_of(fields.layers, mixture), fields.layers.back().sh), 1e-5)
            << order;
    }

    static surface::LitSurfaces light(const Setting& setting,
                                      const std::vector<scene::LightLayer>& layers) {
        Progress silent;
        surface::LightingSettings lighting;
        lighting.bounces.reset();
        lighting.rays = 1 << 16;
        return surface::light_surfaces(setting.scene, setting.visibility, setting.frame, lighting,
                                       silent, layers);
    }

    Fields sweep(const Setting& setting, const std::vector<scene::LightLayer>& layers,
                 int order = 2) {
        Progress silent;
        const surface::LitSurfaces lit = light(setting, layers);
        Fields fields{setting.volume(), std::vector<Volume>(layers.size()), {}};
        const solver::sn::SnProgram sn(device(), setting.grid, {48, order});
        const solver::gather::Layers of{layers, fields.layers};
        const float limit =
            sn.gather_peaks(lit, setting.visibility, setting.scene.sky, silent, fields.volume, of);
        sn.sweep(lit, setting.visibility, setting.scene.sky, limit, silent, fields.volume, of);
        return fields;
    }

    Fields gather(const Setting& setting, const std::vector<scene::LightLayer>& layers,
                  const solver::gather::GatherSettings& settings, float above = 0.0f,
                  uint64_t window = 0) {
        Progress silent;
        const surface::LitSurfaces lit = light(setting, layers);
        Fields fields{setting.volume(), std::vector<Volume>(layers.size()), {}};
        fields.report = solver::gather::GatherProgram(device(), settings, window)
                            .gather(lit, setting.scene.sky, setting.visibility, fields.volume,
                                    silent, above, {layers, fields.layers});
        return fields;
    }
};

TEST_F(Layers, OfAGatherSumUpAndAreLinear) {
    const Setting setting(scenes::lit_by_all());
    for (const auto& [order, above] :
         std::vector<std::pair<int, float>>{{1, 0.0f}, {2, 0.0f}, {2, 2.0f}, {4, 0.0f}}) {
        solver::gather::GatherSettings settings;
        settings.order = order;
        std::vector<scene::LightLayer> layers = layers_with_modes(setting.scene);
        const std::size_t modes = 4, parts = layers.size() - modes;
        const std::vector<glm::vec3> weights = scenes::random_weights(layers.size(), 3);
        layers.push_back(scenes::mixed(layers, weights));
        const Fields plain = gather(setting, {}, settings, above),
                     fields = gather(setting, layers, settings, above);
        EXPECT_EQ(fields.volume.sh, plain.volume.sh) << order;
        EXPECT_EQ(fields.report.rays, plain.report.rays);
        EXPECT_GT(fields.report.interpolated, 0u);
        expect_sums(fields, plain, parts, weights, order);
    }
}

TEST_F(Layers, OfASweepSumUpAndAreLinear) {
    Scene bright = scenes::lit_by_all();
    bright.sky.map = nullptr;
    bright.sky.luminance = glm::vec3(500.0f); // gathered, where that of the other is swept
    for (const Scene& scene : {scenes::lit_by_all(), bright})
        for (const int order : {2, 3}) {
            const Setting setting(scene, 12);
            std::vector<scene::LightLayer> layers = layers_with_modes(setting.scene);
            const std::size_t modes = 4, parts = layers.size() - modes;
            const std::vector<glm::vec3> weights = scenes::random_weights(layers.size(), 5);
            layers.push_back(scenes::mixed(layers, weights));
            const Fields plain = sweep(setting, {}, order), fields = sweep(setting, layers, order);
            EXPECT_EQ(fields.volume.sh, plain.volume.sh) << order;
            expect_sums(fields, plain, parts, weights, order);
        }
}

TEST_F(Layers, ThatDecideForThemselvesDoNotSumUp) {
    const Setting setting(scenes::lit_by_all());
    const std::vector<scene::LightLayer> layers = scenes::layers_of(setting.scene);
    const Fields together = gather(setting, {}, {});
    std::vector<Volume> apart;
    for (const scene::LightLayer& layer : layers)
        apart.push_back(gather(Setting(scenes::of_layer(setting.scene, layer)), {}, {}).volume);
    const std::vector<glm::vec3> ones(layers.size(), glm::vec3(1.0f));
    EXPECT_GT(difference(sum_of(apart, ones), together.volume.sh), 1e-2);

    const Fields swept = sweep(setting, {});
    apart.clear();
    for (const scene::LightLayer& layer : layers)
        apart.push_back(sweep(Setting(scenes::of_layer(setting.scene, layer)), {}).volume);
    EXPECT_GT(difference(sum_of(apart, ones), swept.volume.sh), 1e-2);
}

TEST_F(Layers, OfAConstantSkyAreTheConstantMode) {
    Scene scene = scenes::cornell_box();
    scene.sky.luminance = glm::vec3(1.0f);
    const Setting setting(scene);
    const std::vector<scene::LightLayer> layers = layers_with_modes(setting.scene);
    std::vector<glm::vec3> constant(layers.size(), glm::vec3(0.0f));
    constant[1] = glm::vec3(1.0f / volume::sh_y0);
    for (const Fields& fields : {gather(setting, layers, {}), sweep(setting, layers)})
        EXPECT_LT(difference(sum_of(fields.layers, constant), fields.volume.sh), 1e-5);
}

TEST_F(Layers, AreTheSameForAnyWindow) {
    const Setting setting(scenes::lit_by_all());
    const std::vector<scene::LightLayer> layers = scenes::layers_of(setting.scene);
    const Fields one = gather(setting, layers, {}), other = gather(setting, layers, {}, 0, 1 << 17);
    for (std::size_t layer = 0; layer < layers.size(); ++layer)
        EXPECT_EQ(one.layers[layer].sh, other.layers[layer].sh);
}

} // namespace
} // namespace lpvbake
