// Rays of points near each other, each of use for all of them.
//
// Neighbours on a surface see nearly the same. What the ray of one meets lights the others as well,
// by their own way to it and their own normals: all rays of a group are samples of one mixture of
// their densities (the balance heuristic; Veach and Guibas 1995), so that a weight is bounded and
// near surfaces count as they do from each point. What hides an end from one point of a group but
// not from another is averaged over them; where that shows in what the points' own rays met, beyond
// their noise, these have their say.
#pragma once

#include "surface/lit_surfaces.h"

#include <span>
#include <vector>

namespace lpvbake::surface {

/// What a cosine-distributed ray meets.
struct SharedRay {
    glm::vec3 end;       ///< frame units; a direction where the normal is 0: there is nothing
    glm::vec3 normal;    ///< of the surface at the end, either way
    glm::vec3 luminance; ///< nits, towards all points alike
};

/// Indices of points, group by group: group g has order[first[g]] to order[first[g + 1] - 1], by
/// rising index.
struct PointGroups {
    std::vector<uint32_t> order;
    std::vector<uint32_t> first;
};

/// Points of one cube of a few units that face alike, `most` at most, that are seen from the first
/// of them, so that no wall parts them.
PointGroups group_points(const visibility::Visibility& visibility,
                         std::span<const SidePoint> points, size_t most);

/// Adds the irradiance (lux) that the rays of a group, `each` of every point, give its points.
/// Those that meet darkness can be left out.
void add_shared(std::span<const SidePoint> points, std::span<const SharedRay> rays, int each,
                std::span<glm::vec3> irradiance);

/// What a point's own rays alone say.
struct OwnLight {
    glm::vec3 irradiance; ///< lux
    glm::vec3 variance;   ///< of that, by the rays
};

/// From `count` cosine-distributed rays, of which those that meet darkness can be left out.
OwnLight light_alone(std::span<const SharedRay> rays, int count);

/// Brings the irradiance of a group's points, that add_shared gave, nearer to what their own rays
/// say: of its halves, their halves and so on down to single points, level by level, by as much of
/// the difference as is not noise on that level (James and Stein 1961).
void tell_apart(std::span<const SidePoint> points, std::span<const OwnLight> own,
                std::span<glm::vec3> irradiance);

} // namespace lpvbake::surface
