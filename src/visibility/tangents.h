// A frame around a direction.
#pragma once

#include <glm/glm.hpp>

#include <cmath>

namespace lpvbake::visibility {

template <class Number>
struct Tangents {
    glm::vec<3, Number> u, v;
};

/// Two unit vectors that complete the unit vector n to an orthonormal frame (Duff et al. 2017).
template <class Number>
Tangents<Number> tangents_of(glm::vec<3, Number> n) {
    const Number one = 1, sign = std::copysign(one, n.z);
    const Number a = -one / (sign + n.z), b = n.x * n.y * a;
    return {{one + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}};
}

} // namespace lpvbake::visibility
