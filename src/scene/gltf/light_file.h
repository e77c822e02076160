// A JSON file of lights in the terms of KHR_lights_punctual.
#pragma once

#include "scene/scene.h"

#include <string>
#include <vector>

namespace lpvbake {

/// Reads {"lights": [{"type": "directional"|"point"|"spot", "color": [r, g, b], "intensity": x,
/// "range": m, "spot": {"innerConeAngle": rad, "outerConeAngle": rad}, "position": [x, y, z],
/// "direction": [x, y, z], "name": "..."}]}: the extension's properties, and position and direction
/// (of travel) in place of a node. Throws Error (file, invalid) with the JSON path.
std::vector<Light> load_lights(const std::string& path);

} // namespace lpvbake
