#include "solver/vpl/rsm.h"

#include "raster/raster.h"
#include "scene/light_view.h"
#include "solver/vpl/cascades.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::solver::vpl {

namespace {

/// Moves a point of a triangle a hair towards the centroid: by a thousandth of the way, at most a
/// hundredth of a cell. A point on an edge may otherwise lie, by rounding, behind the wall that
/// meets its own there, and would light what is behind that wall.
glm::vec3 pulled_inward(const raster::RsmVertex* vertex, glm::dvec3 point) {
    const glm::dvec3 centroid = (glm::dvec3(vertex[0].position) + glm::dvec3(vertex[1].position)
                                 + glm::dvec3(vertex[2].position))
                                / 3.0;
    const glm::dvec3 way = centroid - point;
    return glm::vec3(point + way * std::min(1e-3, 1e-2 / std::max(glm::length(way), 1e-9)));
}

/// Depth at which a view's ray meets a triangle's plane, in double.
double depth_at(const scene::RsmView& view, glm::dvec2 at, const raster::RsmVertex* triangle) {
    const glm::dvec3 normal(triangle->plane);
    const double slope = glm::dot(normal, view.along(at));
    // RasterTexel edge-on the plane may be met far away: the triangle's own depths are the limit.
    glm::dvec3 depths;
    for (int k = 0; k < 3; ++k)
        depths[k] = glm::dot(glm::dvec3(triangle[k].position) - view.origin, view.axis);
    const double least = std::max(std::min({depths.x, depths.y, depths.z}), view.nearest);
    const double most = std::max({depths.x, depths.y, depths.z, least});
    const double meets = glm::dot(normal, glm::dvec3(triangle->position) - view.start(at)) / slope;
    return slope == 0 ? 0.5 * (least + most) : std::clamp(meets, least, most);
}

/// From reflectance and triangle to position, normal and power.
void resolve(std::span<const raster::RasterTexel> texels, const raster::RsmGeometry& geometry,
             const scene::Frame& frame, const scene::RsmView& view, const Light& light,
             const raster::Tile& tile, const Texels& cut, Rsm& rsm) {
    const glm::dvec3 color(light.color);
    const glm::ivec2 corner(tile.corner);
    const scene::TexelFlux texel_flux(light, frame, view, tile.size.x);
    tbb::parallel_for(0, rsm.height, [&](int row) {
        for (int column = 0; column < rsm.width; ++column) {
            const std::size_t i = std::size_t(row) * rsm.width + column;
            const raster::RasterTexel& texel = texels[i];
            rsm.position[i] = rsm.normal[i] = rsm.power[i] = glm::vec3(0);
            if (texel.triangle == 0 || cut.holds(corner + glm::ivec2(column, row)))
                continue;
            const raster::RsmVertex* vertex = &geometry.vertices[3 * uint64_t(texel.triangle - 1)];
            const glm::dvec2 at = tile.at(column, row);
            const glm::dvec3 along = view.along(at), normal(vertex->plane);
            const double depth = depth_at(view, at, vertex);
            rsm.position[i] = pulled_inward(vertex, view.start(at) + depth * along);
            rsm.normal[i] = glm::vec3(glm::dot(normal, along) > 0 ? -normal : normal);
            const glm::dvec3 albedo(texel.albedo);
            if (albedo == glm::dvec3(0))
                continue;
            double flux = texel_flux(corner.x + column, corner.y + row);
            if (view.perspective && light.range > 0) {
                const double ratio = depth * glm::length(along) * frame.unit / light.range;
                flux *= std::clamp(1 - ratio * ratio * ratio * ratio, 0.0, 1.0);
            }
            rsm.power[i] = glm::vec3(flux * color * albedo);
        }
    });
}

/// Gives texels the colour of what light has passed on its way to them.
void colour(const visibility::Visibility& glass, Rsm& rsm) {
    const scene::RsmView& view = rsm.view;
    tbb::parallel_for(size_t(0), rsm.power.size(), [&](size_t i) {
        if (rsm.power[i] == glm::vec3(0))
            return;
        const glm::dvec3 to(rsm.position[i]);
        // Parallel light comes from a little before all that is there.
        const double depth = glm::dot(to - view.origin, view.axis);
        const glm::dvec3 from =
            view.perspective ? view.origin : to - view.axis * (depth - view.nearest + 1.0);
        rsm.power[i] *= glass.tint({glm::vec3(from), glm::vec3(to - from)});
    });
}

} // namespace

int usual_map_size(glm::ivec3 dims) {
    return std::max(256, 8 * std::max({dims.x, dims.y, dims.z}));
}

struct RsmPass::Impl {
    scene::Frame frame;
    bool cull;
    raster::Raster raster;
    const visibility::Visibility* glass; ///< null: nothing tints
};

RsmPass::RsmPass(const gpu::Device& device, const Scene& scene, const scene::Frame& frame,
                 const visibility::Visibility* glass)
    : impl_(new Impl{frame, scene.rules.cull_backfaces, raster::Raster(device, scene, frame),
                     glass && glass->is_tinted() ? glass : nullptr}) {}
RsmPass::~RsmPass() = default;

void RsmPass::render(const Light& light, int size, const std::function<void(const Rsm&)>& consume) {
    const scene::Frame& frame = impl_->frame;
    const raster::RsmGeometry& geometry = impl_->raster.geometry();
    Rsm rsm;
    const auto draw = [&](const scene::RsmView& view, const Cascade& cascade, glm::ivec2 corner,
                          uint32_t seed) {
        rsm.width = std::min(raster::max_tile, cascade.drawn.hi.x - corner.x);
        rsm.height = std::min(raster::max_tile, cascade.drawn.hi.y - corner.y);
        const glm::ivec2 extent(rsm.width, rsm.height);
        if (cascade.cut.holds(corner) && cascade.cut.holds(corner + extent - 1))
            return;
        rsm.view = view;
        const std::size_t texels = std::size_t(rsm.width) * rsm.height;
        rsm.position.resize(texels);
        rsm.normal.resize(texels);
        rsm.power.resize(texels);
        raster::Tile tile{glm::ivec2(cascade.size), corner, extent};
        tile.seed = seed + uint32_t(corner.y / raster::max_tile) * 65536u
                    + uint32_t(corner.x / raster::max_tile);
        resolve(impl_->raster.draw(view, tile, impl_->cull), geometry, frame, view, light, tile,
                cascade.cut, rsm);
        if (impl_->glass)
            colour(*impl_->glass, rsm);
        consume(rsm);
    };
    for (const scene::RsmView& view : scene::views_of(light, frame, geometry.lo, geometry.hi)) {
        uint32_t seed = 0; // of a cascade, which chance does not decide like those around it
        for (const Cascade& cascade : cascades_of(view, frame, size)) {
            for (int y = cascade.drawn.lo.y; y < cascade.drawn.hi.y; y += raster::max_tile)
                for (int x = cascade.drawn.lo.x; x < cascade.drawn.hi.x; x += raster::max_tile)
                    draw(view, cascade, {x, y}, seed);
            seed += 1u << 28;
        }
    }
}

} // namespace lpvbake::solver::vpl
