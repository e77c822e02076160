// Random numbers of a path: counters in, numbers out, so that any thread may draw any of them.
#pragma once

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::reference {

/// A bijection of 64-bit words that spreads every bit (Stafford's variant 13 of MurmurHash3's
/// finaliser, as in splitmix64).
constexpr uint64_t mix_bits(uint64_t x) {
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

/// A key that depends on both, in this order.
constexpr uint64_t join_bits(uint64_t a, uint64_t b) {
    return mix_bits(mix_bits(a + 0x9e3779b97f4a7c15u) + b);
}

/// `count` of the cells in rising order, all where there are no more: those of the lowest ranks,
/// which are mix_bits(key + cell), a bijection, so that none are equal.
std::vector<std::size_t> sample_cells(std::vector<std::size_t> cells, uint64_t count, uint64_t key);

/// The cells whose validity is above 0, rising.
std::vector<std::size_t> valid_cells(std::span<const float> validity);

/// The points of one path: sample `index` of the sequence `key`. Every pair that is drawn belongs
/// to a (0,2)-sequence over the indices of its own (Sobol's first two dimensions), which is
/// shuffled and Owen-scrambled by hashing (Burley 2020, "Practical Hash-based Owen Scrambling"), so
/// that each pair is uniform over [0, 1)^2, the first 2^k points are stratified in all elementary
/// intervals, and pairs of a path and sequences of different keys are independent.
class PathSampler {
public:
    PathSampler(uint64_t key, uint32_t index) : key_(key), index_(index) {}
    /// The path's next pair.
    glm::dvec2 pair();
    /// A number in [0, 1) that is not stratified.
    double plain();

private:
    uint64_t key_;
    uint32_t index_;
    uint64_t drawn_ = 0;
};

} // namespace lpvbake::reference
