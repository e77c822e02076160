// glTF documents with views compressed by meshoptimizer.
#pragma once

#include "unit/gltf_document.h"

#include <meshoptimizer.h>

#include <algorithm>

namespace lpvbake {

inline std::string encode_vertices(const void* data, size_t count, size_t stride) {
    std::vector<unsigned char> bytes(meshopt_encodeVertexBufferBound(count, stride));
    bytes.resize(meshopt_encodeVertexBuffer(bytes.data(), bytes.size(), data, count, stride));
    return packed(bytes);
}

inline std::string encode_indices(const std::vector<uint32_t>& indices, bool as_triangles) {
    std::vector<unsigned char> bytes(
        std::max(meshopt_encodeIndexBufferBound(indices.size(), 1 << 20),
                 meshopt_encodeIndexSequenceBound(indices.size(), 1 << 20)));
    bytes.resize(as_triangles ? meshopt_encodeIndexBuffer(bytes.data(), bytes.size(),
                                                          indices.data(), indices.size())
                              : meshopt_encodeIndexSequence(bytes.data(), bytes.size(),
                                                            indices.data(), indices.size()));
    return packed(bytes);
}

/// A document whose buffer 1 has no bytes: its views are compressed in buffer 0.
struct MeshoptDocument : GltfDocument {
    std::string extension = "EXT_meshopt_compression";

    int compressed(const std::string& data, size_t count, size_t stride, const char* mode,
                   const char* filter = nullptr) {
        const int view_index = view(data);
        nlohmann::json& entry = root["bufferViews"][view_index];
        nlohmann::json description = {{"buffer", 0},
                                      {"byteOffset", entry["byteOffset"]},
                                      {"byteLength", data.size()},
                                      {"byteStride", stride},
                                      {"count", count},
                                      {"mode", mode}};
        if (filter)
            description["filter"] = filter;
        entry = {{"buffer", 1},
                 {"byteLength", count * stride},
                 {"extensions", {{extension, description}}}};
        return view_index;
    }

    int attribute(int view_index, size_t count, const char* shape, int component = 5126) {
        return append("accessors", {{"bufferView", view_index},
                                    {"componentType", component},
                                    {"count", count},
                                    {"type", shape}});
    }

    GltfDocument finished() const {
        GltfDocument document = *this;
        document.root["extensionsRequired"] = {extension};
        document.root["buffers"] = {
            {{"byteLength", bytes.size()},
             {"uri", "data:application/octet-stream;base64," + base64(bytes)}},
            {{"byteLength", 1 << 20}}};
        return document;
    }
};

} // namespace lpvbake
