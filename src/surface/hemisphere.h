// Directions into a half-space.
#pragma once

#include "visibility/tangents.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {

/// With density cos / pi around n (Malley's method), from a point in [0, 1)^2.
inline glm::vec3 sample_cosine(glm::vec3 n, glm::vec2 u) {
    const float radius = std::sqrt(u.x), angle = 2.0f * glm::pi<float>() * u.y;
    const auto [x, y] = visibility::tangents_of(n);
    return radius * std::cos(angle) * x + radius * std::sin(angle) * y
           + std::sqrt(std::max(0.0f, 1.0f - u.x)) * n;
}

} // namespace lpvbake::surface
