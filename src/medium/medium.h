// Air that scatters and absorbs light.
#pragma once

#include "scene/scene.h"

#include <optional>

namespace lpvbake::medium {

/// The same everywhere in a box, and nothing outside of it.
struct Medium {
    glm::dvec3 scatter{0.0}; ///< share of light that is scattered a metre, RGB
    glm::dvec3 absorb{0.0};  ///< and that is absorbed
    double g = 0;            ///< mean cosine of the angle by which it is scattered, -1 < g < 1
    Bounds box;              ///< metres

    glm::dvec3 extinction() const { return scatter + absorb; }
};

/// Share of scattered light that goes on at an angle of this cosine from the way it came, 1 / sr
/// (Henyey and Greenstein 1941).
double phase(double g, double cosine);

/// The part of a ray from `begin` to `end` that lies in the box [lo, hi]: none where it is empty.
/// The direction is of any length.
std::optional<glm::dvec2> within(glm::dvec3 origin, glm::dvec3 direction, glm::dvec3 lo,
                                 glm::dvec3 hi, double begin, double end);

/// The integral of exp(-a t) from t0 to t1, any a.
double decay(double a, double t0, double t1);

} // namespace lpvbake::medium
