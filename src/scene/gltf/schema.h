// Types, required properties and references of a glTF document, checked before anything is read.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <string>

namespace lpvbake::scene::gltf {

/// Throws Error (invalid) with the JSON path unless every property that the loader reads has its
/// type and every index points into its array. Whole numbers that are written as reals (4.0, 4e0)
/// become integers where those are wanted.
void check_schema(nlohmann::json& root, const std::string& file);

} // namespace lpvbake::scene::gltf
