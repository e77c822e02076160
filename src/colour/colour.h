// Colours: the transfer function of sRGB (IEC 61966-2-1), and luminance by Rec. 709.
#pragma once

#include <glm/glm.hpp>

#include <array>
#include <cmath>
#include <cstddef>

namespace lpvbake::colour {

/// Luminance of linear Rec. 709 RGB is the dot product with this.
inline constexpr glm::dvec3 rec709_luminance{0.2126, 0.7152, 0.0722};

/// Linear value in [0, 1] of an sRGB-encoded one in [0, 1].
inline double srgb_to_linear(double encoded) {
    return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

/// Linear values in [0, 1], by stored 8-bit value.
inline const std::array<float, 256>& linear_values() {
    static const std::array<float, 256> table = [] {
        std::array<float, 256> values;
        for (std::size_t i = 0; i < values.size(); ++i)
            values[i] = static_cast<float>(srgb_to_linear(static_cast<double>(i) / 255.0));
        return values;
    }();
    return table;
}

/// sRGB-encoded value in [0, 1] of a linear one in [0, 1].
inline double linear_to_srgb(double linear) {
    return linear <= 0.0031308 ? linear * 12.92 : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
}

} // namespace lpvbake::colour
