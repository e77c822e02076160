// What of the scene stands around the cells of a lattice, for whoever reads between them.
#pragma once

#include "visibility/visibility.h"

#include <span>

namespace lpvbake::visibility {

/// Planes that bound a region around each cell's centre in which no surface lies, as Volume::walls
/// has them; as seen from where its light is taken (capture.h). The first goes through the surface
/// point nearest to the centre, the next through the nearest of those that lie before it, and so
/// on: what is before all of them sees the centre, as long as they are enough. At most `count`
/// planes; 0 in cells that are not valid (where there is a validity), and for planes farther than
/// `reach` (frame units). The cells are the frame's, from those of z = `first_layer` on.
///
/// After the scheme of growing convex free regions by nearest obstacles (Deits and Tedrake, 2014),
/// with balls in place of ellipsoids.
std::vector<std::vector<glm::vec3>> find_walls(const Visibility& visibility, glm::ivec3 dims,
                                               std::span<const float> validity, int count,
                                               float reach, int first_layer = 0);

/// The same around one place, where light is taken: fills at most walls.size() of them, and returns
/// how many.
size_t walls_around(const Visibility& visibility, glm::vec3 place, float reach,
                    std::span<glm::vec3> walls);

} // namespace lpvbake::visibility
