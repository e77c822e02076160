// Points on emissive patches, chosen in proportion to the light they send.
#pragma once

#include "surface/patches.h"

#include <algorithm>
#include <span>
#include <vector>

namespace lpvbake::surface {

/// The greatest of the channels.
inline float greatest(glm::vec3 v) {
    return std::max({v.x, v.y, v.z});
}

class EmitterSampling {
public:
    /// `favours` (a patch each; none: 1): how much more often than by their light.
    explicit EmitterSampling(const std::vector<Patch>& patches,
                             std::span<const double> favours = {});
    bool empty() const { return emitters_.empty(); }

    struct Sample {
        glm::vec3 point;     ///< frame units
        glm::vec3 normal;    ///< of the front
        bool double_sided;   ///< glows to both sides
        bool met;            ///< rays may meet it by chance
        glm::vec3 luminance; ///< mean of the patch, nits
        float density;       ///< of the point, per unit of area
        uint32_t patch;      ///< its place among those that were given
    };
    /// `pick` in [0, 1) chooses the patch, `weights` (of its second and third corner) the point.
    Sample sample(float pick, glm::vec2 weights) const;
    /// Density with which points of a patch are chosen, per unit of area.
    float density(const Patch& patch, double favour = 1.0) const;

private:
    std::vector<Patch> emitters_;
    std::vector<uint32_t> given_;    ///< place of each among all patches
    std::vector<double> favours_;    ///< of each; empty: 1
    std::vector<double> cumulative_; ///< power up to and with each, over the total
    double total_ = 0.0;
};

} // namespace lpvbake::surface
