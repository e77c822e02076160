// Volume files of any kind, told apart by their extension.
#pragma once

#include "io/format.h"

namespace lpvbake::io {

/// The format that a path's extension stands for, in any case; null: none does.
const VolumeFormat* volume_format(const std::string& path,
                                  VolumeFormats formats = volume_formats());

/// The same, for files that are read: sidecars count too.
const VolumeFormat* readable_format(const std::string& path,
                                    VolumeFormats formats = volume_formats());

/// The extensions in a row, as ".vdb or .exr"; with those of sidecars as ".vdb, .exr or .json".
std::string format_list(const char* last = " or ", bool sidecars = false,
                        VolumeFormats formats = volume_formats());

/// Writes the kind of file that the path names (`pictures` are of those that have some). A volume
/// that is given up is changed in place; of any other a copy is made where the encoding changes
/// values. Throws Error: argument (unknown extension: names those that are known), and what Stored
/// and the format throw.
WriteReport write_volume(const std::string& path, const Volume& volume, Precision precision,
                         const Pictures& pictures = {}, const volume::Encoding& encoding = {},
                         VolumeFormats formats = volume_formats());
WriteReport write_volume(const std::string& path, Volume&& volume, Precision precision,
                         const Pictures& pictures = {}, const volume::Encoding& encoding = {},
                         VolumeFormats formats = volume_formats());

/// Reads what write_volume wrote, or a sidecar beside it. Grids of other kinds are left out. Throws
/// Error: argument (unknown extension), and what the format throws.
Volume read_volume(const std::string& path, volume::GridKinds kinds,
                   VolumeFormats formats = volume_formats());

} // namespace lpvbake::io
