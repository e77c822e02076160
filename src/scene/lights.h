// What a light has to be, and which light a field can hold.
#pragma once

#include "scene/scene.h"

#include <optional>
#include <string>

namespace lpvbake::scene {

/// Throws Error (invalid), beginning with `place`, unless the light is one that KHR_lights_punctual
/// allows: finite, color and intensity not negative, range not negative, cones with
/// 0 <= inner < outer <= pi/2, a direction of unit length.
void check_light(const Light& light, const std::string& place);

/// Which light a field is to hold.
struct LightSources {
    bool punctual = false;      ///< some point, spot or directional light; reflected alone
    bool emitters = false;      ///< some emissive surface; direct and reflected
    bool sky = false;           ///< the same
    std::optional<int> bounces; ///< reflections at most; none: all
};

/// Throws Error (invalid), beginning with `place`, where none of it can arrive.
void check_light_arrives(const std::string& place, const LightSources& sources);

} // namespace lpvbake::scene
