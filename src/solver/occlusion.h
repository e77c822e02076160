// What geometry does to light inside the grid, on the CPU and once a bake: which links between
// neighbouring cells are open, which cells lie inside solids, and the geometry volume.
#pragma once

#include "surface/patches.h"
#include "visibility/visibility.h"
#include "volume/grid.h"

#include <array>
#include <vector>

namespace lpvbake::solver {

/// Links between the centres of neighbouring cells.
struct Links {
    /// open[3 * cell + axis]: what passes from the cell's centre to its neighbour's in +axis, 0 to
    /// 1. A blocked segment between the centres is 0, so that no wall leaks whatever its
    /// orientation; four more segments through the shared face scale an open one by its coverage.
    /// 1 where the link leaves the grid. 0 on all sides of cells on surfaces
    /// (visibility/capture.h).
    std::vector<float> open;
    /// As trace_validity has it, and 0 in cells on surfaces.
    std::vector<float> validity;
};

/// Traces five bundles of axis-parallel lines through the grid, each line once: 15 n^2 rays for n^3
/// cells, whatever stands on them.
Links trace_links(const visibility::Visibility& visibility, const Grid& grid);

/// Spherical harmonics (1, y, z, x) of the blocking potential B(w) = sum A / h^2 max(0, n.w) of
/// all surfaces, on the grid's corners: node (i, j, k) lies at (i, j, k) in grid units, so there
/// are dims + 1 nodes along each axis. A patch counts at its nearest node, and all normals of a
/// node are turned to the side of its largest patch: the two sides of a thin wall would cancel
/// otherwise.
struct GeometryVolume {
    glm::ivec3 nodes{0};
    std::vector<glm::vec4> blocking;

    /// Blocking potential at a point (grid units, trilinear) along w, either way, 0 to 1.
    float blocked(glm::vec3 point, glm::vec3 w) const;
    /// Coefficients at a point (grid units), trilinear.
    glm::vec4 at(glm::vec3 point) const;
};

GeometryVolume make_geometry_volume(const std::vector<surface::Patch>& patches, const Grid& grid);

/// The geometry volume at the centres of the cells, as Volume::occlusion holds it.
std::vector<std::vector<float>> at_cell_centers(const GeometryVolume& geometry, const Grid& grid);

/// One of the 30 faces that light leaves a source cell through.
struct LpvFace {
    int direction;    ///< of the destination cell: +x, -x, +y, -y, +z, -z
    glm::vec3 normal; ///< outward, seen from the destination's centre
    glm::vec3 toward; ///< unit, from the source's centre to the face's
};

/// For each direction the far face, then the sides +u, -u, +v, -v of the two axes that follow the
/// direction's in the cycle x, y, z.
const std::array<LpvFace, 30>& lpv_faces();

/// Transmittance of the 30 faces that light leaves a source cell through: index
/// [30 * cell + face], in the order of lpv_faces. 1 - blocked(centre + w / 2, w).
std::vector<float> face_transmittance(const GeometryVolume& geometry, const Grid& grid);

} // namespace lpvbake::solver
