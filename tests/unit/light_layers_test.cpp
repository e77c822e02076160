// Layers of a scene's light on its surfaces: linear beside the scene's light, by its rays.
#include "lit_layers.h"
#include "scenes.h"
#include "surface/lit_surfaces.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <random>

namespace lpvbake {
namespace {

const scene::Frame frame{glm::dvec3(-1.1, -0.1, -1.1), 0.2, glm::dvec3(11.0)};

surface::LitSurfaces light(const Scene& scene, const visibility::Visibility& visibility,
                           std::span<const scene::LightLayer> layers,
                           std::optional<int> bounces = {}, bool maps = false) {
    Progress silent;
    surface::LightingSettings settings;
    settings.bounces = bounces;
    settings.rays = 1 << 17;
    settings.maps = maps;
    return surface::light_surfaces(scene, visibility, frame, settings, silent, layers);
}

float greatest_in(const std::vector<glm::vec3>& values) {
    float most = 0.0f;
    for (const glm::vec3 v : values)
        most = std::max({most, std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    return most;
}

/// Largest difference of a channel, of the largest of `wanted` there; below a billionth of the
/// largest of all it is no light.
double difference(const std::vector<glm::vec3>& sum, const std::vector<glm::vec3>& wanted) {
    const float floor = 1e-9f * greatest_in(wanted);
    double most = 0.0;
    for (size_t i = 0; i < wanted.size(); ++i) {
        const glm::vec3 off = glm::abs(sum[i] - wanted[i]), is = glm::abs(wanted[i]);
        most = std::max(
            most, double(std::max({off.x, off.y, off.z}) / std::max({is.x, is.y, is.z, floor})));
    }
    return most;
}

std::vector<glm::vec3> sum_of(const surface::LitSurfaces& lit, std::span<const glm::vec3> weights) {
    std::vector<glm::vec3> sum(lit.luminance.size(), glm::vec3(0.0f));
    for (size_t side = 0; side < sum.size(); ++side)
        for (size_t layer = 0; layer < lit.layer_count; ++layer)
            sum[side] += weights[layer] * lit.layers[lit.layer_count * side + layer];
    return sum;
}

TEST(LightLayers, SumUpToTheScenesLight) {
    const Scene scene = scenes::lit_by_all();
    const visibility::Visibility visibility(scene, frame);
    const std::vector<scene::LightLayer> layers = scenes::layers_of(scene);
    const std::vector<glm::vec3> ones(layers.size(), glm::vec3(1.0f));
    for (const std::optional<int> bounces : {std::optional<int>(), std::optional<int>(0),
                                             std::optional<int>(1), std::optional<int>(3)})
        for (const bool maps : {false, true}) {
            const surface::LitSurfaces plain = light(scene, visibility, {}, bounces, maps);
            const surface::LitSurfaces lit = light(scene, visibility, layers, bounces, maps);
            EXPECT_EQ(lit.luminance, plain.luminance);
            EXPECT_EQ(lit.bounces, plain.bounces);
            EXPECT_EQ(lit.shared, plain.shared);
            ASSERT_EQ(lit.layers.size(), layers.size() * lit.luminance.size());
            // What maps take away leaves rounding of what was there.
            EXPECT_LT(difference(sum_of(lit, ones), lit.luminance), maps ? 1e-3 : 3e-6)
                << bounces.value_or(-1) << maps;
        }
}

TEST(LightLayers, AreLinear) {
    const Scene scene = scenes::lit_by_all();
    const visibility::Visibility visibility(scene, frame);
    std::vector<scene::LightLayer> layers = scenes::layers_of(scene);
    const std::vector<glm::vec3> weights = scenes::random_weights(layers.size(), 7);
    layers.push_back(scenes::mixed(layers, weights));
    const surface::LitSurfaces lit = light(scene, visibility, layers);
    std::vector<glm::vec3> mixture;
    for (size_t side = 0; side < lit.luminance.size(); ++side)
        mixture.push_back(lit.layers[lit.layer_count * side + layers.size() - 1]);
    std::vector<glm::vec3> of_each = weights;
    of_each.push_back(glm::vec3(0.0f));
    EXPECT_LT(difference(sum_of(lit, of_each), mixture), 1e-5);

    // Where each decides for itself (patches, rays, the end of the series), they are not.
    const auto total = [](const std::vector<surface::Patch>& patches,
                          const std::vector<glm::vec3>& luminance) {
        glm::dvec3 sum(0.0);
        for (size_t side = 0; side < luminance.size(); ++side)
            sum += double(patches[side / 2].area) * glm::dvec3(luminance[side]);
        return sum;
    };
    const glm::dvec3 wanted = total(lit.patches, mixture);
    EXPECT_LT(glm::length(total(lit.patches, sum_of(lit, of_each)) - wanted),
              1e-6 * glm::length(wanted));
    glm::dvec3 apart(0.0);
    for (size_t i = 0; i < weights.size(); ++i) {
        const Scene alone = scenes::of_layer(scene, layers[i]);
        const visibility::Visibility own(alone, frame);
        const surface::LitSurfaces other = light(alone, own, {});
        apart += glm::dvec3(weights[i]) * total(other.patches, other.luminance);
    }
    EXPECT_GT(glm::length(apart - wanted), 1e-5 * glm::length(wanted));
    EXPECT_LT(glm::length(apart - wanted), 0.02 * glm::length(wanted));
}

TEST(LightLayers, OneOfOneLightHasItsLightAlone) {
    // Red light has no part in what is green, however often it is reflected.
    const Scene scene = scenes::lit_by_all();
    const visibility::Visibility visibility(scene, frame);
    const std::vector<scene::LightLayer> layers = scenes::layers_of(scene);
    ASSERT_EQ(scene.lights[0].color, glm::vec3(1.0f, 0.0f, 0.0f));
    const surface::LitSurfaces lit = light(scene, visibility, layers);
    glm::dvec3 sum(0.0);
    for (size_t side = 0; side < lit.luminance.size(); ++side)
        sum += glm::dvec3(lit.layers[lit.layer_count * side]);
    EXPECT_GT(sum.x, 0.0);
    EXPECT_EQ(sum.y, 0.0);
    EXPECT_EQ(sum.z, 0.0);
}

TEST(LightLayers, AreTheSameForAnyNumberOfThreads) {
    const Scene scene = scenes::lit_by_all();
    const visibility::Visibility visibility(scene, frame);
    const std::vector<scene::LightLayer> layers = scenes::layers_of(scene);
    const surface::LitSurfaces many = light(scene, visibility, layers);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(light(scene, visibility, layers).layers, many.layers);
}

} // namespace
} // namespace lpvbake
