// What a texel of a 3D texture is in bytes: the little-endian forms that graphics APIs share.
#pragma once

#include "image/image.h"
#include "io/textures.h"
#include "lpvbake/file.h"

#include <span>
#include <string>
#include <string_view>

namespace lpvbake::io {

enum class Coding { full, half, rgb9e5, unorm8, bc6h, bc7 };

/// A form of texels and the numbers that it has in headers.
struct TexelForm {
    Coding coding;
    int channels;    ///< 1 or 4, of half and full; 4 of unorm8; 3 of all else
    uint32_t vulkan; ///< in KTX2
    uint32_t dxgi;   ///< in DDS

    /// Blocks of 4 x 4 texels of a slice (blocks.h).
    bool is_block() const { return coding == Coding::bc6h || coding == Coding::bc7; }
    /// Bytes of a texel, or of a block.
    size_t bytes() const;
    /// Bytes of a channel, of rgb9e5 of all, of blocks 1.
    size_t scalar() const;
    /// Dims that are whole blocks, the least that hold these.
    glm::ivec3 whole(glm::ivec3 dims) const;
    /// Bytes of a texture of these dims.
    size_t size(glm::ivec3 dims) const;
};

/// The form of a texture: three channels have a fourth beside them, which is 1, as GPUs want it,
/// but for rgb9e5.
const TexelForm& form_of(const Texture& texture, Precision precision);

/// The form of that number; null if it is none of ours.
const TexelForm* form_numbered(uint32_t TexelForm::*number, uint32_t value);

/// Texels in their form, x fastest; `pixels` are slices of dims.y rows one below the other. Of
/// blocks, what is beyond the dims is as at their edge, and `weights`, as many numbers as samples,
/// say how much an error of each counts; all alike if there are none.
std::string pack(const image::Pixels& pixels, const TexelForm& form, glm::ivec3 dims,
                 const std::vector<float>& weights = {});

/// The other way, of so many channels (the fourth that pack added is left out); `bytes` has
/// form.size(dims) of them. What is read may be infinite or no number.
image::Pixels unpack(std::string_view bytes, const TexelForm& form, glm::ivec3 dims,
                     size_t channels);

/// Whether texels of that form hold so many channels.
bool holds(const TexelForm& form, size_t channels);

/// A little-endian number in front of which stand `offset` bytes; the bytes have to be there.
template <class Number>
Number number_at(std::string_view bytes, size_t offset) {
    Number value = 0;
    for (size_t i = 0; i < sizeof value; ++i)
        value |= Number(static_cast<unsigned char>(bytes[offset + i])) << 8 * i;
    return value;
}

template <class Number>
void append_number(std::string& bytes, Number value) {
    for (size_t i = 0; i < sizeof value; ++i)
        bytes.push_back(char(value >> 8 * i & 255));
}

} // namespace lpvbake::io
