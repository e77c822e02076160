// Pictures of one layer of a grid: a bake, the reference, and how far they are apart.
#pragma once

#include "report/report.h"

namespace lpvbake::report {

/// The layer that a report shows: the middle one across the shorter horizontal axis.
struct LayerChoice {
    int axis = 2, index = 0;
};
LayerChoice shown_layer(const Grid& grid);

/// One layer of a volume as a volume of its own.
Volume layer_of(const Volume& volume, LayerChoice layer);

/// The reference of one layer: Volume::sh of order `order` at the cells outside geometry. None
/// where the layer has more than 2^18 of them. `validity` is the whole grid's.
std::optional<Volume> trace_layer(const Scene& scene, const visibility::Visibility& visibility,
                                  const Grid& grid, const std::vector<float>& validity,
                                  LayerChoice layer, int order, const reference::PathRules& rules,
                                  uint64_t seed, uint64_t& rays, Progress& progress);

/// The three pictures of a layer; result and reference are volumes of that layer alone.
Slices draw_slices(const Volume& result, const Volume& reference, LayerChoice layer);

} // namespace lpvbake::report
