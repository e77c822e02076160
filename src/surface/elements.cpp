#include "surface/elements.h"

#include "surface/cutting.h"
#include "surface/halton.h"
#include "surface/hemisphere.h"
#include "surface/kept.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace lpvbake::surface {
namespace {

constexpr float edge = 1.0f;    ///< of a cube in the grid
constexpr float open = 2.0f;    ///< in edges: how far away what is seen lies from a whole cube
constexpr float shift = 0.37f;  ///< so that walls, which often lie on the lattice, lie in one
constexpr float alike = 0.766f; ///< least cosine between normals
constexpr float apart = 0.25f;  ///< from a plane, in edges
constexpr float lift = 0.25f;   ///< of the point that has to see all members, in edges
/// First members in a cube. Of what is left each goes to the one whose normal is nearest.
constexpr size_t most_of_cube = 64;

/// The cube that a side lies in: its size and its place.
using Place = std::array<int32_t, 4>;

float cube_edge(int32_t size) {
    return std::ldexp(edge, size);
}

Place place_in(glm::vec3 point, int32_t size) {
    Place place{size};
    for (int axis = 0; axis < 3; ++axis)
        place[size_t(axis) + 1] = int32_t(std::floor(point[axis] / cube_edge(size) + shift));
    return place;
}

/// The cube of a patch. One that is as small as its light fades fast has one no larger than itself.
Place place_of(const Patch& patch, const Boxes& boxes) {
    int32_t size = int32_t(std::log2(graded(1.0f, boxes.distance(patch.position))));
    if (patch.fading)
        size = std::min(size, int32_t(std::floor(std::log2(
                                  std::max({glm::length(patch.edge_u), glm::length(patch.edge_v),
                                            glm::length(patch.edge_u - patch.edge_v)})))));
    return place_in(patch.position, size);
}

/// What another surface hides is not mixed with what hides it, nor what lies under a lamp with what
/// lies beside it.
struct Side {
    Place place;
    bool hidden;
    bool under;
    uint32_t index;
    auto operator<=>(const Side&) const = default;
};

glm::vec3 normal_of(const std::vector<Patch>& patches, uint32_t side) {
    return surface::normal_of(patches[side / 2], side);
}

/// Where the rays of a side start.
glm::vec3 lifted(const std::vector<Patch>& patches, uint32_t side) {
    const glm::vec3 p = patches[side / 2].position;
    return p + ray_offset(p) * normal_of(patches, side);
}

/// What stands right above a point closer than this, and how close: the way there, or `most`.
float room_above(glm::vec3 from, glm::vec3 normal, float most,
                 const visibility::Visibility& visibility) {
    const visibility::Hit hit = visibility.closest({from, most * normal});
    return hit.instance == visibility::no_hit ? most : hit.t * most;
}

/// Harmonic mean distance of what is seen from a point over a surface. Irradiance varies over about
/// as much (Ward, Rubinstein and Clear 1988).
float distance_around(glm::vec3 from, glm::vec3 normal, const visibility::Visibility& visibility) {
    constexpr uint32_t looks = 8;
    std::array<visibility::Ray, looks> rays;
    std::array<visibility::Hit, looks> hits;
    for (uint32_t i = 0; i < looks; ++i) {
        const glm::vec2 u{(float(i) + 0.5f) / looks, float(radical_inverse(i, 2))};
        rays[i] = {from, sample_cosine(normal, u), 0.0f, HUGE_VALF};
    }
    visibility.closest_of_eights(rays, visibility::Bundle::loose, hits);
    float sum = 0.0f;
    for (const visibility::Hit& hit : hits)
        sum += hit.instance == visibility::no_hit ? 0.0f : 1.0f / hit.t;
    return float(looks) / sum;
}

/// Parts the sides of a cube: an element each, in the order of their first members.
std::vector<std::vector<uint32_t>> part(const std::vector<Patch>& patches,
                                        std::span<const Side> sides,
                                        const visibility::Visibility& visibility) {
    const float size = cube_edge(sides[0].place[0]);
    const int32_t finer = sides[0].place[0] - 1;
    std::vector<std::vector<uint32_t>> elements;
    std::vector<uint32_t> left, others, asked, hidden;
    for (const Side& side : sides)
        left.push_back(side.index);
    std::vector<visibility::Ray> rays;
    std::vector<glm::vec3> seen;
    while (!left.empty() && elements.size() < most_of_cube) {
        const glm::vec3 position = patches[left[0] / 2].position;
        const glm::vec3 normal = normal_of(patches, left[0]);
        // Above the first member, clear of what stands there: what has to see the others.
        const glm::vec3 first = lifted(patches, left[0]);
        const float above = room_above(first, normal, lift * size, visibility);
        const bool covered = above < lift * size;
        const glm::vec3 eye = first + (covered ? 0.5f * above : above) * normal;
        const bool near = distance_around(eye, normal, visibility) < open * size;
        const Place half = place_in(position, finer);
        others.clear();
        asked.clear();
        rays.clear();
        for (const uint32_t side : std::span(left).subspan(1)) {
            const glm::vec3 there = patches[side / 2].position;
            if (glm::dot(normal, normal_of(patches, side)) < alike
                || std::abs(glm::dot(there - position, normal)) > apart * size
                || (near && place_in(there, finer) != half)
                // Light that lies below a panel does not belong beside it.
                || (covered
                    && room_above(lifted(patches, side), normal_of(patches, side), 2.0f * above,
                                  visibility)
                           == 2.0f * above)) {
                others.push_back(side);
                continue;
            }
            asked.push_back(side);
            rays.push_back({eye, lifted(patches, side) - eye});
        }
        seen.resize(rays.size());
        visibility.filter_of_eights(rays, visibility::Bundle::tight, seen);
        std::vector<uint32_t>& members = elements.emplace_back(1, left[0]);
        hidden.clear();
        for (size_t i = 0; i < asked.size(); ++i)
            (seen[i].x + seen[i].y + seen[i].z < 1.5f ? hidden : members).push_back(asked[i]);
        left.clear();
        std::ranges::merge(others, hidden, std::back_inserter(left));
    }
    for (const uint32_t side : left)
        std::ranges::max_element(elements, {}, [&](const std::vector<uint32_t>& members) {
            return glm::dot(normal_of(patches, side), normal_of(patches, members[0]));
        })->push_back(side);
    return elements;
}

} // namespace

Elements group_sides(const std::vector<Patch>& patches, const visibility::Visibility& visibility,
                     const Boxes& boxes) {
    return group_sides(patches, visibility, boxes, Keeper());
}

Elements group_sides(const std::vector<Patch>& patches, const visibility::Visibility& visibility,
                     const Boxes& boxes, const Keeper& keeper) {
    std::vector<Side> sides;
    for (size_t i = 0; i < patches.size(); ++i) {
        const Patch& patch = patches[i];
        if (patch.albedo == glm::vec3(0.0f))
            continue;
        const Place place = place_of(patch, boxes);
        const bool hidden = !(patch.area > 0.0f);
        for (const unsigned side : {0u, 1u})
            if (side == 0 || patch.double_sided)
                sides.push_back(
                    {place, hidden, (patch.under >> side & 1) != 0, uint32_t(2 * i + side)});
    }
    tbb::parallel_sort(sides);
    std::vector<size_t> cubes;
    for (size_t i = 0; i < sides.size(); ++i)
        if (i == 0 || sides[i].place != sides[i - 1].place || sides[i].hidden != sides[i - 1].hidden
            || sides[i].under != sides[i - 1].under)
            cubes.push_back(i);
    cubes.push_back(sides.size());
    KeptGroups kept(keeper, most_of_cube);
    std::vector<std::vector<std::vector<uint32_t>>> parts(cubes.size() - 1);
    tbb::parallel_for(size_t(0), parts.size(), [&](size_t i) {
        const auto own = std::span(sides).subspan(cubes[i], cubes[i + 1] - cubes[i]);
        if (keeper) {
            std::vector<uint32_t> indices(own.size());
            std::ranges::transform(own, indices.begin(), &Side::index);
            parts[i] = kept.find(indices);
        }
        if (parts[i].empty())
            parts[i] = part(patches, own, visibility);
    });
    kept.keep(parts);

    Elements elements;
    elements.of_side.assign(2 * patches.size(), Elements::none);
    elements.first.push_back(0);
    elements.members.reserve(sides.size());
    elements.up_to.reserve(sides.size());
    for (const std::vector<std::vector<uint32_t>>& cube : parts)
        for (const std::vector<uint32_t>& members : cube) {
            double area = 0.0, before = 0.0;
            for (const uint32_t side : members)
                area += covered_area(patches[side / 2]);
            for (const uint32_t side : members) {
                before += covered_area(patches[side / 2]);
                elements.of_side[side] = uint32_t(elements.size());
                elements.members.push_back(side);
                elements.up_to.push_back(area > 0.0 ? float(before / area) : 1.0f);
            }
            elements.first.push_back(uint32_t(elements.members.size()));
        }
    return elements;
}

Elements::Pick Elements::pick(size_t element, float share) const {
    const auto begin = up_to.begin() + first[element],
               last = up_to.begin() + first[element + 1] - 1;
    const auto found = std::upper_bound(begin, last, share);
    const float before = found == begin ? 0.0f : *(found - 1);
    const float rest = (share - before) / std::max(*found - before, 1e-20f);
    return {members[size_t(found - up_to.begin())], std::clamp(rest, 0.0f, 0x1.fffffep-1f)};
}

} // namespace lpvbake::surface
