// Light at places that are given, instead of a grid's cells.
#pragma once

#include "lpvbake/volume.h"

#include <cstdint>
#include <vector>

namespace lpvbake::volume {

/// Metres, in the scene's axes.
struct Points {
    std::vector<glm::dvec3> positions;
    std::vector<glm::vec3> normals; ///< unit, one a point; empty: there are none
    /// Of the picture whose texels they are, row by row, such as a lightmap; 0: they are a list.
    std::size_t width = 0;
};

/// Most points of one bake: the texels of a lightmap of 4096 x 4096.
inline constexpr std::size_t most_points = std::size_t(1) << 24;

struct LitPoints {
    Points points;
    /// A row of cells, one a point, that lie nowhere: sh, sh_order, validity, metadata.
    Volume light;
    std::vector<float> backs; ///< share of the directions in which a back is seen first, 0 to 1
    /// Coefficients, up to band 1, of the sky's visibility, 0 to 1: the root of 4 pi, 0, 0, 0 in
    /// the open.
    std::vector<glm::vec4> sky;
    std::vector<glm::vec3> irradiance; ///< lux, RGB, on the normals' planes; empty without those
};

/// What a point takes in memory, bytes, from its file to the files of its light.
constexpr uint64_t point_bytes(int order) {
    return 160 + 24 * uint64_t(order + 1) * uint64_t(order + 1);
}

} // namespace lpvbake::volume
