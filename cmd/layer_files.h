// Layers of light in files: as `bake` writes them, and `mix` names them.
#pragma once

#include "bake/layers.h"
#include "io/layers.h"
#include "scene_options.h"

#include <span>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// "lights", "emitters", "sky", "sky:2" or "NAME=GLOB", several with commas between them. Throws
/// Error (argument).
std::vector<bake::LayerWish> parse_layers(const std::string& text);

/// The layers, in files beside `path`.
std::vector<io::LayerEntry> entries_of(std::span<const bake::Layer> layers,
                                       const std::string& path);

/// Throws Error (argument) for outputs that have no form for layers, or whose files would be each
/// other's or an input.
void check_layer_outputs(const std::vector<std::string>& paths, std::span<const bake::Layer> layers,
                         const std::vector<std::string>& inputs);

/// Writes the volume, its layers and a manifest to all paths, together, as write_outputs; layers
/// get the volume's walls. All grids are gone then.
std::vector<Written> write_layers(const OutputOptions& o, const std::vector<std::string>& paths,
                                  Volume& volume, std::span<const bake::Layer> layers,
                                  std::vector<Volume>& volumes, TerminalProgress& progress);

} // namespace lpvbake::cmd
