// One number for everything in a scene that light can see.
#pragma once

#include "scene/scene.h"

#include <span>
#include <string>

namespace lpvbake::scene {

/// 64-bit FNV-1a over meshes, materials, images, instances, lights and rules (names, paths and
/// cameras left out), as 16 hex digits. Tells stale bakes apart; no protection against forgery.
std::string scene_hash(const Scene& scene);
/// The same over texts, each led by its length.
std::string text_hash(std::span<const std::string> texts);
/// The same over the bytes of a file. Throws Error (file).
std::string file_hash(const std::string& path);

} // namespace lpvbake::scene
