// Triangles that are halved, again and again, along their longest edges.
#pragma once

#include <glm/glm.hpp>

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace lpvbake::reference {

/// Weights of a triangle's second and third vertex at the corners of a piece of it.
using Corners = std::array<glm::vec2, 3>;
inline constexpr Corners whole_triangle{glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(0, 1)};

/// A piece in a tree of halves: they are nodes `first_half` and the one after it.
struct Halved {
    uint32_t first_half = 0; ///< 0: not halved
    uint8_t edge = 0;        ///< the one that was halved, between this corner and the next
};

/// The longest edge of a piece of a triangle with sides ab and ac, and its halves.
struct Halves {
    uint8_t edge;
    Corners first, second;
};
inline Halves halves_of(const Corners& corners, glm::vec3 ab, glm::vec3 ac) {
    const auto length = [&](std::size_t from) {
        const glm::vec2 w = corners[(from + 1) % 3] - corners[from];
        return glm::length(w.x * ab + w.y * ac);
    };
    std::size_t at = 0;
    for (std::size_t i = 1; i < 3; ++i)
        if (length(i) > length(at))
            at = i;
    const glm::vec2 a = corners[at], b = corners[(at + 1) % 3], c = corners[(at + 2) % 3];
    const glm::vec2 middle = 0.5f * (a + b);
    return {uint8_t(at), {middle, b, c}, {a, middle, c}};
}

/// Takes weights of a piece's three corners to those of its half's; returns which half.
inline bool descend(const Halved& piece, std::array<float, 3>& w) {
    const float a = w[piece.edge], b = w[(piece.edge + 1u) % 3], c = w[(piece.edge + 2u) % 3];
    const bool second = b < a;
    w = second ? std::array{a - b, 2.0f * b, c} : std::array{2.0f * a, b - a, c};
    return second;
}

/// The piece that is not halved at a place of a triangle whose tree begins at `root`.
template <class Node>
const Node& piece_at(const std::vector<Node>& nodes, uint32_t root, glm::vec2 barycentric) {
    const Node* node = &nodes[root];
    std::array<float, 3> w{1.0f - barycentric.x - barycentric.y, barycentric.x, barycentric.y};
    while (node->first_half != 0)
        node = &nodes[node->first_half + uint32_t(descend(*node, w))];
    return *node;
}

/// A point uniform over a piece, as weights of the triangle's second and third vertex.
inline glm::dvec2 point_in(const Corners& corners, glm::dvec2 sample) {
    const auto& [a, b, c] = corners;
    const double root = std::sqrt(sample.x);
    return glm::dvec2(a) + root * (1.0 - sample.y) * glm::dvec2(b - a)
           + root * sample.y * glm::dvec2(c - a);
}

} // namespace lpvbake::reference
