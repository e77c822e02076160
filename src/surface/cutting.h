// Where a piece of a surface is cut: what makes patches and what counts them go by it.
#pragma once

#include <glm/glm.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::surface {

/// Corners, frame units.
using Corners = std::array<glm::vec3, 3>;

/// From the box [0, extent] to a point.
inline float distance_to_box(glm::vec3 p, glm::vec3 extent) {
    return glm::distance(p, glm::clamp(p, glm::vec3(0.0f), extent));
}

/// `max_edge` at the grid, and more with the distance from it.
inline float graded(float max_edge, float distance) {
    return max_edge * (1.0f + 0.25f * distance);
}

/// How long the edges of a piece may be: by its nearest corner or centroid.
inline float edge_limit(const Corners& piece, glm::vec3 extent, float max_edge) {
    float nearest = distance_to_box((piece[0] + piece[1] + piece[2]) / 3.0f, extent);
    for (const glm::vec3& corner : piece)
        nearest = std::min(nearest, distance_to_box(corner, extent));
    return graded(max_edge, nearest);
}

/// The edge that is halved, between this corner and the next, and its length.
struct LongestEdge {
    int at = 0;
    float length = 0.0f;
};

inline LongestEdge longest_edge(const Corners& piece) {
    LongestEdge longest;
    for (int i = 0; i < 3; ++i)
        if (const float length = glm::distance(piece[size_t(i)], piece[size_t(i + 1) % 3]);
            length > longest.length)
            longest = {i, length};
    return longest;
}

} // namespace lpvbake::surface
