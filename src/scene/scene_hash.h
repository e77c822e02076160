// One number for everything in a scene that light can see.
#pragma once

#include "scene/scene.h"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene {

/// 64-bit FNV-1a of each instance, with its mesh, material and images, and of lights, sky and rules
/// (names, paths and cameras left out).
struct SceneParts {
    std::vector<uint64_t> instances;
    uint64_t others = 0;
};
SceneParts parts_of(const Scene& scene);

/// The same over all of them, as 16 hex digits. Tells stale bakes apart; no protection against
/// forgery.
std::string scene_hash(const Scene& scene);
/// That of the scene of these instances alone (scene/surroundings.h).
std::string scene_hash(const SceneParts& parts, std::span<const std::size_t> kept);
/// The same over what surfaces are and reflect: without lights, sky and emission.
std::string surfaces_hash(const Scene& scene);
/// The same over texts, each led by its length.
std::string text_hash(std::span<const std::string> texts);
/// The same over the bytes of a file. Throws Error (file).
std::string file_hash(const std::string& path);

} // namespace lpvbake::scene
