// Files beside a scene: reading them, and keeping URIs inside the scene's folder.
#pragma once

#include "lpvbake/error.h"
#include "scene/gltf/memory.h"

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

/// Reads standard input to its end, taking memory as it goes. Throws Error (file, memory).
std::vector<unsigned char> read_standard_input(MemoryLimit& memory);

/// "%41" becomes "A" (RFC 3986); a % without two hex digits stays.
std::string percent_decoded(std::string_view uri);

/// What a URI is refused for that `allow_external` lets through.
class LeadsOut : public Error {
public:
    using Error::Error;
};

/// The file that a relative URI names; backslashes stand for slashes where no name has them. Throws
/// Error (invalid), beginning with `place`, for schemes and, unless `allow_external`, LeadsOut for
/// absolute paths, ".." and links that lead out of `folder`; Error (file) if there is no such file,
/// with the name of one that may be meant.
std::filesystem::path resolve_uri(const std::filesystem::path& folder, std::string_view uri,
                                  const std::string& place, bool allow_external = false);

/// True for "data:...", in letters of either case.
bool is_data_uri(std::string_view uri);

/// The bytes of a data URI (RFC 2397), whose base64 may be broken into lines. Throws Error
/// (invalid), beginning with `place`.
std::vector<unsigned char> decode_data_uri(std::string_view uri, const std::string& place);

} // namespace lpvbake::scene::gltf
