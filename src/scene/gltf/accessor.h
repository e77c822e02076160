// Packed numbers of a glTF buffer as vectors of floats or indices.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

/// The component types of glTF 2.0, by their numbers there.
enum class Component : int {
    int8 = 5120,
    uint8 = 5121,
    int16 = 5122,
    uint16 = 5123,
    uint32 = 5125,
    float32 = 5126,
};

/// Bytes of a component; 0 if glTF has no such type.
size_t component_size(int type);

/// Some bytes, of which element i starts at i * stride. Whoever makes one has checked, by
/// `fits`, that all elements lie inside.
struct Elements {
    std::span<const unsigned char> bytes;
    size_t stride = 0;
    size_t count = 0;
    Component component = Component::float32;
    int width = 1; ///< components an element
    bool normalized = false;
};

/// True if `count` elements of `size` bytes, `stride` apart, lie within `available` bytes.
bool fits(uint64_t count, uint64_t stride, uint64_t size, uint64_t available);

/// All components as floats, width * count of them; integers are normalised where that is asked for
/// (glTF 2.0, section 3.11).
std::vector<float> to_floats(const Elements& elements);

/// All components as integers. Float components are not allowed.
std::vector<uint32_t> to_indices(const Elements& elements);

} // namespace lpvbake::scene::gltf
