// DirectDraw Surface files, a 3D texture each, with a description beside them.
#pragma once

#include "io/format.h"

namespace lpvbake::io {

extern const VolumeFormat dds_format;

/// Writes STEM_sh_l0.dds, ..., with the texels of write_ktx2, and STEM.dds.json (described.h,
/// "format": "lpvbake textures"), which comes last. README.md has it byte by byte. Throws as
/// write_textures.
WriteReport write_dds(const std::string& path, const Stored& stored, Precision precision,
                      const Pictures& pictures);

/// Reads what write_dds made, through STEM.dds.json (STEM.dds and every texture name the same).
/// Throws Error (file, invalid, memory; unsupported: Packing::cube).
Volume read_dds(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());

} // namespace lpvbake::io
