// What the kernels of the sweep read, as the host lays it out.
#pragma once

#include "solver/sn/first_flight.h"
#include "solver/sn/fronts.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::solver::sn {

/// The directions of a batch, for the kernels.
struct Directions {
    std::vector<glm::vec3> travel; ///< unit, world axes; fewer than the stride: the rest is padding
    std::vector<glm::vec4> table;  ///< direction_vec4s each
    std::vector<float> weights;    ///< of the coefficients
    std::vector<glm::vec4> air;    ///< air_direction_vec4s each
};

/// Of directions in octant (+, +, +), at most `stride`; `total` is the number over the sphere.
Directions direction_table(const Octant& octant, std::span<const glm::dvec3> positive,
                           uint32_t stride, int total, int order);

/// The luminance that every slot of the ring starts with, a texel a direction: the sky's, which is
/// read before it is written where a slot's place lies outside the grid.
std::vector<glm::vec4> luminance_beyond(const SnLight& light, const Directions& directions,
                                        uint32_t stride);

/// Some fronts of an octant: [begin, end).
struct Chunk {
    int begin = 0, end = 0;
    std::vector<uint32_t> given_slots; ///< of what is given
    std::vector<glm::vec4> given;      ///< its luminance, nits: [given * stride + direction]
    std::vector<glm::vec4> air;        ///< air_vec4s of each cell; empty where there is none
};

/// Of a cell in air whose source has so many coefficients.
constexpr uint32_t air_vec4s(uint32_t coefficients) {
    return 1 + sh_vec4s(coefficients);
}

/// Takes the fronts from `begin` on that fit `bytes` in each of the lists, one at least; where
/// cells are in air, with so many vec4s each.
void choose_fronts(const FrontOrder& order, uint32_t stride, uint64_t bytes, uint32_t air_vec4s,
                   int begin, Chunk& chunk);

/// Lists what the air is on the way into the chunk's cells, in its middle for the mean of the
/// directions, with so many coefficients of its source.
void pack_air(const FrontOrder& order, const Tile& tile, const Directions& directions,
              const visibility::Air& air, uint32_t coefficients, Chunk& chunk);

/// Finds the luminance of what is given there; and what rays met, unless `sights` is null.
void trace_given(const FrontOrder& order, const SnLight& light, const Directions& directions,
                 uint32_t stride, Chunk& chunk, Sights* sights = nullptr);
/// The same in another light, by what they met.
void recall_given(const FrontOrder& order, const SnLight& light, const Directions& directions,
                  uint32_t stride, const Sights& sights, Chunk& chunk);

} // namespace lpvbake::solver::sn
