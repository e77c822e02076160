#include "render/render.h"

#include "lpvbake/error.h"
#include "mix_word.h"
#include "render/tracking.h"
#include "render/view.h"
#include "scene/material.h"
#include "scene/sky.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <optional>

namespace lpvbake::render {
namespace {

/// Where in its square sample i of n lies: Hammersley's points, centred.
glm::dvec2 place_of(uint32_t i, uint32_t n) {
    double y = 0, digit = 0.5;
    for (uint32_t bits = i; bits != 0; bits >>= 1, digit *= 0.5)
        y += bits & 1 ? digit : 0.0;
    return {(i + 0.5) / n, y + 0.5 / std::bit_ceil(n)};
}

/// A surface point's colour, but for what is read from the volume's other grids. `indirect` gives
/// the irradiance of the field and is asked only where that counts.
template <class Indirect>
glm::dvec3 colour_of(Show show, const SurfacePoint& p, const reference::Paths& paths,
                     uint64_t& rays, const Indirect& indirect) {
    if (show == Show::albedo)
        return p.albedo;
    if (show == Show::normal)
        return p.smooth;
    if (show == Show::irradiance)
        return indirect();
    glm::dvec3 colour(0.0), irradiance(0.0);
    if (show != Show::direct)
        irradiance += indirect();
    if (show != Show::indirect) {
        irradiance += paths.illuminance(reference::off_surface(p.point, p.normal), p.smooth, rays,
                                        reference::Paths::Lights::others);
        colour += paths.emission(p.hit);
    }
    return colour + p.albedo / glm::pi<double>() * irradiance;
}

/// True if what is shown is light on its way to the eye.
bool is_seen_through_glass(Show show) {
    return show == Show::final || show == Show::direct || show == Show::indirect;
}

glm::dvec3 background(const Scene& scene, Show show, glm::dvec3 direction) {
    return show == Show::final || show == Show::direct
               ? glm::dvec3(scene::sky_luminance(scene.sky, glm::vec3(glm::normalize(direction))))
               : glm::dvec3(0.0);
}

/// What the volume itself has at a point (metres).
glm::dvec3 colour_of_volume(Show show, const Volume& volume, const readers::Reader& reader,
                            glm::dvec3 point, glm::dvec3 n) {
    if (show == Show::cells) {
        const glm::ivec3 cell =
            glm::clamp(glm::ivec3(glm::floor(volume.grid.to_grid(point) + 0.5 * n)), glm::ivec3(0),
                       volume.grid.dims - 1);
        return double(volume::sh_y0) * glm::dvec3(volume.sh[0][volume.grid.index(cell)]);
    }
    const volume::CellWeights plain = volume::weights_at(volume, point, n, Reading::trilinear);
    double sum = 0;
    if (show == Show::validity) {
        for (std::size_t i = 0; i < 8; ++i)
            sum += volume.validity.empty() ? plain.weight[i]
                                           : plain.weight[i] * volume.validity[plain.cell[i]];
        const volume::CellWeights used = readers::taps_of(reader, volume, point, n);
        if (std::ranges::count(used.weight, 0.0) == 8)
            return {1, 0, 0};
        return glm::dvec3(sum);
    }
    const volume::ShValues basis = volume::sh_basis(1, glm::vec3(n));
    for (std::size_t i = 0; i < 8; ++i)
        for (std::size_t k = 0; k < volume.occlusion.size(); ++k)
            sum += plain.weight[i] * double(basis[k] * volume.occlusion[k][plain.cell[i]]);
    return glm::dvec3(std::clamp(sum, 0.0, 1.0));
}

/// What is seen of a colour so far along a ray, with what the air before it adds, so many times.
glm::dvec3 through_air(const medium::Fog& fog, Show show, glm::dvec3 origin, glm::dvec3 along,
                       double depth, glm::dvec3 colour, double weight) {
    const double length = glm::length(along), distance = depth * length;
    const glm::dvec3 way = along / length;
    colour *= fog.transmittance(origin, way, distance);
    if (weight > 0 && show != Show::indirect)
        colour += weight * fog.direct(origin, way, distance);
    if (weight > 0 && show != Show::direct)
        colour += weight * fog.of_field(origin, way, distance);
    return colour;
}

/// How often what air adds counts in each of n samples: it is summed in few, spread over the pixel.
std::vector<double> fog_weights(uint32_t n) {
    constexpr uint32_t most = 4;
    const uint32_t stride = n / std::min(n, most);
    std::vector<double> weights;
    for (uint32_t i = 0; i < n; ++i)
        weights.push_back(i % stride == i / stride % stride ? 1.0 : 0.0);
    const double all = std::accumulate(weights.begin(), weights.end(), 0.0);
    for (double& weight : weights)
        weight *= n / all;
    return weights;
}

/// Tells `take(index, point)` what each pixel of a picture sees in its middle, if anything.
template <class Take>
void for_middles(const scene::RsmView& view, glm::ivec2 size, const raster::Raster& raster,
                 const Surface& surface, const Take& take) {
    const std::vector<raster::RsmOrigin>& origins = raster.geometry().origins;
    for (int y = 0; y < size.y; y += raster::max_tile)
        for (int x = 0; x < size.x; x += raster::max_tile) {
            const raster::Tile tile{
                size, {x, y}, glm::min(glm::ivec2(raster::max_tile), size - glm::ivec2(x, y))};
            const std::span<const raster::RasterTexel> seen = raster.draw(view, tile, true);
            for (int row = 0; row < tile.extent.y; ++row)
                for (int column = 0; column < tile.extent.x; ++column) {
                    const raster::RasterTexel& texel =
                        seen[std::size_t(row) * std::size_t(tile.extent.x) + std::size_t(column)];
                    if (texel.triangle == 0)
                        continue;
                    const auto [instance, triangle] = origins[texel.triangle - 1];
                    const glm::dvec3 along = view.along(tile.at(column, row));
                    take(std::size_t(y + row) * std::size_t(size.x) + std::size_t(x + column),
                         surface.point(instance, triangle,
                                       surface.barycentric(instance, triangle, view.origin, along),
                                       along));
                }
        }
}

SeenPlanes planes_of(const scene::RsmView& view, glm::ivec2 size, const raster::Raster& raster,
                     const Surface& surface) {
    std::vector<SeenPlanes::Plane> planes(std::size_t(size.x) * std::size_t(size.y));
    for_middles(view, size, raster, surface, [&](std::size_t i, const SurfacePoint& p) {
        planes[i] = {p.point, p.normal};
    });
    return {view, size, std::move(planes)};
}

medium::Texture<float> distances_of(const scene::RsmView& view, glm::ivec2 size,
                                    const raster::Raster& raster, const Surface& surface) {
    medium::Texture<float> distances(size, HUGE_VALF);
    for_middles(view, size, raster, surface, [&](std::size_t i, const SurfacePoint& p) {
        distances.texels[i] = float(glm::length(p.point - view.origin));
    });
    return distances;
}

/// Of a row of a picture.
struct RowCount {
    uint64_t rays = 0;
    PairCount pairs;
};

image::Pixels black(glm::ivec2 size) {
    return {size.x, size.y, 3, std::vector<float>(std::size_t(size.x) * std::size_t(size.y) * 3)};
}

void set_pixel(image::Pixels& picture, int column, int row, glm::dvec3 colour) {
    const std::size_t first =
        3 * (std::size_t(row) * std::size_t(picture.width) + std::size_t(column));
    for (int channel = 0; channel < 3; ++channel)
        picture.samples[first + std::size_t(channel)] = float(colour[channel]);
}

/// Adds light of suns in air, marched at fewer pixels and read between them.
void add_volume_light(const ViewSettings& settings, const scene::RsmView& view,
                      const raster::Raster& raster, const Surface& surface, Rendering& result) {
    if (!settings.volume_light || (settings.show != Show::final && settings.show != Show::direct))
        return;
    const medium::Texture<glm::dvec3> light = settings.volume_light->scattered(
        view, distances_of(view, settings.size, raster, surface), result.steps);
    image::Pixels& picture = result.picture;
    for (int row = 0; row < picture.height; ++row)
        for (int column = 0; column < picture.width; ++column) {
            const glm::dvec3 more =
                light.between((glm::dvec2(column, row) + 0.5) / double(medium::coarseness));
            const std::size_t first =
                3 * (std::size_t(row) * std::size_t(picture.width) + std::size_t(column));
            for (int channel = 0; channel < 3; ++channel)
                picture.samples[first + std::size_t(channel)] += float(more[channel]);
        }
}

} // namespace

Rendering render(const LitScene& lit, const volume::Levels& levels, const raster::Raster& raster,
                 const readers::Reader& reader, const ViewSettings& settings, Progress& progress) {
    const Scene& scene = lit.scene;
    const scene::Frame& frame = lit.frame;
    const visibility::Visibility& visibility = lit.visibility;
    const reference::Paths& paths = lit.paths;
    const Show show = settings.show;
    if (show == Show::occlusion && levels.volumes.front().occlusion.empty())
        throw Error(ErrorKind::invalid, "the volume holds no occlusion to show; lpv bakes it");
    const glm::ivec2 size = settings.size;
    const scene::RsmView view = view_of(settings.camera, frame, size);
    const Surface surface(scene, frame);
    const std::vector<raster::RsmOrigin>& origins = raster.geometry().origins;
    const auto samples = uint32_t(settings.samples);
    const RsmLight* const rsm = settings.rsm;
    std::optional<SeenPlanes> planes;
    if (rsm && rsm->settings().seen == RsmLightSettings::Seen::ssdo)
        planes = planes_of(view, size, raster, surface);

    const bool through_glass = is_seen_through_glass(show);
    const auto tint_of = [&](glm::dvec3 along, double depth) {
        if (!through_glass)
            return glm::dvec3(1.0);
        return glm::dvec3(visibility.tint(
            {glm::vec3(view.origin), glm::vec3(along), float(view.nearest), float(depth)}, true));
    };
    const auto colour = [&](const raster::RasterTexel& seen, glm::dvec3 along, double fog_weight,
                            uint32_t key, RowCount& count) {
        const auto in_air = [&](glm::dvec3 behind, double depth) {
            return settings.fog && through_glass ? through_air(*settings.fog, show, view.origin,
                                                               along, depth, behind, fog_weight)
                                                 : behind;
        };
        if (seen.triangle == 0)
            return in_air(background(scene, show, along) * tint_of(along, HUGE_VAL), HUGE_VAL);
        const auto [instance, triangle] = origins[seen.triangle - 1];
        SurfacePoint p = surface.point(
            instance, triangle, surface.barycentric(instance, triangle, view.origin, along), along);
        p.albedo = seen.albedo;
        const glm::dvec3 world = frame.to_world(p.point);
        if (show == Show::cells || show == Show::validity || show == Show::occlusion)
            return colour_of_volume(show, levels.volumes[volume::level_at(levels, world)], reader,
                                    world, p.smooth);
        const double depth = glm::dot(p.point - view.origin, view.axis);
        const glm::dvec3 of_surface = colour_of(show, p, paths, count.rays, [&] {
            if (rsm)
                return rsm->illuminance(reference::off_surface(p.point, p.normal), p.smooth, key,
                                        planes ? &*planes : nullptr, count.rays, count.pairs);
            return glm::max(readers::irradiance(reader, levels, world, p.smooth), 0.0);
        });
        return in_air(tint_of(along, depth) * of_surface, depth);
    };

    Rendering result;
    result.picture = black(size);
    const std::vector<double> fog = fog_weights(samples);
    std::vector<glm::dvec3> sums;
    std::vector<RowCount> counts(std::size_t(size.y));
    const auto across = uint64_t((size.x + raster::max_tile - 1) / raster::max_tile);
    const auto down = uint64_t((size.y + raster::max_tile - 1) / raster::max_tile);
    progress.begin("render", across * down * samples);
    uint64_t done = 0;
    for (int y = 0; y < size.y; y += raster::max_tile)
        for (int x = 0; x < size.x; x += raster::max_tile) {
            raster::Tile tile{
                size, {}, glm::min(glm::ivec2(raster::max_tile), size - glm::ivec2(x, y))};
            tile.seed = uint32_t(y / raster::max_tile) * 65536u + uint32_t(x / raster::max_tile);
            const glm::ivec2 extent = tile.extent;
            sums.assign(std::size_t(extent.x) * std::size_t(extent.y), glm::dvec3(0.0));
            for (uint32_t sample = 0; sample < samples; ++sample) {
                tile.corner = glm::dvec2(x, y) + place_of(sample, samples) - 0.5;
                // What is seen of a blended surface is spread over the samples, by the golden
                // ratio.
                tile.shift = sample * 0x9e3779b9u;
                const std::span<const raster::RasterTexel> seen = raster.draw(view, tile, true);
                tbb::parallel_for(0, extent.y, [&](int row) {
                    for (int column = 0; column < extent.x; ++column) {
                        const std::size_t i =
                            std::size_t(row) * std::size_t(extent.x) + std::size_t(column);
                        const auto key = uint32_t((y + row) * size.x + x + column) * samples;
                        sums[i] += colour(seen[i], view.along(tile.at(column, row)), fog[sample],
                                          mix_word(key + sample), counts[std::size_t(y + row)]);
                    }
                });
                progress.advance(++done);
            }
            for (int row = 0; row < extent.y; ++row)
                for (int column = 0; column < extent.x; ++column)
                    set_pixel(result.picture, x + column, y + row,
                              sums[std::size_t(row) * std::size_t(extent.x) + std::size_t(column)]
                                  / double(samples));
        }
    add_volume_light(settings, view, raster, surface, result);
    for (const RowCount& row : counts) {
        result.rays += row.rays;
        result.pairs.add(row.pairs);
    }
    return result;
}

Rendering trace_picture(const LitScene& lit, const ViewSettings& settings, Progress& progress) {
    constexpr int rows_at_a_time = 16;
    const Scene& scene = lit.scene;
    const scene::Frame& frame = lit.frame;
    const visibility::Visibility& visibility = lit.visibility;
    const reference::Paths& paths = lit.paths;
    const Show show = settings.show;
    const glm::ivec2 size = settings.size;
    const scene::RsmView view = view_of(settings.camera, frame, size);
    const Surface surface(scene, frame);
    const auto samples = uint32_t(settings.samples);
    std::optional<TrackedAir> air;
    if (settings.air && is_seen_through_glass(show))
        air.emplace(paths, frame, *settings.air);

    const auto colour = [&](glm::dvec3 along, reference::PathSampler& sampler, uint64_t& rays) {
        ++rays;
        const visibility::Hit hit = visibility.closest_front(
            {glm::vec3(view.origin), glm::vec3(along), float(view.nearest), HUGE_VALF});
        const glm::dvec3 tint(is_seen_through_glass(show) ? hit.tint : glm::vec3(1.0f));
        const bool is_hit = hit.instance != visibility::no_hit;
        TrackedAir::Seen seen{glm::dvec3(0.0), glm::dvec3(1.0)};
        if (air) {
            const double length = glm::length(along);
            seen =
                air->track(view.origin, along / length, is_hit ? double(hit.t) * length : HUGE_VAL,
                           {show != Show::indirect, show != Show::direct}, sampler, rays);
            if (seen.left == glm::dvec3(0.0))
                return seen.scattered;
        }
        if (!is_hit)
            return seen.left * tint * background(scene, show, along);
        SurfacePoint p = surface.point(
            hit.instance, hit.triangle,
            surface.barycentric(hit.instance, hit.triangle, view.origin, along), along);
        const Mesh& mesh = scene.meshes[std::size_t(scene.instances[hit.instance].mesh)];
        p.albedo = scene::sample_surface(scene, mesh, hit.triangle, p.hit.barycentric).albedo;
        return seen.left * tint * colour_of(show, p, paths, rays, [&] {
                   return paths.irradiance(glm::vec3(reference::off_surface(p.point, p.normal)),
                                           p.smooth, sampler, rays);
               });
    };

    Rendering result;
    result.picture = black(size);
    std::vector<uint64_t> rays(std::size_t(size.y), 0);
    std::vector<glm::dvec3> variance(std::size_t(size.y), glm::dvec3(0.0));
    progress.begin("reference", uint64_t(size.y));
    for (int y = 0; y < size.y; y += rows_at_a_time) {
        tbb::parallel_for(y, std::min(y + rows_at_a_time, size.y), [&](int row) {
            for (int column = 0; column < size.x; ++column) {
                const uint64_t key = reference::join_bits(uint64_t(row), uint64_t(column));
                glm::dvec3 sum(0.0), squares(0.0);
                for (uint32_t i = 0; i < samples; ++i) {
                    reference::PathSampler sampler(key, i);
                    const glm::dvec2 at =
                        2.0 * (glm::dvec2(column, row) + sampler.pair()) / glm::dvec2(size) - 1.0;
                    const glm::dvec3 value =
                        colour(view.along(at), sampler, rays[std::size_t(row)]);
                    sum += value;
                    squares += value * value;
                }
                const double n = samples;
                set_pixel(result.picture, column, row, sum / n);
                if (samples > 1)
                    variance[std::size_t(row)] +=
                        glm::max(glm::dvec3(0.0), squares - sum * sum / n) / (n * (n - 1));
            }
        });
        progress.advance(uint64_t(std::min(y + rows_at_a_time, size.y)));
    }
    result.rays = std::accumulate(rays.begin(), rays.end(), uint64_t(0));
    const glm::dvec3 sum = std::accumulate(variance.begin(), variance.end(), glm::dvec3(0.0));
    result.noise = std::sqrt((sum.x + sum.y + sum.z) / (3.0 * size.x * size.y));
    return result;
}

} // namespace lpvbake::render
