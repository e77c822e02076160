// How a light looks at the scene: its maps' rays, and how much light each texel stands for.
#pragma once

#include "scene/frame.h"
#include "scene/photometry.h"

#include <vector>

namespace lpvbake::scene {

/// One map. A texel at (x, y) in [-1, 1]^2 sees along the ray of points
/// origin + x u + y v + t axis (parallel) or origin + t (axis + x u + y v) (perspective), t the
/// depth. All in frame units, the frame's orientation that of the world.
struct RsmView {
    bool perspective = false;
    glm::dvec3 origin{0.0};
    glm::dvec3 axis{0.0, 0.0, -1.0}; ///< unit, along the light
    glm::dvec3 u{1.0, 0.0, 0.0};     ///< u, v, axis are orthogonal; lengths: half the map's edges
    glm::dvec3 v{0.0, 1.0, 0.0};
    double nearest = 0;  ///< smallest depth that is seen
    double farthest = 0; ///< largest; perspective: unlimited

    glm::dvec3 start(glm::dvec2 at) const { return perspective ? origin : origin + aside(at); }
    glm::dvec3 along(glm::dvec2 at) const { return perspective ? axis + aside(at) : axis; }
    glm::dvec3 aside(glm::dvec2 at) const { return at.x * u + at.y * v; }
    /// Clip space (depth reversed: 1 nearest) from positions relative to `origin`.
    glm::dmat4 clip() const;
};

/// The maps of a light: one, or for a point light or a spot of more than 80 degrees the faces of a
/// cube. None where it cannot light anything. [lo, hi] are the scene's bounds: a directional
/// light's map covers their part inside the frame's levels across, and all of them along the light.
std::vector<RsmView> views_of(const Light& light, const Frame& frame, glm::dvec3 lo, glm::dvec3 hi);

/// Light of colour 1 that leaves through each texel of a map of size x size, lumen, before `range`:
/// illuminance times area, or intensity times solid angle. The solid angle of a texel is the
/// midpoint rule with its second-order term; intensity is averaged over the texels of a spot's ramp
/// and rim.
class TexelFlux {
public:
    TexelFlux(const Light& light, const Frame& frame, const RsmView& view, int size);
    double operator()(int column, int row) const;

private:
    /// Through the rectangle of edges `extent` around `at`, both in tangents.
    double through(glm::dvec2 at, glm::dvec2 extent) const;
    glm::dvec3 towards(glm::dvec2 at) const;

    double parallel_ = 0; ///< of any texel of a directional light
    bool spot_ = false;
    double intensity_ = 0;
    Cone cone_;
    glm::dvec3 axis_, u_, v_; ///< unit
    glm::dvec2 half_, edge_;  ///< of the map, of a texel: metres or tangents
    int parts_ = 1;           ///< samples along a texel's edge where intensity varies
};

} // namespace lpvbake::scene
