// The table of formats: what kinds of volume files there are.
//
// A new format is a pair of files with a `const VolumeFormat`, and its place in the list of io.cpp.
// Whatever names formats, writes or reads goes by the rows.
#pragma once

#include "io/pictures.h"
#include "io/stored.h"

#include <span>
#include <string>
#include <vector>

namespace lpvbake::io {

/// A kind of volume file. Functions may not be null.
struct VolumeFormat {
    const char* extension; ///< ".vdb", lower case; unique, also among sidecars
    /// End of the name of a file beside it by which it may be read too; empty: there is none.
    const char* sidecar = "";
    const char* help; ///< what is written for NAME, as "NAME.vdb"
    /// It stores cells as Pictures says, for programs that are told how by the notes of a Target.
    bool has_pictures = false;
    bool has_rgb9e5 = false; ///< it takes Precision::rgb9e5
    bool has_ratios = false; ///< it takes precisions that store light over its mean
    /// The files of a volume with these grids, in the order in which `write` lists them; null: the
    /// path's alone.
    std::vector<std::string> (*files)(const std::string& path, const Volume& grids,
                                      const Pictures& pictures,
                                      volume::ShConvention convention) = nullptr;
    /// Writes all grids of the volume, atomically. Throws Error: file; unsupported (it has no form
    /// for such a volume).
    WriteReport (*write)(const std::string& path, const Stored& stored, Precision precision,
                         const Pictures& pictures);
    /// The canonical volume with its grids of these kinds. Throws Error (file, invalid, memory,
    /// unsupported).
    Volume (*read)(const std::string& path, volume::GridKinds kinds);
};

using VolumeFormats = std::span<const VolumeFormat* const>;

/// OpenVDB, NanoVDB, OpenEXR, KTX2, DDS, glTF, Godot's probes.
VolumeFormats volume_formats();

} // namespace lpvbake::io
