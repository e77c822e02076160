#include "medium/volume_light.h"

#include "mix_word.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::medium {
namespace {

/// A step, in texels: half a unit where a map of 2048 texels is 2500 units wide.
constexpr double fine_step = 0.5 * 2048 / 2500;
constexpr double most_steps = 8192; ///< of a ray; where that is not enough they are longer

/// Each texel of `make`'s, row by row at once.
template <class T, class Make>
Texture<T> filled(glm::ivec2 size, const Make& make) {
    Texture<T> texture(size);
    tbb::parallel_for(0, size.y, [&](int y) {
        for (int x = 0; x < size.x; ++x)
            texture[{x, y}] = make(glm::ivec2(x, y));
    });
    return texture;
}

glm::vec2 joined(glm::vec2 a, glm::vec2 b) {
    return {std::min(a.x, b.x), std::max(a.y, b.y)};
}

template <class Choose>
Texture<float> of_neighbours(const Texture<float>& texture, const Choose& choose) {
    return filled<float>(texture.size, [&](glm::ivec2 at) {
        float value = texture[at];
        for (int i = 0; i < 9; ++i)
            value = choose(value, texture.clamped(at + glm::ivec2(i % 3 - 1, i / 3 - 1)));
        return value;
    });
}

glm::ivec2 coarse_size(glm::ivec2 size) {
    return (size + coarseness - 1) / coarseness;
}

/// The pixel that a coarse texel looks at.
glm::ivec2 pixel_of(glm::ivec2 coarse, glm::ivec2 size) {
    return glm::min(coarseness * coarse + coarseness / 2, size - 1);
}

/// The mean of nine texels along an axis.
Texture<glm::dvec3> blurred_across(const Texture<glm::dvec3>& light, glm::ivec2 axis) {
    return filled<glm::dvec3>(light.size, [&](glm::ivec2 at) {
        glm::dvec3 sum(0.0);
        for (int i = -4; i <= 4; ++i)
            sum += light.clamped(at + i * axis);
        return sum / 9.0;
    });
}

} // namespace

Texture<glm::vec2> tiles_of(const Texture<float>& distances) {
    Texture<glm::vec2> level =
        filled<glm::vec2>(distances.size, [&](glm::ivec2 at) { return glm::vec2(distances[at]); });
    for (int edge = 1; edge < tile_edge; edge *= 2)
        level = filled<glm::vec2>(level.size / 2, [&](glm::ivec2 at) {
            return joined(joined(level[2 * at], level[2 * at + glm::ivec2(1, 0)]),
                          joined(level[2 * at + glm::ivec2(0, 1)], level[2 * at + 1]));
        });
    return level;
}

Texture<float> with_filled_holes(const Texture<glm::vec2>& tiles) {
    Texture<float> map = filled<float>(tiles.size, [&](glm::ivec2 at) { return tiles[at].x; });
    for (int i = 0; i < 3; ++i)
        map = of_neighbours(map, [](float a, float b) { return std::min(a, b); });
    for (int i = 0; i < 5; ++i)
        map = of_neighbours(map, [](float a, float b) { return std::max(a, b); });
    return map;
}

Texture<glm::dvec2> edges_of(const Texture<float>& picture_distances) {
    constexpr int weights[3][5] = {{3, 5, 0, -5, -3}, {2, 3, 0, -3, -2}, {1, 2, 0, -2, -1}};
    constexpr double all = 24; // of those on one side
    return filled<glm::dvec2>(coarse_size(picture_distances.size), [&](glm::ivec2 at) {
        const glm::ivec2 pixel = pixel_of(at, picture_distances.size);
        glm::dvec2 gradient(0.0);
        for (int y = -2; y <= 2; ++y)
            for (int x = -2; x <= 2; ++x) {
                const double there =
                    double(picture_distances.clamped(pixel + coarseness / 2 * glm::ivec2(x, y)));
                gradient -=
                    there * glm::dvec2(weights[std::abs(y)][x + 2], weights[std::abs(x)][y + 2]);
            }
        const double here = double(picture_distances[pixel]);
        if (!(here > 0))
            return glm::dvec2(0.0);
        const glm::dvec2 along = glm::dvec2(-gradient.y, gradient.x) / (all * here);
        return along / std::max(1.0, glm::length(along));
    });
}

Texture<glm::dvec3> blurred_along(const Texture<glm::dvec2>& edges,
                                  const Texture<glm::dvec3>& light) {
    return filled<glm::dvec3>(light.size, [&](glm::ivec2 at) {
        if (edges[at] == glm::dvec2(0.0))
            return light[at];
        glm::dvec3 sum(0.0);
        for (int i = -7; i <= 7; ++i)
            sum += light.between(glm::dvec2(at) + 0.5 + double(i) * edges[at]);
        return sum / 15.0;
    });
}

Texture<glm::dvec3> blurred(const Texture<glm::dvec3>& light) {
    return blurred_across(blurred_across(light, {1, 0}), {0, 1});
}

VolumeLight::VolumeLight(const Scene& scene, const visibility::Visibility& visibility,
                         const scene::Frame& frame, bool with_statics, const Medium& medium,
                         const VolumeLightSettings& settings)
    : air_(medium, frame),
      settings_(settings) {
    for (const Light& light : scene.lights) {
        if (light.type != LightType::directional || (light.is_static && !with_statics))
            continue;
        Sun& sun = suns_.emplace_back();
        sun.power = light.intensity * glm::dvec3(light.color);
        sun.direction = glm::normalize(light.direction);
        for (const scene::RsmView& view :
             views_into(light, visibility, frame, air_.lo(), air_.hi())) {
            sun.open = false;
            sun.view = view;
            sun.distances = Texture<float>(glm::ivec2(settings.map_size));
            sun.distances.texels = depths_of(view, visibility, settings.map_size);
            sun.tiles = tiles_of(sun.distances);
            if (settings.boost != 0)
                sun.filled = with_filled_holes(sun.tiles);
        }
    }
}

glm::dvec3 VolumeLight::Sun::place(glm::dvec3 point) const {
    const glm::dvec3 from = point - view.origin;
    const glm::dvec2 at(glm::dot(from, view.u) / glm::dot(view.u, view.u),
                        glm::dot(from, view.v) / glm::dot(view.v, view.v));
    return {0.5 * (at + 1.0) * glm::dvec2(distances.size), glm::dot(from, view.axis)};
}

glm::dvec3 VolumeLight::march(const Sun& sun, const MediumInFrame::Part& part, double jitter,
                              StepCount& steps) const {
    const double length = part.end - part.begin;
    const double texel_edge =
        2 * std::sqrt(glm::length(sun.view.u) * glm::length(sun.view.v)) / settings_.map_size;
    const double step = sun.open ? length : std::max(fine_step * texel_edge, length / most_steps);
    const glm::dvec3 first = sun.open ? glm::dvec3(0.0) : sun.place(part.at(part.begin));
    const glm::dvec3 along =
        sun.open ? glm::dvec3(0.0) : sun.place(part.at(part.begin + step)) - first;
    const double count = std::ceil(length / step);
    const double across = glm::length(glm::dvec2(along));
    const double coarse =
        !settings_.long_steps ? 1.0 : std::clamp(std::floor(tile_edge / across), 1.0, count);
    glm::dvec3 sum(0.0);
    double before = 0, taken = 1;
    for (double i = 0; i < count; i += taken) {
        const glm::dvec3 at = first + (i + jitter) * along;
        const glm::ivec2 texel(glm::floor(glm::dvec2(at)));
        bool is_lit = true, is_even = true;
        double times = 1;
        if (!sun.open && glm::all(glm::greaterThanEqual(texel, glm::ivec2(0)))
            && glm::all(glm::lessThan(texel, sun.distances.size))) {
            const glm::vec2 tile = sun.tiles[texel / tile_edge];
            const double later = at.z + coarse * along.z;
            is_lit = at.z < double(sun.distances[texel]);
            is_even =
                std::max(at.z, later) < double(tile.x) || std::min(at.z, later) > double(tile.y);
            if (settings_.boost != 0 && at.z > double(sun.filled[texel / tile_edge]))
                times += settings_.boost;
        }
        taken = is_even ? coarse : 1;
        ++steps.all;
        steps.coarse += is_even && coarse > 1;
        const double from = part.begin + i * step, to = std::min(from + taken * step, part.end);
        const double own = air_.column(part.at(from), part.at(to));
        if (is_lit && own > 0)
            sum += times * air_.step_weight(before, own)
                   * glm::exp(-air_.extinction()
                              * air_.column_before(part.at(0.5 * (from + to)), sun.direction));
        before += own;
    }
    return phase(air_.medium().g, -glm::dot(sun.direction, part.direction)) * sun.power * sum;
}

glm::dvec3 VolumeLight::march(glm::dvec3 origin, glm::dvec3 direction, double distance,
                              double jitter, StepCount& steps) const {
    glm::dvec3 sum(0.0);
    if (const auto part = air_.part_in(origin, direction, distance))
        for (const Sun& sun : suns_)
            sum += march(sun, *part, jitter, steps);
    return air_.scatter() * sum;
}

Texture<glm::dvec3> VolumeLight::scattered(const scene::RsmView& eye,
                                           const Texture<float>& distances,
                                           StepCount& steps) const {
    const auto along = [&](glm::ivec2 pixel) {
        return glm::normalize(
            eye.along(2.0 * (glm::dvec2(pixel) + 0.5) / glm::dvec2(distances.size) - 1.0));
    };
    const auto end_of = [&](glm::ivec2 pixel) { // where there is nothing, of the air
        const auto part = air_.part_in(eye.origin, along(pixel), double(distances[pixel]));
        return std::isfinite(distances[pixel]) ? distances[pixel] : part ? float(part->end) : 0.0f;
    };
    const glm::ivec2 size = coarse_size(distances.size);
    Texture<StepCount> counts(size, {});
    const Texture<glm::dvec3> light = filled<glm::dvec3>(size, [&](glm::ivec2 at) {
        const glm::ivec2 pixel = pixel_of(at, distances.size);
        const double jitter =
            double(mix_word(uint32_t(at.y) * 65536u + uint32_t(at.x)) >> 8) * 0x1p-24;
        return march(eye.origin, along(pixel), double(distances[pixel]), jitter, counts[at]);
    });
    for (const StepCount& count : counts.texels) {
        steps.all += count.all;
        steps.coarse += count.coarse;
    }
    const Texture<float> ends = filled<float>(distances.size, end_of);
    return blurred(blurred_along(edges_of(ends), light));
}

} // namespace lpvbake::medium
