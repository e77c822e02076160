#include "reference/sampler.h"

#include <algorithm>

namespace lpvbake::reference {
namespace {

uint32_t reverse_bits(uint32_t x) {
    x = (x & 0x55555555u) << 1 | (x >> 1 & 0x55555555u);
    x = (x & 0x33333333u) << 2 | (x >> 2 & 0x33333333u);
    x = (x & 0x0f0f0f0fu) << 4 | (x >> 4 & 0x0f0f0f0fu);
    return __builtin_bswap32(x);
}

/// Flips each bit depending on the bits above it alone, by Laine and Karras' hash of the reversed
/// word; `x` is given and returned reversed.
uint32_t scramble_reversed(uint32_t x, uint32_t seed) {
    x += seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    return x ^ x * 0x8d22f6e6u;
}

uint32_t scramble(uint32_t x, uint32_t seed) {
    return reverse_bits(scramble_reversed(reverse_bits(x), seed));
}

/// The second dimension of Sobol's sequence: row r of its matrix is row r - 1 times (1 + x).
uint32_t sobol_second(uint32_t index) {
    uint32_t result = 0;
    for (uint32_t row = 1u << 31; index != 0; index >>= 1, row ^= row >> 1)
        if (index & 1)
            result ^= row;
    return result;
}

} // namespace

std::vector<std::size_t> valid_cells(std::span<const float> validity) {
    std::vector<std::size_t> cells;
    for (std::size_t i = 0; i < validity.size(); ++i)
        if (validity[i] > 0.0f)
            cells.push_back(i);
    return cells;
}

std::vector<std::size_t> sample_cells(std::vector<std::size_t> cells, uint64_t count,
                                      uint64_t key) {
    if (count >= cells.size())
        return cells;
    std::ranges::nth_element(cells, cells.begin() + std::ptrdiff_t(count), {},
                             [&](std::size_t cell) { return mix_bits(key + cell); });
    cells.resize(std::size_t(count));
    std::ranges::sort(cells);
    return cells;
}

glm::dvec2 PathSampler::pair() {
    const uint64_t seeds = join_bits(key_, drawn_++);
    const uint64_t more = mix_bits(seeds);
    const uint32_t index = scramble(index_, uint32_t(more));
    // The first dimension is the index reversed: scrambled, it need not be reversed twice.
    const uint32_t x = reverse_bits(scramble_reversed(index, uint32_t(seeds)));
    const uint32_t y = scramble(sobol_second(index), uint32_t(seeds >> 32));
    return {x * 0x1p-32, y * 0x1p-32};
}

double PathSampler::plain() {
    return double(join_bits(join_bits(key_, drawn_++), index_) >> 11) * 0x1p-53;
}

} // namespace lpvbake::reference
