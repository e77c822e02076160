// glTF 2.0 (.gltf, .glb) to a Scene. The only folder that sees tinygltf, libdraco and
// meshoptimizer.
#pragma once

#include "scene/scene.h"

#include <optional>
#include <string>

namespace lpvbake {

/// What of a file is taken, and how much it may cost. Scenes, animations and variants go by name
/// or, where no name fits, by index.
struct LoadSettings {
    MaterialRules rules = {};
    std::string scene = {};          ///< empty: the file's default, else its first
    std::string animation = {};      ///< empty: none, or the first where there is a time
    std::optional<double> time = {}; ///< seconds; none: 0 where there is an animation
    std::string variant = {};        ///< of KHR_materials_variants; empty: the default materials
    bool strict = false;             ///< a warning is an error
    bool allow_external = false;     ///< URIs may leave the scene's folder
    bool skip_colors = false; ///< images that do nothing but colour surfaces have a size alone
    uint64_t max_memory = uint64_t{4} << 30; ///< bytes that loading may take
};

/// Loads a file. Errors carry the file, the JSON path, what is wrong and the remedy: file
/// (unreadable), invalid (broken, or a warning under `strict`), unsupported (a required extension
/// that is not understood), usage (there is no such scene, animation or variant), memory (past
/// `max_memory`). What is left out or understood only in part is named in Scene::warnings.
Scene load_gltf(const std::string& path, const LoadSettings& settings = {});

} // namespace lpvbake
