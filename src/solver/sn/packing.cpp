#include "solver/sn/packing.h"

#include "scene/sky.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::sn {

Directions direction_table(const Octant& octant, std::span<const glm::dvec3> positive,
                           uint32_t stride, int total, int order) {
    const SweepLayout& layout = octant.layout;
    const size_t coefficients = size_t(volume::sh_count(order));
    const uint32_t back[] = {1, layout.pitch(), 0};
    Directions directions;
    directions.table.assign(stride * direction_vec4s, glm::vec4(0.0f));
    directions.weights.assign(stride * coefficients, 0.0f);
    directions.air.assign(stride * air_direction_vec4s, glm::vec4(0.0f));
    for (size_t i = 0; i < positive.size(); ++i) {
        const glm::dvec3 d = positive[i];
        const int along = d.x > d.y ? d.x > d.z ? 0 : 2 : d.y > d.z ? 1 : 2;
        const int u = (along + 1) % 3, v = (along + 2) % 3;
        const double du = d[u] / d[along], dv = d[v] / d[along];
        const glm::uvec4 slots{back[along], back[along] + back[u], back[along] + back[v],
                               back[along] + back[u] + back[v]};
        glm::vec4* row = &directions.table[direction_vec4s * i];
        row[0] = glm::dvec4((1 - du) * (1 - dv), du * (1 - dv), (1 - du) * dv, du * dv);
        row[1] = glm::vec4(slots); // exact: fewer than 2^24
        glm::vec3 travel;
        for (int a = 0; a < 3; ++a)
            travel[layout.axes[a]] = float(d[a] * octant.sign[layout.axes[a]]);
        directions.travel.push_back(travel);
        const volume::ShValues basis = volume::sh_basis(order, -travel);
        for (size_t k = 0; k < coefficients; ++k)
            directions.weights[coefficients * i + k] =
                float(4.0 * glm::pi<double>() / total * double(basis[k]));
        const volume::ShValues seen = volume::sh_basis(2, -travel);
        for (uint32_t k = 0; k < 9; ++k)
            directions.air[air_direction_vec4s * i + k / 4][int(k % 4)] = seen[k];
        directions.air[air_direction_vec4s * i + 3].x = float(1.0 / d[along]);
    }
    return directions;
}

std::vector<glm::vec4> luminance_beyond(const SnLight& light, const Directions& directions,
                                        uint32_t stride) {
    std::vector<glm::vec4> luminance(stride, glm::vec4(0.0f));
    if (light.part == LightPart::surfaces)
        for (size_t d = 0; d < directions.travel.size(); ++d)
            luminance[d] = glm::vec4(
                light.luminance({Sight::sky, glm::vec3(1.0f)}, -directions.travel[d]), 0.0f);
    return luminance;
}

void choose_fronts(const FrontOrder& order, uint32_t stride, uint64_t bytes, uint32_t air_vec4s,
                   int begin, Chunk& chunk) {
    const uint64_t of_cell = std::max(sizeof(Entry), air_vec4s * sizeof(glm::vec4));
    const auto fits = [&](int end) {
        return order.cells_of(begin, end) * of_cell <= bytes
               && uint64_t(order.given_of(begin, end)) * stride * sizeof(glm::vec4) <= bytes;
    };
    chunk.begin = begin;
    chunk.end = begin + 1;
    while (chunk.end < order.fronts() && fits(chunk.end + 1))
        ++chunk.end;
}

void pack_air(const FrontOrder& order, const Tile& tile, const Directions& directions,
              const visibility::Air& air, uint32_t coefficients, Chunk& chunk) {
    glm::vec3 half(0.0f);
    for (const glm::vec3 travel : directions.travel) {
        const glm::vec3 size = glm::abs(travel);
        half += travel * (0.5f / std::max({size.x, size.y, size.z}));
    }
    half /= float(directions.travel.size());
    const uint32_t first = order.first[size_t(chunk.begin)];
    const size_t count = order.cells_of(chunk.begin, chunk.end);
    const size_t vec4s = air_vec4s(coefficients);
    chunk.air.assign(count * vec4s, glm::vec4(0.0f));
    tbb::parallel_for(size_t(0), count, [&](size_t i) {
        const glm::ivec3 cell = tile.in_grid(tile.cells.cell_at(order.cells[first + i].cell));
        const glm::vec3 centre = glm::vec3(cell) + 0.5f;
        const visibility::Air::Place place = air.at(centre - half);
        glm::vec4* const row = &chunk.air[i * vec4s];
        row[0] = place.density * glm::vec4(air.extinction(), 1.0f);
        for (uint32_t k = 0; k < 3 * coefficients; ++k)
            row[1 + k / 4][int(k % 4)] = place.source[k / 3][int(k % 3)];
    });
}

namespace {

/// Zero where places have no direction.
void pad(const Directions& directions, uint32_t stride, std::span<glm::vec4> luminance) {
    for (size_t i = 0; i < luminance.size(); i += stride)
        std::ranges::fill(luminance.subspan(i, stride).subspan(directions.travel.size()),
                          glm::vec4(0.0f));
}

} // namespace

void trace_given(const FrontOrder& order, const SnLight& light, const Directions& directions,
                 uint32_t stride, Chunk& chunk, Sights* sights) {
    const uint32_t first = order.first_given[size_t(chunk.begin)];
    const uint32_t count = order.given_of(chunk.begin, chunk.end);
    chunk.given_slots.resize(count);
    std::vector<uint32_t> eights; // of places of a front
    for (int f = chunk.begin; f < chunk.end; ++f)
        for (uint32_t i = order.first_given[size_t(f)]; i < order.first_given[size_t(f + 1)];
             i += 8)
            eights.push_back(i);
    eights.push_back(order.first_given[size_t(chunk.end)]);
    chunk.given.resize(size_t(count) * stride);
    if (sights) {
        sights->sides.assign(chunk.given.size(), surface::LitSurfaces::no_side);
        if (light.visibility.is_tinted())
            sights->tints.assign(chunk.given.size(), glm::vec3(1.0f));
    }
    const std::span<const SnPlace> all(order.given);
    // Of a caster as many as it is best asked at a time.
    const size_t step = std::max<size_t>(
        1, light.visibility.batch() / std::max<size_t>(8 * directions.travel.size(), 1));
    tbb::parallel_for(size_t(0), (eights.size() - 1 + step - 1) / step, [&](size_t i) {
        const uint32_t from = eights[i * step];
        const uint32_t some = eights[std::min((i + 1) * step, eights.size() - 1)] - from;
        for (uint32_t k = from; k < from + some; ++k)
            chunk.given_slots[k - first] = all[k].slot;
        const size_t at = size_t(from - first) * stride;
        pad(directions, stride, std::span(chunk.given).subspan(at, some * stride));
        trace_arriving(light, all.subspan(from, some), directions.travel, stride,
                       std::span(chunk.given).subspan(at), sights, at);
    });
}

void recall_given(const FrontOrder& order, const SnLight& light, const Directions& directions,
                  uint32_t stride, const Sights& sights, Chunk& chunk) {
    const uint32_t first = order.first_given[size_t(chunk.begin)];
    const uint32_t count = order.given_of(chunk.begin, chunk.end);
    chunk.given_slots.resize(count);
    chunk.given.resize(size_t(count) * stride);
    tbb::parallel_for(size_t(0), size_t(count), [&](size_t i) {
        chunk.given_slots[i] = order.given[first + i].slot;
        pad(directions, stride, std::span(chunk.given).subspan(i * stride, stride));
        for (size_t d = 0; d < directions.travel.size(); ++d) {
            const size_t at = i * stride + d;
            chunk.given[at] = glm::vec4(light.luminance(sights[at], -directions.travel[d]), 0.0f);
        }
    });
}

} // namespace lpvbake::solver::sn
