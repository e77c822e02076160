// The sky as bins of directions: what a cell gathers where no surface is in the way.
#pragma once

#include "scene/light_layer.h"
#include "scene/sky.h"

#include <span>
#include <vector>

namespace lpvbake::solver::gather {

/// Directions between two heights and two azimuths around +y, the same solid angle in every bin.
struct SkyBin {
    float low, high; ///< y of the direction
    float from, to;  ///< azimuth, radians
    /// [3 * k + colour]: the bin's luminance projected to spherical harmonics, nits.
    std::vector<float> coefficients;
    /// The same of layers each; empty where a layer has none.
    std::vector<std::vector<float>> layers = {};

    /// u in [0, 1)^2 spreads evenly over the bin.
    glm::vec3 direction(glm::vec2 u) const;
};

/// Bins that follow each other and together are one of the larger size.
inline constexpr size_t sky_group = 4;

/// About `count` groups of bins, which together hold the whole sky's coefficients up to `order`;
/// none for a black sky.
std::vector<SkyBin> make_sky_bins(const Sky& sky, int count, int order,
                                  std::span<const scene::LightLayer> layers = {});

} // namespace lpvbake::solver::gather
