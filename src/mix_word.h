// Bits that look random, from a counter.
#pragma once

#include <cstdint>

namespace lpvbake {

/// A bijection of 32-bit words that spreads every bit evenly (Wellons' lowbias32 constants).
constexpr uint32_t mix_word(uint32_t x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

} // namespace lpvbake
