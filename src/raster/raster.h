// What a view sees of the scene, drawn by Vulkan: the nearest triangle of each texel.
#pragma once

#include "gpu/gpu.h"
#include "raster/geometry.h"
#include "scene/light_view.h"

#include <memory>
#include <span>

namespace lpvbake::raster {

/// What a texel sees. A black back (of a single-sided material) has albedo 0.
struct RasterTexel {
    glm::vec3 albedo;
    uint32_t triangle; ///< of Raster::geometry(), counted from one; 0: nothing was seen
};
static_assert(sizeof(RasterTexel) == 16);

/// Texels of a view at a time, along each side.
inline constexpr int max_tile = 1024;

/// A part of a view's map of `size` texels: its texel (c, r) is the map's at corner + (c, r), its
/// ray that of its centre. A corner that is not whole moves the rays within the texels.
struct Tile {
    glm::ivec2 size{0};
    glm::dvec2 corner{0.0};
    glm::ivec2 extent{0}; ///< at most max_tile along each side
    uint32_t seed = 0;    ///< of what chance decides: whether a texel sees a blended surface
    uint32_t shift = 0;   ///< added, modulo 2^32, to the number that decides it

    /// Where the ray of a tile's texel pierces the map, in [-1, 1]^2 inside the map.
    glm::dvec2 at(int column, int row) const {
        return (corner + glm::dvec2(column, row) + 0.5) * 2.0 / glm::dvec2(size) - 1.0;
    }
};

/// GPU resources for drawing one scene: geometry, textures, pipelines, targets.
class Raster {
public:
    /// As flatten. Throws Error (memory, device).
    Raster(const gpu::Device& device, const Scene& scene, const scene::Frame& frame,
           bool (*is_there)(Role) = scene::blocks);
    ~Raster();

    const RsmGeometry& geometry() const;
    /// The tile's texels, row-major, until the next call. With `cull` the backs of single-sided
    /// materials are not there.
    std::span<const RasterTexel> draw(const scene::RsmView& view, const Tile& tile,
                                      bool cull) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

} // namespace lpvbake::raster
