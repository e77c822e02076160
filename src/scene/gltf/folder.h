// Files beside a scene: reading them, and keeping URIs inside the scene's folder.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace lpvbake {

/// Reads a regular file whole. Throws Error (file) whose text begins with `place`.
std::vector<unsigned char> read_file(const std::filesystem::path& path, const std::string& place);

/// "%41" becomes "A" (RFC 3986); a % without two hex digits stays.
std::string percent_decoded(std::string_view uri);

/// The file that a relative URI names. Throws Error (invalid), beginning with `place`, for absolute
/// paths, schemes, "..", and links that lead out of `folder`; Error (file) if there is no such
/// file.
std::filesystem::path resolve_uri(const std::filesystem::path& folder, std::string_view uri,
                                  const std::string& place);

/// The bytes of "data:...;base64,...". Throws Error (invalid), beginning with `place`.
std::vector<unsigned char> decode_data_uri(std::string_view uri, const std::string& place);

} // namespace lpvbake
