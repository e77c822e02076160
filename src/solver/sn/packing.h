// What the kernels of the sweep read, as the host lays it out.
#pragma once

#include "solver/sn/first_flight.h"
#include "solver/sn/planes.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::solver::sn {

/// The directions of a batch, for the kernels: index 4 * i + quadrant, where i counts those of a
/// quadrant. Fewer than the stride: the rest is padding.
struct Directions {
    Travel travel;                ///< world axes
    std::vector<glm::vec4> table; ///< direction_vec4s each
    std::vector<float> weights;   ///< of the coefficients
    std::vector<glm::vec4> air;   ///< air_direction_vec4s each

    size_t count() const { return travel.all.size(); }
    glm::vec3 along(size_t index) const {
        return travel.all[index % quadrants * travel.of_each() + index / quadrants];
    }
};

/// Those of octant (+, +, +) that a course takes into each of its quadrants.
std::vector<glm::dvec3> of_course(const Course& course, std::span<const glm::dvec3> positive);

/// Of such directions, at most a quarter of `stride`; `total` is the number over the sphere.
Directions direction_table(const Course& course, std::span<const glm::dvec3> positive,
                           uint32_t stride, int total, int order);

/// The luminance that every slot starts with, a texel a direction: the sky's, which is read before
/// it is written where a slot's place lies outside the grid.
std::vector<glm::vec4> luminance_beyond(const SnLight& light, const Directions& directions,
                                        uint32_t stride);

/// Some planes of a course: [begin, end).
struct Chunk {
    int begin = 0, end = 0;
    std::vector<uint32_t> given_slots; ///< SnPlace::entry of what is given
    /// Its luminance, nits: [given * stride / 4 + direction of its quadrant].
    std::vector<glm::vec4> given;
    /// air_vec4s of each cell for each quadrant; empty where there is none.
    std::vector<glm::vec4> air;

    int first_of_cells() const { return std::max(begin, 1); } ///< plane
};

/// Of a cell in air whose source has so many coefficients.
constexpr uint32_t air_vec4s(uint32_t coefficients) {
    return 1 + sh_vec4s(coefficients);
}

/// Takes the planes from `begin` on that fit `bytes` in each of the lists, one at least; where
/// cells are in air, with so many vec4s each.
void choose_planes(const Course& course, const PlaneOrder& order, uint32_t stride, uint64_t bytes,
                   uint32_t air_vec4s, int begin, Chunk& chunk);

/// Lists what the air is on the way into the chunk's cells, in its middle for the mean of a
/// quadrant's directions, with so many coefficients of its source.
void pack_air(const Course& course, const Directions& directions, const visibility::Air& air,
              uint32_t coefficients, Chunk& chunk);

/// Finds the luminance of what is given there; and what rays met, unless `sights` is null.
void trace_given(const PlaneOrder& order, const SnLight& light, const Directions& directions,
                 uint32_t stride, Chunk& chunk, Sights* sights = nullptr);
/// The same in another light, by what they met.
void recall_given(const PlaneOrder& order, const SnLight& light, const Directions& directions,
                  uint32_t stride, const Sights& sights, Chunk& chunk);

} // namespace lpvbake::solver::sn
