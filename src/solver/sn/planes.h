// The order of a sweep: plane by plane of cells, and what is given in each.
#pragma once

#include "solver/sn/first_flight.h"
#include "solver/sn/occupancy.h"
#include "solver/sn/sweep.h"
#include "visibility/visibility.h"
#include "volume/grid.h"

#include <cstdint>
#include <span>
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

/// The directions that go farther along one axis, one way, than along the others: a sixth of all,
/// in four quadrants by which way they go along those.
struct Course {
    static constexpr int count = 6;

    const Tile& tile;
    int axis; ///< of the grid, 0 to 2
    int sign; ///< of the way along it, 1 or -1
    int u, v; ///< the other axes, u < v
    SweepLayout layout;

    /// `number` is 0 to 5.
    Course(const Tile& tile, int number);

    /// The signs of the directions' x, y and z in a quadrant.
    glm::ivec3 signs(int quadrant) const;
    /// The cell of the tile at (u, v) in a plane, of which 0 lies before the tile; outside of it
    /// where these are.
    glm::ivec3 cell(int at_u, int at_v, int plane) const;
    int plane_of(glm::ivec3 cell) const;
};

/// A cell beside surfaces.
struct NearCell {
    glm::ivec3 cell; ///< of the tile
    glm::vec3 point; ///< where its light is taken, in units of the grid
    /// Bit x + 2 y + 4 z: a surface is upstream for directions along -x, -y, -z where these are 1.
    uint8_t octants;
};

/// Of the cells of the whole grid that are in `feeding`, in the order of the tile's cells. Others
/// take what surfaces would stop, which goes nowhere.
std::vector<NearCell> find_near(const Tile& tile, const Occupancy& surfaces,
                                const std::vector<uint8_t>& feeding,
                                const visibility::Visibility& visibility);

/// What is given along a course: cells beside surfaces, and places beside the tile.
struct PlaneOrder {
    std::vector<SnPlace> given;  ///< plane by plane, in it by quadrant, and in that by slot
    std::vector<uint32_t> first; ///< [4 * plane + quadrant]; ends with their number

    int planes() const { return int(first.size() / quadrants); }
    uint32_t first_of(int plane) const { return first[quadrants * size_t(plane)]; }
    /// Of the planes [begin, end).
    uint32_t given_of(int begin, int end) const { return first_of(end) - first_of(begin); }
};

/// With `boundary` places outside the tile that light enters from are given.
PlaneOrder order_planes(const Course& course, std::span<const NearCell> near, bool boundary,
                        const visibility::Visibility& visibility);

} // namespace lpvbake::solver::sn
