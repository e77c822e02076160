#include "io/blocks.h"

#include <Imath/half.h>
#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake::io {
namespace {

/// How far each of 16 steps goes from one end to the other, in 64ths.
constexpr int steps[16] = {0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64};

using Ends = std::array<std::array<int, 3>, 2>; ///< in the numbers of a mode
using Indices = std::array<int, block_texels>;
using Palette = std::array<glm::vec3, 16>;

/// The ends of a line through the colours, where they are looked for.
struct Line {
    glm::dvec3 from{0.0}, to{0.0};
};

struct Choice {
    Ends ends{};
    Indices indices{};
    double error = std::numeric_limits<double>::infinity();
    int mode = 0;
};

/// Along the axis of the largest variance, from the first colour to the last.
Line principal_line(const std::array<glm::dvec3, block_texels>& at, const Block& weights) {
    glm::dvec3 mean(0.0), sum(0.0);
    for (size_t i = 0; i < block_texels; ++i) {
        mean += glm::dvec3(weights[i]) * at[i];
        sum += glm::dvec3(weights[i]);
    }
    mean /= glm::max(sum, 1e-300);
    std::array<glm::dvec3, 3> covariance{};
    for (size_t i = 0; i < block_texels; ++i) {
        const glm::dvec3 off = at[i] - mean;
        for (int c = 0; c < 3; ++c)
            covariance[size_t(c)] += double(weights[i][c]) * off[c] * off;
    }
    glm::dvec3 axis(1.0);
    for (int step = 0; step < 16; ++step) {
        const glm::dvec3 next =
            covariance[0] * axis.x + covariance[1] * axis.y + covariance[2] * axis.z;
        if (!(glm::length(next) > 0))
            break;
        axis = glm::normalize(next);
    }
    axis = glm::normalize(axis);
    double low = std::numeric_limits<double>::infinity(), high = -low;
    const float most = glm::length(
        *std::ranges::max_element(weights, {}, [](const glm::vec3& w) { return glm::length(w); }));
    for (size_t i = 0; i < block_texels; ++i)
        if (glm::length(weights[i]) > 1e-2f * most) {
            low = std::min(low, glm::dot(at[i] - mean, axis));
            high = std::max(high, glm::dot(at[i] - mean, axis));
        }
    return {mean + low * axis, mean + high * axis};
}

/// The line of least squares for given indices; a colour whose indices are all alike stays.
void refit(const std::array<glm::dvec3, block_texels>& at, const Block& weights,
           const Indices& indices, Line& line) {
    for (int c = 0; c < 3; ++c) {
        double ff = 0, ft = 0, tt = 0, f = 0, t = 0;
        for (size_t i = 0; i < block_texels; ++i) {
            const double to = steps[indices[i]] / 64.0, from = 1 - to, w = weights[i][c];
            ff += w * from * from;
            ft += w * from * to;
            tt += w * to * to;
            f += w * from * at[i][c];
            t += w * to * at[i][c];
        }
        const double determinant = ff * tt - ft * ft;
        if (!(determinant > 1e-9 * ff * tt))
            continue;
        line.from[c] = (f * tt - t * ft) / determinant;
        line.to[c] = (t * ff - f * ft) / determinant;
    }
}

/// The nearest of the palette for each texel.
void choose(const Block& colours, const Block& weights, const Palette& palette, Choice& choice) {
    choice.error = 0;
    for (size_t i = 0; i < block_texels; ++i) {
        double least = std::numeric_limits<double>::infinity();
        for (int step = 0; step < 16; ++step) {
            const glm::dvec3 off = glm::dvec3(palette[size_t(step)]) - glm::dvec3(colours[i]);
            const double error = glm::dot(glm::dvec3(weights[i]), off * off);
            if (error < least) {
                least = error;
                choice.indices[i] = step;
            }
        }
        choice.error += least;
    }
}

/// Fills 128 bits from the lowest.
class BitWriter {
public:
    void put(int value, int count) {
        for (int i = 0; i < count; ++i, ++at_)
            bytes_[size_t(at_) / 8] |= static_cast<unsigned char>((value >> i & 1) << at_ % 8);
    }
    /// From the highest bit of the number on.
    void put_reversed(int value, int count) {
        while (count-- > 0)
            put(value >> count, 1);
    }
    /// Indices of 4 bits, but for the first, whose highest is 0.
    void put(const Indices& indices) {
        for (size_t i = 0; i < block_texels; ++i)
            put(indices[i], i == 0 ? 3 : 4);
    }
    const BlockBytes& bytes() const { return bytes_; }

private:
    BlockBytes bytes_{};
    int at_ = 0;
};

class BitReader {
public:
    explicit BitReader(std::string_view bytes) : bytes_(bytes) {}
    int get(int count) {
        int value = 0;
        for (int i = 0; i < count; ++i, ++at_)
            value |= (static_cast<unsigned char>(bytes_[size_t(at_) / 8]) >> at_ % 8 & 1) << i;
        return value;
    }
    int get_reversed(int count) {
        int value = 0;
        while (count-- > 0)
            value = value << 1 | get(1);
        return value;
    }
    Block get(const Palette& palette) {
        Block block;
        for (size_t i = 0; i < block_texels; ++i)
            block[i] = palette[size_t(get(i == 0 ? 3 : 4))];
        return block;
    }

private:
    std::string_view bytes_;
    int at_ = 0;
};

/// Turns a line round so that the highest bit of the first index is 0.
void orient(Choice& choice) {
    if (choice.indices[0] < 8)
        return;
    std::swap(choice.ends[0], choice.ends[1]);
    for (int& index : choice.indices)
        index = 15 - index;
}

// ---------------------------------------------------------------- BC6H

/// A mode of one region: its 5 bits, and the bits of the first end and of the second, which but in
/// the first mode is a difference from that.
struct HdrMode {
    int number, bits, second;
};
constexpr HdrMode hdr_modes[] = {{3, 10, 10}, {7, 11, 9}, {11, 12, 8}, {15, 16, 4}};

/// Interpolation is in 16 bits that are proportional to the bits of a half.
double to_hdr(float value) {
    return Imath::half(std::clamp(value, 0.0f, 65504.0f)).bits() * 64.0 / 31;
}

float from_hdr(int value) {
    Imath::half half;
    half.setBits(static_cast<unsigned short>(value * 31 >> 6));
    return half;
}

int unquantized(int value, int bits) {
    if (bits >= 15 || value == 0)
        return value;
    return value == (1 << bits) - 1 ? 0xffff : ((value << 16) + 0x8000) >> bits;
}

Palette hdr_palette(const Ends& ends, int bits) {
    Palette palette;
    for (size_t step = 0; step < 16; ++step)
        for (size_t c = 0; c < 3; ++c)
            palette[step][glm::length_t(c)] =
                from_hdr((unquantized(ends[0][c], bits) * (64 - steps[step])
                          + unquantized(ends[1][c], bits) * steps[step] + 32)
                         >> 6);
    return palette;
}

Ends hdr_ends(const Line& line, int bits) {
    Ends ends;
    for (size_t e = 0; e < 2; ++e)
        for (size_t c = 0; c < 3; ++c) {
            const double at = (e == 0 ? line.from : line.to)[glm::length_t(c)];
            ends[e][c] = std::clamp(int(std::clamp(at, 0.0, 65535.0) * (1 << bits) / 65536), 0,
                                    (1 << bits) - 1);
        }
    return ends;
}

/// Whether the second end can be told from the first.
bool fits(const Ends& ends, const HdrMode& mode) {
    if (mode.bits == mode.second)
        return true;
    const int most = 1 << (mode.second - 1);
    for (size_t c = 0; c < 3; ++c)
        if (const int way = ends[1][c] - ends[0][c]; way < -most || way >= most)
            return false;
    return true;
}

// ---------------------------------------------------------------- BC7

/// Mode 6: ends of 7 bits and one that an end's colours share, the lowest.
Palette ldr_palette(const Ends& ends) {
    Palette palette;
    for (size_t step = 0; step < 16; ++step)
        for (size_t c = 0; c < 3; ++c)
            palette[step][glm::length_t(c)] =
                float((ends[0][c] * (64 - steps[step]) + ends[1][c] * steps[step] + 32) >> 6) / 255;
    return palette;
}

Ends ldr_ends(const Line& line, int shared) {
    Ends ends;
    for (size_t e = 0; e < 2; ++e)
        for (size_t c = 0; c < 3; ++c) {
            const int lowest = shared >> e & 1;
            const double at = 255 * (e == 0 ? line.from : line.to)[glm::length_t(c)];
            ends[e][c] = 2 * int(std::lround(std::clamp((at - lowest) / 2, 0.0, 127.0))) + lowest;
        }
    return ends;
}

} // namespace

BlockBytes encode_bc6h(const Block& colours, const Block& weights) {
    std::array<glm::dvec3, block_texels> at;
    Block slopes; // what an error where the line is costs in light
    for (size_t i = 0; i < block_texels; ++i)
        for (int c = 0; c < 3; ++c) {
            at[i][c] = to_hdr(colours[i][c]);
            slopes[i][c] = weights[i][c] * std::max(colours[i][c] * colours[i][c], 1e-9f);
        }
    Line line = principal_line(at, slopes);
    Choice best;
    for (int round = 0; round < 4; ++round) {
        Choice nearest;
        for (const HdrMode& mode : hdr_modes) {
            Choice choice;
            choice.ends = hdr_ends(line, mode.bits);
            choice.mode = int(&mode - hdr_modes);
            choose(colours, weights, hdr_palette(choice.ends, mode.bits), choice);
            orient(choice);
            if (choice.error < nearest.error && fits(choice.ends, mode))
                nearest = choice;
        }
        if (nearest.error < best.error)
            best = nearest;
        refit(at, slopes, nearest.indices, line);
    }
    const HdrMode& mode = hdr_modes[best.mode];
    BitWriter bits;
    bits.put(mode.number, 5);
    for (size_t c = 0; c < 3; ++c)
        bits.put(best.ends[0][c], 10);
    for (size_t c = 0; c < 3; ++c) {
        bits.put(mode.bits == mode.second ? best.ends[1][c] : best.ends[1][c] - best.ends[0][c],
                 mode.second);
        bits.put_reversed(best.ends[0][c] >> 10, mode.bits - 10);
    }
    bits.put(best.indices);
    return bits.bytes();
}

std::optional<Block> decode_bc6h(std::string_view bytes) {
    BitReader bits(bytes);
    const int number = bits.get(5);
    const HdrMode* mode = std::ranges::find(hdr_modes, number, &HdrMode::number);
    if (mode == std::end(hdr_modes))
        return {};
    Ends ends;
    for (size_t c = 0; c < 3; ++c)
        ends[0][c] = bits.get(10);
    for (size_t c = 0; c < 3; ++c) {
        ends[1][c] = bits.get(mode->second);
        ends[0][c] |= bits.get_reversed(mode->bits - 10) << 10;
        if (mode->bits != mode->second) {
            const int sign = 1 << (mode->second - 1);
            ends[1][c] = (ends[0][c] + (ends[1][c] ^ sign) - sign) & ((1 << mode->bits) - 1);
        }
    }
    return bits.get(hdr_palette(ends, mode->bits));
}

BlockBytes encode_bc7(const Block& colours, const Block& weights) {
    std::array<glm::dvec3, block_texels> at;
    std::ranges::copy(colours, at.begin());
    Line line = principal_line(at, weights);
    Choice best;
    for (int round = 0; round < 4; ++round) {
        Choice nearest;
        for (int shared = 0; shared < 4; ++shared) {
            Choice choice;
            choice.ends = ldr_ends(line, shared);
            choose(colours, weights, ldr_palette(choice.ends), choice);
            if (choice.error < nearest.error)
                nearest = choice;
        }
        if (nearest.error < best.error)
            best = nearest;
        refit(at, weights, nearest.indices, line);
    }
    orient(best);
    BitWriter bits;
    bits.put(1 << 6, 7);
    for (size_t c = 0; c < 3; ++c)
        for (size_t e = 0; e < 2; ++e)
            bits.put(best.ends[e][c] >> 1, 7);
    bits.put(127, 7); // alpha, which nobody reads
    bits.put(127, 7);
    for (size_t e = 0; e < 2; ++e)
        bits.put(best.ends[e][0] & 1, 1);
    bits.put(best.indices);
    return bits.bytes();
}

std::optional<Block> decode_bc7(std::string_view bytes) {
    BitReader bits(bytes);
    if (bits.get(7) != 1 << 6)
        return {};
    Ends ends;
    for (size_t c = 0; c < 3; ++c)
        for (size_t e = 0; e < 2; ++e)
            ends[e][c] = bits.get(7) << 1;
    bits.get(14);
    for (size_t e = 0; e < 2; ++e) {
        const int lowest = bits.get(1);
        for (int& end : ends[e])
            end |= lowest;
    }
    return bits.get(ldr_palette(ends));
}

} // namespace lpvbake::io
