// Which cells are solved, and which are interpolated between those (Greger et al. 1998).
#pragma once

#include "solver/gather/cell_zone.h"
#include "volume/slab.h"
#include "volume/volume.h"

#include <cstdint>
#include <vector>

namespace lpvbake::solver::gather {

/// Edge of the boxes whose corners are solved first, cells.
inline constexpr int coarse_edge = 4;

/// Where a cell's light comes from.
enum class CellState : uint8_t {
    open,
    between_4, ///< interpolated over a box of this edge
    between_2,
    wanted,
    solved,
};

/// A box of cells from lo to hi, both included.
struct CellBox {
    glm::ivec3 lo, hi;

    glm::ivec3 corner(size_t i) const {
        return {i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z};
    }
};

/// The state of all cells of a slab of a grid.
class AdaptiveGrid {
public:
    /// The arguments outlive it; `tolerance` as GatherSettings has it. The volume has the validity
    /// of the whole grid, and the light of the slab, which begins at a multiple of coarse_edge.
    AdaptiveGrid(const Volume& volume, volume::Slab slab, const Occupied& occupied,
                 float tolerance);

    std::vector<CellState> state; ///< by index()

    /// Of a cell of the grid, in `state` and in the volume's light.
    size_t index(glm::ivec3 cell) const { return grid_.index(cell) - first_; }
    CellBox all() const {
        return {{0, 0, slab_.begin}, {grid_.dims.x - 1, grid_.dims.y - 1, slab_.end - 1}};
    }
    /// Wants the valid cells of a box at multiples of `step` and at its corners, in `layers` alone.
    void want(const CellBox& box, int step, volume::Slab layers);
    /// Of all boxes of `edge`: leaves those that are smooth to interpolation, returns the others.
    std::vector<CellBox> leave_smooth(int edge);
    /// The same of the halves, of `edge`, of boxes.
    std::vector<CellBox> leave_smooth_halves(const std::vector<CellBox>& boxes, int edge);
    /// Interpolates the cells of some layers that are left to it, from the corners of their boxes.
    void interpolate(volume::Slab layers, Volume& volume) const;
    uint64_t interpolated(volume::Slab layers) const; ///< cells

private:
    CellBox box_around(glm::ivec3 cell, int edge) const;
    void leave(const CellBox& box, int edge);
    bool smooth(const CellBox& box, int edge) const;
    glm::vec3 between(const std::vector<glm::vec3>& values, const CellBox& box,
                      glm::ivec3 cell) const;

    const Volume& volume_;
    const Grid& grid_;
    volume::Slab slab_;
    size_t first_; ///< index of its first cell in the grid
    const Occupied& occupied_;
    float tolerance_;
};

} // namespace lpvbake::solver::gather
