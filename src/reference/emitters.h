// Emissive triangles as targets of rays.
#pragma once

#include "visibility/visibility.h"

#include <vector>

namespace lpvbake::reference {

/// Chooses points on all emissive surfaces with a density that follows the emitted luminance.
class Emitters {
public:
    Emitters(const Scene& scene, const scene::Frame& frame);
    bool empty() const { return triangles_.empty(); }

    /// A place on an emissive triangle.
    struct Target {
        uint32_t instance = 0;
        uint32_t triangle = 0; ///< of the instance's mesh
        glm::dvec3 point{0.0}; ///< frame units
    };
    /// A triangle with probability proportional to its area times luminance, as sampled at a few
    /// of its points, and a point uniform over it.
    Target target(glm::dvec2 sample) const;

    /// How likely, per steradian, `target` chooses the direction in which `hit` was met, and the
    /// triangle that was hit; `towards` is the ray's unit direction, so that Hit::t is the
    /// distance. 0 for what does not glow.
    double density(const visibility::Hit& hit, glm::dvec3 towards) const;

private:
    struct Triangle {
        glm::vec3 a, ab, ac;
        uint32_t instance, triangle;
        double luminance = 0.0; ///< density per unit of area, once divided by the total power
    };
    std::vector<Triangle> triangles_;
    std::vector<double> cumulative_; ///< power up to and with each triangle, over the total
    std::vector<uint32_t> first_;    ///< an instance: its first in triangles_; ~0u: none
};

} // namespace lpvbake::reference
