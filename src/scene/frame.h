// The frame in which light is computed: grid units, so that a scene of 1e-4 m and one of 1e6 m, at
// the origin or far from it, look alike to single precision.
#pragma once

#include "scene/scene.h"

namespace lpvbake::scene {

/// A level around the grid: another grid of the same bake, of larger cells.
struct CoarserBox {
    glm::vec3 lo, hi; ///< frame units
    float cell;       ///< units
};

/// p_frame = (p_world - origin) / unit, evaluated in double. The box [0, extent] is the grid.
struct Frame {
    glm::dvec3 origin{0.0};
    double unit = 1.0;                    ///< metres a unit: the edge of a cell
    glm::dvec3 extent{1.0};               ///< size of the grid in units (its dims)
    std::vector<CoarserBox> coarser = {}; ///< levels around it, from finer to coarser; mostly none

    /// The box of all levels, frame units.
    glm::dvec3 lo() const {
        return glm::dvec3(coarser.empty() ? glm::vec3(0.0f) : coarser.back().lo);
    }
    glm::dvec3 hi() const { return coarser.empty() ? extent : glm::dvec3(coarser.back().hi); }
    glm::dvec3 from_world(glm::dvec3 p) const { return (p - origin) / unit; }
    glm::dvec3 to_world(glm::dvec3 p) const { return origin + p * unit; }
};

/// The frame of a grid (volume/grid.h, which this room does not know).
template <class Grid>
Frame frame_of(const Grid& grid) {
    return {grid.origin, grid.cell, glm::dvec3(grid.dims)};
}

/// A placed mesh's vertex positions in the frame: world transform and frame are joined in double,
/// then rounded once.
std::vector<glm::vec3> positions_in_frame(const Scene& scene, const Instance& instance,
                                          const Frame& frame);

/// True if the instance's transform mirrors, so that its triangles' winding has to be turned.
bool is_mirrored(const Instance& instance);

} // namespace lpvbake::scene
