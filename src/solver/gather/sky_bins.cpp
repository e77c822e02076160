#include "solver/gather/sky_bins.h"

#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lpvbake::solver::gather {
namespace {

/// A side of the square of points that a bin is sampled at.
constexpr int samples = 4;

/// The bin's coefficients of a layer: of what it has of the sky, and of what is beyond that.
std::vector<float> layer_of(const SkyBin& bin, const scene::LightLayer& layer, double weight,
                            int order) {
    if (!layer.is_seen() && layer.sky == glm::vec3(0.0f))
        return {};
    const int own = layer.order.value_or(order);
    std::vector<double> sum(3 * size_t(volume::sh_count(own)), 0.0);
    for (size_t i = 0; i < std::min(sum.size(), bin.coefficients.size()); ++i)
        sum[i] = double(layer.sky[int(i % 3)]) * double(bin.coefficients[i]);
    for (int i = 0; layer.is_seen() && i < samples * samples; ++i) {
        const glm::vec3 w = bin.direction(
            {(float(i / samples) + 0.5f) / samples, (float(i % samples) + 0.5f) / samples});
        const glm::vec3 luminance = layer.beyond(w);
        const volume::ShValues y = volume::sh_basis(own, w);
        for (size_t k = 0; k < sum.size(); ++k)
            sum[k] += weight * double(luminance[int(k % 3)]) * double(y[k / 3]);
    }
    return {sum.begin(), sum.end()};
}

} // namespace

glm::vec3 SkyBin::direction(glm::vec2 u) const {
    const float y = glm::mix(low, high, u.x), angle = glm::mix(from, to, u.y);
    const float radius = std::sqrt(std::max(0.0f, 1.0f - y * y));
    return {radius * std::sin(angle), y, radius * std::cos(angle)};
}

std::vector<SkyBin> make_sky_bins(const Sky& sky, int count, int order,
                                  std::span<const scene::LightLayer> layers) {
    std::vector<SkyBin> bins;
    const float turn = 2.0f * glm::pi<float>();
    // Rings of equal steps in the angle from the pole, cut into about square bins; the heights
    // between them are then moved so that all bins have one solid angle.
    const int rings = std::max(2, int(std::lround(std::sqrt(count * glm::pi<double>() / 4.0))));
    std::vector<int> sectors;
    for (int i = 0; i < rings; ++i)
        sectors.push_back(std::max(
            3, int(std::lround(2.0 * rings * std::sin((i + 0.5) * glm::pi<double>() / rings)))));
    const int total = std::accumulate(sectors.begin(), sectors.end(), 0);
    int before = 0;
    for (const int n : sectors) {
        const float high = 1.0f - 2.0f * float(before) / float(total);
        before += n;
        const float low = 1.0f - 2.0f * float(before) / float(total);
        const float middle = 0.5f * (low + high), step = turn / float(2 * n);
        static_assert(sky_group == 4);
        for (int i = 0; i < 2 * n; i += 2)
            for (int k = i; k < i + 2; ++k) {
                bins.push_back({low, middle, step * float(k), step * float(k + 1), {}});
                bins.push_back({middle, high, step * float(k), step * float(k + 1), {}});
            }
    }
    tbb::parallel_for(size_t(0), bins.size(), [&](size_t i) {
        SkyBin& bin = bins[i];
        const auto terms = size_t(volume::sh_count(order));
        std::vector<double> sum(3 * terms, 0.0);
        for (int a = 0; a < samples; ++a)
            for (int b = 0; b < samples; ++b) {
                const glm::vec3 w =
                    bin.direction({(float(a) + 0.5f) / samples, (float(b) + 0.5f) / samples});
                const auto along = [](float begin, float end, int step) {
                    return glm::mix(double(begin), double(end), double(step) / samples);
                };
                const glm::dvec3 luminance = scene::sky_mean(
                    sky, along(bin.low, bin.high, a), along(bin.low, bin.high, a + 1),
                    along(bin.from, bin.to, b), along(bin.from, bin.to, b + 1));
                const volume::ShValues y = volume::sh_basis(order, w);
                for (size_t k = 0; k < terms; ++k)
                    for (size_t c = 0; c < 3; ++c)
                        sum[3 * k + c] += luminance[int(c)] * double(y[k]);
            }
        const double weight = 4.0 * glm::pi<double>() / (samples * samples * double(bins.size()));
        for (const double value : sum)
            bin.coefficients.push_back(float(weight * value));
        for (const scene::LightLayer& layer : layers)
            bin.layers.push_back(layer_of(bin, layer, weight, order));
    });
    const bool black = std::all_of(bins.begin(), bins.end(), [](const SkyBin& bin) {
        return std::all_of(bin.coefficients.begin(), bin.coefficients.end(),
                           [](float c) { return c == 0.0f; });
    });
    return black ? std::vector<SkyBin>{} : bins;
}

} // namespace lpvbake::solver::gather
