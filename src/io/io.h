// Volume files of any kind, told apart by their extension.
#pragma once

#include "io/exr.h"
#include "io/vdb.h"

#include <optional>

namespace lpvbake {

enum class VolumeFormat { vdb, exr };

/// The format that a path's extension (.vdb, .exr, in any case) stands for; none: it is neither.
std::optional<VolumeFormat> volume_format(const std::string& path);

/// Writes .vdb or .exr (`pictures` are of the latter). Throws Error: usage (unknown extension:
/// names those that are known), and what write_vdb and write_exr throw.
WriteReport write_volume(const std::string& path, const Volume& volume, Precision precision,
                         const Pictures& pictures = {}, const Encoding& encoding = {});

/// Reads .vdb or .exr, or the .json beside the latter. Throws Error: usage (unknown extension), and
/// what read_vdb and read_exr throw.
Volume read_volume(const std::string& path);

} // namespace lpvbake
