#include "surface/flux.h"

#include "colour/colour.h"
#include "surface/in_place.h"
#include "surface/kept.h"
#include "surface/narrow.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::surface {
namespace {

/// A light in the frame.
struct Source {
    const Light& light;
    const scene::Frame& frame;
    glm::dvec3 position;
    scene::Cone cone;

    Source(const Light& of, const scene::Frame& in)
        : light(of),
          frame(in),
          position(in.from_world(of.position)),
          cone(of.type == LightType::spot ? scene::Cone(of) : scene::Cone()) {}

    /// What is left of the light towards a point: cone and range.
    double share(glm::vec3 point) const {
        const glm::dvec3 way = glm::dvec3(point) - position;
        const double distance = glm::length(way);
        const double window = scene::range_window(light, distance * frame.unit);
        return light.type == LightType::spot && distance > 0.0 ? window * cone(way / distance)
                                                               : window;
    }
    /// Where the way to a point begins.
    glm::vec3 way_from(glm::vec3 point, float across) const {
        return light.type == LightType::directional ? across * glm::vec3(-light.direction)
                                                    : glm::vec3(position - glm::dvec3(point));
    }
};

/// Solid angle of a triangle from the origin (van Oosterom and Strackee 1983), sr.
double solid_angle(glm::dvec3 a, glm::dvec3 b, glm::dvec3 c) {
    const double la = glm::length(a), lb = glm::length(b), lc = glm::length(c);
    const double volume = std::abs(glm::dot(a, glm::cross(b, c)));
    return 2.0
           * std::atan2(volume, la * lb * lc + glm::dot(a, b) * lc + glm::dot(a, c) * lb
                                    + glm::dot(b, c) * la);
}

/// Centroids of the four halves of the halves, then the corners.
constexpr std::array<glm::vec2, 7> points{{{1.0f / 6, 1.0f / 6},
                                           {4.0f / 6, 1.0f / 6},
                                           {1.0f / 6, 4.0f / 6},
                                           {1.0f / 3, 1.0f / 3},
                                           {0, 0},
                                           {1, 0},
                                           {0, 1}}};
constexpr size_t middles = 4;

/// Light that arrives on a patch, if nothing is in the way, lumen of colour 1; 0 where it varies
/// too much over the patch to be known from a few points.
double unhidden(const Source& source, const Patch& patch) {
    const double covered = double(patch.alpha);
    if (source.light.type == LightType::directional)
        return source.light.intensity * double(patch.area) * covered * source.frame.unit
               * source.frame.unit
               * std::abs(
                   glm::dot(glm::dvec3(patch.normal), glm::normalize(source.light.direction)));
    double least = HUGE_VAL, most = 0, sum = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        const double share = source.share(patch.at(points[i]));
        least = std::min(least, share);
        most = std::max(most, share);
        if (i < middles)
            sum += share / double(middles);
    }
    if (!(most - least <= 0.5 * sum))
        return 0;
    return source.light.intensity * covered * sum
           * solid_angle(glm::dvec3(patch.at({0, 0})) - source.position,
                         glm::dvec3(patch.at({1, 0})) - source.position,
                         glm::dvec3(patch.at({0, 1})) - source.position);
}

/// What partly transparent surfaces leave of the light on a side, in the mean.
double transmittance(const Source& source, const LitSurfaces& lit, uint32_t side) {
    const Patch& patch = lit.patches[side / 2];
    const glm::vec3 normal = normal_of(patch, side);
    const float across = 2.0f * glm::length(lit.visibility->hi() - lit.visibility->lo()) + 1.0f;
    double sum = 0;
    for (size_t i = 0; i < middles; ++i) {
        const glm::vec3 point = patch.at(points[i]), from = point + ray_offset(point) * normal;
        const glm::vec3 way = source.way_from(from, across);
        const float end = 1.0f - ray_offset(glm::vec3(source.position)) / glm::length(way);
        sum += double(lit.visibility->transmittance(
            {from, way, 0.0f, source.light.type == LightType::directional ? 1.0f : end}));
    }
    return sum / double(middles);
}

/// The flux of a side in closed form; 0 where the texels know better: where something hides a part
/// of it, and where it is too small or too steeply lit, as parts of patches are.
double closed_form(const Source& source, const LitSurfaces& lit, const SideFlux& seen, bool veils) {
    const Patch& patch = lit.patches[seen.side / 2];
    const bool part = seen.side / 2 >= lit.patches.size() - lit.cut_from.size();
    if (seen.edged || patch.crossed || part || !(seen.flux > 0.0))
        return 0;
    double exact = unhidden(source, patch);
    const double texels = seen.flux * exact / seen.squares; // that would fall on it
    if (!(texels >= 2.0))
        return 0;
    double passes = double(patch.alpha);
    if (veils) {
        const double left = transmittance(source, lit, seen.side);
        if (!(left > 0.0))
            return 0;
        exact *= left;
        passes *= left;
    }
    // Texels at the rim of the patch, and those that pass by chance, make the flux uncertain.
    const double rim = 0.15 * std::min(1.0, 3.5 / std::sqrt(texels));
    const double noise = 4.0 * std::sqrt((rim + (1.0 - passes) / passes) / texels);
    return seen.flux >= (1.0 - noise) * exact ? exact : 0;
}

double brightness_of(const Light& light) {
    return glm::dot(glm::dvec3(light.color), colour::rec709_luminance);
}

/// `weights`: what layers have of it.
void add_light(const Source& source, const LightMap& map, const LitSurfaces& lit, bool veils,
               std::span<const glm::vec3> weights, PunctualLight& result) {
    std::vector<double> exact(map.sides.size());
    tbb::parallel_for(size_t(0), exact.size(),
                      [&](size_t i) { exact[i] = closed_form(source, lit, map.sides[i], veils); });
    double seen = 0, known = 0;
    for (size_t i = 0; i < exact.size(); ++i)
        if (exact[i] > 0.0) {
            seen += map.sides[i].flux;
            known += exact[i];
        }
    const double factor = known > 0.0 ? seen / known : 1.0;
    const double square = source.frame.unit * source.frame.unit;
    const double brightness = brightness_of(source.light);
    result.landed += brightness * map.power.landed;
    result.lost += brightness * map.power.lost;
    for (size_t i = 0; i < exact.size(); ++i) {
        const SideFlux& side = map.sides[i];
        const Patch& patch = lit.patches[side.side / 2];
        const double flux = exact[i] > 0.0 ? factor * exact[i] : side.flux;
        const double share = flux / (double(patch.area) * double(patch.alpha) * square);
        // Exactly 1 where nothing was coloured.
        const glm::dvec3 tint = side.flux > 0.0 ? side.tinted / side.flux : glm::dvec3(1.0);
        const glm::vec3 lux = source.light.color * float(share) * glm::vec3(tint);
        result.lux[side.side] += lux;
        for (size_t layer = 0; layer < weights.size(); ++layer)
            result.layers[weights.size() * side.side + layer] += weights[layer] * lux;
    }
}

/// A light of intensity 1: what decides what it sees.
Light unit_light(Light light) {
    light.intensity = 1.0;
    return light;
}

/// What a light of intensity 1 sees, once patches are cut to it.
struct Sighting {
    double narrow = 0;             ///< flux on less than a quarter of a patch, before
    std::vector<NarrowLight> cuts; ///< by which they were cut
    LightMap map;

    /// Of the map what add_light() takes.
    void write(bool tinted, cache::Writer& out) const {
        std::vector<uint32_t> sides, edged;
        std::vector<double> numbers;
        for (const SideFlux& of : map.sides) {
            sides.push_back(of.side);
            edged.push_back(of.edged ? 1 : 0);
            numbers.insert(numbers.end(), {of.flux, of.squares});
            if (tinted)
                numbers.insert(numbers.end(), {of.tinted.x, of.tinted.y, of.tinted.z});
        }
        out.put(narrow);
        out.put(map.power);
        out.put(cuts);
        out.put(sides);
        out.put(edged);
        out.put(numbers);
    }

    bool read(bool tinted, cache::Reader& in) {
        std::vector<uint32_t> sides, edged;
        std::vector<double> numbers;
        const size_t own = tinted ? 5 : 2; // numbers of a side
        if (!in.get(narrow) || !in.get(map.power) || !in.get(cuts) || !in.get(sides)
            || !in.get(edged) || !in.get(numbers) || edged.size() != sides.size()
            || numbers.size() != own * sides.size())
            return false;
        map.sides.resize(sides.size());
        for (size_t i = 0; i < sides.size(); ++i) {
            const double* of = &numbers[own * i];
            SideFlux& side = map.sides[i];
            side.side = sides[i];
            side.edged = edged[i] != 0;
            side.flux = of[0];
            side.squares = of[1];
            side.tinted = tinted ? glm::dvec3(of[2], of[3], of[4]) : glm::dvec3(of[0]);
        }
        return true;
    }

    /// Of this many patches, before they are cut.
    bool cuts_fit(size_t patches) const {
        return std::ranges::all_of(cuts,
                                   [&](const NarrowLight& cut) { return cut.side / 2 < patches; });
    }
    /// And after.
    bool map_fits(size_t patches) const {
        return std::ranges::all_of(map.sides,
                                   [&](const SideFlux& side) { return side.side / 2 < patches; });
    }

    void scale(double intensity) {
        narrow *= intensity;
        for (double* power : {&map.power.sent, &map.power.landed, &map.power.missed,
                              &map.power.black, &map.power.lost})
            *power *= intensity;
        for (SideFlux& side : map.sides) {
            side.flux *= intensity;
            side.tinted *= intensity;
            side.squares *= intensity * intensity;
        }
    }
};

Sighting look(const Light& light, uint32_t key, LightMapper& mapper, LitSurfaces& lit) {
    Sighting seen;
    seen.map = mapper.draw(light, key);
    for (const SideFlux& side : seen.map.sides)
        if (is_within(side, mapper, 0.25))
            seen.narrow += side.flux;
    seen.cuts = find_narrow(seen.map, mapper);
    const size_t uncut = lit.cut_from.size();
    if (cut_to_light(seen.cuts, mapper, lit) > 0)
        seen.map = mapper.draw_again(light, key, seen.map, std::span(lit.cut_from).subspan(uncut));
    return seen;
}

/// The same, where it is kept from there.
Sighting look(const Light& light, uint32_t key, LightMapper& mapper, LitSurfaces& lit,
              Keeper* keeper) {
    if (!keeper || !*keeper)
        return look(light, key, mapper, lit);
    cache::Key kept = keeper->key("lamps");
    kept.add_text(keeper->cuts())
        .add(mapper.base(), key, light.type, light.position, light.direction, light.range,
             light.inner_cone, light.outer_cone);
    const bool tinted = lit.visibility->is_tinted();
    Sighting seen;
    bool there = keeper->cache().get(kept, [&](cache::Reader& in) {
        return seen.read(tinted, in) && seen.cuts_fit(lit.patches.size());
    });
    if (there) {
        cut_to_light(seen.cuts, mapper, lit);
        if (!seen.map_fits(lit.patches.size()))
            seen.map = mapper.draw(light, key);
    } else {
        seen = look(light, key, mapper, lit);
        keeper->cache().put(kept, [&](cache::Writer& out) { seen.write(tinted, out); });
    }
    keeper->add_cuts(seen.cuts);
    return seen;
}

/// Gives patches that another surface lies on, which rays may meet as well, what that has.
void share_light(const LitSurfaces& lit, PunctualLight& light) {
    tbb::parallel_for(size_t(0), light.lux.size(), [&](size_t i) {
        const Patch& patch = lit.patches[i / 2];
        if (patch.area > 0.0f || (i % 2 != 0 && !patch.double_sided))
            return;
        const glm::vec3 normal = normal_of(patch, uint32_t(i));
        const uint32_t seen = seen_at(lit, patch.position, normal);
        if (seen == LitSurfaces::no_side)
            return;
        light.lux[i] = light.lux[seen];
        for (size_t layer = 0; layer < light.layer_count; ++layer)
            light.layers[light.layer_count * i + layer] = light.of(seen, layer);
    });
}

} // namespace

void PunctualLight::follow(const LitSurfaces& lit) {
    if (lux.empty())
        return;
    const size_t uncut = lit.patches.size() - lit.cut_from.size();
    for (size_t i = lux.size() / 2; i < lit.patches.size(); ++i)
        for (const uint32_t side : {0u, 1u}) {
            const uint32_t from = 2 * lit.cut_from[i - uncut] + side;
            lux.push_back(lux[from]);
            for (size_t layer = 0; layer < layer_count; ++layer)
                layers.push_back(of(from, layer));
        }
}

PunctualLight illuminate(const Scene& scene, std::span<const Light> lights, LitSurfaces& lit,
                         const scene::Frame& frame, uint32_t key, Progress& progress,
                         std::span<const std::vector<glm::vec3>> weights, Keeper* keeper) {
    PunctualLight result;
    if (lights.empty())
        return result;
    result.lux.assign(2 * lit.patches.size(), glm::vec3(0.0f));
    result.layer_count = weights.size();
    result.layers.assign(weights.size() * result.lux.size(), glm::vec3(0.0f));
    std::vector<glm::vec3> of_light(weights.size());
    LightMapper mapper(scene, lit, frame, lights);
    for (size_t i = 0; i < lights.size(); ++i) {
        progress.advance(0);
        Sighting seen = look(unit_light(lights[i]), key + uint32_t(i), mapper, lit, keeper);
        seen.scale(lights[i].intensity);
        result.follow(lit);
        result.narrow += seen.narrow * brightness_of(lights[i]);
        result.power.push_back(seen.map.power);
        for (size_t layer = 0; layer < weights.size(); ++layer)
            of_light[layer] = weights[layer][i];
        add_light(Source(lights[i], frame), seen.map, lit, mapper.veiled(), of_light, result);
    }
    share_light(lit, result);
    return result;
}

} // namespace lpvbake::surface
