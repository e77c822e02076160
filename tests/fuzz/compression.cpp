// Compressed geometry alone. The first byte chooses the codec, and mode and filter of meshopt's;
// then the counts that the document would declare, and the data.
#include "fuzz.h"

#include "scene/gltf/compression.h"

#include <cstdint>

namespace lpvbake {
namespace {

void draco(std::span<const unsigned char> data) {
    const scene::gltf::DracoLimits limits{data[0], data[1]};
    const scene::gltf::DracoMesh mesh = scene::gltf::decode_draco(data.subspan(2), limits, "data");
    fuzz::require(mesh.vertices == limits.vertices && mesh.indices.size() == limits.indices,
                  "a mesh has the counts that were declared");
    for (const auto& [id, attribute] : mesh.attributes)
        fuzz::require(
            attribute.bytes.size()
                == mesh.vertices * static_cast<size_t>(attribute.width)
                       * scene::gltf::component_size(static_cast<int>(attribute.component)),
            "an attribute has a value a vertex");
}

void meshopt(int kind, std::span<const unsigned char> data) {
    constexpr const char* modes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
    constexpr const char* filters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};
    const scene::gltf::MeshoptView view{data.subspan(2), data[0], data[1], modes[kind / 4 % 3],
                                        filters[kind % 4]};
    scene::gltf::check_meshopt(view, view.count * view.stride, "data");
    fuzz::require(scene::gltf::decode_meshopt(view, "data").size() == view.count * view.stride,
                  "a view has the length that was declared");
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    using namespace lpvbake;
    if (size < 3)
        return 0;
    const std::span<const unsigned char> rest(data + 1, size - 1);
    fuzz::accepts([&] {
        if (data[0] == 0)
            draco(rest);
        else
            meshopt(data[0] - 1, rest);
    });
    return 0;
}
