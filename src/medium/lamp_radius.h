// How large lamps are.
#pragma once

#include "lpvbake/scene.h"

#include <span>
#include <string>

namespace lpvbake::medium {

/// Of point and spot lights whose names fit the pattern (scene::fits_pattern).
struct LampRadius {
    std::string names = "*";
    double metres = 0;
};

/// Of a light, metres: that of the last of these that fits it; 0 where none does, and of
/// directional lights.
double radius_of(const Light& light, std::span<const LampRadius> radii);

} // namespace lpvbake::medium
