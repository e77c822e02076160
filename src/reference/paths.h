// Light along paths, traced backwards from a point.
#pragma once

#include "reference/lit_pieces.h"
#include "reference/sampler.h"
#include "visibility/visibility.h"

#include <array>
#include <optional>

namespace lpvbake::reference {

/// Which light a path carries.
struct PathRules {
    std::optional<int> bounces = 1; ///< reflections at most; none: all
    bool emitters = true;           ///< emissive surfaces give light
    /// Below this reflectance in all a path of unlimited reflections goes on by chance. Many short
    /// paths say more of many places, few long ones of one.
    double faint = 0.1;

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

    /// Light from a direction.
    struct Glimpse {
        glm::dvec3 direction{0.0, 1.0, 0.0};
        glm::dvec3 luminance{0.0}; ///< nits, RGB, weighted
    };
    /// An unbiased estimate of the light that arrives at `origin` (frame units), of static lights
    /// (by one of them, drawn evenly) and of punctual lights
    /// after one reflection to PathRules::bounces and of emitters and the sky after none to
    /// PathRules::bounces, in parts: the mean over the sphere of luminance times f(direction) is
    /// the expectation of the sum of g.luminance f(g.direction). Surfaces reflect as Lambert. At
    /// each the punctual lights' illuminance is summed in full; emitters, and a sky with a map,
    /// count where a path meets them and, by a ray of their own, where it aims at one (multiple
    /// importance sampling, balance heuristic: Veach and Guibas 1995); so does what point and spot
    /// lights shine on, from the second reflection on, since beside a lamp it is as bright as one
    /// likes. The first ray of a path goes one time of two where photons of the punctual lights
    /// fell. Adds the rays it took to `rays`.
    /// Throws Error (invalid) where a path does not end: a closed scene of albedo 1.
    std::array<Glimpse, 4> arriving(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const;

    /// An unbiased estimate of the irradiance (lux, RGB) that a surface at `origin` (frame units,
    /// off the surface: see off_surface) with unit normal n gets from the light of arriving().
    glm::dvec3 irradiance(glm::vec3 origin, glm::dvec3 n, PathSampler& sampler,
                          uint64_t& rays) const;

    enum class Lights { all, statics, others };
    /// Illuminance (lux, RGB) of punctual lights on a surface at `point` (as above) with unit
    /// normal n, shadows included.
    glm::dvec3 illuminance(glm::dvec3 point, glm::dvec3 n, uint64_t& rays,
                           Lights which = Lights::all) const;

    /// How many punctual lights there are, and what of one of them arrives at a point (frame
    /// units).
    struct FromLight {
        glm::dvec3 way{0.0}; ///< from the point to the light, or to where nothing is any more
        glm::dvec3 lux{0.0}; ///< on a surface that faces the light, shadows included
        bool is_static = false;
    };
    std::size_t lights() const { return sources_.size(); }
    FromLight from_light(std::size_t i, glm::dvec3 point, uint64_t& rays) const;

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
        bool is_static;
    };
    /// The way from a point to a light, and what arrives if nothing stands in it.
    struct LightWay {
        glm::dvec3 way;     ///< of any length
        double share = 0.0; ///< of PunctualLight::color on a surface that faces the light
        double end = 1.0;   ///< of the shadow ray: before a surface that the light lies on
    };
    LightWay way_to(const PunctualLight& source, glm::dvec3 point) const;
    /// Of one static light.
    Glimpse seen_light(glm::vec3 origin, PathSampler& sampler, uint64_t& rays) const;

    /// How rays leave a place: evenly, or by the cosine over a surface of normal n.
    struct Lobe {
        std::optional<glm::dvec3> n;
        glm::dvec3 sample(glm::dvec2 sample) const;
        double density(glm::dvec3 towards) const; ///< 1 / sr
    };
    /// The front of a target, where nothing hides it and the lobe goes there.
    struct Met {
        glm::dvec3 towards; ///< unit direction
        visibility::Hit hit;
    };
    std::optional<Met> meet(const Emitters::Target& target, glm::vec3 origin, const Lobe& lobe,
                            uint64_t& rays) const;
    /// A surface that a ray met, as it reflects.
    struct Bounce {
        glm::dvec3 point, n; ///< where rays from it start: see off_surface
        glm::dvec3 albedo;
    };
    Bounce bounce_of(const visibility::Hit& hit, glm::vec3 origin, glm::dvec3 towards) const;
    /// arriving(), from a lobe, after so many reflections: by a path, and by aiming at an emitter
    /// and the sky. What arrives is weighted as if its direction were drawn from the lobe.
    Glimpse trace(glm::vec3 origin, Lobe lobe, PathSampler& sampler, uint64_t& rays) const;
    Glimpse aim(glm::vec3 origin, const Lobe& lobe, int reflections, PathSampler& sampler,
                uint64_t& rays) const;
    Glimpse aim_at_sky(glm::vec3 origin, const Lobe& lobe, int reflections, PathSampler& sampler,
                       uint64_t& rays) const;
    /// What arrives at a surface of what lamps shine on; and how much of that is left to a path
    /// from the surface that meets it.
    glm::dvec3 aim_at_spot(glm::vec3 origin, const Lobe& lobe, PathSampler& sampler,
                           uint64_t& rays) const;
    double share_of_path(const visibility::Hit& hit, glm::vec3 origin, glm::dvec3 towards,
                         const Lobe& lobe) const;
    /// How likely a path goes in the direction in which `hit` was met.
    double density_of(const visibility::Hit& hit, glm::vec3 origin, glm::dvec3 towards,
                      const Lobe& lobe, int reflections) const;
    /// Whether what was reflected so often may be reflected once more.
    bool goes_on(int reflections) const { return !rules_.bounces || reflections < *rules_.bounces; }
    /// Whether a path that was reflected so often goes where photons fell, one time of two: of the
    /// first ray, since what is dark from a place costs the path.
    bool is_guided(int reflections) const;

    const Scene& scene_;
    const visibility::Visibility& visibility_;
    PathRules rules_;
    double unit_;
    double across_; ///< longer than the way from any surface out of the scene, frame units
    std::vector<PunctualLight> sources_;
    std::vector<std::size_t> statics_; ///< which of those
    Emitters emitters_;
    std::optional<LitPieces> lit_;   ///< the first ray goes there; unless it is empty
    std::optional<LitPieces> spots_; ///< further rays do; unless it is empty
    const SkyMap* sky_ = nullptr;    ///< unless it is black
};

} // namespace lpvbake::reference
