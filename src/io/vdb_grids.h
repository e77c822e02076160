// What is made of a VDB file's grids once OpenVDB has read them.
#pragma once

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

struct VdbContent {
    openvdb::MetaMap::Ptr metadata;              ///< of the file
    std::function<bool(const std::string&)> has; ///< whether there is a grid of that name
    /// The grid of that name, null if there is none.
    std::function<openvdb::GridBase::Ptr(const std::string&)> grid;
};

/// The volume that the grids hold; its values may be anything. Throws Error (invalid, memory) that
/// begins with `path`, and openvdb::Exception.
Volume volume_of(const VdbContent& content, const std::string& path,
                 volume::GridKinds kinds = volume::grid_kinds());

} // namespace lpvbake::io
