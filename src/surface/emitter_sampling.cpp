#include "surface/emitter_sampling.h"

#include <algorithm>

namespace lpvbake::surface {
namespace {

double brightness(const Patch& patch) {
    return double(greatest(patch.emission));
}

} // namespace

EmitterSampling::EmitterSampling(const std::vector<Patch>& patches,
                                 std::span<const double> favours) {
    for (size_t i = 0; i < patches.size(); ++i) {
        const double favour = favours.empty() ? 1.0 : favours[i];
        const double power = favour * brightness(patches[i]) * double(patches[i].area);
        if (!(power > 0.0))
            continue;
        total_ += power;
        emitters_.push_back(patches[i]);
        given_.push_back(uint32_t(i));
        if (!favours.empty())
            favours_.push_back(favour);
        cumulative_.push_back(total_);
    }
    for (double& c : cumulative_)
        c /= total_;
}

EmitterSampling::Sample EmitterSampling::sample(float pick, glm::vec2 weights) const {
    const auto found = std::upper_bound(cumulative_.begin(), cumulative_.end() - 1, double(pick));
    const auto at = size_t(found - cumulative_.begin());
    const Patch& patch = emitters_[at];
    return {patch.at(weights),  patch.normal,
            patch.double_sided, patch.met,
            patch.emission,     density(patch, favours_.empty() ? 1.0 : favours_[at]),
            given_[at]};
}

float EmitterSampling::density(const Patch& patch, double favour) const {
    return float(favour * brightness(patch) / total_);
}

} // namespace lpvbake::surface
