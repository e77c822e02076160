// What a place sees all around, by surfaces alone.
#pragma once

#include "visibility/visibility.h"

namespace lpvbake::visibility {

/// Rays from a place, spread evenly over the sphere (Fibonacci's lattice, and its mirror image
/// through the place, so that a place in the open has no direction).
inline constexpr int looks = 256;

struct Around {
    float backs = 0.0f; ///< share of the rays that meet the back of a single-sided surface first
    /// Of the sky's visibility, 0 to 1 (through glass its tint's mean), the coefficients of
    /// volume/sh.h up to band 1: the root of 4 pi, 0, 0, 0 in the open.
    glm::vec4 sky{0.0f};
};

/// From `place`, frame units.
Around look_around(const Visibility& visibility, glm::vec3 place);

} // namespace lpvbake::visibility
