// Small bright places: where lamps light little of what is seen from there.
#pragma once

#include "surface/emitter_sampling.h"
#include "surface/lit_surfaces.h"

#include <vector>

namespace lpvbake::surface {

/// The light that is reflected at such places is found as that of emitters is, by rays that are
/// aimed at them: rays in all directions would meet them by luck.
struct Spots {
    /// A side, nits; empty where there are none.
    std::vector<glm::vec3> luminance;
    std::vector<uint32_t> sides; ///< those of `aim`, in its order
    EmitterSampling aim{{}};

    /// None.
    Spots() = default;
    /// By LitSurfaces::luminance, the light of lamps. Sides that lie together are much brighter
    /// than the mean of what can be seen from the brightest of them, themselves with it, and send
    /// more than a hundredth of its light. It is what is around a place that counts, not the whole
    /// scene: a hole lets little of the sun into a room, and all that the room has.
    Spots(const Scene& scene, const scene::Frame& frame, const std::vector<glm::vec3>& emission,
          const LitSurfaces& lit);

    /// With which rays are aimed at a side, per unit of area.
    float density(uint32_t side) const { return density_[side]; }

private:
    std::vector<float> density_;
};

} // namespace lpvbake::surface
