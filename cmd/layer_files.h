// Layers of light in files: as `bake` writes them, and `mix` names them.
#pragma once

#include "bake/layers.h"
#include "io/layers.h"
#include "scene_options.h"
#include "volume/points.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// "lights", "emitters", "sky", "sky:2" or "NAME=GLOB", several with commas between them. Throws
/// Error (argument).
std::vector<bake::LayerWish> parse_layers(const std::string& text);

/// The layers, in files beside `path`, of so many levels, or places.
std::vector<io::LayerEntry> entries_of(std::span<const bake::Layer> layers, const std::string& path,
                                       std::size_t levels = 1, bool placed = false);

/// The sets of levels that layers of levels are: `layers` has all of a level, and the set its form.
std::vector<volume::VolumeSet> sets_of(const volume::VolumeSet& set,
                                       std::vector<std::vector<Volume>> layers);

/// What the suns among the layers err between each other, in the first volume; none of fewer than
/// three.
std::optional<bake::HeldOut> held_out(std::span<const bake::Layer> layers,
                                      std::span<const volume::VolumeSet> sets,
                                      const std::vector<float>& validity);

/// Throws Error (argument) for outputs that have no form for layers, or whose files, of so many
/// levels or of these places, would be each other's or an input.
void check_layer_outputs(const std::vector<std::string>& paths, std::span<const bake::Layer> layers,
                         std::size_t levels, const std::vector<volume::Place>& places,
                         const std::vector<std::string>& inputs, bool own_grid);

/// Layers of a set, and all light in their cells where those are not the set's.
struct LayerSets {
    std::vector<volume::VolumeSet> sets;
    std::optional<volume::VolumeSet> whole;
};

/// Writes the set, its layers and a manifest to all paths, together, as write_levels; layers get
/// the walls of all light. All grids are gone then.
std::vector<Written> write_layers(const OutputOptions& o, const std::vector<std::string>& paths,
                                  volume::VolumeSet& set, std::span<const bake::Layer> layers,
                                  LayerSets& made, TerminalProgress& progress);

/// The same of the light at points.
std::vector<Written> write_layers(const std::vector<std::string>& paths, volume::LitPoints& lit,
                                  std::span<const bake::Layer> layers, std::vector<Volume>& fields);

} // namespace lpvbake::cmd
