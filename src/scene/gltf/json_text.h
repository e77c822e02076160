// The text of a glTF document, made values.
#pragma once

#include "scene/gltf/warnings.h"

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

/// Parses JSON text. A number that is none or too large for a double (NaN, 1e400) becomes null,
/// which nobody misses who does not read it; bytes that are no UTF-8 are taken for Latin-1, with a
/// warning. Throws Error (invalid) beginning with `file`.
nlohmann::json parse_json(std::string_view text, const std::string& file, Warnings& warnings);

} // namespace lpvbake::scene::gltf
