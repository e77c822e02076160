// What programs write against glTF 2.0 and viewers show all the same, put right in the document.
#pragma once

#include "scene/gltf/warnings.h"

#include <nlohmann/json_fwd.hpp>

namespace lpvbake::scene::gltf {

/// With a warning for each: spot lights get the `spot` that they lack, textures and images lose
/// references that lead nowhere, and a default scene goes where nodes are all that there is. What
/// has another type than it should is left to check_schema.
void repair(nlohmann::json& root, Warnings& warnings);

} // namespace lpvbake::scene::gltf
