// How many patches a scene makes, known without making them.
#pragma once

#include "scene/frame.h"
#include "surface/patches.h"

#include <array>
#include <vector>

namespace lpvbake::surface {

/// The placed triangles of a scene, or a sample of them, each with how many it stands for.
struct TriangleSample {
    struct Triangle {
        std::array<glm::dvec3, 3> corners; ///< metres
        uint32_t instance = 0, triangle = 0;
        double stands_for = 1.0;
    };
    std::vector<Triangle> triangles;
};

/// All that have an area where those are `most` at most; else so many, drawn by even steps
/// (systematic sampling; Madow 1949), half by number and half by length.
TriangleSample sample_triangles(const Scene& scene, size_t most = 1 << 16);

struct PatchCount {
    double patches = 0; ///< as cover_surfaces makes them
    double inside = 0;  ///< area inside the grid, square units
    double faces = 0;   ///< area over the square of the longest edge that a patch may have there
};

/// By halving as cover_surfaces does; where all pieces may be of one size, by shapes that are alike
/// instead of piece by piece. What walls, lamps and texels cut further is known from up to 4096
/// pieces, drawn by even steps, that are cut on trial; without a trial it is left out. What narrow
/// light cuts is not counted: up to half as many (narrow.h).
PatchCount count_patches(const TriangleSample& sample, const scene::Frame& frame, float max_edge,
                         const CutTrial* trial = nullptr);

} // namespace lpvbake::surface
