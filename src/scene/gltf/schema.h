// Types, required properties and references of a glTF document, checked before anything is read.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <cstdint>
#include <string>
#include <string_view>

namespace lpvbake::scene::gltf {

/// Most bytes that a value of JSON takes here and in tinygltf, its text aside.
inline constexpr uint64_t json_element_bytes = 384;

/// At least the number of values in JSON text, told without parsing it. Throws Error (invalid)
/// beginning with `file` for text nested so deeply that a recursive reader could exhaust its stack.
uint64_t json_elements(std::string_view text, const std::string& file);

/// Parses JSON text. Throws Error (invalid) beginning with `file`.
nlohmann::json parse_json(std::string_view text, const std::string& file);

/// Throws Error (invalid) with the JSON path unless every property that the loader reads has its
/// type and every index points into its array.
void check_schema(const nlohmann::json& root, const std::string& file);

} // namespace lpvbake::scene::gltf
