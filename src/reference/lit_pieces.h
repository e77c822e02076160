// Surfaces that punctual lights light up, as targets of rays: most of what a small lamp gives comes
// from a small spot beside it.
#pragma once

#include "reference/emitters.h"
#include "reference/halves.h"
#include "visibility/visibility.h"

#include <span>
#include <unordered_map>
#include <vector>

namespace lpvbake::reference {

/// Chooses points on lit surfaces with a density that follows the light they send on, their
/// distance and the side that they turn. Photons (2^14, half of them by the lights' number, half by
/// their power) tell where light is; triangles are halved until their pieces hold few. The pieces
/// are the leaves of a binary tree, which is descended by what each of two halves may give (after
/// Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree
/// Splitting"). Where no photon fell the density is 0: not all rays may be aimed.
class LitPieces {
public:
    enum class Light {
        all,  ///< of all lights, reflected up to fifteen times
        spots ///< what point and spot lights, which may be as near as one likes, shine on
    };
    LitPieces(const Scene& scene, const visibility::Visibility& visibility,
              const scene::Frame& frame, Light light);
    bool empty() const { return tree_.empty(); }

    /// A point on a piece, as it is seen from `origin` (frame units).
    Emitters::Target target(glm::dvec3 origin, glm::dvec2 sample) const;
    /// How likely, per steradian, `target` chooses from `origin` the direction in which `hit` was
    /// met; `towards` is the ray's unit direction, so that Hit::t is the distance.
    double density(const visibility::Hit& hit, glm::dvec3 origin, glm::dvec3 towards) const;

private:
    struct Photon {
        uint32_t instance, triangle;
        glm::vec2 barycentric;
        glm::vec3 facing; ///< power times the normal of the side that is lit
    };
    /// A triangle with lit pieces.
    struct Placed {
        glm::vec3 a, ab, ac;
        uint32_t instance, triangle;
    };
    struct Piece : Halved {
        uint32_t leaf = ~0u; ///< in leaves_; ~0u: dark, or halved
    };
    struct Leaf {
        uint32_t placed; ///< in placed_
        Corners corners;
        double area = 0;
        double power = 0;
        glm::dvec3 facing{0.0}; ///< sum of the photons'
        uint32_t branch = 0;    ///< in tree_
    };
    /// Some leaves, as they look from outside.
    struct Branch {
        glm::dvec3 centre{0.0};
        double around = 0; ///< square of the radius around the centre
        double power = 0;
        double even = 0; ///< of the power what turns all ways alike
        glm::dvec3 facing{0.0};
        uint32_t parent = ~0u; ///< of the first of all: ~0u
        uint32_t second = 0;   ///< the second half; the first is the next branch
        uint32_t leaf = ~0u;   ///< ~0u: it has halves
    };

    void halve(std::span<Photon> photons, uint32_t placed);
    void grow(std::span<uint32_t> leaves, uint32_t parent);
    glm::dvec3 corner(const Leaf& leaf, std::size_t i) const;
    glm::dvec3 middle(uint32_t leaf) const;
    /// Parts leaves in two, the bright from the far; returns how many come first.
    std::size_t part(std::span<uint32_t> leaves, glm::dvec3 lo, glm::dvec3 hi) const;
    static double importance(const Branch& branch, glm::dvec3 origin);
    /// How likely the first of a branch's halves is chosen.
    double first_share(const Branch& branch, glm::dvec3 origin) const;

    std::vector<Placed> placed_;
    std::vector<Piece> pieces_;
    std::unordered_map<uint64_t, uint32_t> roots_; ///< instance and triangle: in pieces_
    std::vector<Leaf> leaves_;
    std::vector<Branch> tree_;
};

} // namespace lpvbake::reference
