// Bytes as text.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>

namespace lpvbake {

/// RFC 4648, with padding.
inline std::string base64(std::string_view bytes) {
    constexpr const char* digits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t group = 0;
        const std::size_t have = std::min<std::size_t>(3, bytes.size() - i);
        for (std::size_t j = 0; j < 3; ++j)
            group = group << 8 | (j < have ? static_cast<unsigned char>(bytes[i + j]) : 0u);
        for (std::size_t j = 0; j < 4; ++j)
            text += j <= have ? digits[group >> (18 - 6 * j) & 63] : '=';
    }
    return text;
}

} // namespace lpvbake
