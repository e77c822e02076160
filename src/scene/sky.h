// Light from beyond the scene.
#pragma once

#include "scene/scene.h"

namespace lpvbake {

/// Luminance (nits) that arrives from `towards` (unit, world axes) where nothing is in the way.
glm::vec3 sky_luminance(const Sky& sky, glm::vec3 towards);

} // namespace lpvbake
