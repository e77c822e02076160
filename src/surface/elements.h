// Elements: sides of patches that lie together, face alike and are seen alike. Light that varies
// slowly (of emitters, sky and other surfaces) is found for an element, by rays from all over it,
// so that it costs what a grid can show and not what a mesh is made of.
#pragma once

#include "surface/cutting.h"
#include "surface/patches.h"

#include <span>
#include <vector>

namespace lpvbake::surface {
class Keeper;

/// Also of a patch that another surface hides: a ray may meet either. Frame units squared.
inline double covered_area(const Patch& patch) {
    return 0.5 * double(patch.alpha * glm::length(glm::cross(patch.edge_u, patch.edge_v)));
}

/// A side of a patch is 2 * patch, its back one more.
struct Elements {
    static constexpr uint32_t none = ~0u;
    std::vector<uint32_t> of_side; ///< a side: its element; none where nothing is reflected
    std::vector<uint32_t> first;   ///< an element: its first member; one more at the end
    std::vector<uint32_t> members; ///< sides
    std::vector<float> up_to;      ///< a member: share of the element's area before its end

    size_t size() const { return first.size() - 1; }
    std::span<const uint32_t> members_of(size_t element) const {
        return std::span(members).subspan(first[element], first[element + 1] - first[element]);
    }
    /// The member at this share of an element's area, in [0, 1), and how far inside of it that is.
    struct Pick {
        uint32_t side;
        float rest;
    };
    Pick pick(size_t element, float share) const;
};

/// Groups the sides that reflect: of one cube, of about a cell near the grid and larger the farther
/// away, as patches are, of half of that where other surfaces are near; those whose normals differ
/// by less than about 40 degrees, that lie near one plane, and that a point above the first of them
/// sees, so that no wall and no sheet parts them. The same for any number of threads, and whatever
/// is kept.
Elements group_sides(const std::vector<Patch>& patches, const visibility::Visibility& visibility,
                     const Boxes& boxes, const Keeper& keeper);
Elements group_sides(const std::vector<Patch>& patches, const visibility::Visibility& visibility,
                     const Boxes& boxes);

} // namespace lpvbake::surface
