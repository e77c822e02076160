// What a scene or a volume file holds, in words and as `lpvbake info --help` documents it.
#pragma once

#include "scene/scene.h"
#include "volume/volume.h"

#include <nlohmann/json_fwd.hpp>

#include <string>

namespace lpvbake::report {

/// `hash`: of a scene whose pictures are all there; else empty.
nlohmann::ordered_json scene_json(const std::string& path, const Scene& scene,
                                  const std::string& hash);
std::string scene_text(const std::string& path, const Scene& scene, const std::string& hash);

/// The scene's lights, as load_lights reads them.
nlohmann::ordered_json lights_json(const Scene& scene);

nlohmann::ordered_json volume_json(const std::string& path, const Volume& volume);
std::string volume_text(const std::string& path, const Volume& volume);

} // namespace lpvbake::report
