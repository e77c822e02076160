// Zones of a grid's cells, of which most see what those around them see.
#pragma once

#include "solver/gather/zone.h"
#include "volume/grid.h"

#include <memory>

namespace lpvbake::solver::gather {

/// Where surfaces are: box (i, j, k) of level n spans the centres of cells i 2^n to (i + 1) 2^n
/// along x and so on.
class Occupied {
public:
    Occupied(const std::vector<surface::Patch>& patches, const Grid& grid);
    /// True if a surface may cross the box from cell `lo` to lo + 2^level; lo a multiple of that.
    bool operator()(glm::ivec3 lo, int level) const;

private:
    std::vector<Grid> grids_;
    std::vector<std::vector<uint8_t>> levels_;
};

/// The cells of a grid, and what stands among them.
struct Cells {
    const Grid& grid;
    const Occupied& occupied;
    std::span<const float> validity;
};

/// A cube of cells. A cell tests another point of each cluster than its neighbours; where the
/// corners of a cube of cells agree, the cells inside take their answer.
class CellZone : public Zone {
public:
    CellZone(const Surroundings& world, const Cells& cells, glm::ivec3 base);

    uint64_t rays() const { return rays_; }
    /// What a cell (of this zone) sees; stays there as long as the zone.
    const uint64_t* sees(glm::ivec3 cell) { return bits(cell - base_); }

private:
    size_t slot(glm::ivec3 point) const;
    const uint64_t* bits(glm::ivec3 point);
    bool usable(glm::ivec3 point) const;

    const Cells& cells_;
    glm::ivec3 base_;
    std::vector<uint16_t> known_; ///< a point: 1 + its place in bits_, or 0
    std::vector<std::unique_ptr<uint64_t[]>> bits_;
    uint64_t rays_ = 0;
};

} // namespace lpvbake::solver::gather
