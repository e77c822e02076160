// The transfer function of sRGB (IEC 61966-2-1).
#pragma once

#include <cmath>

namespace lpvbake {

/// Linear value in [0, 1] of an sRGB-encoded one in [0, 1].
inline double srgb_to_linear(double encoded) {
    return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

/// sRGB-encoded value in [0, 1] of a linear one in [0, 1].
inline double linear_to_srgb(double linear) {
    return linear <= 0.0031308 ? linear * 12.92 : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
}

} // namespace lpvbake
