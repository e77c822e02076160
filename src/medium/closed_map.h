// How far a light would reach if there were no small holes in what stands in its way.
#pragma once

#include "lpvbake/scene.h"
#include "scene/frame.h"
#include "visibility/visibility.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace lpvbake::medium {

/// A map of the distances at which opaque surfaces stop a light, seen from its middle, and the same
/// map closed: in each place the nearest distance within `metres` of it (erosion of what is lit),
/// and of these the farthest within as much (dilation). What is lit through holes that no disc of
/// this radius passes lies between the two. Around point and spot lights the disc is that large at
/// the distance of what stands around the hole, up to 20 degrees, and is looked at in a 12th of its
/// radius. Corners that face the light are holes, too, where they are narrower.
class ClosedMap {
public:
    /// Of a directional light texels are the beams that `per_cell` makes of it (BeamSettings).
    ClosedMap(const Light& light, const visibility::Visibility& visibility,
              const scene::Frame& frame, int per_cell, double metres);

    /// How far from its origin a beam of the light goes with the holes closed, along a unit vector;
    /// none where there is no hole. Frame units; beams of a point or spot light begin in it.
    std::optional<double> reach(glm::dvec3 origin, glm::dvec3 direction) const;

private:
    template <class RayOf>
    void look(const visibility::Visibility& visibility, std::size_t texels, const RayOf& ray_of);
    void make_parallel(const visibility::Visibility& visibility, glm::dvec3 direction,
                       glm::dvec3 size, int per_cell, double radius);
    void make_around(const visibility::Visibility& visibility, glm::dvec3 size, double radius);
    void keep_holes(const std::vector<float>& closed);
    static std::size_t texel_of(glm::dvec3 direction);

    std::vector<float> depths_; ///< a texel, frame units; HUGE_VALF: nothing stops the light
    bool parallel_;
    glm::dvec3 at_{0.0}; ///< of the light; parallel: in the middle of the map
    // Of parallel light: texels lie in rows along u.
    glm::dvec3 u_{0.0}, v_{0.0};
    glm::ivec2 count_{0};
    double pitch_ = 1; ///< of texels
};

} // namespace lpvbake::medium
