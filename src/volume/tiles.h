// A world in tiles: grids on one lattice, each of which is baked by itself.
#pragma once

#include "lpvbake/scene.h"

#include <glm/glm.hpp>

#include <span>
#include <string>
#include <vector>

namespace lpvbake::volume {

inline constexpr std::size_t most_tiles = 1'000'000;

/// Cells [begin, end) of the lattice whose cell 0 begins at the world's origin.
struct Tile {
    glm::ivec3 at; ///< which, in tiles; upwards from the lowest in its column
    glm::ivec3 begin, end;

    /// "x3_y0_z-2".
    std::string name() const;
    Bounds bounds(double cell) const { return {glm::dvec3(begin) * cell, glm::dvec3(end) * cell}; }
};

/// The tiles of `size` cells along an edge that have surfaces in these boxes, by z, y and x. Along
/// x and z they stand at multiples of their size; upwards from where the surfaces in their column
/// begin to where those end, at multiples of 8 cells. What lies elsewhere changes none of it.
/// Throws Error (argument): they are more than most_tiles, or the lattice is too fine for the
/// world.
std::vector<Tile> tiles_around(std::span<const Bounds> boxes, double cell, int size);

} // namespace lpvbake::volume
