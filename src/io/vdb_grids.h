// OpenVDB's grids: those that files are made of, and what is made of a file's once OpenVDB has read
// them.
#pragma once

#include "io/stored.h"
#include "io/vdb.h"
#include "volume/grids.h"

// What its library registers of its templates is what we instantiate: one and the same, though all
// of ours is hidden.
#pragma GCC visibility push(default)
#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#pragma GCC visibility pop

#include <functional>
#include <string>

namespace lpvbake::io {

/// Written for viewers, never read.
extern const GridKind density_kind;

/// What OpenVDB needs before anything else; once.
void initialise_vdb();

/// OpenVDB's messages may span lines.
std::string one_line(std::string text);

/// All grids of the volume, and Stored::density for viewers, which is never read.
std::vector<volume::ConstGridView> grids_to_write(const Stored& stored);

/// 1 where a cell carries meaning: where any grid has a value that is not 0.
std::vector<uint8_t> active_cells(const Volume& volume);

/// A grid as Vec3S or float, with name, transform and class. Uniform blocks are tiles. Of bricks
/// where those stand.
openvdb::GridBase::Ptr make_grid(const volume::ConstGridView& view, const Stored& stored,
                                 const std::vector<uint8_t>& active,
                                 const BrickPlaces* bricks = nullptr);

/// Name, transform and class of a grid of the lattice; `fog` of density.
void describe_grid(const std::string& name, const Grid& lattice, bool corner_index, bool fog,
                   openvdb::GridBase& grid);

/// What a reader must know to make sense of any of the grids: lattice, order and encoding.
void insert_lattice(const Volume& volume, const volume::Encoding& encoding,
                    openvdb::MetaMap& metadata, const BrickPlaces* bricks = nullptr);
/// Metadata of a file: the volume's, lattice and precision.
openvdb::MetaMap file_metadata(const Volume& volume, const volume::Encoding& encoding, bool half,
                               const BrickPlaces* bricks = nullptr);

/// Precision and metadata of a grid of that kind in a file of the volume; the lattice is there.
void insert_facts(const GridKind& kind, const Volume& volume, const volume::Encoding& encoding,
                  bool half, openvdb::GridBase& grid, const BrickPlaces* bricks = nullptr);

/// Writes a file of so many grids, which `make` returns; at most `at_once` of them are in memory at
/// a time, and `make` is then called by as many threads. Throws Error (file), and what `make`
/// throws.
WriteReport::File write_grids(const std::string& path, const openvdb::MetaMap& metadata,
                              std::size_t count, std::size_t at_once,
                              const std::function<openvdb::GridBase::Ptr(std::size_t)>& make);

struct VdbContent {
    openvdb::MetaMap::Ptr metadata;              ///< of the file
    std::function<bool(const std::string&)> has; ///< whether there is a grid of that name
    /// The grid of that name, null if there is none.
    std::function<openvdb::GridBase::Ptr(const std::string&)> grid;
};

/// A file that write_vdb made, with the UUID that tells it from all others. `known`, if it is not
/// empty, is the UUID of a file that was opened before; it is then not looked through for damage
/// again. Throws Error (file; invalid: damaged, or another than the known one).
struct OpenVdb {
    VdbContent content;
    std::string uuid;
};
OpenVdb open_vdb(const std::string& path, const std::string& known = "");

/// The grids that a file of a volume of that order has, without values: those that are read, as
/// grids_of has them, and, for viewers, density.
std::vector<volume::ConstGridView> grids_in(const VdbContent& content, int order);

/// Throws Error (invalid) where the grid is active outside of a lattice of these dims.
void check_within(const openvdb::GridBase& grid, glm::ivec3 dims, const std::string& path);

/// Copies a grid's active values into a view's cells, of a lattice, or of the stack of bricks;
/// those without stay as they are. Throws Error (invalid).
void copy_grid(const openvdb::GridBase::Ptr& base, const Grid& lattice, const BrickPlaces* bricks,
               const std::string& path, const volume::GridView& view);

/// take(at, value) for each active voxel, those of blocks of equal ones as well.
template <class GridType, class Take>
void each_active(const GridType& grid, const Take& take) {
    for (auto value = grid.cbeginValueOn(); value; ++value) {
        openvdb::CoordBBox box;
        value.getBoundingBox(box);
        for (auto at = box.begin(); at; ++at)
            take(*at, *value);
    }
}

/// The volume that the grids hold; its values may be anything. Throws Error (invalid, memory) that
/// begins with `path`, and openvdb::Exception.
Volume volume_of(const VdbContent& content, const std::string& path,
                 volume::GridKinds kinds = volume::grid_kinds(),
                 const BrickPlaces* bricks = nullptr);

} // namespace lpvbake::io
