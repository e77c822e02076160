// What pieces of surfaces emit: the integral of textures over them, by texels.
#pragma once

#include "lpvbake/scene.h"

#include <array>
#include <vector>

namespace lpvbake::scene {

/// What a piece of a triangle emits, and where on it. Moments are of the piece's weights of its
/// second and third corner, by the largest channel of what is emitted.
struct PieceEmission {
    glm::vec3 mean{0.0f}; ///< nits, over the area, as sample_emission
    glm::vec2 centre{1.0f / 3.0f};
    glm::vec3 squares{1.0f / 6.0f, 1.0f / 6.0f, 1.0f / 12.0f}; ///< of the first, the second; mixed
    /// Of its area, would it glow evenly: squared mean over mean square.
    float lit = 1.0f;
};

/// How far the light of a piece is from lying evenly over it, by its moments.
struct Unevenness {
    float shift = 0.0f;  ///< of its centre off the centroid
    float spread = 0.0f; ///< of the mean square of its distance from its centre
};
Unevenness unevenness(const PieceEmission& emission, glm::vec3 edge_u, glm::vec3 edge_v);

/// Answers for any piece of a scene's triangles. Textures are clipped by the piece, texel by texel
/// where it covers few of them (bilinear, or constant for `nearest`), else by blocks of texels,
/// which are halved along its edges where they do not glow evenly, five times at most: what pieces
/// give sums up to what their whole gives. Where alpha has a share in it, by points.
class EmissionMaps {
public:
    /// Takes up to 6 bytes for each texel of emission textures.
    explicit EmissionMaps(const Scene& scene);

    /// `corners`: weights of the triangle's second and third vertex.
    PieceEmission over(const Mesh& mesh, uint32_t triangle,
                       const std::array<glm::vec2, 3>& corners) const;

    /// Means of blocks of 2^level x 2^level texels, level by level; those at the right and the
    /// lower edge may be cut off.
    struct Level {
        int width = 0, height = 0;
        std::vector<glm::vec4> blocks; ///< and the mean square of the largest channel
    };

private:
    PieceEmission by_points(const Mesh& mesh, uint32_t triangle,
                            const std::array<glm::vec2, 3>& corners, int steps) const;

    const Scene& scene_;
    std::vector<std::vector<Level>> levels_; ///< a texture; levels from 1 on
};

} // namespace lpvbake::scene
