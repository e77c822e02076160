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

/// Empty: the volume has none.
std::vector<glm::vec3> base_of(const Volume& volume) {
    std::vector<glm::vec3> base;
    for (const volume::ConstGridView& grid : volume::grids_of(volume, base_kind))
        for (size_t cell = 0; cell < grid.cells; ++cell)
            base.emplace_back(grid.data[3 * cell], grid.data[3 * cell + 1],
                              grid.data[3 * cell + 2]);
    return base;
}

void set_base(const std::vector<glm::vec3>& base, Volume& volume) {
    volume::set_grids(volume, base_kind, 1);
    float* to = volume::grids_of(volume, base_kind)[0].data;
    for (const glm::vec3& colour : base)
        for (glm::length_t c = 0; c < 3; ++c)
            *to++ = colour[c];
}

/// What the form of its texture gives back of a mean, in units of `unit`.
std::vector<glm::vec3> rounded(const std::vector<glm::vec3>& mean, float unit,
                               const TexelForm& form, glm::ivec3 dims,
                               const std::vector<float>& weights) {
    image::Pixels pixels{dims.x, dims.y * dims.z, 3, {}};
    std::vector<float> counts;
    for (size_t cell = 0; cell < mean.size(); ++cell)
        for (glm::length_t c = 0; c < 3; ++c) {
            pixels.samples.push_back(std::max(0.0f, mean[cell][c] / unit));
            counts.push_back(weights[cell]);
        }
    pixels = unpack(pack(pixels, form, dims, counts), form, dims, 3);
    std::vector<glm::vec3> back;
    for (size_t cell = 0; cell < mean.size(); ++cell)
        back.emplace_back(pixels.samples[3 * cell], pixels.samples[3 * cell + 1],
                          pixels.samples[3 * cell + 2]);
    return back;
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
    const std::vector<glm::vec3> base = base_of(cells);
    std::vector<glm::vec3> middle_base(base.empty() ? 0 : middle.grid.size());
    for (size_t i = 0; i < middle.grid.size(); ++i)
        for (int corner = 0; corner < 8; ++corner) {
            const glm::ivec3 step(corner & 1, corner >> 1 & 1, corner >> 2);
            const size_t cell =
                cells.grid.index(glm::min(middle.grid.cell_at(i) + step, cells.grid.dims - 1));
            for (size_t k = 0; k < cells.sh.size(); ++k)
                middle.sh[k][i] += 0.125f * cells.sh[k][cell];
            if (!base.empty())
                middle_base[i] += 0.125f * base[cell];
            if (!cells.is_valid(cell))
                middle.validity[i] = 0;
        }
    if (!base.empty())
        set_base(middle_base, middle);
    return middle;
}

double difference(Volume is, Volume was, const volume::Encoding& encoding) {
    decode(encoding, "", is);
    decode(encoding, "", was);
    return volume::compare(is, was, {{}, 0}).relative_l1;
}

} // namespace

std::vector<float> cell_weights(const Volume& volume) {
    const bool all = volume.validity.empty() || volume.metadata.contains("fit")
                     || volume.metadata.contains("dilate");
    std::vector<float> weights(volume.grid.size(), 1.0f);
    for (size_t cell = 0; cell < weights.size() && !all; ++cell)
        if (volume.validity[cell] == 0)
            weights[cell] = 1e-3f;
    return weights;
}

Ranges to_ratios(const TexelForm& form, Volume& stored) {
    const std::vector<float> weights = cell_weights(stored);
    const float unit = unit_of(stored.sh[0]);
    const std::vector<glm::vec3> mean =
        rounded(stored.sh[0], unit, form, stored.grid.dims, weights);
    Ranges ranges(stored.sh.size());
    ranges[0].fill({0, unit});
    const size_t first = form.is_block() ? 0 : 1;
    tbb::parallel_for(3 * first, 3 * stored.sh.size(), [&](size_t i) {
        const size_t k = i / 3;
        const auto c = glm::length_t(i % 3);
        const auto light = [&](size_t cell) { return unit * mean[cell][c]; };
        const auto ratio = [&](size_t cell) {
            return light(cell) > 0 ? stored.sh[k][cell][c] / light(cell) : 0.0f;
        };
        Weighted values;
        values.reserve(mean.size());
        for (size_t cell = 0; cell < mean.size(); ++cell)
            if (light(cell) > 0)
                values.emplace_back(ratio(cell), light(cell) * weights[cell]);
        const Range range = best_range(std::move(values));
        const float width = range.high - range.low;
        for (size_t cell = 0; cell < mean.size(); ++cell)
            stored.sh[k][cell][c] =
                width > 0 ? std::clamp((ratio(cell) - range.low) / width, 0.0f, 1.0f) : 0.0f;
        const float scale = form.is_block() ? unit : 1.0f; // nothing else tells the base's
        ranges[k][size_t(c)] = {scale * range.low, scale * range.high};
    });
    if (!form.is_block()) {
        stored.sh[0] = mean;
        return ranges;
    }
    set_base(mean, stored);
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
    const std::vector<glm::vec3> base = base_of(stored), &over = base.empty() ? stored.sh[0] : base;
    for (size_t k = base.empty() ? 1 : 0; k < stored.sh.size(); ++k)
        for (size_t cell = 0; cell < stored.grid.size(); ++cell)
            stored.sh[k][cell] *= over[cell];
    volume::set_grids(stored, base_kind, 0);
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
