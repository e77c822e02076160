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

/// The extensions in a row, as ".vdb, .exr or .dds"; with the ends of sidecars as ".vdb, .exr,
/// .dds, .json or .dds.json".
std::string format_list(const char* last = " or ", bool sidecars = false,
                        VolumeFormats formats = volume_formats());

/// Throws Error (argument) unless the path's format and the packing have a form for the precision;
/// of an unknown extension it says nothing.
void check_precision(const std::string& path, Precision precision, Packing packing,
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

inline constexpr double least_l1_scale = 0.01, most_l1_scale = 100; ///< Target::l1_scale

/// Multiplies band 1.
void scale_band_one(double factor, Volume& volume);

/// Reads what write_volume wrote, or a sidecar beside it. Grids of other kinds are left out. What
/// Target::l1_scale did to band 1 is undone; the metadata tell of it still. Throws Error: argument
/// (unknown extension), and what the format throws.
Volume read_volume(const std::string& path, volume::GridKinds kinds,
                   VolumeFormats formats = volume_formats());

} // namespace lpvbake::io
