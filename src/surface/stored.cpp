#include "surface/stored.h"

#include "surface/kept_cover.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {
namespace {

bool are_finite(const std::vector<glm::vec3>& values) {
    return std::ranges::all_of(
        values, [](glm::vec3 value) { return std::isfinite(value.x + value.y + value.z); });
}

/// Whether a float holds the light of all.
bool is_bounded(const LitSurfaces& lit) {
    double power = 0;
    for (size_t i = 0; i < lit.luminance.size(); ++i) {
        const Patch& patch = lit.patches[i / 2];
        const glm::vec3 light = glm::abs(lit.luminance[i]);
        power += (double(light.x) + double(light.y) + double(light.z))
                 * double(patch.area + glm::length(glm::cross(patch.edge_u, patch.edge_v)));
    }
    return power < 1e37;
}

/// Whether the numbers fit the patches.
bool is_sound(const LitSurfaces& lit) {
    const size_t sides = 2 * lit.patches.size();
    const auto fits = [](const std::vector<glm::vec3>& values, size_t count) {
        return values.size() == count && are_finite(values);
    };
    return fits(lit.luminance, sides) && (lit.shared.empty() || fits(lit.shared, sides))
           && lit.layer_count <= lit.layers.size() && fits(lit.layers, lit.layer_count * sides)
           && lit.cut_from.size() <= lit.patches.size()
           && std::ranges::all_of(lit.cut_from,
                                  [&](uint32_t patch) { return patch < lit.patches.size(); })
           && lit.bounces >= 0 && std::isfinite(lit.residual + lit.narrow + lit.lost)
           && is_bounded(lit);
}

} // namespace

void put(LitSurfaces lit, cache::Writer& out) {
    PatchCover cover;
    cover.patches = std::move(lit.patches);
    cover.tree = std::move(lit.tree);
    cover.receivers = std::move(lit.receivers);
    write_cover(cover, out);
    out.put(lit.luminance);
    out.put(lit.cut_from);
    out.put(lit.shared);
    out.put(lit.layers);
    out.put(uint64_t(lit.layer_count));
    out.put(int32_t(lit.bounces));
    for (const double number : {lit.residual, lit.narrow, lit.lost})
        out.put(number);
}

bool get(cache::Reader& in, const Scene& scene, const visibility::Visibility& visibility,
         LitSurfaces& lit) {
    PatchCover cover;
    uint64_t layers = 0;
    int32_t bounces = 0;
    if (!read_cover(in, scene, cover) || !in.get(lit.luminance) || !in.get(lit.cut_from)
        || !in.get(lit.shared) || !in.get(lit.layers) || !in.get(layers) || !in.get(bounces)
        || !in.get(lit.residual) || !in.get(lit.narrow) || !in.get(lit.lost) || !in.at_end())
        return false;
    lit.patches = std::move(cover.patches);
    lit.tree = std::move(cover.tree);
    lit.receivers = std::move(cover.receivers);
    lit.layer_count = size_t(layers);
    lit.bounces = bounces;
    lit.visibility = &visibility;
    return is_sound(lit);
}

} // namespace lpvbake::surface
