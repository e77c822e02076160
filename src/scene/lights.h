// What a light has to be, and which light a field can hold.
#pragma once

#include "scene/scene.h"

#include <optional>
#include <string>

namespace lpvbake::scene {

/// Throws Error (invalid), beginning with `place`, unless the light is one that KHR_lights_punctual
/// allows: finite, color and intensity not negative, range not negative, cones with
/// 0 <= inner < outer <= pi/2, a direction of unit length. A spot with a hard edge, inner = outer,
/// may be as well.
void check_light(const Light& light, const std::string& place);

/// Brings an inner cone that is not below the outer one, but past it by at most `most` radians,
/// back to it. True if the spot has a hard edge then, which is against KHR_lights_punctual;
/// programs write it all the same.
bool make_hard_edge(Light& light, double most);

/// Which light a field is to hold.
struct LightSources {
    bool punctual = false;      ///< some point, spot or directional light; reflected alone
    bool emitters = false;      ///< some emissive surface; direct and reflected
    bool sky = false;           ///< the same
    bool statics = false;       ///< some static light; direct and reflected
    std::optional<int> bounces; ///< reflections at most; none: all
};

/// What to say of a field without any light.
std::string why_dark(const Scene& scene);

/// Throws Error (invalid), beginning with `place`, where none of it can arrive.
void check_light_arrives(const std::string& place, const LightSources& sources);

} // namespace lpvbake::scene
