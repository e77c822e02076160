#include "surface/emitter_sampling.h"

#include <algorithm>

namespace lpvbake::surface {
namespace {

double brightness(const Patch& patch) {
    return double(std::max({patch.emission.x, patch.emission.y, patch.emission.z}));
}

} // namespace

EmitterSampling::EmitterSampling(const std::vector<Patch>& patches) {
    for (const Patch& patch : patches) {
        const double power = brightness(patch) * double(patch.area);
        if (!(power > 0.0))
            continue;
        total_ += power;
        emitters_.push_back(patch);
        cumulative_.push_back(total_);
    }
    for (double& c : cumulative_)
        c /= total_;
}

EmitterSampling::Sample EmitterSampling::sample(float pick, glm::vec2 weights) const {
    const auto found = std::upper_bound(cumulative_.begin(), cumulative_.end() - 1, double(pick));
    const Patch& patch = emitters_[size_t(found - cumulative_.begin())];
    return {patch.at(weights), patch.normal, patch.double_sided, patch.emission, density(patch)};
}

float EmitterSampling::density(const Patch& patch) const {
    return float(brightness(patch) / total_);
}

} // namespace lpvbake::surface
