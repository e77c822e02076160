#include "surface/stored.h"

#include "surface/kept_cover.h"

#include <algorithm>
#include <cmath>
#include <functional>

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

} // namespace

bool is_sound(const LitSurfaces& lit) {
    const size_t sides = 2 * lit.patches.size();
    const auto fits = [](const std::vector<glm::vec3>& values, size_t count) {
        return values.size() == count && are_finite(values);
    };
    return fits(lit.luminance, sides) && (lit.shared.empty() || fits(lit.shared, sides))
           && lit.layer_count <= lit.layers.size() && fits(lit.layers, lit.layer_count * sides)
           && (lit.cut_from.empty() || lit.cut_from.size() < lit.patches.size())
           && std::ranges::all_of(lit.cut_from,
                                  [&](uint32_t patch) { return patch < lit.patches.size(); })
           && lit.bounces >= 0 && std::isfinite(lit.residual + lit.narrow + lit.lost)
           && is_bounded(lit);
}

namespace {

/// Their numbers, of one part.
void put(const ElementRays& rays, cache::Writer& out) {
    out.put(rays.lux);
    out.put(rays.spots);
    out.put(rays.hits);
    out.put(rays.tints);
}

bool get(cache::Reader& in, ElementRays& rays) {
    return in.get(rays.lux) && in.get(rays.spots) && in.get(rays.hits) && in.get(rays.tints)
           && are_finite(rays.lux) && are_finite(rays.spots) && are_finite(rays.tints);
}

/// Whether every side is of the patches, and of one element at most.
bool set_sides(Elements& elements, size_t sides) {
    elements.of_side.assign(sides, Elements::none);
    if (elements.first.empty() || elements.first.front() != 0
        || elements.first.back() != elements.members.size()
        || std::ranges::adjacent_find(elements.first, std::greater_equal()) != elements.first.end())
        return false;
    for (size_t i = 0; i < elements.size(); ++i)
        for (const uint32_t side : elements.members_of(i)) {
            if (side >= sides || elements.of_side[side] != Elements::none)
                return false;
            elements.of_side[side] = uint32_t(i);
        }
    return true;
}

/// Whether the rays of parts are those of all elements, as many each, and meet sides of some.
bool fit_together(const std::vector<LitPart>& parts) {
    const LitPart& whole = parts.front();
    const size_t count = whole.elements.size();
    size_t elements = 0, hits = 0;
    for (const LitPart& part : parts) {
        const ElementRays& rays = part.rays;
        const bool tinted = !whole.rays.tints.empty() || !rays.tints.empty();
        if (rays.lux.size() > count - elements || rays.spots.size() != rays.lux.size()
            || (rays.lux.empty() ? !rays.hits.empty() : rays.hits.size() % rays.lux.size() != 0)
            || (tinted && rays.tints.size() != rays.hits.size())
            || std::ranges::any_of(rays.hits, [&](uint32_t side) {
                   return side != ElementRays::black
                          && (side >= whole.elements.of_side.size()
                              || whole.elements.of_side[side] == Elements::none);
               }))
            return false;
        elements += rays.lux.size();
        hits += rays.hits.size();
    }
    const size_t sides = whole.lit.luminance.size();
    return elements == count
           && (count == 0 || (hits % count == 0 && (hits == 0) == (whole.reflections.most == 1)))
           && (whole.spots.empty() || whole.spots.size() == sides) && are_finite(whole.spots);
}

bool get(cache::Reader& in, const Scene* scene, LitSurfaces& lit) {
    PatchCover cover;
    uint64_t layers = 0;
    int32_t bounces = 0;
    if (!read_cover(in, scene, cover) || !in.get(lit.luminance) || !in.get(lit.cut_from)
        || !in.get(lit.shared) || !in.get(lit.layers) || !in.get(layers) || !in.get(bounces)
        || !in.get(lit.residual) || !in.get(lit.narrow) || !in.get(lit.lost))
        return false;
    lit.patches = std::move(cover.patches);
    lit.tree = std::move(cover.tree);
    lit.receivers = std::move(cover.receivers);
    lit.layer_count = size_t(layers);
    lit.bounces = bounces;
    return is_sound(lit);
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
    lit.visibility = &visibility;
    return get(in, &scene, lit) && in.at_end();
}

void put(LitPart part, cache::Writer& out) {
    put(part.rays, out);
    if (part.index != 1)
        return;
    put(std::move(part.lit), out);
    out.put(part.elements.first);
    out.put(part.elements.members);
    out.put(part.spots);
    out.put(uint8_t(part.emitters));
    out.put(int32_t(part.reflections.most.value_or(-1)));
    out.put(part.reflections.tolerance);
}

bool get(std::span<cache::Reader> in, std::vector<LitPart>& parts) {
    parts.resize(in.size());
    for (size_t i = 0; i < in.size(); ++i)
        if (!get(in[i], parts[i].rays) || (i > 0 && !in[i].at_end()))
            return false;
    LitPart& whole = parts.front();
    uint8_t emitters = 0;
    int32_t most = 0;
    if (!get(in[0], nullptr, whole.lit) || !in[0].get(whole.elements.first)
        || !in[0].get(whole.elements.members) || !in[0].get(whole.spots) || !in[0].get(emitters)
        || !in[0].get(most) || !in[0].get(whole.reflections.tolerance) || !in[0].at_end())
        return false;
    whole.emitters = emitters != 0;
    if (most >= 0)
        whole.reflections.most = most;
    return whole.reflections.tolerance > 0.0f
           && set_sides(whole.elements, whole.lit.luminance.size()) && fit_together(parts);
}

} // namespace lpvbake::surface
