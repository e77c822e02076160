#include "surface/narrow.h"

#include "surface/cutting.h"
#include "surface/together.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace lpvbake::surface {
namespace {

using Node = PatchTree::Node;

constexpr double uneven = 0.5;        ///< of a patch
constexpr double enough = 0.5;        ///< of the light of sides that lie together
constexpr double least = 1.0 / 512.0; ///< and of one of them

/// Where the light of a side falls.
struct Spot {
    glm::vec3 centre;
    float radius;
};

/// A node of the tree, which moves as the tree grows.
struct Place {
    bool root = false; ///< in PatchTree::pieces
    size_t at = 0;

    Node& in(PatchTree& tree) const { return root ? tree.pieces[at] : tree.nodes[at]; }
};

Place place_of(const Node* node, const PatchTree& tree) {
    const auto first = std::less<>{}(node, tree.pieces.data());
    if (!first && std::less<>{}(node, tree.pieces.data() + tree.pieces.size()))
        return {true, size_t(node - tree.pieces.data())};
    return {false, size_t(node - tree.nodes.data())};
}

float distance_to_segment(glm::vec3 point, glm::vec3 a, glm::vec3 b) {
    const glm::vec3 way = b - a;
    const float along = glm::dot(point - a, way) / std::max(glm::dot(way, way), 1e-30f);
    return glm::distance(point, a + std::clamp(along, 0.0f, 1.0f) * way);
}

/// From a piece to a point in its plane.
float distance_to(const Corners& piece, glm::vec3 normal, glm::vec3 point) {
    float nearest = HUGE_VALF;
    int inside = 0;
    for (size_t i = 0; i < 3; ++i) {
        const glm::vec3 a = piece[i], b = piece[(i + 1) % 3];
        nearest = std::min(nearest, distance_to_segment(point, a, b));
        inside += glm::dot(glm::cross(b - a, point - a), normal) >= 0.0f ? 1 : -1;
    }
    return std::abs(inside) == 3 ? 0.0f : nearest;
}

visibility::Hit triangle_of(const Patch& patch) {
    visibility::Hit hit;
    hit.instance = patch.instance;
    hit.triangle = patch.triangle;
    return hit;
}

/// Mean square of the distance from the middle of the light on a side, frame units squared.
double square_radius(const SideFlux& side, const LightMapper& mapper) {
    const glm::dmat3 corners = mapper.triangle(triangle_of(mapper.lit.patches[side.side / 2]));
    const glm::dvec3 u = corners[1] - corners[0], v = corners[2] - corners[0];
    const glm::dvec2 mean = side.weights / side.flux;
    const glm::dvec3 squares = side.squared_weights / side.flux
                               - glm::dvec3(mean.x * mean.x, mean.y * mean.y, mean.x * mean.y);
    return std::max(0.0, squares.x * glm::dot(u, u) + squares.y * glm::dot(v, v)
                             + 2.0 * squares.z * glm::dot(u, v));
}

class NarrowCutter {
public:
    NarrowCutter(const LightMapper& mapper, LitSurfaces& lit)
        : mapper_(mapper),
          lit_(lit),
          most_(lit.patches.size() - lit.cut_from.size()) {}

    void cut(const NarrowLight& light) {
        const uint32_t index = light.side / 2;
        const Patch whole = lit_.patches[index];
        if (whole.crossed || lit_.cut_from.size() > most_ / 2 + 4096)
            return;
        visibility::Hit hit = triangle_of(whole);
        hit.barycentric = light.at;
        glm::vec2 weights;
        const Node* node = lit_.tree.leaf(hit, weights);
        if (!node || node->at != index || node->halved)
            return; // what lies beside the patch gave it light, or another light has cut it
        halve(index, place_of(node, lit_.tree), {whole.at(weights), light.radius});
    }

private:
    void halve(uint32_t index, Place root, const Spot& spot) {
        const Patch whole = lit_.patches[index];
        const float least_edge =
            std::max(2.5f * spot.radius, 0.125f * mapper_.patch_edge(whole.position));
        struct Open {
            Corners corners;
            Place place;
        };
        std::vector<Open> open{{{whole.at({0, 0}), whole.at({1, 0}), whole.at({0, 1})}, root}};
        bool first = true;
        PatchTree& tree = lit_.tree;
        while (!open.empty()) {
            const auto [corners, place] = open.back();
            open.pop_back();
            const auto [at, length] = longest_edge(corners);
            if (length > least_edge
                && distance_to(corners, whole.normal, spot.centre) < 2.0f * spot.radius + 1e-6f) {
                const glm::vec3 a = corners[size_t(at)], b = corners[size_t(at + 1) % 3],
                                c = corners[size_t(at + 2) % 3], middle = 0.5f * (a + b);
                const size_t half = tree.nodes.size();
                tree.nodes.insert(tree.nodes.end(), 2, Node{});
                place.in(tree) = {uint32_t(half), true, uint8_t(at)};
                open.push_back({{b, c, middle}, {false, half}});
                open.push_back({{c, a, middle}, {false, half + 1}});
                continue;
            }
            Patch piece = whole;
            piece.position = (corners[0] + corners[1] + corners[2]) / 3.0f;
            piece.edge_u = corners[1] - corners[0];
            piece.edge_v = corners[2] - corners[0];
            piece.area = 0.5f * glm::length(glm::cross(piece.edge_u, piece.edge_v));
            place.in(tree) = {first ? index : uint32_t(lit_.patches.size())};
            if (first) {
                lit_.patches[index] = piece;
                first = false;
            } else {
                lit_.patches.push_back(piece);
                lit_.cut_from.push_back(index);
            }
        }
    }

    const LightMapper& mapper_;
    LitSurfaces& lit_;
    size_t most_; ///< patches before any was cut
};

} // namespace

bool is_within(const SideFlux& side, const LightMapper& mapper, double share) {
    const Patch& patch = mapper.lit.patches[side.side / 2];
    if (!(side.flux * side.flux < share * double(patch.area) * side.peak))
        return false;
    if (!mapper.veiled())
        return true;
    // What lets some through by chance leaves gaps: only how far what falls on it spreads tells.
    const glm::dvec3 u(patch.edge_u), v(patch.edge_v), w = u - v;
    const double even = (glm::dot(u, u) + glm::dot(v, v) + glm::dot(w, w)) / 36.0;
    return square_radius(side, mapper) < share * even;
}

std::vector<NarrowLight> find_narrow(const LightMap& map, const LightMapper& mapper) {
    const LitSurfaces& lit = mapper.lit;
    const auto is_narrow = [&](const SideFlux& side) { return is_within(side, mapper, uneven); };
    std::vector<Placed> placed;
    for (uint32_t i = 0; i < map.sides.size(); ++i) {
        const uint32_t side = map.sides[i].side;
        placed.push_back({together(lit.patches[side / 2], side, mapper.frame), i});
    }
    tbb::parallel_sort(placed);
    std::vector<NarrowLight> found;
    for (const std::span<const Placed> group : groups_of(placed)) {
        double all = 0.0, on_little = 0.0;
        for (const Placed& at : group) {
            const SideFlux& side = map.sides[at.index];
            all += side.flux;
            on_little += is_narrow(side) ? side.flux : 0.0;
        }
        if (on_little > enough * all)
            for (const Placed& at : group)
                if (const SideFlux& side = map.sides[at.index];
                    side.flux > least * all && is_narrow(side))
                    found.push_back({side.side, glm::vec2(side.weights / side.flux),
                                     float(std::sqrt(square_radius(side, mapper)))});
    }
    return found;
}

size_t cut_to_light(std::span<const NarrowLight> narrow, const LightMapper& mapper,
                    LitSurfaces& lit) {
    const size_t before = lit.patches.size();
    NarrowCutter cutter(mapper, lit);
    for (const NarrowLight& light : narrow)
        cutter.cut(light);
    return lit.patches.size() - before;
}

} // namespace lpvbake::surface
