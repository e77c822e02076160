// Where a fit cannot hold: points that see nothing of each other, face alike, and are read from the
// same cells, but need different light.
//
// The bands tell the two sides of a wall apart by their normals. Not so the floors of two rooms, or
// of two storeys: where a reader mixes the same cells for both, each shows some of the other's
// light. Smaller cells part them. What stands between surfaces of one plane (a wall on a floor)
// leaves a strip along it whose width is a cell's; surfaces behind each other (storeys) share
// nothing any more where they are a cell apart.
#pragma once

#include "readers/fit.h"
#include "scene/frame.h"
#include "visibility/visibility.h"

namespace lpvbake::bake {

/// More of the light than this, wrong because cells are contested, is told.
inline constexpr double contested_most = 0.02;

struct Contested {
    /// What is wrong by it, of the light that arrives at all points: sum of |E - T| at such points
    /// over sum of T, luminance.
    double share = 0;
    glm::dvec3 worst{0.0}; ///< the place of the point of most error, metres
    /// Edge of a cell, metres, from which down no more than contested_most is expected to stay
    /// contested; that of the volume where that is so already.
    double cell = 0;
};

/// Of what the reader shows of a volume that is fitted to the points; `visibility` is in units of
/// its grid. The same bits for any number of threads.
Contested find_contested(const readers::Reader& reader, const Volume& volume,
                         std::span<const readers::FitPoint> points,
                         const visibility::Visibility& visibility);

} // namespace lpvbake::bake
