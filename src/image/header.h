// What the first bytes of an image tell: enough to refuse it before memory is taken.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace lpvbake::image {

struct ImageHeader {
    const char* format = nullptr; ///< OpenImageIO's name for PNG, JPEG or WebP; null: none of them
    uint64_t width = 0, height = 0; ///< 0 if they cannot be told

    uint64_t texels() const { return width * height; }
};

/// Reads the header of an image of which `data` are the first bytes. A JPEG's size comes after its
/// metadata.
ImageHeader read_image_header(std::span<const std::byte> data);

/// True if `magic` stands at offset `at`.
bool has_bytes(std::span<const std::byte> data, size_t at, std::string_view magic);

/// `bytes` bytes at offset `at`; those past the end count as 0.
uint64_t big_endian(std::span<const std::byte> data, size_t at, int bytes);

} // namespace lpvbake::image
