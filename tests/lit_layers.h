// A scene that every kind of light lights, and its layers.
#pragma once

#include "scene/light_layer.h"
#include "scene/sky.h"
#include "scenes.h"

#include <cstdint>

namespace lpvbake::scenes {

/// A Cornell box with a pane of amber glass in it, lit by a red lamp, a narrow spot (whose light is
/// a bright place of a dim part), two panels of different emission, and a sky with a sun.
inline Scene lit_by_all() {
    Scene scene = cornell_box();
    scene.lights.push_back(point_light({0.1, 1.8, 0.1}, 20.0, {1.0f, 0.0f, 0.0f}));
    scene.lights.push_back(spot_light({0.7, 1.2, 0.9}, {0.02, -1.0, 0.03}, 3000.0, 0.03, 0.06));
    const int warm = add_material(scene, glm::vec3(0.2f), {30.0f, 20.0f, 5.0f});
    add_quad(scene, warm, {-0.3f, 1.99f, -0.3f}, {0.4f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.4f});
    const int blue = add_material(scene, glm::vec3(0.3f), {1.0f, 2.0f, 40.0f}, true);
    add_quad(scene, blue, {-0.9f, 0.4f, 0.2f}, {0.0f, 0.3f, 0.0f}, {0.0f, 0.0f, 0.3f});
    const int glass = add_material(scene, {0.9f, 0.6f, 0.2f}, glm::vec3(0.0f), true);
    scene.materials[std::size_t(glass)].transmission = 0.7f;
    add_quad(scene, glass, {0.2f, 0.0f, 0.8f}, {0.7f, 0.0f, 0.0f}, {0.0f, 1.5f, 0.0f});
    std::vector<glm::vec3> texels;
    for (int i = 0; i < 16 * 32; ++i)
        texels.push_back(glm::vec3(2.0f, 4.0f, 8.0f) * (i < 8 * 32 ? 1.0f : 0.2f));
    texels[3 * 32 + 24] = glm::vec3(30000.0f);
    scene.sky = scene::make_sky(32, 16, texels, 0.0);
    return scene;
}

/// A layer of none of its lights.
inline scene::LightLayer no_light(const Scene& scene) {
    return {std::vector<glm::vec3>(scene.lights.size(), glm::vec3(0.0f)),
            std::vector<glm::vec3>(scene.materials.size(), glm::vec3(0.0f))};
}

/// Its lights, emissive materials and sky, a layer each.
inline std::vector<scene::LightLayer> layers_of(const Scene& scene) {
    const scene::LightLayer none = no_light(scene);
    std::vector<scene::LightLayer> layers;
    for (std::size_t i = 0; i < scene.lights.size(); ++i)
        layers.emplace_back(none).lights[i] = glm::vec3(1.0f);
    for (std::size_t i = 0; i < scene.materials.size(); ++i)
        if (scene.materials[i].emission != glm::vec3(0.0f))
            layers.emplace_back(none).emissions[i] = glm::vec3(1.0f);
    if (scene::has_sky(scene))
        layers.emplace_back(none).sky = glm::vec3(1.0f);
    return layers;
}

/// Colours, greys and zeros.
inline std::vector<glm::vec3> random_weights(std::size_t count, uint32_t seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> weight(0.0f, 3.0f);
    std::vector<glm::vec3> weights;
    for (std::size_t i = 0; i < count; ++i)
        weights.push_back(i % 3 == 1   ? glm::vec3(0.0f)
                          : i % 3 == 2 ? glm::vec3(weight(random))
                                       : glm::vec3(weight(random), weight(random), weight(random)));
    return weights;
}

/// The layer that is that sum of layers.
inline scene::LightLayer mixed(const std::vector<scene::LightLayer>& layers,
                               const std::vector<glm::vec3>& weights) {
    scene::LightLayer sum = layers.front();
    for (glm::vec3& light : sum.lights)
        light *= weights.front();
    for (glm::vec3& emission : sum.emissions)
        emission *= weights.front();
    sum.sky *= weights.front();
    for (std::size_t i = 1; i < layers.size(); ++i) {
        for (std::size_t k = 0; k < sum.lights.size(); ++k)
            sum.lights[k] += weights[i] * layers[i].lights[k];
        for (std::size_t k = 0; k < sum.emissions.size(); ++k)
            sum.emissions[k] += weights[i] * layers[i].emissions[k];
        sum.sky += weights[i] * layers[i].sky;
    }
    sum.beyond = [layers, weights](glm::vec3 towards) {
        glm::vec3 luminance(0.0f);
        for (std::size_t i = 0; i < layers.size(); ++i)
            if (layers[i].beyond)
                luminance += weights[i] * layers[i].beyond(towards);
        return luminance;
    };
    return sum;
}

/// The scene in the light of a layer alone, with that of weight 0 left out.
inline Scene of_layer(const Scene& scene, const scene::LightLayer& layer) {
    Scene alone = scene;
    alone.lights.clear();
    for (std::size_t i = 0; i < scene.lights.size(); ++i)
        if (layer.lights[i] != glm::vec3(0.0f)) {
            alone.lights.push_back(scene.lights[i]);
            alone.lights.back().color *= layer.lights[i];
        }
    for (std::size_t i = 0; i < scene.materials.size(); ++i)
        alone.materials[i].emission *= layer.emissions[i];
    if (layer.sky == glm::vec3(0.0f))
        alone.sky = {};
    return alone;
}

} // namespace lpvbake::scenes
