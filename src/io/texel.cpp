#include "io/texel.h"

#include "io/blocks.h"
#include "io/stored.h"

#include <Imath/half.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

namespace lpvbake::io {
namespace {

/// Numbers of the formats R32F, R16F, RGBA32F, RGBA16F, RGB9E5, RGBA8, BC6H_UF16 and BC7: Vulkan's
/// enumeration of formats; DXGI_FORMAT of dxgiformat.h.
constexpr TexelForm forms[] = {
    {Coding::full, 1, 100, 41}, {Coding::half, 1, 76, 54},    {Coding::full, 4, 109, 2},
    {Coding::half, 4, 97, 10},  {Coding::rgb9e5, 3, 123, 67}, {Coding::unorm8, 4, 37, 28},
    {Coding::bc6h, 3, 143, 95}, {Coding::bc7, 3, 145, 98},
};

/// 9 bits of each of three colours and an exponent for all: the section "RGB to Shared Exponent
/// Conversion" of the Vulkan specification.
uint32_t to_rgb9e5(const float* rgb) {
    constexpr int mantissa = 9, bias = 15;
    constexpr float largest = 65408; // (2^9 - 1) / 2^9 * 2^(31 - 15)
    float c[3];
    for (int i = 0; i < 3; ++i)
        c[i] = std::clamp(rgb[i], 0.0f, largest);
    const float most = std::max({c[0], c[1], c[2]});
    int exponent = (most > 0 ? std::max(-bias - 1, std::ilogb(most)) : -bias - 1) + 1 + bias;
    const auto scaled = [&](float x) {
        return uint32_t(std::floor(std::ldexp(x, bias + mantissa - exponent) + 0.5f));
    };
    if (scaled(most) == 1u << mantissa)
        ++exponent;
    return scaled(c[0]) | scaled(c[1]) << 9 | scaled(c[2]) << 18 | uint32_t(exponent) << 27;
}

/// Calls visit(block, at, sample) for the texels of each block: the first sample of a texel, that
/// at the edge where the block reaches beyond.
template <class Visit>
void for_each_block_texel(glm::ivec3 dims, const Visit& visit) {
    size_t block = 0;
    for (int z = 0; z < dims.z; ++z)
        for (int y = 0; y < dims.y; y += block_side)
            for (int x = 0; x < dims.x; x += block_side, ++block)
                for (int i = 0; i < int(block_texels); ++i) {
                    const int u = x + i % block_side, v = y + i / block_side;
                    const size_t row = size_t(z * dims.y + std::min(v, dims.y - 1));
                    visit(block, size_t(i), row * size_t(dims.x) + size_t(std::min(u, dims.x - 1)),
                          u < dims.x && v < dims.y);
                }
}

std::string pack_blocks(const image::Pixels& pixels, const TexelForm& form, glm::ivec3 dims,
                        const std::vector<float>& weights) {
    std::vector<std::pair<Block, Block>> blocks(form.size(dims) / block_bytes);
    for_each_block_texel(dims, [&](size_t block, size_t i, size_t texel, bool) {
        for (size_t c = 0; c < 3; ++c) {
            blocks[block].first[i][glm::length_t(c)] = pixels.samples[3 * texel + c];
            blocks[block].second[i][glm::length_t(c)] =
                weights.empty() ? 1.0f : weights[3 * texel + c];
        }
    });
    std::string bytes(blocks.size() * block_bytes, '\0');
    tbb::parallel_for(size_t(0), blocks.size(), [&](size_t b) {
        const auto& [colours, counts] = blocks[b];
        const BlockBytes encoded =
            form.coding == Coding::bc7 ? encode_bc7(colours, counts) : encode_bc6h(colours, counts);
        std::ranges::copy(encoded, bytes.begin() + std::ptrdiff_t(b * block_bytes));
    });
    return bytes;
}

void unpack_blocks(std::string_view bytes, const TexelForm& form, glm::ivec3 dims,
                   image::Pixels& pixels) {
    Block colours;
    for_each_block_texel(dims, [&](size_t block, size_t i, size_t texel, bool is_inside) {
        if (i == 0) {
            const std::string_view own = bytes.substr(block * block_bytes, block_bytes);
            const auto known = form.coding == Coding::bc7 ? decode_bc7(own) : decode_bc6h(own);
            if (!known)
                colours.fill(glm::vec3(std::numeric_limits<float>::quiet_NaN()));
            else
                colours = *known;
        }
        for (size_t c = 0; c < 3 && is_inside; ++c)
            pixels.samples[3 * texel + c] = colours[i][glm::length_t(c)];
    });
}

void from_rgb9e5(uint32_t bits, float* rgb) {
    for (int i = 0; i < 3; ++i)
        rgb[i] = std::ldexp(float(bits >> 9 * i & 511), int(bits >> 27) - 15 - 9);
}

} // namespace

size_t TexelForm::bytes() const {
    return is_block() ? block_bytes : coding == Coding::rgb9e5 ? 4 : size_t(channels) * scalar();
}

size_t TexelForm::scalar() const {
    return is_block() || coding == Coding::unorm8 ? 1 : coding == Coding::half ? 2 : 4;
}

glm::ivec3 TexelForm::whole(glm::ivec3 dims) const {
    const auto up = [](int side) { return (side + block_side - 1) / block_side * block_side; };
    return is_block() ? glm::ivec3(up(dims.x), up(dims.y), dims.z) : dims;
}

size_t TexelForm::size(glm::ivec3 dims) const {
    const glm::ivec3 all = whole(dims);
    return size_t(all.x) * size_t(all.y) * size_t(all.z) / (is_block() ? block_texels : 1)
           * bytes();
}

const TexelForm& form_of(const Texture& texture, Precision precision) {
    const bool is_light = texture.kind == &volume::light_kind(),
               is_plain = texture.is_plain_colour(),
               is_shadow = texture.kind == &volume::kind_named("shadow");
    Coding coding = precision == Precision::full ? Coding::full : Coding::half;
    if (precision == Precision::bc6h && (is_light || is_plain))
        coding = is_light ? Coding::bc7 : Coding::bc6h;
    else if (is_plain && (precision == Precision::rgb9e5 || precision == Precision::unorm8))
        coding = Coding::rgb9e5;
    else if ((is_light || is_shadow) && precision == Precision::unorm8)
        coding = Coding::unorm8;
    return *std::ranges::find_if(forms, [&](const TexelForm& form) {
        return form.coding == coding
               && (form.channels == 3 || form.channels == (texture.channels() == 1 ? 1 : 4)
                   || coding == Coding::unorm8);
    });
}

const TexelForm* form_numbered(uint32_t TexelForm::*number, uint32_t value) {
    const auto found = std::ranges::find(forms, value, number);
    return found == std::end(forms) ? nullptr : found;
}

bool holds(const TexelForm& form, size_t channels) {
    return channels == size_t(form.channels) || (form.channels == 4 && channels == 3);
}

std::string pack(const image::Pixels& pixels, const TexelForm& form, glm::ivec3 dims,
                 const std::vector<float>& weights) {
    if (form.is_block())
        return pack_blocks(pixels, form, dims, weights);
    const size_t texels = size_t(pixels.width) * size_t(pixels.height),
                 channels = size_t(pixels.channels);
    std::string bytes;
    bytes.reserve(form.size(dims));
    for (size_t t = 0; t < texels; ++t) {
        const float* from = &pixels.samples[t * channels];
        if (form.coding == Coding::rgb9e5) {
            append_number(bytes, to_rgb9e5(from));
            continue;
        }
        for (size_t c = 0; c < size_t(form.channels); ++c) {
            const float value = c < channels ? from[c] : 1.0f;
            if (form.coding == Coding::unorm8)
                append_number(bytes, uint8_t(std::lround(255 * std::clamp(value, 0.0f, 1.0f))));
            else if (form.coding == Coding::half)
                append_number(bytes, Imath::half(value).bits());
            else
                append_number(bytes, std::bit_cast<uint32_t>(value));
        }
    }
    return bytes;
}

image::Pixels unpack(std::string_view bytes, const TexelForm& form, glm::ivec3 dims,
                     size_t channels) {
    image::Pixels pixels{dims.x, dims.y * dims.z, int(channels), {}};
    const size_t texels = size_t(pixels.width) * size_t(pixels.height);
    pixels.samples.resize(texels * channels);
    if (form.is_block())
        unpack_blocks(bytes, form, dims, pixels);
    for (size_t t = 0; t < texels && !form.is_block(); ++t) {
        const size_t first = t * form.bytes();
        float* to = &pixels.samples[t * channels];
        if (form.coding == Coding::rgb9e5) {
            from_rgb9e5(number_at<uint32_t>(bytes, first), to);
            continue;
        }
        for (size_t c = 0; c < channels; ++c)
            if (form.coding == Coding::unorm8) {
                to[c] = float(number_at<uint8_t>(bytes, first + c)) / 255;
            } else if (form.coding == Coding::half) {
                Imath::half value;
                value.setBits(number_at<uint16_t>(bytes, first + 2 * c));
                to[c] = value;
            } else {
                to[c] = std::bit_cast<float>(number_at<uint32_t>(bytes, first + 4 * c));
            }
    }
    return pixels;
}

} // namespace lpvbake::io
