// What options name by a pattern of the shell: lights and nodes of a scene.
#pragma once

#include "lpvbake/scene.h"
#include "medium/lamp_radius.h"

#include <string>
#include <vector>

namespace lpvbake::cmd {

/// What lights of some names are multiplied by; 0 leaves them out.
struct LightScale {
    std::string names; ///< a pattern, as fnmatch has it
    double scale = 0;
};

/// "NAMES=X". Throws Error (argument).
LightScale parse_light_scale(const std::string& text);

/// Lights, and emissive materials. Throws Error (argument) for a pattern that none fits.
void scale_lights(const std::vector<LightScale>& scales, Scene& scene);

/// Makes lights of such names static. Throws Error (argument) for a pattern that none fits.
void make_static(const std::vector<std::string>& patterns, Scene& scene);

/// "METRES", of all lamps, or "NAMES=METRES". Throws Error (argument).
medium::LampRadius parse_lamp_radius(const std::string& text);

/// Throws Error (argument) for a pattern, other than *, that no point or spot light fits.
void check_lamps(const std::vector<medium::LampRadius>& radii, const Scene& scene);

/// The box of the nodes whose names fit, with all below them. Throws Error (argument) where none
/// does, of that option.
Bounds box_of_nodes(const std::string& names, const char* option, const Scene& scene);

} // namespace lpvbake::cmd
