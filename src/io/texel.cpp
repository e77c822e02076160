#include "io/texel.h"

#include "io/stored.h"

#include <Imath/half.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace lpvbake::io {
namespace {

/// Numbers of the formats R32F, R16F, RGBA32F, RGBA16F, RGB9E5 and RGBA8: Vulkan's enumeration of
/// formats; DXGI_FORMAT of dxgiformat.h.
constexpr TexelForm forms[] = {
    {Precision::full, 1, 100, 41}, {Precision::half, 1, 76, 54},    {Precision::full, 4, 109, 2},
    {Precision::half, 4, 97, 10},  {Precision::rgb9e5, 3, 123, 67}, {Precision::unorm8, 4, 37, 28},
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

void from_rgb9e5(uint32_t bits, float* rgb) {
    for (int i = 0; i < 3; ++i)
        rgb[i] = std::ldexp(float(bits >> 9 * i & 511), int(bits >> 27) - 15 - 9);
}

} // namespace

const TexelForm& form_of(const Texture& texture, Precision precision) {
    if (has_ratios(precision) && texture.kind == &volume::light_kind()) {
        if (texture.is_plain_colour())
            precision = Precision::rgb9e5;
    } else if (precision != Precision::full && !texture.is_plain_colour()) {
        precision = Precision::half;
    }
    const int channels = precision == Precision::rgb9e5 ? 3 : texture.channels() == 1 ? 1 : 4;
    return *std::ranges::find_if(forms, [&](const TexelForm& form) {
        return form.precision == precision && form.channels == channels;
    });
}

const TexelForm* form_numbered(uint32_t TexelForm::*number, uint32_t value) {
    const auto found = std::ranges::find(forms, value, number);
    return found == std::end(forms) ? nullptr : found;
}

bool holds(const TexelForm& form, size_t channels) {
    return channels == size_t(form.channels) || (form.channels == 4 && channels == 3);
}

std::string pack(const image::Pixels& pixels, const TexelForm& form) {
    const size_t texels = size_t(pixels.width) * size_t(pixels.height),
                 channels = size_t(pixels.channels);
    std::string bytes;
    bytes.reserve(texels * form.bytes());
    for (size_t t = 0; t < texels; ++t) {
        const float* from = &pixels.samples[t * channels];
        if (form.precision == Precision::rgb9e5) {
            append_number(bytes, to_rgb9e5(from));
            continue;
        }
        for (size_t c = 0; c < size_t(form.channels); ++c) {
            const float value = c < channels ? from[c] : 1.0f;
            if (form.precision == Precision::unorm8)
                append_number(bytes, uint8_t(std::lround(255 * std::clamp(value, 0.0f, 1.0f))));
            else if (form.precision == Precision::half)
                append_number(bytes, Imath::half(value).bits());
            else
                append_number(bytes, std::bit_cast<uint32_t>(value));
        }
    }
    return bytes;
}

image::Pixels unpack(std::string_view bytes, const TexelForm& form, int width, int height,
                     size_t channels) {
    image::Pixels pixels{width, height, int(channels), {}};
    const size_t texels = size_t(width) * size_t(height);
    pixels.samples.resize(texels * channels);
    for (size_t t = 0; t < texels; ++t) {
        const size_t first = t * form.bytes();
        float* to = &pixels.samples[t * channels];
        if (form.precision == Precision::rgb9e5) {
            from_rgb9e5(number_at<uint32_t>(bytes, first), to);
            continue;
        }
        for (size_t c = 0; c < channels; ++c)
            if (form.precision == Precision::unorm8) {
                to[c] = float(number_at<uint8_t>(bytes, first + c)) / 255;
            } else if (form.precision == Precision::half) {
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
