// Directions that a sweep follows.
#pragma once

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::solver::sn {

/// Of the largest set.
inline constexpr uint64_t most_directions = 384;

/// How many directions a set may have, rising.
std::span<const int> sn_direction_counts();

/// The smallest set that has at least `wanted` directions; the largest if none has.
int sn_direction_count(int wanted);

/// The (x, y) of the directions with x > y > z > 0 of the set of `count`, which must be one of
/// sn_direction_counts(). With all permutations and signs they make up the set: 48 each, all of
/// weight 4 pi / count. The mean of a spherical harmonic of band 1 to sn_exact_band(count) over the
/// set is 0, as over the sphere.
std::span<const glm::dvec2> sn_base_directions(int count);
int sn_exact_band(int count);

/// The unit directions of octant (+, +, +), a permutation of each base direction after the other.
std::vector<glm::dvec3> sn_octant_directions(int count);

} // namespace lpvbake::solver::sn
