// Sides that lie together: in one box and facing alike.
#pragma once

#include "surface/cutting.h"
#include "surface/patches.h"

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::surface {

/// The same for sides of patches (2 * patch + side) that face the same of six ways and whose
/// centroids lie in one box, of eight edges of the patches there and one such edge deep; another
/// number for others, but for some that are very far apart.
inline uint64_t together(const Patch& patch, uint32_t side, const Boxes& boxes) {
    const int level = int(std::log2(graded(1.0f, boxes.distance(patch.position))));
    const glm::vec3 normal = normal_of(patch, side), along = glm::abs(normal);
    const int axis = along.x > along.y && along.x > along.z ? 0 : along.y > along.z ? 1 : 2;
    glm::dvec3 edges(std::ldexp(8.0, level));
    edges[axis] = std::ldexp(1.0, level);
    const glm::ivec3 box(glm::floor(glm::dvec3(patch.position) / edges));
    auto number = uint64_t(level * 6 + axis * 2 + (normal[axis] < 0.0f ? 1 : 0));
    for (int i = 0; i < 3; ++i)
        number = number << 18 ^ uint64_t(uint32_t(box[i]) & 0x3ffffu);
    return number;
}

/// Number of those that something lies together with, and the place of that in a list.
struct Placed {
    uint64_t together;
    uint32_t index;
    auto operator<=>(const Placed&) const = default;
};

/// What lies together, of a list in order.
inline std::vector<std::span<const Placed>> groups_of(std::span<const Placed> placed) {
    std::vector<std::span<const Placed>> groups;
    for (size_t first = 0, end; first < placed.size(); first = end) {
        for (end = first; end < placed.size() && placed[end].together == placed[first].together;)
            ++end;
        groups.push_back(placed.subspan(first, end - first));
    }
    return groups;
}

} // namespace lpvbake::surface
