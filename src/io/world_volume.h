// The tiles of one lighting of a world, as the one volume that they make together.
//
// The file of a tile holds the cells of its bounds and one more layer around them, so that
// neighbours have two layers in common. A cell is taken from the tile in whose bounds it lies; of
// the layers around these, from the first row of the plan that has it. Cells of no tile are 0 and
// not valid.
#pragma once

#include "io/io.h"
#include "io/world.h"
#include "lpvbake/progress.h"

#include <cstdint>
#include <string>
#include <vector>

namespace lpvbake::io {

struct WorldVolume {
    struct Tile {
        std::size_t row; ///< of the plan
        std::string file, hash;
        glm::ivec3 begin, end; ///< cells of its bounds, of `grid`
    };
    std::string path; ///< of the plan
    std::string scenario;
    Grid grid; ///< around all tiles and the layers around them
    std::vector<Tile> tiles;

    /// "row 3 (noon, w_noon_x0_y0_z0.vdb)".
    std::string title_of(const Tile& tile) const;
};

/// Of the scenario of this name; of none ("") of the only one. Throws Error: argument (there is no
/// such scenario, or none is named of several), invalid (rows that are no tiles of one lattice).
WorldVolume world_volume(const std::string& path, const World& world, const std::string& scenario);

/// Which tile's a cell is, of those around it.
class TileShares {
public:
    /// Refers to the volume.
    explicit TileShares(const WorldVolume& volume);
    /// Of each cell of the tile's file 1 where the volume has it from there.
    std::vector<uint8_t> of(std::size_t tile) const;
    /// The tiles that cells [begin, end) are taken from.
    std::vector<std::size_t> tiles_in(glm::ivec3 begin, glm::ivec3 end) const;

private:
    const WorldVolume& volume_;
    std::vector<std::vector<std::size_t>> near_; ///< of each tile those that have cells of its file
};

/// Whether the volume of that name is there: its file, or the description of its textures.
bool is_there(const std::string& file);
/// Throws Error (file) unless the tile is there.
void require(const WorldVolume& volume, const WorldVolume::Tile& tile);
/// Throws Error (invalid) unless `header`, which is what the file says of
/// itself, is that of the row: of its place and of its hash.
void check_tile(const WorldVolume& volume, const WorldVolume::Tile& tile, const Volume& header);

/// What tiles have in common of their metadata, and `world` and `scenario`.
class CommonFacts {
public:
    /// Throws Error (invalid) where rays were traced by another instruction set, or another version
    /// of Embree, than those of the first, or the order is another.
    void add(const WorldVolume& volume, const WorldVolume::Tile& tile, const Volume& header);
    /// Order and metadata.
    Volume header(const WorldVolume& volume) const;

private:
    std::optional<Volume> common_;
};

/// Cells [begin, end) of the volume, from the files that have some, one after the other. Metadata
/// are CommonFacts of these. Throws Error as read_volume, and: file (a row is missing), invalid
/// (check_tile, CommonFacts), memory (all cells take more than `most_bytes`; `max_memory`).
Volume read_cells(const WorldVolume& volume, glm::ivec3 begin, glm::ivec3 end, uint64_t most_bytes);

/// Whether export_world can take the tiles: they are .vdb.
bool can_export(const WorldVolume& volume);
/// Writes all cells as write_vdb writes read_cells of all of them (of float tiles byte for byte),
/// but with no more in memory than one grid, which has no cells where there is no tile. Throws
/// Error as these two, and: unsupported (tiles are stored in a convention or with axes of their
/// own; a value does not fit half). A grid of a tile is a step.
struct WorldExport {
    WriteReport report;
    int sh_order = 0;
};
WorldExport export_world(const WorldVolume& volume, const std::string& path, Precision precision,
                         Progress& progress);

} // namespace lpvbake::io
