// A Scene as a glTF file, for tests that read scenes from files.
#pragma once

#include "scene/scene.h"

#include <string>

namespace lpvbake::scenes {

/// Writes meshes (positions alone), colours, emission, sidedness, instances and lights to a .gltf
/// file with its buffer embedded. Textures, vertex colours and cameras are left out.
void write_gltf(const Scene& scene, const std::string& path);

} // namespace lpvbake::scenes
