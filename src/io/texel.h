// What a texel of a 3D texture is in bytes: the little-endian forms that graphics APIs share.
#pragma once

#include "image/image.h"
#include "io/textures.h"
#include "lpvbake/file.h"

#include <span>
#include <string>
#include <string_view>

namespace lpvbake::io {

/// A form of texels and the numbers that it has in headers.
struct TexelForm {
    Precision precision;
    int channels;    ///< 1 or 4, of half and full; 3 of rgb9e5; 4 of unorm8
    uint32_t vulkan; ///< in KTX2
    uint32_t dxgi;   ///< in DDS

    size_t bytes() const {
        return precision == Precision::rgb9e5 ? 4 : size_t(channels) * scalar();
    }
    /// Bytes of a channel, of rgb9e5 of all.
    size_t scalar() const {
        return precision == Precision::unorm8 ? 1 : precision == Precision::half ? 2 : 4;
    }
};

/// The form of a texture: three channels have a fourth beside them, which is 1, as GPUs want it,
/// but for rgb9e5.
const TexelForm& form_of(const Texture& texture, Precision precision);

/// The form of that number; null if it is none of ours.
const TexelForm* form_numbered(uint32_t TexelForm::*number, uint32_t value);

/// Texels in their form, in the order of `pixels`.
std::string pack(const image::Pixels& pixels, const TexelForm& form);

/// The other way, of so many channels (the fourth that pack added is left out); `bytes` has
/// width * height of them. What is read may be infinite or no number.
image::Pixels unpack(std::string_view bytes, const TexelForm& form, int width, int height,
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
