// What punctual lights give, by direction and distance.
#pragma once

#include "scene/scene.h"

namespace lpvbake::scene {

/// A spot's share of its intensity by direction: KHR_lights_punctual's squared linear ramp in the
/// cosine, without the extension's widening of ramps narrower than 0.001.
struct Cone {
    Cone() = default;
    explicit Cone(const Light& light);
    double operator()(glm::dvec3 to) const; ///< `to` is a unit vector; 0 to 1

    glm::dvec3 axis{0.0, 0.0, -1.0};
    double inner = 0, outer = 0; ///< radians
    double cos_inner = 1, cos_outer = 1;
};

/// The share of a light that is left at a distance (metres): KHR_lights_punctual's window of
/// `range`, without its 1 / d^2; 1 where the light has no range.
double range_window(const Light& light, double metres);

} // namespace lpvbake::scene
