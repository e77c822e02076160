#include "image/header.h"

namespace lpvbake::image {
namespace {

int byte_at(std::span<const std::byte> data, size_t i) {
    return i < data.size() ? std::to_integer<int>(data[i]) : 0;
}

uint64_t little_endian(std::span<const std::byte> data, size_t at, int bytes) {
    uint64_t value = 0;
    for (int i = bytes; i-- > 0;)
        value = value << 8 | unsigned(byte_at(data, at + size_t(i)));
    return value;
}

/// The size that a JPEG's frame header (marker SOFn, ITU T.81 B.2.2) announces, if there is one.
ImageHeader jpeg_header(std::span<const std::byte> data) {
    const ImageHeader none{"jpeg"};
    size_t at = 2;
    while (at + 9 < data.size()) {
        if (byte_at(data, at) != 0xff)
            return none;
        const int marker = byte_at(data, at + 1);
        if (marker == 0xff) { // fill byte
            ++at;
            continue;
        }
        const bool frame =
            marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
        if (frame)
            return {"jpeg", big_endian(data, at + 7, 2), big_endian(data, at + 5, 2)};
        if (marker == 0xda || marker == 0xd9) // image data or the end, and no frame before it
            return none;
        const bool alone = marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
        at += 2 + (alone ? 0 : big_endian(data, at + 2, 2));
    }
    return none;
}

/// Of a WebP's first chunk: VP8X and VP8L hold sizes less 1, VP8 (RFC 6386, section 9.1) as is.
ImageHeader webp_header(std::span<const std::byte> data) {
    ImageHeader header{"webp"};
    if (data.size() < 30)
        return header;
    if (has_bytes(data, 12, "VP8X")) {
        header.width = little_endian(data, 24, 3) + 1;
        header.height = little_endian(data, 27, 3) + 1;
    } else if (has_bytes(data, 12, "VP8L")) {
        const uint64_t bits = little_endian(data, 21, 4);
        header.width = (bits & 0x3fff) + 1;
        header.height = (bits >> 14 & 0x3fff) + 1;
    } else if (has_bytes(data, 12, "VP8 ")) {
        header.width = little_endian(data, 26, 2) & 0x3fff;
        header.height = little_endian(data, 28, 2) & 0x3fff;
    }
    return header;
}

} // namespace

uint64_t big_endian(std::span<const std::byte> data, size_t at, int bytes) {
    uint64_t value = 0;
    for (int i = 0; i < bytes; ++i)
        value = value << 8 | unsigned(byte_at(data, at + size_t(i)));
    return value;
}

bool has_bytes(std::span<const std::byte> data, size_t at, std::string_view magic) {
    for (size_t i = 0; i < magic.size(); ++i)
        if (at + i >= data.size() || char(byte_at(data, at + i)) != magic[i])
            return false;
    return true;
}

ImageHeader read_image_header(std::span<const std::byte> data) {
    if (has_bytes(data, 0, "\x89PNG\r\n\x1a\n"))
        return {"png", big_endian(data, 16, 4), big_endian(data, 20, 4)};
    if (has_bytes(data, 0, "\xff\xd8\xff"))
        return jpeg_header(data);
    if (has_bytes(data, 0, "RIFF") && has_bytes(data, 8, "WEBP"))
        return webp_header(data);
    return {};
}

} // namespace lpvbake::image
