#include "scene/photometry.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::scene {

Cone::Cone(const Light& light)
    : axis(glm::normalize(light.direction)),
      inner(std::min(light.inner_cone, light.outer_cone)),
      outer(light.outer_cone),
      cos_inner(std::cos(inner)),
      cos_outer(std::cos(outer)) {}

double Cone::operator()(glm::dvec3 to) const {
    const double cosine = glm::dot(to, axis);
    if (cosine <= cos_outer)
        return 0;
    if (cosine >= cos_inner)
        return 1;
    const double ramp = (cosine - cos_outer) / (cos_inner - cos_outer);
    return ramp * ramp;
}

double range_window(const Light& light, double metres) {
    return light.range > 0.0 ? std::clamp(1.0 - std::pow(metres / light.range, 4.0), 0.0, 1.0)
                             : 1.0;
}

} // namespace lpvbake::scene
