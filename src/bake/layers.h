// Layers of a scene's light: which of it each is, and how they are named.
#pragma once

#include "lpvbake/volume.h"
#include "scene/light_layer.h"
#include "scene/sun_arc.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::bake {

inline constexpr std::size_t most_layers = 64;
inline constexpr int most_mode_order = 2;

/// Of what layers are asked for.
struct LayerWish {
    enum class Kind {
        lights,   ///< each punctual light
        emitters, ///< each emissive material
        sky,      ///< the sky, and `order` harmonics beside it
        transfer, ///< the sky, what of any is seen, and what `order` harmonics become by reflection
        group,    ///< lights and emissive materials whose names fit a pattern of the shell, as one
        suns,     ///< those of suns_along()
    };
    Kind kind;
    std::string name = {}, pattern = {}; ///< of a group
    int order = -1;                      ///< highest band of the harmonics; -1: none
    scene::SunArc arc = {};
    int suns = 0;
};

inline constexpr int most_suns = 48;

/// So many suns of a day, as lights of a scene: their sum is the mean of the daylight, and each is
/// named by its time, "sun_0430".
std::vector<Light> suns_along(const scene::SunArc& arc, int count);

struct Layer {
    std::string name;       ///< unique; letters, digits, dots, dashes and underscores
    std::string kind;       ///< as io/layers.h has them
    std::string unit;       ///< what weight 1 is: "scene": as the scene has it; "nits"
    glm::vec3 weight{1.0f}; ///< sum with these: the scene's light
    scene::LightLayer light;
    std::vector<std::string> emitters = {}; ///< names of the materials whose emission it has
    std::optional<scene::SunArc> arc = {};  ///< of a sun
    double hour = 0;                        ///< the same
};

/// The layers that are wished for, suns first, then groups: a light has a part in the first that
/// asks for it, and what none asks for is a layer "rest", so that their sum is the scene's light.
/// Modes are "sky_0", "sky_1", ...: skies whose luminance is one of the harmonics, in the order of
/// Volume::sh, nits; they have weight 0. So have "sky_visibility", what is seen of a sky of one
/// nit, to sh_max_order, and "sky_bounce_0", ...: the light of modes without what is seen of them.
/// `emitters`: whether emissive surfaces give light. Throws Error (argument) where a wish finds
/// nothing, or there are more than most_layers.
std::vector<Layer> make_layers(const Scene& scene, std::span<const LayerWish> wishes,
                               bool emitters);

/// Whether a name may be given to a layer.
bool is_layer_name(const std::string& name);

/// How far the irradiance of suns is from what those before and after them make of it, L1 of the
/// mean of such suns: of every other, so that it is what suns twice as far apart err half-way
/// between them. `fields` are those of suns, in their order. None of fewer than three, or without
/// light.
struct HeldOut {
    double mean = 0, worst = 0;
    double hour = 0; ///< of the worst
};
std::optional<HeldOut> hold_out(const scene::SunArc& arc, std::span<const double> hours,
                                std::span<const Volume* const> fields,
                                const std::vector<float>& validity);

/// Coefficients of a sky up to a band, nits: the weights of its modes that come nearest to it.
std::vector<glm::vec3> project_sky(const Sky& sky, int order);

} // namespace lpvbake::bake
