// Surfaces as small flat patches: the one base of emission, occlusion and lit surfaces.
#pragma once

#include "scene/frame.h"
#include "visibility/visibility.h"

#include <array>
#include <memory>
#include <span>
#include <vector>

namespace lpvbake::surface {

/// A flat piece of a triangle, itself a triangle.
struct Patch {
    glm::vec3 position; ///< centroid, frame units
    glm::vec3 normal;   ///< unit, out of the front
    glm::vec3 edge_u;   ///< from the first corner to the second and the third, frame units;
    glm::vec3 edge_v;   ///< the first lies at position - (edge_u + edge_v) / 3
    float area = 0;     ///< frame units squared
    float alpha = 1;    ///< mean covered share; 0 of glass that but tints
    uint32_t instance = 0;
    uint32_t triangle = 0;
    glm::vec3 albedo{0};   ///< mean of the covered part
    glm::vec3 emission{0}; ///< mean luminance of the front, its uncovered share included, nits
    bool double_sided = false;
    /// Something stands on it, so that its centroid does not see all its corners; or a lamp lies
    /// close above a part of it.
    bool crossed = false;
    /// Near the end of a lamp close above: it is as small as the gap between them.
    bool fading = false;
    bool met = true;   ///< by rays: false for what but shines
    bool asked = true; ///< light is wanted on it
    uint8_t under = 0; ///< the sides whose centroids lie under such a lamp (bit 0: front, 1: back)

    /// Luminance that its covered part sends by itself, nits.
    glm::vec3 sent() const { return alpha > 0.0f ? emission / alpha : glm::vec3(0.0f); }
    /// The point with these weights of the second and the third corner.
    glm::vec3 at(glm::vec2 weights) const {
        return position + (weights.x - 1.0f / 3.0f) * edge_u + (weights.y - 1.0f / 3.0f) * edge_v;
    }
};

/// Out of a side of a patch, 2 * patch + side.
inline glm::vec3 normal_of(const Patch& patch, uint32_t side) {
    return side % 2 != 0 ? -patch.normal : patch.normal;
}

/// How far above a surface (frame units) rays start, so that they do not meet it.
float ray_offset(glm::vec3 point);

/// Cuts every placed triangle into patches whose edges are at most `max_edge` units long and drops
/// those outside the grid. Zero-area triangles give none. Throws Error (memory) beyond 2^25
/// patches. Of what blocks light alone.
std::vector<Patch> make_patches(const Scene& scene, const scene::Frame& frame, float max_edge);

/// Which patch a point of a triangle belongs to: the halvings that made the patches, kept. Where
/// all pieces of a triangle were halved as often, and alike, the way down is arithmetic.
struct PatchTree {
    static constexpr uint32_t none = ~0u;
    /// A piece of corners (a, b, c): a patch; or halves (b, c, m) and (c, a, m), m between a and b,
    /// of corners that are turned `turn` places before that.
    struct Node {
        uint32_t at = none; ///< the patch, or the first half's place in `nodes`; the other follows
        bool halved = false;
        uint8_t turn = 0;
        bool crossed = false; ///< as the patch
        /// Which points of a side (bit 0: front, 1: back) lie under something matters; and whether
        /// its centroid does (2, 3).
        uint8_t cover = 0;
    };
    /// A triangle, its corners turned `turn` places. Halved `levels` times without another turn, it
    /// has 2^levels pieces from `first` on: bits of a piece's number say which half, the first
    /// halving's the highest.
    struct Root {
        uint32_t first = none;
        uint8_t levels = 0;
        uint8_t turn = 0;
    };
    std::vector<Node> pieces;         ///< of the roots: the way to most hits is one load
    std::vector<Node> nodes;          ///< of pieces that are halved further, and unused ones
    std::vector<Root> roots;          ///< a placed triangle
    std::vector<uint64_t> first_root; ///< an instance

    /// The patch at a hit, and the weights of its second and third corner there; none for no_hit
    /// and for what has neither area nor cover.
    uint32_t find(const visibility::Hit& hit, glm::vec2& weights) const {
        const Node* node = leaf(hit, weights);
        return node ? node->at : none;
    }
    /// Its node; null for no_hit.
    const Node* leaf(const visibility::Hit& hit, glm::vec2& weights) const;

    /// leaf() in two parts, for many hits: what the second loads comes meanwhile. Where a hit lies
    /// among the pieces, and its weights of that piece's corners.
    struct Approach {
        const Node* piece = nullptr;
        std::array<float, 3> weights{};
    };
    Approach approach(const visibility::Hit& hit) const;
    /// The same for many; nothing for those that meet a back.
    void approach(std::span<const visibility::Hit> hits, std::span<Approach> result) const;
    /// The node at the end of it, if any, and the weights of its second and third corner there.
    const Node* arrive(const Approach& from, glm::vec2& weights) const;
};

/// A piece of a placed triangle.
struct TrialPiece {
    uint32_t instance = 0, triangle = 0;
    std::array<glm::vec3, 3> corners; ///< frame units
    std::array<glm::vec2, 3> weights; ///< of the triangle's second and third vertex
};

/// Cuts pieces of a scene as cover_surfaces does, whatever the grid, to know how many patches they
/// make: what stands on them it sees by rays in a frame of its own, which is as fine as the scene
/// is large.
class CutTrial {
public:
    /// The scene outlives it.
    explicit CutTrial(const Scene& scene);
    ~CutTrial();

    uint64_t count(const TrialPiece& piece, const scene::Frame& frame, float max_edge) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

/// Whether anything lies less than half a cell (of those that surfaces were lit for) above a point
/// of a surface, on this side of it.
bool is_covered(const visibility::Visibility& visibility, glm::vec3 point, glm::vec3 normal);

/// All surfaces, also those outside the grid.
struct PatchCover {
    /// Of two surfaces in one place only one is seen: the patches of the other have area 0.
    std::vector<Patch> patches;
    PatchTree tree;
    std::vector<Patch> receivers; ///< of surfaces that receive light alone, which are none of those
};

/// Cuts every placed triangle into patches of at most `max_edge` units; outside the grid they may
/// grow with their distance from it. One that a wall crosses, so that its centroid does not see its
/// corners just above it, is cut further, down to an eighth; one near the end of a lamp close
/// above, down to the gap between them or a 64th. Throws Error as make_patches.
PatchCover cover_surfaces(const Scene& scene, const scene::Frame& frame,
                          const visibility::Visibility& visibility, float max_edge);

} // namespace lpvbake::surface
