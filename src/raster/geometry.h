// A scene as one stream of triangles in the frame, in the order in which it is drawn.
#pragma once

#include "scene/frame.h"
#include "scene/roles.h"

#include <cstdint>
#include <vector>

namespace lpvbake::raster {

/// As the vertex shader reads it.
struct RsmVertex {
    glm::vec3 position; ///< frame units
    glm::vec4 plane;    ///< unit normal n out of the triangle's front, and n.p; the same thrice
    glm::vec2 uv;
    glm::vec4 color; ///< base colour factor times vertex colour
};
static_assert(sizeof(RsmVertex) == 13 * sizeof(float));

/// Where a triangle comes from.
struct RsmOrigin {
    uint32_t instance = 0;
    uint32_t triangle = 0; ///< of the instance's mesh
};

/// Consecutive triangles of one material.
struct MaterialRun {
    int material = 0;
    uint64_t first = 0; ///< vertices
    uint64_t count = 0;
};

struct RsmGeometry {
    std::vector<RsmVertex> vertices;  ///< three a triangle, counter-clockwise seen from the front
    std::vector<RsmOrigin> origins;   ///< one a triangle
    std::vector<MaterialRun> runs;    ///< in the order of `vertices`
    glm::dvec3 lo{1e300}, hi{-1e300}; ///< bounds, frame units
};

/// Of the roles that are there, as Visibility has it. Triangles without an area are left out.
/// Throws Error (memory) beyond 2^31 - 1 triangles.
RsmGeometry flatten(const Scene& scene, const scene::Frame& frame,
                    bool (*is_there)(Role) = scene::blocks);

} // namespace lpvbake::raster
