// Files beside a scene: reading them, and keeping URIs inside the scene's folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace lpvbake::scene::gltf {

/// Bytes of a regular file. Throws Error (file) whose text begins with `place`.
uint64_t file_size(const std::filesystem::path& path, const std::string& place);

/// Reads a regular file, its first `most` bytes if it has more. Throws Error (file) whose text
/// begins with `place`.
std::vector<unsigned char> read_file(const std::filesystem::path& path, const std::string& place,
                                     uint64_t most = std::numeric_limits<uint64_t>::max());

/// "%41" becomes "A" (RFC 3986); a % without two hex digits stays.
std::string percent_decoded(std::string_view uri);

/// The file that a relative URI names. Throws Error (invalid), beginning with `place`, for schemes
/// and, unless `allow_external`, for absolute paths, "..", and links that lead out of `folder`;
/// Error (file) if there is no such file.
std::filesystem::path resolve_uri(const std::filesystem::path& folder, std::string_view uri,
                                  const std::string& place, bool allow_external = false);

/// The bytes of "data:...;base64,...". Throws Error (invalid), beginning with `place`.
std::vector<unsigned char> decode_data_uri(std::string_view uri, const std::string& place);

} // namespace lpvbake::scene::gltf
