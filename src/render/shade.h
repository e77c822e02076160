// What a point that a picture shows looks like.
#pragma once

#include "reference/paths.h"
#include "scene/frame.h"

#include <array>

namespace lpvbake::render {

/// What a picture shows of each surface point. Nits where nothing else is said; RGB.
enum class Show {
    final,      ///< direct and indirect
    direct,     ///< emission, sky, and what reflects the light of punctual lights
    indirect,   ///< what reflects the light of the field
    albedo,     ///< reflectance, 0 to 1
    normal,     ///< unit, world axes
    irradiance, ///< of the field, on the surface, lux
    occlusion,  ///< of the geometry volume, for light along the normal, 0 to 1
    validity, ///< share of the cells around a point that are valid; red: the field has none for it
    cells,    ///< mean luminance of the cell half a cell before the surface, not interpolated
};

/// A point of a surface, on the side from which it is seen.
struct SurfacePoint {
    visibility::Hit hit; ///< instance, triangle, barycentric
    glm::dvec3 point;    ///< frame units
    glm::dvec3 normal;   ///< unit, of the triangle
    glm::dvec3 smooth;   ///< unit, interpolated between the file's normals where it has some
    glm::dvec3 albedo;
};

/// Finds points of a scene's surfaces. Refers to its arguments.
class Surface {
public:
    Surface(const Scene& scene, const scene::Frame& frame);

    /// Where a ray (frame units) meets the plane of a triangle; a hair inside the triangle, where
    /// that lies on its rim or beyond, so that it is not behind another that meets it there.
    glm::vec2 barycentric(uint32_t instance, uint32_t triangle, glm::dvec3 origin,
                          glm::dvec3 direction) const;
    /// The point of these weights as seen along `direction`. `albedo` is the caller's.
    SurfacePoint point(uint32_t instance, uint32_t triangle, glm::vec2 barycentric,
                       glm::dvec3 direction) const;

private:
    std::array<glm::dvec3, 3> corners(uint32_t instance, uint32_t triangle) const;

    const Scene& scene_;
    scene::Frame frame_;
    std::vector<glm::dmat3> normal_to_world_; ///< an instance
};

} // namespace lpvbake::render
