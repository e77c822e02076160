// Where a piece of a surface is cut: what makes patches and what counts them go by it.
#pragma once

#include "scene/frame.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace lpvbake::surface {

/// Corners, frame units.
using Corners = std::array<glm::vec3, 3>;

/// From the box [0, extent] to a point.
inline float distance_to_box(glm::vec3 p, glm::vec3 extent) {
    return glm::distance(p, glm::clamp(p, glm::vec3(0.0f), extent));
}

/// `max_edge` at the grid, and more with the distance from it.
constexpr float growth = 0.25f;
inline float graded(float max_edge, float distance) {
    return max_edge * (1.0f + growth * distance);
}

/// Where cells are that light is wanted for: a frame's grid, and the boxes around it.
struct Boxes {
    glm::vec3 extent; ///< of the grid
    std::span<const scene::CoarserBox> coarser;

    Boxes(glm::vec3 grid) : extent(grid) {}
    Boxes(const scene::Frame& frame) : extent(frame.extent), coarser(frame.coarser) {}

    /// How far from the grid patches may be as large as at what lies between these corners: that
    /// far, or nearer where a coarser box asks for smaller ones.
    float distance(glm::vec3 from, glm::vec3 to) const {
        const auto away = [&](glm::vec3 lo, glm::vec3 hi) {
            return glm::length(glm::max(glm::max(from - hi, lo - to), glm::vec3(0.0f)));
        };
        float least = away(glm::vec3(0.0f), extent);
        for (const scene::CoarserBox& box : coarser)
            least = std::min(least, (box.cell - 1.0f) / growth + away(box.lo, box.hi));
        return least;
    }
    float distance(glm::vec3 point) const {
        float least = distance_to_box(point, extent);
        for (const scene::CoarserBox& box : coarser)
            least = std::min(least, (box.cell - 1.0f) / growth
                                        + glm::distance(point, glm::clamp(point, box.lo, box.hi)));
        return least;
    }
    /// Edge of the cells at a point, units: of the finest box that it lies in, or of the last.
    float cell_at(glm::vec3 point) const {
        float cell = 1.0f;
        if (coarser.empty() || distance_to_box(point, extent) <= 0.0f)
            return cell;
        for (const scene::CoarserBox& box : coarser) {
            cell = box.cell;
            if (point == glm::clamp(point, box.lo, box.hi))
                break;
        }
        return cell;
    }
};

/// How long the edges of a piece may be: by its nearest corner or centroid.
inline float edge_limit(const Corners& piece, const Boxes& boxes, float max_edge) {
    float nearest = boxes.distance((piece[0] + piece[1] + piece[2]) / 3.0f);
    for (const glm::vec3& corner : piece)
        nearest = std::min(nearest, boxes.distance(corner));
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
