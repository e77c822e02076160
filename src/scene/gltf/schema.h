// Types, required properties and references of a glTF document, checked before anything is read.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <string_view>

namespace lpvbake {

/// Parses JSON text. Throws Error (invalid) beginning with `file`, also for text nested so deeply
/// that a recursive reader could exhaust its stack.
nlohmann::json parse_json(std::string_view text, const std::string& file);

/// Throws Error (invalid) with the JSON path unless every property that the loader reads has its
/// type and every index points into its array.
void check_schema(const nlohmann::json& root, const std::string& file);

} // namespace lpvbake
