// The order of a sweep: an octant's cells, front by front.
#pragma once

#include "solver/sn/first_flight.h"
#include "solver/sn/occupancy.h"
#include "solver/sn/sweep.h"
#include "volume/grid.h"

#include <cstdint>
#include <vector>

namespace lpvbake::solver::sn {

/// Cells that are swept by themselves: those of a grid from `begin` on. What enters from beside it
/// is given.
struct Tile {
    glm::ivec3 begin{0};
    Grid cells; ///< its own lattice, of which the dims count

    /// The cell of the whole grid, whose units the frame has.
    glm::ivec3 in_grid(glm::ivec3 cell) const { return begin + cell; }
};

/// The coordinates of an octant, along the way of its light.
struct Octant {
    const Tile& tile;
    const SweepLayout& layout;
    glm::ivec3 sign; ///< of the directions' x, y, z

    /// `number` is 0 to 7.
    Octant(const Tile& tile, const SweepLayout& layout, int number);

    /// The cell of the tile at (p, q, r); outside of it where these are.
    glm::ivec3 cell(int p, int q, int r) const;
    /// The cube of the whole grid's Occupancy upstream of a cell.
    glm::ivec3 cube(glm::ivec3 c) const { return tile.in_grid(c) + (1 - sign) / 2; }
};

struct Entry {
    uint32_t slot; ///< of the ring
    uint32_t cell; ///< of the tile
};
static_assert(sizeof(Entry) == 8);

/// Everything of an octant, front by front.
struct FrontOrder {
    std::vector<Entry> cells;     ///< of a front those that are given first
    std::vector<float> slots;     ///< of the cells, without their front's base
    std::vector<uint32_t> first;  ///< a front's first entry of `cells`; ends with their number
    std::vector<uint32_t> middle; ///< its first entry that is not given
    std::vector<SnPlace> given;   ///< cells beside surfaces, and places beside the grid
    std::vector<uint32_t> first_given;

    int fronts() const { return int(middle.size()); }
    /// Of the fronts [begin, end).
    uint32_t cells_of(int begin, int end) const {
        return first[size_t(end)] - first[size_t(begin)];
    }
    uint32_t given_of(int begin, int end) const {
        return first_given[size_t(end)] - first_given[size_t(begin)];
    }
};

/// Orders the cells of a front by the slab of `slab_layers` layers that they lie in, too. With
/// `boundary` places outside the tile, beside its upstream faces, are given.
FrontOrder order_fronts(const Octant& octant, const Occupancy& surfaces, bool boundary,
                        int slab_layers);

} // namespace lpvbake::solver::sn
