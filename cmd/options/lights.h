// --sun, --point and --sky as the command line has them.
#pragma once

#include "scene/scene.h"

#include <optional>
#include <string>
#include <string_view>

namespace lpvbake::cmd::options {

/// Linear colour of "#rrggbb" (sRGB); none of any other text.
std::optional<glm::vec3> parse_hex_colour(std::string_view text);

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

} // namespace lpvbake::cmd::options
