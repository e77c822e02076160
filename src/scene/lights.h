// Lights that do not come with the scene: from the command line or a JSON file.
#pragma once

#include "scene/scene.h"

#include <optional>
#include <string>

namespace lpvbake {

/// "AZIMUTH,ELEVATION,LUX[,COLOUR]": where the sun stands. Azimuth in degrees from +Z towards +X,
/// elevation in degrees above the horizon. COLOUR is #rrggbb (sRGB) or R:G:B (linear).
/// Throws Error (argument) that shows the form.
Light parse_sun(const std::string& text);

/// "X,Y,Z,CD[,COLOUR]": a point light at X,Y,Z metres of CD candela.
/// Throws Error (argument) that shows the form.
Light parse_point(const std::string& text);

/// "COLOUR,NITS": a sky of the same luminance everywhere. COLOUR as in parse_sun.
/// Throws Error (argument) that shows the form.
Sky parse_sky(const std::string& text);

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

} // namespace lpvbake
