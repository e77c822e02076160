#include "medium/medium.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::medium {

double phase(double g, double cosine) {
    const double root = 1 + g * g - 2 * g * cosine;
    return (1 - g * g) / (4 * glm::pi<double>() * root * std::sqrt(root));
}

std::optional<glm::dvec2> within(glm::dvec3 origin, glm::dvec3 direction, glm::dvec3 lo,
                                 glm::dvec3 hi, double begin, double end) {
    for (int axis = 0; axis < 3; ++axis) {
        if (direction[axis] == 0) {
            if (!(origin[axis] >= lo[axis] && origin[axis] < hi[axis]))
                return std::nullopt;
            continue;
        }
        const double a = (lo[axis] - origin[axis]) / direction[axis];
        const double b = (hi[axis] - origin[axis]) / direction[axis];
        begin = std::max(begin, std::min(a, b));
        end = std::min(end, std::max(a, b));
    }
    if (!(begin < end))
        return std::nullopt;
    return glm::dvec2(begin, end);
}

double decay(double a, double t0, double t1) {
    const double x = a * (t1 - t0);
    return std::exp(-a * t0) * (t1 - t0) * (x == 0 ? 1 : -std::expm1(-x) / x);
}

} // namespace lpvbake::medium
