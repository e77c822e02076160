// Zones of a grid's cells, of which most see what those around them see.
#pragma once

#include "solver/gather/zone.h"
#include "volume/grid.h"

#include <array>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace lpvbake::solver::gather {

/// Frame units: how near to a box a surface is taken to cross it.
inline constexpr float occupied_slack = surface_margin + 1e-3f;

/// The box around a patch, frame units.
std::pair<glm::vec3, glm::vec3> box_of(const surface::Patch& patch);

/// Where surfaces are: box (i, j, k) of level n spans the centres of cells i 2^n to (i + 1) 2^n
/// along x and so on.
class Occupied {
public:
    Occupied(const std::vector<surface::Patch>& patches, const Grid& grid);
    /// The same of a lattice of `dims`, its first place and its step in frame units, and of `some`
    /// of the patches.
    Occupied(std::span<const surface::Patch> patches, std::span<const uint32_t> some,
             glm::vec3 first, float step, glm::ivec3 dims);
    /// True if a surface may cross the box from cell `lo` to lo + 2^level; lo a multiple of that.
    bool operator()(glm::ivec3 lo, int level) const;

private:
    explicit Occupied(glm::ivec3 dims);
    void add(const surface::Patch& patch, glm::vec3 first, float step);
    void fill_levels();

    std::vector<Grid> grids_;
    std::vector<std::vector<uint8_t>> levels_;
};

/// The cells of a grid, or of another lattice, and what stands among them.
struct Cells {
    const Grid& grid;
    const Occupied& occupied;
    std::span<const float> validity;
    glm::vec3 first{0.5f}; ///< the place of the first one, frame units
    float step = 1;        ///< from place to place
    uint32_t draw = 0;     ///< another number, other points of clusters are tested
    /// Where the light of each is taken; empty: where that of the frame's cells is.
    std::span<const glm::vec3> points = {};

    glm::vec3 place(glm::ivec3 cell) const { return first + step * glm::vec3(cell); }
    glm::vec3 point(const visibility::Visibility& visibility, glm::ivec3 cell) const {
        return points.empty() ? visibility.capture(cell).point : points[grid.index(cell)];
    }
};

/// A cube of cells. A cell tests another point of each cluster than its neighbours; where the
/// corners of a cube of cells that no surface crosses agree, the cells inside take their answer.
class CellZone : public Zone {
public:
    /// Of the cells from `base` to `last`, which is at most zone_edge from it.
    CellZone(const Surroundings& world, const Cells& cells, glm::ivec3 base, glm::ivec3 last);

    uint64_t rays() const { return rays_; }
    /// Finds what some cells (of this zone) see that were not asked for yet, on all threads.
    void find(std::span<const glm::ivec3> cells);
    /// What one of them sees; stays there as long as the zone.
    const uint64_t* sees(glm::ivec3 cell) const { return bits(cell - base_); }

private:
    /// Points by how far apart those lie whose answers they may take: the coarsest, which take
    /// none, come first.
    using Ranks = std::array<std::vector<glm::ivec3>, 4>;

    size_t slot(glm::ivec3 point) const;
    uint64_t* bits(glm::ivec3 point) const { return bits_[known_[slot(point)] - 1u].get(); }
    bool usable(glm::ivec3 point) const;
    /// The edge of the cube whose corners a point asks, and that cube's first one; 0: it asks none.
    int cube_around(glm::ivec3 point, glm::ivec3& lo) const;
    void add(glm::ivec3 point, Ranks& ranks);
    /// Finds what some points of a rank see; returns how many rays it took.
    uint64_t find_from(std::span<const glm::ivec3> points) const;
    /// Sets what corners agree on that a point sees; `open`: the sources that it has to test.
    void take_agreed(glm::ivec3 point, std::span<uint64_t> open) const;

    const Cells& cells_;
    glm::ivec3 base_;
    std::vector<uint16_t> known_; ///< a point: 1 + its place in bits_, or 0
    std::vector<std::unique_ptr<uint64_t[]>> bits_;
    uint64_t rays_ = 0;
};

} // namespace lpvbake::solver::gather
