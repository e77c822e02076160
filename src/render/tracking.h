// Light in air along random ways, for path-traced pictures. It knows a medium by its density at
// places alone, and shares no code with medium/fog.h.
#pragma once

#include "medium/medium.h"
#include "reference/paths.h"

namespace lpvbake::render {

class TrackedAir {
public:
    /// Refers to its arguments.
    TrackedAir(const reference::Paths& paths, const scene::Frame& frame,
               const medium::Medium& medium);

    /// What of light counts that air scatters.
    struct Kinds {
        bool direct = true; ///< of punctual lights that are not static, attenuated on their way
        bool field = true;  ///< of all else, as Paths::arriving has it, which is not
    };
    struct Seen {
        glm::dvec3 scattered{0.0}; ///< nits
        glm::dvec3 left{0.0};      ///< what of light from the end of the way counts
    };
    /// An unbiased estimate, by one way: delta tracking, of three channels at once (Kutz et al.
    /// 2017), to where light is scattered or to `distance` (frame units; may be infinite) along the
    /// unit vector `direction`; ratio tracking (Novák et al. 2014) from there to each light.
    Seen track(glm::dvec3 origin, glm::dvec3 direction, double distance, Kinds kinds,
               reference::PathSampler& sampler, uint64_t& rays) const;

private:
    /// The part of a ray in the medium's box; empty where end <= begin.
    struct Part {
        double begin, end;
    };
    Part part_in(glm::dvec3 origin, glm::dvec3 direction, double distance) const;
    double density(glm::dvec3 place) const;
    glm::dvec3 transmittance(glm::dvec3 origin, glm::dvec3 direction, double distance,
                             reference::PathSampler& sampler) const;
    glm::dvec3 scattered_at(glm::dvec3 place, glm::dvec3 direction, Kinds kinds,
                            reference::PathSampler& sampler, uint64_t& rays) const;
    double phase(double cosine) const;

    const reference::Paths& paths_;
    scene::Frame frame_;
    const medium::Medium& medium_;
    glm::dvec3 lo_, hi_;               ///< frame units
    glm::dvec3 scatters_, extinction_; ///< a frame unit, at density 1
    double most_;                      ///< extinction anywhere, of any channel
};

} // namespace lpvbake::render
