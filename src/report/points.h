// Where a report measures: seeded samples of cells and of surfaces.
#pragma once

#include "scene/scene.h"
#include "visibility/visibility.h"
#include "volume/grid.h"

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::report {

/// `count` of the valid cells, by rising index; all where there are no more. The same seed and
/// validity draw the same cells.
std::vector<std::size_t> draw_cells(std::span<const float> validity, uint64_t count, uint64_t seed);

/// A point on the side of a surface that light can reach.
struct FrontPoint {
    glm::dvec3 position{0.0}; ///< metres
    glm::dvec3 normal{0.0};   ///< unit, out of the triangle's front
};

/// Frame units, off the surface by 64 steps of single precision.
glm::vec3 lifted(const FrontPoint& point, const scene::Frame& frame);

/// `count` points of equal share of the surfaces' area inside `box` (metres), on their fronts.
/// Passed over are points whose front lies inside geometry (most of what it sees are backs) and
/// points that are not there (masked; blended by alpha). Fewer, or none, where a hundred draws a
/// point were not enough. `frame` is that of `visibility`.
std::vector<FrontPoint> draw_surface_points(const Scene& scene,
                                            const visibility::Visibility& visibility,
                                            const scene::Frame& frame, const Bounds& box,
                                            uint64_t count, uint64_t seed);

} // namespace lpvbake::report
