// KTX 2.0 files, a 3D texture each, compressed by Zstandard.
#pragma once

#include "io/format.h"
#include "io/texel.h"

#include <string>
#include <string_view>

namespace lpvbake::io {

extern const VolumeFormat ktx2_format;

/// Writes STEM_sh_l0.ktx2, ..., the textures that an EXR has as pictures, as 3D textures: R16F or
/// R32F where one channel is stored, RGBA16F or RGBA32F where three (alpha is 1) or four are, as
/// graphics APIs want it, and with Precision::rgb9e5 E5B9G9R9 where three colours have no sign.
/// README.md has it byte by byte. The description (described.h, "format": "lpvbake textures") is
/// the value of the key "lpvbake", the same in all files of a volume. Throws as write_textures.
WriteReport write_ktx2(const std::string& path, const Stored& stored, Precision precision,
                       const Pictures& pictures);

/// Reads what write_ktx2 made, by the path that was written or by that of any of its textures. A
/// volume in one file may have been renamed; files beside each other have to be of one volume.
/// Throws Error (file, invalid, memory; unsupported: Packing::cube).
Volume read_ktx2(const std::string& path, volume::GridKinds kinds = volume::grid_kinds());

/// A whole file; without a description it has no key of ours.
std::string encode_ktx2(const TexelForm& form, glm::ivec3 dims, std::string_view texels,
                        std::string_view description);

/// The texels of a whole file, of a texture of `dims` with so many channels, slice below slice.
/// Throws Error (invalid), beginning with `place`.
image::Pixels decode_ktx2(std::string_view bytes, const std::string& place, glm::ivec3 dims,
                          size_t channels);

} // namespace lpvbake::io
