// What the sweep has to know of surfaces: where they lie between cell centres, and what they send
// along the axes.
#pragma once

#include "surface/lit_surfaces.h"
#include "volume/grid.h"

#include <array>
#include <cstdint>
#include <vector>

namespace lpvbake {

/// A surface that ends the way from a cell's centre to that of the next one, or nothing.
struct SnLink {
    glm::vec3 luminance{0.0f}; ///< that the surface sends back along the link, nits
    float inverse = 0.0f;      ///< 1 / its distance, cells, at least about 1; 0: an open link
    glm::vec3 normal{0.0f};    ///< unit, on the cell's side
};

struct SnWalls {
    glm::ivec3 dims{0};
    /// occupied[i + (dims.x + 1) (j + (dims.y + 1) k)]: 1 where a surface meets the unit cube whose
    /// corners are the centres of the cells i - 1 and i, j - 1 and j, k - 1 and k.
    std::vector<uint8_t> occupied;
    /// Links of a cell that has an occupied cube around it, towards -x, +x, -y, +y, -z, +z.
    std::vector<std::array<SnLink, 6>> links;
    std::vector<uint32_t> links_of; ///< a cell's entry in `links`, ~0u: none

    bool is_occupied(glm::ivec3 cube) const {
        return occupied[size_t(cube.x)
                        + size_t(dims.x + 1)
                              * (size_t(cube.y) + size_t(dims.y + 1) * size_t(cube.z))]
               != 0;
    }
};

/// Finds the cubes that hold a surface and traces the links beside them, without the links
/// (`with_links` false) where nobody asks for them. A surface through a cell's centre ends the
/// links of its neighbours, so that light may reach that centre from both sides, and go no further.
SnWalls find_walls(const LitSurfaces& lit, const Visibility& visibility, const Grid& grid,
                   bool with_links);

} // namespace lpvbake
