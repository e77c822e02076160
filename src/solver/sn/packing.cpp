#include "solver/sn/packing.h"

#include "scene/sky.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace lpvbake::solver::sn {

std::vector<glm::dvec3> of_course(const Course& course, std::span<const glm::dvec3> positive) {
    std::vector<glm::dvec3> own;
    std::ranges::copy_if(positive, std::back_inserter(own), [&](const glm::dvec3& d) {
        return d[course.axis] > std::max(d[course.u], d[course.v]);
    });
    return own;
}

Directions direction_table(const Course& course, std::span<const glm::dvec3> positive,
                           uint32_t stride, int total, int order) {
    const size_t coefficients = size_t(volume::sh_count(order));
    Directions directions;
    directions.travel.all.resize(quadrants * positive.size());
    directions.table.assign(stride * direction_vec4s, glm::vec4(0.0f));
    directions.weights.assign(stride * coefficients, 0.0f);
    directions.air.assign(stride * air_direction_vec4s, glm::vec4(0.0f));
    for (size_t i = 0; i < directions.travel.all.size(); ++i) {
        const size_t quadrant = i % quadrants;
        const glm::dvec3 d = positive[i / quadrants];
        const glm::ivec3 signs = course.signs(int(quadrant));
        const double du = d[course.u] / d[course.axis], dv = d[course.v] / d[course.axis];
        const float back_u = float(signs[course.u]);
        const float back_v = float(signs[course.v]) * float(course.layout.pitch());
        glm::vec4* row = &directions.table[direction_vec4s * i];
        row[0] = glm::dvec4((1 - du) * (1 - dv), du * (1 - dv), (1 - du) * dv, du * dv);
        row[1] = {0.0f, back_u, back_v, back_u + back_v}; // exact: fewer than 2^24
        const glm::vec3 travel(d * glm::dvec3(signs));
        directions.travel.all[quadrant * positive.size() + i / quadrants] = travel;
        const volume::ShValues basis = volume::sh_basis(order, -travel);
        for (size_t k = 0; k < coefficients; ++k)
            directions.weights[coefficients * i + k] =
                float(4.0 * glm::pi<double>() / total * double(basis[k]));
        const volume::ShValues seen = volume::sh_basis(2, -travel);
        for (uint32_t k = 0; k < 9; ++k)
            directions.air[air_direction_vec4s * i + k / 4][int(k % 4)] = seen[k];
        directions.air[air_direction_vec4s * i + 3].x = float(1.0 / d[course.axis]);
    }
    return directions;
}

std::vector<glm::vec4> luminance_beyond(const SnLight& light, const Directions& directions,
                                        uint32_t stride) {
    std::vector<glm::vec4> luminance(stride, glm::vec4(0.0f));
    if (light.part == LightPart::surfaces)
        for (size_t d = 0; d < directions.count(); ++d)
            luminance[d] = glm::vec4(
                light.luminance({Sight::sky, glm::vec3(1.0f)}, -directions.along(d)), 0.0f);
    return luminance;
}

void choose_planes(const Course& course, const PlaneOrder& order, uint32_t stride, uint64_t bytes,
                   uint32_t air_vec4s, int begin, Chunk& chunk) {
    const uint64_t of_plane =
        uint64_t(course.layout.cells()) * quadrants * air_vec4s * sizeof(glm::vec4);
    const uint64_t of_given = stride / quadrants * sizeof(glm::vec4);
    const auto fits = [&](int end) {
        return uint64_t(end - begin) * of_plane <= bytes
               && order.given_of(begin, end) * of_given <= bytes;
    };
    chunk.begin = begin;
    chunk.end = begin + 1;
    while (chunk.end < order.planes() && fits(chunk.end + 1))
        ++chunk.end;
}

void pack_air(const Course& course, const Directions& directions, const visibility::Air& air,
              uint32_t coefficients, Chunk& chunk) {
    const glm::ivec3 n = course.layout.dims;
    const size_t vec4s = air_vec4s(coefficients);
    const int first = chunk.first_of_cells(), rows = std::max(chunk.end - first, 0) * n.y;
    std::array<glm::vec3, quadrants> half{};
    const size_t of_each = directions.travel.of_each();
    for (size_t i = 0; i < directions.count(); ++i) {
        const glm::vec3 travel = directions.travel.all[i];
        half[i / of_each] += travel * (0.5f / (std::abs(travel[course.axis]) * float(of_each)));
    }
    chunk.air.assign(size_t(rows) * size_t(n.x) * quadrants * vec4s, glm::vec4(0.0f));
    tbb::parallel_for(0, rows, [&](int row_of_chunk) {
        const int plane = first + row_of_chunk / n.y, v = row_of_chunk % n.y;
        glm::vec4* row = &chunk.air[size_t(row_of_chunk) * size_t(n.x) * quadrants * vec4s];
        for (int u = 0; u < n.x; ++u)
            for (uint32_t quadrant = 0; quadrant < quadrants; ++quadrant, row += vec4s) {
                const glm::ivec3 cell = course.tile.in_grid(course.cell(u, v, plane));
                const visibility::Air::Place place =
                    air.at(glm::vec3(cell) + 0.5f - half[quadrant]);
                row[0] = place.density * glm::vec4(air.extinction(), 1.0f);
                for (uint32_t k = 0; k < 3 * coefficients; ++k)
                    row[1 + k / 4][int(k % 4)] = place.source[k / 3][int(k % 3)];
            }
    });
}

namespace {

/// Room for what is given in a chunk; zero where places have no direction.
void begin_given(const PlaneOrder& order, size_t directions, size_t stride, Chunk& chunk) {
    const size_t count = order.given_of(chunk.begin, chunk.end);
    chunk.given_slots.resize(count);
    for (size_t i = 0; i < count; ++i)
        chunk.given_slots[i] = order.given[order.first_of(chunk.begin) + i].entry;
    chunk.given.resize(count * stride);
    if (directions < stride)
        std::ranges::fill(chunk.given, glm::vec4(0.0f));
}

/// The first of some places each, up to eight of one quadrant; ends with the last of all.
std::vector<uint32_t> eights_of(const PlaneOrder& order, const Chunk& chunk) {
    std::vector<uint32_t> eights;
    for (size_t group = quadrants * size_t(chunk.begin); group < quadrants * size_t(chunk.end);
         ++group)
        for (uint32_t i = order.first[group]; i < order.first[group + 1]; i += 8)
            eights.push_back(i);
    eights.push_back(order.first_of(chunk.end));
    return eights;
}

} // namespace

void trace_given(const PlaneOrder& order, const SnLight& light, const Directions& directions,
                 uint32_t stride, Chunk& chunk, Sights* sights) {
    const size_t of_each = stride / quadrants, own = directions.travel.of_each();
    begin_given(order, own, of_each, chunk);
    if (sights) {
        sights->sides.assign(chunk.given.size(), surface::LitSurfaces::no_side);
        if (light.visibility.is_tinted())
            sights->tints.assign(chunk.given.size(), glm::vec3(1.0f));
    }
    const std::span<const SnPlace> all(order.given);
    const uint32_t first = order.first_of(chunk.begin);
    const std::vector<uint32_t> eights = eights_of(order, chunk);
    // Of a caster as many as it is best asked at a time.
    const size_t step =
        std::max<size_t>(1, light.visibility.batch() / std::max<size_t>(8 * own, 1));
    tbb::parallel_for(size_t(0), (eights.size() - 1 + step - 1) / step, [&](size_t i) {
        const uint32_t from = eights[i * step];
        const uint32_t some = eights[std::min((i + 1) * step, eights.size() - 1)] - from;
        const size_t at = size_t(from - first) * of_each;
        trace_arriving(light, all.subspan(from, some), directions.travel, of_each,
                       std::span(chunk.given).subspan(at), sights, at);
    });
}

void recall_given(const PlaneOrder& order, const SnLight& light, const Directions& directions,
                  uint32_t stride, const Sights& sights, Chunk& chunk) {
    const size_t of_each = stride / quadrants;
    begin_given(order, directions.travel.of_each(), of_each, chunk);
    const uint32_t first = order.first_of(chunk.begin);
    tbb::parallel_for(size_t(0), chunk.given_slots.size(), [&](size_t i) {
        const std::span<const glm::vec3> travel = directions.travel.of(order.given[first + i]);
        for (size_t d = 0; d < travel.size(); ++d) {
            const size_t at = i * of_each + d;
            chunk.given[at] = glm::vec4(light.luminance(sights[at], -travel[d]), 0.0f);
        }
    });
}

} // namespace lpvbake::solver::sn
