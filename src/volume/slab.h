// Layers of a grid along z: the cells that a part of a bake solves.
#pragma once

#include "lpvbake/volume.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lpvbake::volume {

/// Layers [begin, end) along z. Their cells follow each other, since z runs slowest.
struct Slab {
    int begin = 0, end = 0;

    bool contains(int z) const { return z >= begin && z < end; }
    bool operator==(const Slab&) const = default;
};

/// All layers of a grid.
inline Slab all_of(const Grid& grid) {
    return {0, grid.dims.z};
}

/// The slab and `halo` layers on either side, as far as the grid goes.
inline Slab widened(Slab slab, int halo, const Grid& grid) {
    return {std::max(slab.begin - halo, 0), std::min(slab.end + halo, grid.dims.z)};
}

/// Index of the slab's first cell in the grid.
inline std::size_t first_of(Slab slab, const Grid& grid) {
    return grid.index({0, 0, slab.begin});
}

/// The lattice of its cells alone.
inline Grid grid_of(Slab slab, Grid grid) {
    if (slab != all_of(grid))
        grid.origin = grid.to_world({0, 0, slab.begin});
    grid.dims.z = slab.end - slab.begin;
    return grid;
}

/// Of values a cell of `from` leaves those of `slab`, which lies in it.
template <class T>
void cut(Slab from, Slab slab, const Grid& grid, std::vector<T>& values) {
    const auto at = [&](int z) {
        return values.begin() + std::ptrdiff_t(grid.index({0, 0, z}) - first_of(from, grid));
    };
    if (slab == from)
        return;
    values.erase(at(slab.end), values.end());
    values.erase(values.begin(), at(slab.begin));
    values.shrink_to_fit();
}

/// One of several that a grid is parted into, as even as whole units of layers allow.
struct Shard {
    int index = 1, count = 1; ///< from 1
    bool operator==(const Shard&) const = default;
};

/// How many there may be.
inline int most_shards(const Grid& grid, int unit) {
    return (grid.dims.z + unit - 1) / unit;
}

/// Its layers; there are no more shards than most_shards.
inline Slab slab_of(Shard shard, const Grid& grid, int unit) {
    const auto end_of = [&](int index) {
        const long units = long(most_shards(grid, unit)) * index / shard.count;
        return int(std::min(units * unit, long(grid.dims.z)));
    };
    return {end_of(shard.index - 1), end_of(shard.index)};
}

} // namespace lpvbake::volume
