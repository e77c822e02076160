// Direct light of punctual lights on surfaces, by the power that each light sends to what it sees.
#pragma once

#include "surface/light_map.h"

#include <span>

namespace lpvbake::surface {
class Keeper;

/// Mean illuminance (lux) of the covered part of every side, [2 * patch + side], by lights.
struct PunctualLight {
    std::vector<glm::vec3> lux; ///< empty without lights
    std::vector<glm::vec3>
        layers; ///< the same of layers: [layer_count * (2 * patch + side) + layer]
    size_t layer_count = 0;
    double landed = 0;             ///< power on sides, by its luminance
    double narrow = 0;             ///< what of it falls on less than a quarter of its patches
    double lost = 0;               ///< and what has no patch
    std::vector<LightPower> power; ///< a light

    /// Patches that were cut since are as light as what they were part of.
    void follow(const LitSurfaces& lit);
    glm::vec3 of(uint32_t side) const { return lux.empty() ? glm::vec3(0.0f) : lux[side]; }
    glm::vec3 of(uint32_t side, size_t layer) const {
        return layers.empty() ? glm::vec3(0.0f) : layers[layer_count * side + layer];
    }
};

/// Each light gives its power, but for what meets nothing or backs, to the sides that it sees
/// (LightMapper). A side's share of it is what the texels on it hold. Sides that a light sees
/// wholly, by enough texels, have their exact share instead, which has no noise: irradiance in
/// closed form, times one factor a light that keeps the sum. Patches are cut where lights need
/// smaller ones (cut_to_light). `key`: another one gives other rays. `weights`: what each layer has
/// of each light, [layer][light]. With a keeper, what a light sees is kept: it does not depend on
/// its colour and intensity.
PunctualLight illuminate(const Scene& scene, std::span<const Light> lights, LitSurfaces& lit,
                         const scene::Frame& frame, uint32_t key, Progress& progress,
                         std::span<const std::vector<glm::vec3>> weights = {},
                         Keeper* keeper = nullptr);

} // namespace lpvbake::surface
