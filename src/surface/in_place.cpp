#include "surface/in_place.h"

#include "lpvbake/volume.h"
#include "visibility/tangents.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace lpvbake::surface {
namespace {

using visibility::Facing;
using visibility::Hit;
using visibility::Visibility;

float reach_at(glm::vec3 point) {
    return 2.0f * ray_offset(point);
}

/// True if a body with this front stands on a sheet that turns its back on it.
bool stands_on(const Visibility& visibility, const Patch& patch, const Hit& sheet) {
    const glm::vec3 up = -patch.normal; // before the sheet's front
    const auto [u, v] = visibility::tangents_of(up);
    const glm::vec3 from = patch.position + (ray_offset(patch.position) - sheet.t) * up;
    thread_local std::vector<visibility::Crossing> met;
    int backs = 0;
    for (const glm::vec3 way : {up, up + u, up - u, up + v, up - v}) {
        visibility.crossings({from, way, 0.0f, HUGE_VALF}, met);
        backs += std::ranges::any_of(met, [](const visibility::Crossing& each) {
            return each.facing == Facing::back && each.t - met[0].t <= surface_margin;
        });
    }
    return backs >= 3;
}

bool hides(const Visibility& visibility, const Hit& sheet, const Patch& patch) {
    const float on = visibility::same_place(patch.position);
    if (patch.double_sided)
        return std::abs(sheet.t) <= on && sheet.facing == Facing::both
               && std::tie(sheet.instance, sheet.triangle)
                      < std::tie(patch.instance, patch.triangle);
    if (sheet.t > on)
        return true;
    if (sheet.facing == Facing::back)
        return stands_on(visibility, patch, sheet);
    return sheet.t >= -on
           && (sheet.facing == Facing::both
               || std::tie(sheet.instance, sheet.triangle)
                      < std::tie(patch.instance, patch.triangle));
}

} // namespace

bool is_hidden(const Visibility& visibility, const Patch& patch) {
    thread_local std::vector<Hit> sheets;
    visibility.sheets_at(patch.position, patch.normal, reach_at(patch.position), sheets);
    for (const Hit& sheet : sheets)
        if ((sheet.instance != patch.instance || sheet.triangle != patch.triangle)
            && hides(visibility, sheet, patch))
            return true;
    return false;
}

uint32_t seen_at(const LitSurfaces& lit, glm::vec3 point, glm::vec3 normal) {
    thread_local std::vector<Hit> sheets;
    lit.visibility->sheets_at(point, normal, reach_at(point), sheets);
    for (const Hit& sheet : sheets)
        if (const uint32_t side = lit.side(sheet, -normal);
            side != LitSurfaces::no_side && lit.patches[side / 2].area > 0.0f)
            return side;
    return LitSurfaces::no_side;
}

} // namespace lpvbake::surface
