// All surfaces inside the grid as small flat patches: the one base of emission, occlusion and
// validity.
#pragma once

#include "scene/frame.h"

#include <vector>

namespace lpvbake {

/// A flat piece of a triangle, at most about a cell across.
struct Patch {
    glm::vec3 position; ///< centroid, frame units
    glm::vec3 normal;   ///< unit, out of the front
    float area = 0;     ///< frame units squared
    float alpha = 1;    ///< mean covered share
    uint32_t instance = 0;
    uint32_t triangle = 0;
    glm::vec2 barycentric{0}; ///< of the centroid, in the mesh's triangle
    glm::vec3 emission{0};    ///< mean luminance of the front, its uncovered share included, nits
    bool double_sided = false;
};

/// Cuts every placed triangle into patches whose edges are at most `max_edge` units long and drops
/// those outside the grid. Zero-area triangles give none. Throws Error (memory) beyond 2^26
/// patches.
std::vector<Patch> make_patches(const Scene& scene, const Frame& frame, float max_edge);

} // namespace lpvbake
