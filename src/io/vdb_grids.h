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

/// What OpenVDB needs before anything else; once.
void initialise_vdb();

/// All grids of the volume, and Stored::density for viewers, which is never read.
std::vector<volume::ConstGridView> grids_to_write(const Stored& stored);

/// 1 where a cell carries meaning: where any grid has a value that is not 0.
std::vector<uint8_t> active_cells(const Volume& volume);

/// A grid as Vec3S or float, with name, transform and class. Uniform blocks are tiles. Of bricks
/// where those stand.
openvdb::GridBase::Ptr make_grid(const volume::ConstGridView& view, const Stored& stored,
                                 const std::vector<uint8_t>& active,
                                 const BrickPlaces* bricks = nullptr);

struct VdbContent {
    openvdb::MetaMap::Ptr metadata;              ///< of the file
    std::function<bool(const std::string&)> has; ///< whether there is a grid of that name
    /// The grid of that name, null if there is none.
    std::function<openvdb::GridBase::Ptr(const std::string&)> grid;
};

/// The volume that the grids hold; its values may be anything. Throws Error (invalid, memory) that
/// begins with `path`, and openvdb::Exception.
Volume volume_of(const VdbContent& content, const std::string& path,
                 volume::GridKinds kinds = volume::grid_kinds(),
                 const BrickPlaces* bricks = nullptr);

} // namespace lpvbake::io
