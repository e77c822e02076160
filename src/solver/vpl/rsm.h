// Reflective shadow maps (Dachsbacher and Stamminger 2005): what a light sees, as virtual point
// lights.
#pragma once

#include "gpu/gpu.h"
#include "scene/light_view.h"
#include "visibility/visibility.h"

#include <functional>
#include <memory>
#include <vector>

namespace lpvbake::solver::vpl {

/// One map, or a tile of one: row-major texels. A texel that sees nothing, or a black back, has
/// power 0.
struct Rsm {
    int width = 0;
    int height = 0;
    std::vector<glm::vec3> position; ///< frame units
    std::vector<glm::vec3> normal;   ///< unit, of the triangle, on the lit side
    std::vector<glm::vec3> power;    ///< reflected power of the texel, lm a channel
    scene::RsmView view;             ///< of the whole map
};

/// A virtual point light: emits power / pi * max(0, n.w) candela.
struct Vpl {
    glm::vec3 position;                 ///< frame units
    glm::vec3 normal;                   ///< unit
    glm::vec3 power;                    ///< lm
    std::vector<glm::vec3> layers = {}; ///< the same of layers of the light, if they are wanted
};

/// Sides of a grid, a bit each: 2 axis, and the one after it for the side of larger coordinates.
using Sides = unsigned;
inline constexpr Sides all_sides = 63;

struct RsmSettings {
    int size = 256; ///< texels along each side of a map's coarsest cascade
    int kernel = 4; ///< texels along each side of a block that is clustered; 1: every texel a VPL
};

/// Texels along a side that suit a grid: 8 a cell of the longest axis, at least 256.
int usual_map_size(glm::ivec3 dims);

/// GPU resources for rendering one scene's maps: geometry, textures, pipeline, targets.
class RsmPass {
public:
    /// `glass`, of the same scene and frame and if it is given, says what light has passed.
    RsmPass(const gpu::Device& device, const Scene& scene, const scene::Frame& frame,
            const visibility::Visibility* glass = nullptr);
    ~RsmPass();
    /// Renders every map of a light (one, six for a point light or a wide spot), in cascades where
    /// the frame has levels (cascades.h), in tiles of at most 1024 texels a side and hands each
    /// tile to `consume` in a fixed order. What a finer cascade shows has power 0. Positions and
    /// normals are exact to single precision: a texel's ray meets its triangle's plane in double.
    void render(const Light& light, int size, const std::function<void(const Rsm&)>& consume);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

/// Clusters blocks of kernel x kernel texels: texels less than sqrt(3) cells from the brightest, of
/// the frame's finest level that holds that, whose normals are within 45 degrees of its own join
/// it; what is left over forms clusters of its own. Power is summed, never averaged. The normal is
/// the mean weighted by brightness, the position that of the texel nearest to such a mean, which
/// lies on the surface. The scheme is that of the downsampling in Kaplanyan and Dachsbacher 2010,
/// made to conserve power.
void cluster_vpls(const Rsm& rsm, const scene::Frame& frame, int kernel, std::vector<Vpl>& vpls);

} // namespace lpvbake::solver::vpl
