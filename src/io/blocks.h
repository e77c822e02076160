// Block compression of GPUs: 4 x 4 texels of three colours in 16 bytes (Khronos Data Format
// Specification 1.3, sections BC6H and BC7; Direct3D 11 has the same).
#pragma once

#include <glm/vec3.hpp>

#include <array>
#include <optional>
#include <string_view>

namespace lpvbake::io {

constexpr int block_side = 4;
constexpr size_t block_texels = 16, block_bytes = 16;

/// Texels row by row.
using Block = std::array<glm::vec3, block_texels>;
using BlockBytes = std::array<unsigned char, block_bytes>;

/// BC6H_UF16: colours from 0 to 65504. Written are its modes of one region, the best of them;
/// `weights` say how much a squared error of each colour of a texel counts, at least one above 0.
BlockBytes encode_bc6h(const Block& colours, const Block& weights);

/// BC7: colours from 0 to 1, no alpha. Written is mode 6.
BlockBytes encode_bc7(const Block& colours, const Block& weights);

/// Of what is written here; none: another mode.
std::optional<Block> decode_bc6h(std::string_view bytes);
std::optional<Block> decode_bc7(std::string_view bytes);

} // namespace lpvbake::io
