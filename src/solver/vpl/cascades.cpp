#include "solver/vpl/cascades.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake::solver::vpl {
namespace {

constexpr double texels_a_cell = 8;
constexpr int largest_map = 1 << 20; ///< texels along a side

struct Box {
    glm::dvec3 lo, hi; ///< frame units
    double cell;       ///< units
};

/// Of the frame's levels, coarsest first.
std::vector<Box> boxes_of(const scene::Frame& frame) {
    std::vector<Box> boxes{{glm::dvec3(0), frame.extent, 1}};
    for (const scene::CoarserBox& level : frame.coarser)
        boxes.push_back({glm::dvec3(level.lo), glm::dvec3(level.hi), double(level.cell)});
    std::ranges::reverse(boxes);
    return boxes;
}

/// Where a box lies in a map, each axis from -1 to 1, and how far from the light it ends.
struct Shadow {
    glm::dvec2 lo{std::numeric_limits<double>::infinity()}, hi{-lo};
    double farthest = 0;
};

Shadow shadow_of(const Box& box, const scene::RsmView& view) {
    const glm::dvec2 half(glm::length(view.u), glm::length(view.v));
    const auto seen = [&](glm::dvec3 p) { // across the map, and the depth
        const glm::dvec3 way = p - view.origin;
        return glm::dvec3(glm::dot(way, view.u) / (half.x * half.x),
                          glm::dot(way, view.v) / (half.y * half.y), glm::dot(way, view.axis));
    };
    Shadow shadow;
    const auto add = [&](glm::dvec3 p) {
        const glm::dvec2 at = glm::dvec2(p) / (view.perspective ? p.z : 1.0);
        shadow.lo = glm::min(shadow.lo, at);
        shadow.hi = glm::max(shadow.hi, at);
        shadow.farthest = std::max(shadow.farthest, p.z);
    };
    for (int corner = 0; corner < 8; ++corner)
        for (int axis = 0; axis < 3; ++axis) {
            if (corner >> axis & 1)
                continue;
            glm::dvec3 ends[2];
            for (const int end : {0, 1})
                for (int k = 0; k < 3; ++k)
                    ends[end][k] = (corner | end << axis) >> k & 1 ? box.hi[k] : box.lo[k];
            const glm::dvec3 a = seen(ends[0]), b = seen(ends[1]);
            const double near = view.nearest;
            for (const glm::dvec3 p : {a, b})
                if (!view.perspective || p.z >= near)
                    add(p);
            // What goes on behind the light is cut off before it.
            if (view.perspective && (a.z < near) != (b.z < near))
                add(glm::mix(a, b, (near - a.z) / (b.z - a.z)));
        }
    return shadow;
}

/// A box's texels in a map, rounded out.
Texels covered(const Shadow& shadow, int size) {
    constexpr double slack = 1e-6; // of a texel: rounding takes no more of them
    const auto texels = [&](glm::dvec2 at) {
        return glm::clamp(0.5 * double(size) * (at + 1.0), -1.0, size + 1.0);
    };
    if (!glm::all(glm::lessThan(shadow.lo, shadow.hi)))
        return {};
    return {glm::max(glm::ivec2(glm::floor(texels(shadow.lo) + slack)), 0),
            glm::min(glm::ivec2(glm::ceil(texels(shadow.hi) - slack)), size)};
}

} // namespace

std::vector<Cascade> cascades_of(const scene::RsmView& view, const scene::Frame& frame, int size) {
    const std::vector<Box> boxes = boxes_of(frame);
    std::vector<Cascade> cascades{{size, {glm::ivec2(0), glm::ivec2(size)}, {}}};
    const double edge = 2 * std::max(glm::length(view.u), glm::length(view.v));
    double parted = boxes.front().cell; // the cells that the last cascade is for
    for (std::size_t i = 1; i < boxes.size(); ++i) {
        const Shadow shadow = shadow_of(boxes[i], view);
        Cascade& last = cascades.back();
        const Texels part = covered(shadow, last.size);
        if (part.is_empty())
            break;
        const double texel = edge * (view.perspective ? shadow.farthest : 1.0) / last.size;
        int parts = 1;
        while (parts * boxes[i].cell < parted && texel * texels_a_cell > parts * boxes[i].cell
               && last.size * parts < largest_map)
            parts *= 2;
        if (parts == 1)
            continue;
        last.cut = part;
        parted = boxes[i].cell;
        cascades.push_back({last.size * parts, {part.lo * parts, part.hi * parts}, {}});
    }
    return cascades;
}

} // namespace lpvbake::solver::vpl
