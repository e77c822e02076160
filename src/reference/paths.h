// Light along paths, traced backwards from a point.
#pragma once

#include "reference/emitters.h"
#include "reference/sampler.h"
#include "visibility/visibility.h"

#include <optional>

namespace lpvbake::reference {

/// Which light a path carries.
struct PathRules {
    std::optional<int> bounces = 1; ///< reflections at most; none: all
    bool emitters = true;           ///< emissive surfaces give light

    bool operator==(const PathRules&) const = default;
};

/// Where rays from a surface start: a hair before `point` on the side of the unit normal n. Frame
/// units.
glm::dvec3 off_surface(glm::dvec3 point, glm::dvec3 n);

/// What every path of a scene needs; several threads may trace at once. Refers to its arguments.
class Paths {
public:
    /// `unit` is the length of a frame unit in metres.
    Paths(const Scene& scene, const visibility::Visibility& visibility, const scene::Frame& frame,
          const PathRules& rules);

    /// An unbiased estimate of the light (RGB, nits) that arrives at `origin` (frame units), of
    /// punctual lights after one reflection to PathRules::bounces and of emitters and the sky
    /// after none to PathRules::bounces, in parts: the mean over the sphere of luminance times
    /// f(direction) is the expectation of luminance(towards) f(towards), `towards` uniform over the
    /// sphere, plus those of g.luminance f(g.direction), g being glimpse() and glimpse_sky().
    /// Surfaces reflect as Lambert. At each the punctual lights' illuminance is summed in full;
    /// emitters, and a sky with a map, count where a path meets them and, by a ray of their own,
    /// where it aims at one (multiple importance sampling, balance heuristic: Veach and Guibas
    /// 1995). Adds the rays it took to `rays`. Throws Error (invalid)
    /// where a path does not end: a closed scene of albedo 1.
    glm::dvec3 luminance(glm::vec3 origin, glm::dvec3 towards, PathSampler& sampler,
                         uint64_t& rays) const;

    struct Glimpse {
        glm::dvec3 direction{0.0, 1.0, 0.0};
        glm::dvec3 luminance{0.0}; ///< weighted by the share that luminance() leaves
    };
    /// Looks from `origin` at a point of an emitter; dark where there are none.
    Glimpse glimpse(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const;
    /// Looks from `origin` where the sky's map is bright; dark where there is none.
    Glimpse glimpse_sky(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const;

    /// An unbiased estimate of the irradiance (lux, RGB) that a surface at `origin` (frame units,
    /// off the surface: see off_surface) with unit normal n gets from the light of luminance().
    glm::dvec3 irradiance(glm::vec3 origin, glm::dvec3 n, PathSampler& sampler,
                          uint64_t& rays) const;

    /// Illuminance (lux, RGB) of all punctual lights on a surface at `point` (as above) with unit
    /// normal n, shadows included.
    glm::dvec3 illuminance(glm::dvec3 point, glm::dvec3 n, uint64_t& rays) const;

    /// What a surface emits (nits) where a ray meets it, of the share alpha that is there.
    glm::dvec3 emission(const visibility::Hit& hit) const;

private:
    /// A light as a surface point sees it, positions in frame units.
    struct PunctualLight {
        LightType type;
        glm::dvec3 color; ///< colour times intensity, lux or cd
        glm::dvec3 position, direction;
        double range; ///< metres; 0: unlimited
        double cos_inner, cos_outer;
    };

    /// luminance() towards a direction that was drawn with a given density (1 / sr).
    glm::dvec3 trace(glm::vec3 origin, glm::dvec3 towards, double density, PathSampler& sampler,
                     uint64_t& rays) const;
    /// Looks at an emitter; `density` of a direction is that with which a path would go there.
    template <class Density>
    Glimpse aim(glm::vec3 origin, const Density& density, PathSampler& sampler,
                uint64_t& rays) const;
    /// The same at the sky, which has a map.
    template <class Density>
    Glimpse aim_at_sky(glm::vec3 origin, const Density& density, PathSampler& sampler,
                       uint64_t& rays) const;

    const Scene& scene_;
    const visibility::Visibility& visibility_;
    PathRules rules_;
    double unit_;
    double across_; ///< longer than the way from any surface out of the scene, frame units
    std::vector<PunctualLight> sources_;
    Emitters emitters_;
    const SkyMap* sky_ = nullptr; ///< unless it is black
};

} // namespace lpvbake::reference
