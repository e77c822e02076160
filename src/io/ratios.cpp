#include "io/ratios.h"

#include "io/stored.h"
#include "volume/compare.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::io {
namespace {

/// What coefficient 0 is stored in units of.
float unit_of(const std::vector<glm::vec3>& mean) {
    constexpr float most = 32768;
    float largest = 0;
    for (const glm::vec3& colour : mean)
        largest = std::max({largest, colour.r, colour.g, colour.b});
    return largest == 0 || (largest <= most && largest >= 1)
               ? 1.0f
               : std::ldexp(1.0f, std::ilogb(largest / most) + 1);
}

/// Each value with the light that it is of.
using Weighted = std::vector<std::pair<float, float>>;

/// The end of a range that clips `share` of the light above it; of values in descending order.
float quantile(const Weighted& values, double share) {
    double left = 0;
    for (const auto& [value, weight] : values)
        left += weight;
    left *= share;
    for (const auto& [value, weight] : values)
        if ((left -= weight) < 0)
            return value;
    return values.empty() ? 0.0f : values.back().first;
}

/// Rounding to 255 steps is off by a quarter of a step in the mean, clipping by the way to the end:
/// the sum of both is least where 1 of 4 x 255 of the light lies beyond either end.
Range best_range(Weighted values) {
    constexpr double share = 1.0 / (4 * 255);
    std::ranges::sort(values);
    const float low = quantile(values, share);
    std::ranges::reverse(values);
    return {low, quantile(values, share)};
}

/// The light of a volume with its validity, no other grids.
Volume light_of(const Volume& volume) {
    Volume light;
    light.grid = volume.grid;
    light.sh_order = volume.sh_order;
    light.sh = volume.sh;
    light.validity = volume.validity;
    return light;
}

/// What a texture unit makes of the cells in the middle between eight; valid where all are.
Volume between(const Volume& cells) {
    Volume middle;
    middle.grid = cells.grid;
    middle.grid.dims = glm::max(cells.grid.dims - 1, 1);
    middle.sh_order = cells.sh_order;
    middle.sh.assign(cells.sh.size(), std::vector<glm::vec3>(middle.grid.size()));
    middle.validity.assign(middle.grid.size(), 1.0f);
    for (size_t i = 0; i < middle.grid.size(); ++i)
        for (int corner = 0; corner < 8; ++corner) {
            const glm::ivec3 step(corner & 1, corner >> 1 & 1, corner >> 2);
            const size_t cell =
                cells.grid.index(glm::min(middle.grid.cell_at(i) + step, cells.grid.dims - 1));
            for (size_t k = 0; k < cells.sh.size(); ++k)
                middle.sh[k][i] += 0.125f * cells.sh[k][cell];
            if (!cells.validity.empty() && cells.validity[cell] == 0)
                middle.validity[i] = 0;
        }
    return middle;
}

double difference(Volume is, Volume was, const volume::Encoding& encoding) {
    decode(encoding, "", is);
    decode(encoding, "", was);
    return volume::compare(is, was, {{}, 0}).relative_l1;
}

} // namespace

Ranges to_ratios(const TexelForm& form, Volume& stored) {
    std::vector<glm::vec3>& mean = stored.sh[0];
    const float unit = unit_of(mean);
    image::Pixels pixels{int(mean.size()), 1, 3, {}};
    for (const glm::vec3& colour : mean)
        for (glm::length_t c = 0; c < 3; ++c)
            pixels.samples.push_back(std::max(0.0f, colour[c] / unit));
    pixels = unpack(pack(pixels, form), form, pixels.width, 1, 3);
    for (size_t cell = 0; cell < mean.size(); ++cell)
        mean[cell] = {pixels.samples[3 * cell], pixels.samples[3 * cell + 1],
                      pixels.samples[3 * cell + 2]};
    Ranges ranges(stored.sh.size());
    ranges[0].fill({0, unit});
    tbb::parallel_for(size_t(3), 3 * stored.sh.size(), [&](size_t i) {
        const size_t k = i / 3;
        const auto c = glm::length_t(i % 3);
        Weighted values;
        values.reserve(stored.grid.size());
        for (size_t cell = 0; cell < stored.grid.size(); ++cell)
            if (const float light = unit * mean[cell][c]; light > 0)
                values.emplace_back(stored.sh[k][cell][c] / light, light);
        const Range range = best_range(std::move(values));
        ranges[k][size_t(c)] = range;
        const float width = range.high - range.low;
        for (size_t cell = 0; cell < stored.grid.size(); ++cell) {
            const float light = unit * mean[cell][c];
            float& value = stored.sh[k][cell][c];
            const float ratio = light > 0 ? value / light : 0.0f;
            value = width > 0 ? std::clamp((ratio - range.low) / width, 0.0f, 1.0f) : 0.0f;
        }
    });
    return ranges;
}

void from_ratios(const Ranges& ranges, Volume& stored) {
    for (size_t k = stored.sh.size(); k-- > 0;)
        for (size_t cell = 0; cell < stored.grid.size(); ++cell)
            for (size_t c = 0; c < 3; ++c) {
                const auto [low, high] = ranges[k][c];
                float& value = stored.sh[k][cell][glm::length_t(c)];
                value = low + (high - low) * value;
            }
    for (size_t k = 1; k < stored.sh.size(); ++k)
        for (size_t cell = 0; cell < stored.grid.size(); ++cell)
            stored.sh[k][cell] *= stored.sh[0][cell];
}

PackingError packing_error(const Volume& stored, const volume::Encoding& encoding,
                           const Ranges& ranges, Volume packed) {
    PackingError error;
    Volume middle = between(packed);
    from_ratios(ranges, middle);
    error.filtered = difference(std::move(middle), between(stored), encoding);
    from_ratios(ranges, packed);
    error.cells = difference(light_of(packed), light_of(stored), encoding);
    return error;
}

} // namespace lpvbake::io
