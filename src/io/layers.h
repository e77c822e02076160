// Files of layers of light: a volume of each beside that of all light, and a manifest.
//
// STEM.EXTENSION holds all light, STEM_layer_NAME.EXTENSION a layer; of levels and of places there
// are sets of files by these names (io/levels.h), and of points files of them. Where layers have
// larger cells, STEM_layers.EXTENSION holds all light in those. STEM.layers.json:
//
//     {"format": "lpvbake layers", "version": 1,
//      "file": of the volume of all light in the same cells, beside the manifest, or the manifest
//      of its set, "layers": [{"name", "kind": "light", "emitter", "group", "sun", "sky", "rest",
//      "mode",
//                  "visibility" (of order 4, whatever that of all light is) or "bounce",
//                  "unit": what weight 1 is: "scene": as the scene has it; "nits",
//                  "weight": [r, g, b]: the sum with these is all light,
//                  "lights": its places in the metadata `lights` of that, "emitters": names of
//                  its materials, "sky": whether it has the sky: what to dim of the direct light,
//                  "sun": of a sun {"latitude", "longitude", "date": "06-21", "hour"},
//                  "file": of the layer, as above}, ...]}
#pragma once

#include "lpvbake/file.h"

#include <glm/glm.hpp>

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::io {

/// When and where a layer's sun stands, as scene::SunArc has it.
struct SunPlace {
    double latitude = 0, longitude = 0; ///< degrees
    std::string date;                   ///< "06-21"
    double hour = 0;
};

struct LayerEntry {
    std::string name, kind, unit;
    glm::vec3 weight{1.0f};
    std::string file; ///< the path of its volume, or of the manifest of its set
    std::vector<std::size_t> lights = {};
    std::vector<std::string> emitters = {};
    bool sky = false;
    std::optional<SunPlace> sun = {};
};

struct LayerSet {
    std::string file; ///< as LayerEntry::file, of all light
    std::vector<LayerEntry> layers;
};

std::string layer_path(const std::string& path, const std::string& name);
/// Of all light in the cells of layers whose cells are not those of the volume.
std::string layers_whole_path(const std::string& path);
/// Of the volume, or set, of this name.
std::string layer_manifest_path(const std::string& path);
/// By the end of its name.
bool is_layer_manifest(const std::string& path);

/// The list as metadata `layers` have it: name, kind, unit and weight of each, JSON.
std::string text_of(const std::vector<LayerEntry>& layers);

/// The manifest of what is written by the name `path`, which is read by `file`, and of layers;
/// removes files of layers that a former one of the name lists, but for those that are `written`.
/// Throws Error (file).
WriteReport::File write_layer_manifest(const std::string& path, const std::string& file,
                                       const std::vector<LayerEntry>& layers,
                                       const std::vector<WriteReport::File>& written);

/// All but what is to be dimmed of direct light. Throws Error: file (it is not there), invalid
/// (what it says is wrong).
LayerSet read_layer_manifest(const std::string& path);

} // namespace lpvbake::io
