// What air between an eye and what it sees leaves of light, and what it adds.
#pragma once

#include "medium/light_depths.h"
#include "medium/medium_in_frame.h"
#include "scene/photometry.h"
#include "volume/levels.h"

#include <vector>

namespace lpvbake::medium {

struct FogSettings {
    /// 0: the light of lamps and suns is summed over the parts of a ray that they reach, in closed
    /// form (directional) or by Gauss' rule over the angle at the light (point, spot). Else so many
    /// equal steps, with a shadow ray to each light in the middle of each: what programs do. Where
    /// density is not even the parts are summed in steps as long as it may be taken to be.
    int steps = 0;
    int map_size = 1024; ///< texels along the side of a light's map, a power of two
    bool suns = true;    ///< false: without directional lights, which something else shows
};

/// Single scattering of the light of punctual lights, and of a field where there is one. Light is
/// attenuated on its way from where it enters the medium, or from a lamp in it, to the place where
/// it is scattered, and from there to the eye; not on its way to surfaces, nor that of the field.
class Fog {
public:
    /// Refers to its arguments. `levels` may be null; else they hold the light of static lights.
    Fog(const Scene& scene, const visibility::Visibility& visibility, const scene::Frame& frame,
        const volume::Levels* levels, const Medium& medium, const FogSettings& settings);

    /// What is left of light that comes from so far along a ray (frame units, which may be
    /// infinite), a channel. The direction is a unit vector.
    glm::dvec3 transmittance(glm::dvec3 origin, glm::dvec3 direction, double distance) const;
    /// What is scattered into the ray before that, nits: of punctual lights, and of the field.
    glm::dvec3 direct(glm::dvec3 origin, glm::dvec3 direction, double distance) const;
    glm::dvec3 of_field(glm::dvec3 origin, glm::dvec3 direction, double distance) const;

private:
    /// A light in frame units.
    struct Source {
        const Light& light;
        glm::dvec3 power; ///< colour times intensity, lux or cd
        glm::dvec3 at, direction;
        scene::Cone cone;
        std::vector<LightDepths> depths; ///< one, unless it is marched to
    };
    using Part = MediumInFrame::Part;
    /// The column that a source's light has passed at a place, from where it enters; and its
    /// illuminance there, lx, if nothing stands in the way.
    double way_in(const Source& source, glm::dvec3 place) const;
    glm::dvec3 illuminance(const Source& source, glm::dvec3 place) const;
    double deflection(const Source& source, glm::dvec3 place, glm::dvec3 direction) const;

    glm::dvec3 marched(const Source& source, const Part& part) const;
    glm::dvec3 of_parallel(const Source& source, const Part& part, glm::dvec2 lit) const;
    glm::dvec3 of_lamp(const Source& source, const Part& part, glm::dvec2 lit) const;
    glm::dvec3 of_smooth_lamp(const Source& source, const Part& part, glm::dvec2 lit) const;
    /// Of either, where density is not the same everywhere: in steps in which light is even.
    glm::dvec3 in_steps(const Source& source, const Part& part, glm::dvec2 lit) const;
    std::vector<double> steps_in(const Source* source, const Part& part, glm::dvec2 lit) const;

    const visibility::Visibility& visibility_;
    scene::Frame frame_;
    const volume::Levels* levels_;
    MediumInFrame air_;
    FogSettings settings_;
    std::vector<Source> sources_;
};

} // namespace lpvbake::medium
