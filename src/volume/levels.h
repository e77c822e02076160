// Nested levels: volumes of one lit scene in boxes around each other, each of larger cells than the
// one in it. They stand for each other, and are never summed.
//
// Samples nest (the centres of the cells): those of a level that lie in the box of a finer one are
// samples of that too, and the box of the outermost samples of a level, its *hull*, ends on planes
// of samples of the next.
#pragma once

#include "volume/bricks.h"
#include "volume/places.h"
#include "volume/sampler.h"

#include <optional>
#include <span>
#include <vector>

namespace lpvbake::volume {

/// What a level is asked for by.
struct LevelBox {
    glm::dvec3 lo, hi; ///< metres; the hull holds it
    double cell;       ///< metres
    bool made = false; ///< by levels_around, and told so
};

inline constexpr std::size_t most_levels = 8;

/// The grids of levels, whose cells are powers of two of the smallest, finest first, whatever the
/// order of `levels`. The outermost box keeps its middle, the others begin and end on samples of
/// the next. Throws Error: argument (a box is inside out or not in that of the next, cells are
/// alike or no power of two of each other, too many levels), and as fit_grid.
std::vector<Grid> nest_grids(std::vector<LevelBox> levels);

/// Boxes of `count` levels: `focus` of the smallest cells, then around its middle boxes of twice
/// the size and cells each, and last the whole, from `lo` to `hi`, out of which none reaches.
/// Throws Error (argument) where the focus lies outside.
std::vector<LevelBox> levels_around(const LevelBox& focus, glm::dvec3 lo, glm::dvec3 hi,
                                    std::size_t count);

/// Volumes of levels, of places, or of bricks.
struct VolumeSet {
    std::vector<Volume> levels; ///< finest first, or by falling priority; at least one
    /// Cells of the next level, inside of a hull, over which a level takes over from that.
    double blend = 1;
    std::vector<Place> places = {}; ///< of each, where they stand beside each other; else empty
    /// There are bricks instead of levels: `levels` are those of the tree, of which the first and
    /// the last have the metadata.
    std::optional<BrickTree> bricks = {};

    /// All samples that a level has, or that bricks of it could have, the finest first.
    std::vector<Grid> grids() const;
    /// Those of the finest, and of the outermost level.
    Grid finest() const { return bricks ? bricks->levels().finest : levels.front().grid; }
    Grid outermost() const {
        return bricks ? bricks->levels().lattice(bricks->levels().count - 1) : levels.back().grid;
    }
};

/// The volumes of a set, or one that is alone. Refers to them.
struct Levels {
    std::span<const Volume> volumes;
    double blend = 1;
    std::span<const Place> places = {};
    const BrickTree* bricks = nullptr; ///< the volumes are its; null: they are levels, or places

    Levels(const Volume& alone) : volumes(&alone, 1) {}
    Levels(const VolumeSet& set)
        : volumes(set.levels),
          blend(set.blend),
          places(set.places),
          bricks(set.bricks ? &*set.bricks : nullptr) {}
};

/// Brings volumes of places into the order in which they are seen.
void order_by_priority(VolumeSet& set);

/// What messages call one of a set: "level 1", "volume hall".
std::string title_of(const VolumeSet& set, std::size_t level);

/// What a level weighs at a point (metres) against the coarser ones: 0 outside of its hull, rising
/// to 1 (smoothstep) over `blend` cells of the next level. At faces that it has in common with the
/// outermost level it stays what it is beside them. The outermost level's is 1, and a brick's. Of
/// a place: 0 outside of its cells, rising to 1 over its falloff inside.
double share_of(const Levels& levels, std::size_t level, glm::dvec3 point);

/// The first that has a share at the point, the finest brick there; of places where none has a
/// share, the nearest.
std::size_t level_at(const Levels& levels, glm::dvec3 point);

/// What is read of a level.
template <class Value>
struct LevelReading {
    Value value;
    bool clear = true; ///< of cells that the point sees
};

/// The mean of what `read(level)`, a LevelReading, finds at a point, by the levels' shares of what
/// finer ones leave. What is not clear does not count, unless nothing is; then the finest does. Of
/// bricks the finest that is clear counts alone.
template <class Read>
auto blend(const Levels& levels, glm::dvec3 point, const Read& read) {
    const std::size_t finest = level_at(levels, point);
    const auto first = read(finest);
    if (levels.bricks) {
        auto found = first;
        for (auto up = levels.bricks->parent(finest); up && !found.clear;
             up = levels.bricks->parent(*up))
            found = read(*up);
        return found.clear ? found.value : first.value;
    }
    auto sum = 0.0 * first.value;
    double total = 0, left = 1;
    for (std::size_t level = finest; level < levels.volumes.size() && left > 0; ++level) {
        const double share = share_of(levels, level, point);
        if (share == 0)
            continue;
        const auto own = level == finest ? first : read(level);
        if (!own.clear)
            continue;
        sum += left * share * own.value;
        total += left * share;
        left *= 1 - share;
    }
    return total > 0 ? sum / total : first.value;
}

/// What of a level's cells a sample of a flattened volume is made of.
struct Taps {
    CellWeights cells;       ///< the valid ones before all of whose walls it lies
    std::size_t nearest = 0; ///< of those, or of all eight where none counts
    bool valid = false;      ///< there are some
};
Taps taps_at(const Volume& volume, glm::dvec3 point);

/// Coefficients at a point (metres), of the valid cells around before whose walls it lies, as
/// blend() mixes levels.
std::vector<glm::dvec3> field_at(const Levels& levels, glm::dvec3 point);

/// The set as one volume of cubic cells, with samples in the hull of the outermost level: light is
/// that of field_at(); validity and walls are those of the nearest of them. Throws Error as
/// fit_grid, and: argument (more than 2^31 - 1 cells), memory (more than the machine has).
Volume flatten(const Levels& levels, double cell);

} // namespace lpvbake::volume
