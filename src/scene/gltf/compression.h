// Compressed geometry: meshoptimizer's buffer views and Draco's meshes. Sizes are checked against
// what the document declares before memory is taken.
#pragma once

#include "scene/gltf/accessor.h"

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

/// EXT_meshopt_compression's or KHR_meshopt_compression's description of a buffer view.
struct MeshoptView {
    std::span<const unsigned char> bytes; ///< compressed
    uint64_t count = 0;                   ///< elements
    uint64_t stride = 0;                  ///< bytes an element
    std::string mode;                     ///< ATTRIBUTES, TRIANGLES, INDICES
    std::string filter = "NONE";
};

/// Throws Error (invalid), beginning with `place`, unless the extension allows what `view` says of
/// `length` decompressed bytes.
void check_meshopt(const MeshoptView& view, uint64_t length, const std::string& place);

/// count * stride bytes. Throws Error (invalid, unsupported), beginning with `place`.
std::vector<unsigned char> decode_meshopt(const MeshoptView& view, const std::string& place);

/// What a primitive of KHR_draco_mesh_compression has to hold.
struct DracoLimits {
    uint64_t vertices = 0;
    uint64_t indices = 0; ///< 3 a triangle
};

struct DracoMesh {
    struct Attribute {
        std::vector<unsigned char> bytes; ///< packed
        Component component;
        int width;
    };
    std::vector<uint32_t> indices;
    uint64_t vertices = 0;
    std::map<int, Attribute> attributes; ///< by Draco's unique id
};

/// Throws Error (invalid), beginning with `place`, unless the mesh has just the triangles and
/// vertices of `limits`; memory stays proportional to them whatever the data say.
DracoMesh decode_draco(std::span<const unsigned char> bytes, const DracoLimits& limits,
                       const std::string& place);

} // namespace lpvbake::scene::gltf
