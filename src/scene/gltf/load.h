// glTF 2.0 (.gltf, .glb) to a Scene. The only folder that sees tinygltf and image decoders.
#pragma once

#include "scene/scene.h"

#include <string>

namespace lpvbake {

/// Loads a file and its default scene. URIs may not leave the file's folder. Errors carry the file,
/// the JSON path and the remedy: file (unreadable), invalid (broken), unsupported (a required
/// extension that is not understood). What is understood only in part is named in Scene::warnings.
Scene load_gltf(const std::string& path, const MaterialRules& rules);

} // namespace lpvbake
