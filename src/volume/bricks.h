// Bricks: cubes of 8 x 8 x 8 cells of one lit scene, small where it needs them.
//
// A level is a lattice of samples, of which every second one is a sample of the next coarser level,
// too. A brick has 9 x 9 x 9 samples of its level; it has the outermost in common with its
// neighbours. The coarsest bricks fill a box. An eighth of a brick may be a brick of the next finer
// level; around it, in all 26 directions, are bricks of its own level or of the next coarser one.
#pragma once

#include "lpvbake/volume.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace lpvbake::volume {

inline constexpr int brick_cells = 8;              ///< along an edge, between samples
inline constexpr int brick_edge = brick_cells + 1; ///< samples along an edge
inline constexpr std::size_t brick_samples = 9 * 9 * 9;
inline constexpr std::size_t most_brick_places = std::size_t(1) << 24; ///< of the finest level

struct Brick {
    int level = 0;    ///< 0 the finest
    glm::ivec3 at{0}; ///< its place among those of its level
    bool operator==(const Brick&) const = default;
};

/// How far cells are from each other in size and what box they fill.
struct BrickLevels {
    Grid finest; ///< all samples that level 0 could have: 8 n + 1 along an axis
    int count = 1;

    /// All samples that a level could have.
    Grid lattice(int level) const;
    /// How many bricks of a level stand along each axis.
    glm::ivec3 places(int level) const;
    /// The samples of a brick.
    Grid grid_of(const Brick& brick) const;
};

/// Levels of cells from `fine` to `coarse` metres over the box from `lo` to `hi`, from whose lower
/// corner on they begin. Throws Error (argument): a size is not above 0, `fine` is above `coarse`,
/// their ratio is no power of two or above 2^7, a coarsest brick is larger than all of the box, or
/// there are more than most_brick_places; and (invalid) as fit_grid.
BrickLevels brick_levels(double fine, double coarse, glm::dvec3 lo, glm::dvec3 hi);

/// Which bricks there are.
class BrickTree {
public:
    BrickTree() = default;
    /// In any order. Throws Error (invalid) where one lies outside, is there twice, or where a
    /// coarsest one, or the brick of which another is an eighth, is missing.
    BrickTree(const BrickLevels& levels, std::vector<Brick> bricks);

    const BrickLevels& levels() const { return levels_; }
    /// The finest level first; in a level x runs fastest, z slowest.
    std::span<const Brick> bricks() const { return bricks_; }
    std::optional<std::size_t> find(const Brick& brick) const;
    /// The finest brick at a point, metres; at the nearest one of the box.
    std::size_t at(glm::dvec3 point) const;
    /// For each place of level 0, x fastest, the finest brick there.
    std::span<const uint32_t> finest() const { return finest_; }
    /// The brick that one is an eighth of; none of the coarsest.
    std::optional<std::size_t> parent(std::size_t brick) const;
    bool operator==(const BrickTree& other) const;

private:
    BrickLevels levels_;
    std::vector<Brick> bricks_;
    std::vector<uint32_t> finest_;
};

/// Overwrites the outermost samples of bricks that lie on coarser ones by what these make of them,
/// so that trilinear reading, each place by its finest brick, has no step. `bricks` is one volume
/// for each brick of the tree. Such a sample is valid if all that it is made of is.
void stitch(const BrickTree& tree, std::span<Volume> bricks);

/// Makes a brick of a tree.
using MakeBrick = std::function<Volume(std::size_t brick)>;

/// What bricks may lose by trim().
struct TrimGoal {
    double error = 0;                   ///< as Trimmed::error
    std::size_t most = SIZE_MAX;        ///< bricks; it counts before the error
    std::span<const uint8_t> kept = {}; ///< not 0: that brick does not go; empty: all may
};

struct Trimmed {
    std::vector<Brick> bricks; ///< that are left
    /// Root mean square, over all valid samples of the finest bricks that there were, all normals
    /// and RGB, of the irradiance that reading them by what is left changes, without their noise;
    /// as a share of its mean.
    double error = 0;
};

/// Takes bricks away, those first that cost the least error, from all levels but the coarsest: as
/// many as the error allows, and more where there are more than `most`. Bricks are read as
/// flatten() does, and have not been stitched; each is made once, on any thread, and is there only
/// while those in it are looked at. The same for any number of threads.
/// `noise` is the mean square error by chance of the samples of each brick, as
/// mean_square_irradiance() has it (empty: none). It is not lost: what a sample differs by from
/// what others make of its place holds the noise of both, which smaller cells do not take away.
Trimmed trim(const BrickTree& tree, const MakeBrick& make, const TrimGoal& goal,
             std::span<const double> noise = {});

/// How bricks stand in one volume.
struct BrickStack {
    glm::ivec3 slots; ///< along its axes; x runs fastest

    explicit BrickStack(std::size_t bricks);
    /// The first sample of a brick.
    glm::ivec3 first(std::size_t brick) const;
    glm::ivec3 dims() const { return brick_edge * slots; }
};

/// Bricks beside each other in one volume of BrickStack::dims; its grid lies nowhere. Metadata are
/// those of the first.
Volume stacked(std::span<const Volume> bricks);
/// As many bricks as there are grids; the first and the last have the metadata. Throws Error
/// (invalid) where the volume has other dims.
std::vector<Volume> unstacked(const Volume& stack, std::span<const Grid> grids);

/// Irradiance (lux) of a sample, its mean over all normals and RGB.
double mean_irradiance(const Volume& volume, std::size_t sample);
/// The mean square of what coefficients c[k], differences of two samples, make of it.
double mean_square_irradiance(std::span<const glm::dvec3> c);

} // namespace lpvbake::volume
