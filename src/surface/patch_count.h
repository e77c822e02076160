// How many patches a scene makes, known without making them.
#pragma once

#include "scene/frame.h"

#include <array>
#include <vector>

namespace lpvbake::surface {

/// The placed triangles of a scene, or a sample of them, each with how many it stands for.
struct TriangleSample {
    struct Triangle {
        std::array<glm::dvec3, 3> corners; ///< metres
        double stands_for = 1.0;
    };
    std::vector<Triangle> triangles;
};

/// All that have an area where those are `most` at most; else so many, drawn by even steps
/// (systematic sampling; Madow 1949), half by number and half by length.
TriangleSample sample_triangles(const Scene& scene, size_t most = 1 << 16);

struct PatchCount {
    double patches = 0; ///< as cover_surfaces makes them, but for those that walls cross
    double inside = 0;  ///< area inside the grid, square units
    double faces = 0;   ///< area over the square of the longest edge that a patch may have there
};

/// By halving as cover_surfaces does; where all pieces may be of one size, by shapes that are alike
/// instead of piece by piece.
PatchCount count_patches(const TriangleSample& sample, const scene::Frame& frame, float max_edge);

} // namespace lpvbake::surface
