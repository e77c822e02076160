// Volumes as 3D textures, a file each: what KTX2 and DDS have in common. Texel (x, y, z) is cell
// (x, y, z), x fastest, so that the texture's coordinates are those of the box, 0 at its lower
// corner.
#pragma once

#include "io/described.h"
#include "io/format.h"
#include "io/texel.h"

#include <string>
#include <string_view>
#include <vector>

namespace lpvbake::io {

constexpr int max_texture_side = 2048; ///< of Direct3D 11 and 12

/// A kind of file that holds a 3D texture of one level.
struct TextureContainer {
    const VolumeFormat* format;
    const char* description; ///< what is the "format" of the description
    /// The whole file. One that has no room for the description leaves it out, and its format has a
    /// sidecar.
    std::string (*encode)(const TexelForm& form, glm::ivec3 dims, std::string_view texels,
                          std::string_view description);
};

/// What a file says of its texture, of which all but the texels are checked.
struct TextureContent {
    const TexelForm* form;
    glm::ivec3 dims;
    std::string description; ///< empty: it is not in the file
};

/// Of the textures of a packing. Throws Error (unsupported): more than 2048 texels a side.
glm::ivec3 texture_dims(const std::string& path, glm::ivec3 cells, Packing packing);

/// Throws Error (unsupported): packing and encoding have no form for the order or for each other,
/// or a texture would have more than 2048 texels a side.
std::vector<std::string> texture_files(const TextureContainer& container, const std::string& path,
                                       const Volume& volume, const Pictures& pictures,
                                       volume::ShConvention convention);

/// Writes STEM_sh_l0, ... as texture_files names them; each is atomic, and none takes its name
/// before all are on the disk. Throws as texture_files; Error: file; failure (a value is not
/// finite).
WriteReport write_textures(const TextureContainer& container, const std::string& path,
                           const Stored& stored, Precision precision, const Pictures& pictures);

/// Reads a file whose number of bytes is bounded by what is on the disk.
std::string read_texture_file(const std::string& path);

/// Throws Error (invalid), naming the file, unless it has a texture of these dims with so many
/// channels.
void check_texture(const TextureContent& content, const std::string& path, glm::ivec3 dims,
                   size_t channels);

} // namespace lpvbake::io
