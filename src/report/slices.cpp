#include "report/slices.h"

#include "image/image.h"
#include "io/slice.h"
#include "reference/sampler.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <algorithm>

namespace lpvbake::report {
namespace {

constexpr std::size_t most_cells = 1 << 18;
constexpr uint64_t usual_rays = 256;

Volume empty_layer(const Grid& grid, LayerChoice layer, int order) {
    Volume volume;
    volume.grid = grid;
    glm::dvec3 corner(0);
    corner[layer.axis] = layer.index;
    volume.grid.origin = grid.to_world(corner);
    volume.grid.dims[layer.axis] = 1;
    volume.sh_order = order;
    volume.sh.assign(std::size_t(volume::sh_count(order)),
                     std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    volume.validity.assign(volume.grid.size(), 0.0f);
    return volume;
}

/// Calls `act` with a cell's index in the layer and its coordinates in the whole grid.
template <class Act>
void for_cells(const Grid& layer_grid, LayerChoice layer, const Act& act) {
    glm::ivec3 c;
    for (c.z = 0; c.z < layer_grid.dims.z; ++c.z)
        for (c.y = 0; c.y < layer_grid.dims.y; ++c.y)
            for (c.x = 0; c.x < layer_grid.dims.x; ++c.x) {
                glm::ivec3 whole = c;
                whole[layer.axis] = layer.index;
                act(layer_grid.index(c), whole);
            }
}

} // namespace

LayerChoice shown_layer(const Grid& grid) {
    const int axis = grid.dims.x < grid.dims.z ? 0 : 2;
    return {axis, grid.dims[axis] / 2};
}

Volume layer_of(const Volume& volume, LayerChoice layer) {
    Volume result = empty_layer(volume.grid, layer, volume.sh_order);
    for_cells(result.grid, layer, [&](std::size_t own, glm::ivec3 whole) {
        const std::size_t cell = volume.grid.index(whole);
        for (std::size_t k = 0; k < result.sh.size(); ++k)
            result.sh[k][own] = volume.sh[k][cell];
        result.validity[own] = volume.validity.empty() ? 1.0f : volume.validity[cell];
    });
    return result;
}

std::optional<Volume> trace_layer(const Scene& scene, const visibility::Visibility& visibility,
                                  const Grid& grid, const std::vector<float>& validity,
                                  LayerChoice layer, int order, const reference::PathRules& rules,
                                  uint64_t seed, uint64_t& rays, Progress& progress) {
    Volume volume = empty_layer(grid, layer, order);
    if (volume.grid.size() > most_cells)
        return std::nullopt;
    std::vector<std::size_t> cells;
    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    for_cells(volume.grid, layer, [&](std::size_t own, glm::ivec3 whole) {
        if (validity[grid.index(whole)] == 0)
            return;
        volume.validity[own] = 1;
        cells.push_back(own);
        points.push_back(visibility.capture(whole).point);
        keys.push_back(own);
    });
    const scene::Frame frame = scene::frame_of(grid);
    reference::ReferenceSettings settings;
    settings.sh_order = order;
    settings.rays = usual_rays;
    settings.paths = rules;
    settings.seed = seed;
    const reference::ProbeField field =
        reference::trace_probes(scene, visibility, frame, points, keys, settings, progress);
    for (std::size_t k = 0; k < volume.sh.size(); ++k)
        for (std::size_t i = 0; i < cells.size(); ++i)
            volume.sh[k][cells[i]] = field.sh[k][i];
    rays = field.rays;
    return volume;
}

Slices draw_slices(const Volume& result, const Volume& reference, LayerChoice layer) {
    Slices slices;
    slices.axis = layer.axis;
    slices.index = layer.index;
    const io::SliceScale scale = io::slice_scale(reference, layer.axis, 0);
    slices.white = double(scale.white);
    slices.result = image::encode_png(io::slice_picture(result, layer.axis, 0, scale), "slice");
    slices.reference =
        image::encode_png(io::slice_picture(reference, layer.axis, 0, scale), "slice");

    const volume::Comparison comparison = volume::compare(result, reference, {});
    slices.error_white = io::error_white(comparison.cell_error);
    Volume error = reference;
    error.sh_order = 0;
    error.sh.resize(1);
    for (std::size_t i = 0; i < error.sh[0].size(); ++i) {
        error.sh[0][i] =
            io::false_colour(comparison.cell_error[i] / slices.error_white) / volume::sh_y0;
        error.validity[i] = volume::valid_in_both(result, reference, i);
    }
    slices.error =
        image::encode_png(io::slice_picture(error, layer.axis, 0, io::SliceScale{}), "slice");
    return slices;
}

} // namespace lpvbake::report
