#include "raster/mips.h"

#include "colour/colour.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::raster {

namespace {

/// Source texels under one target texel along an axis, and how much of each.
struct Taps {
    int first = 0;
    std::vector<float> weights; ///< sum 1
};

/// Halving n rounds down, so a target texel covers two to three source texels.
std::vector<Taps> taps_of(int source, int target) {
    std::vector<Taps> taps(target);
    for (int64_t i = 0; i < target; ++i) {
        // In units of 1/target of a source texel, target texel i spans [i, i + 1] * source.
        const int64_t lo = i * source, hi = lo + source;
        taps[i].first = int(lo / target);
        for (int64_t t = lo / target; t * target < hi; ++t)
            taps[i].weights.push_back(
                float(std::min(hi, (t + 1) * target) - std::max(lo, t * target)) / float(source));
    }
    return taps;
}

/// The code whose linear value is nearest.
uint8_t encode(float value, const std::array<float, 256>& linear) {
    const auto above = std::lower_bound(linear.begin() + 1, linear.end() - 1, value);
    return uint8_t(above - linear.begin() - (value - above[-1] < above[0] - value ? 1 : 0));
}

Image halved(const Image& image, bool weighted, const std::array<float, 256>& linear) {
    Image half;
    half.width = std::max(image.width / 2, 1);
    half.height = std::max(image.height / 2, 1);
    half.rgba.resize(std::size_t(half.width) * half.height * 4);
    const auto columns = taps_of(image.width, half.width),
               rows = taps_of(image.height, half.height);
    tbb::parallel_for(0, half.height, [&](int y) {
        for (int x = 0; x < half.width; ++x) {
            glm::vec3 color(0), shown(0);
            float alpha = 0;
            for (std::size_t j = 0; j < rows[y].weights.size(); ++j)
                for (std::size_t i = 0; i < columns[x].weights.size(); ++i) {
                    const uint8_t* texel =
                        &image.rgba[4
                                    * (std::size_t(rows[y].first + int(j)) * image.width
                                       + columns[x].first + int(i))];
                    const float weight = rows[y].weights[j] * columns[x].weights[i];
                    const glm::vec3 value(linear[texel[0]], linear[texel[1]], linear[texel[2]]);
                    color += weight * value;
                    shown += weight * float(texel[3]) * value;
                    alpha += weight * float(texel[3]);
                }
            if (weighted && alpha > 0)
                color = shown / alpha;
            uint8_t* target = &half.rgba[4 * (std::size_t(y) * half.width + x)];
            for (int c = 0; c < 3; ++c)
                target[c] = encode(color[c], linear);
            target[3] = uint8_t(std::lround(alpha));
        }
    });
    return half;
}

} // namespace

std::vector<Image> mip_levels(const Image& image, int first, bool weighted) {
    const std::array<float, 256>& linear = colour::linear_values();
    std::vector<Image> levels{image};
    while (levels.back().width > 1 || levels.back().height > 1) {
        levels.push_back(halved(levels.back(), weighted, linear));
        if (first > 0) {
            levels.erase(levels.begin());
            --first;
        }
    }
    return levels;
}

} // namespace lpvbake::raster
