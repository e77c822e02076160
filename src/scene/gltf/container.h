// The parts of a glTF file.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace lpvbake::scene::gltf {

/// The JSON and the binary chunk of a .glb, or the text of a .gltf.
struct Container {
    std::string_view text;
    std::span<const unsigned char> chunk;
};

/// Throws Error (invalid, unsupported), beginning with `file`.
Container open_container(std::span<const unsigned char> bytes, const std::string& file);

} // namespace lpvbake::scene::gltf
