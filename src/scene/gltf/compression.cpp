#include "scene/gltf/compression.h"

#include "lpvbake/error.h"
#include "quoted.h"
#include "scene/gltf/allocation_limit.h"

#include <meshoptimizer.h>

#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <draco/compression/mesh/mesh_sequential_decoder.h>
#include <draco/core/varint_decoding.h>

#include <memory>
#include <new>
#include <optional>

namespace lpvbake::scene::gltf {
namespace {

[[noreturn]] void refuse(const std::string& place, const std::string& why) {
    throw Error(ErrorKind::invalid, place + ": " + why + "; compress the file again");
}

// ---------------------------------------------------------------- Draco

std::optional<Component> component_of(draco::DataType type) {
    switch (type) {
    case draco::DT_INT8:
        return Component::int8;
    case draco::DT_UINT8:
        return Component::uint8;
    case draco::DT_INT16:
        return Component::int16;
    case draco::DT_UINT16:
        return Component::uint16;
    case draco::DT_UINT32:
        return Component::uint32;
    case draco::DT_FLOAT32:
        return Component::float32;
    default:
        return std::nullopt;
    }
}

/// Most components of all attributes of a vertex: glTF's eight standard ones have 30 at most, and
/// an application's own come to few more.
constexpr int64_t max_components = 256;

/// A decoder of Draco's that looks at the counts in the data before it takes memory for them.
template <typename Base>
class Guarded : public Base {
public:
    explicit Guarded(const DracoLimits& limits) : limits_(limits) {}
    const std::string& fault() const { return fault_; }

protected:
    bool DecodeConnectivity() override {
        draco::DecoderBuffer ahead = *this->buffer();
        uint64_t faces = 0, vertices = 0;
        return read_counts(ahead, faces, vertices)
               && expect(faces * 3 == limits_.indices, "holds " + std::to_string(faces)
                                                           + " triangles, its indices say "
                                                           + std::to_string(limits_.indices / 3))
               && expect(vertices <= limits_.vertices, "holds " + std::to_string(vertices)
                                                           + " vertices, its attributes say "
                                                           + std::to_string(limits_.vertices))
               && Base::DecodeConnectivity();
    }

    bool DecodeAllAttributes() override {
        const draco::PointCloud& cloud = *this->point_cloud();
        int64_t components = 0;
        for (int i = 0; i < cloud.num_attributes(); ++i)
            components += cloud.attribute(i)->num_components();
        return expect(cloud.num_points() == limits_.vertices,
                      "holds " + std::to_string(cloud.num_points())
                          + " vertices, its attributes say " + std::to_string(limits_.vertices))
               && expect(components <= max_components,
                         "has " + std::to_string(components) + " components a vertex")
               && Base::DecodeAllAttributes();
    }

private:
    bool expect(bool ok, const std::string& fault) {
        if (!ok)
            fault_ = fault;
        return ok;
    }

    /// The first numbers of the connectivity, as the two encodings order them.
    bool read_counts(draco::DecoderBuffer& ahead, uint64_t& faces, uint64_t& vertices) {
        uint32_t first = 0, second = 0;
        const bool old = this->bitstream_version() < DRACO_BITSTREAM_VERSION(2, 2);
        const auto number = [&](uint32_t& value) {
            return old ? ahead.Decode(&value) : draco::DecodeVarint(&value, &ahead);
        };
        constexpr bool edgebreaker = std::is_same_v<Base, draco::MeshEdgebreakerDecoder>;
        if (edgebreaker && old && !number(first)) // vertices that the encoder made
            return false;
        if (!number(first) || !number(second))
            return false;
        faces = edgebreaker ? second : first;
        vertices = edgebreaker ? first : second;
        return true;
    }

    const DracoLimits limits_;
    std::string fault_;
};

/// Most bytes that decoding allocates, freed or not: several times what meshes of all sorts took.
uint64_t allocated_by_draco(uint64_t data, const DracoLimits& limits) {
    return (1 << 20) + 64 * data + 1000 * (limits.vertices + limits.indices);
}

template <typename Decoder>
std::unique_ptr<draco::Mesh> run_draco(draco::DecoderBuffer& buffer, const DracoLimits& limits,
                                       const std::string& place) {
    Guarded<Decoder> decoder(limits);
    auto mesh = std::make_unique<draco::Mesh>();
    const draco::DecoderOptions options;
    try {
        // Not every count inside the attributes' data is looked at before it is believed.
        const AllocationLimit limit(allocated_by_draco(buffer.remaining_size(), limits));
        if (decoder.Decode(options, &buffer, mesh.get()).ok())
            return mesh;
    } catch (const std::bad_alloc&) {
        refuse(place, "the Draco data would take more memory than a mesh of their size");
    }
    refuse(place, decoder.fault().empty() ? "the Draco data cannot be decoded"
                                          : "the Draco mesh " + decoder.fault());
}

DracoMesh::Attribute packed(const draco::PointAttribute& attribute, uint64_t vertices,
                            Component component) {
    DracoMesh::Attribute result{{}, component, attribute.num_components()};
    const size_t size = component_size(static_cast<int>(component)) * result.width;
    result.bytes.resize(vertices * size);
    for (uint64_t i = 0; i < vertices; ++i)
        attribute.GetMappedValue(draco::PointIndex(static_cast<uint32_t>(i)),
                                 result.bytes.data() + i * size);
    return result;
}

} // namespace

DracoMesh decode_draco(std::span<const unsigned char> bytes, const DracoLimits& limits,
                       const std::string& place) {
    draco::DecoderBuffer buffer, ahead;
    buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    ahead.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    draco::DracoHeader header;
    if (!draco::PointCloudDecoder::DecodeHeader(&ahead, &header).ok()
        || header.encoder_type != draco::TRIANGULAR_MESH)
        refuse(place, "does not hold a Draco mesh");
    const std::unique_ptr<draco::Mesh> mesh =
        header.encoder_method == draco::MESH_EDGEBREAKER_ENCODING
            ? run_draco<draco::MeshEdgebreakerDecoder>(buffer, limits, place)
            : run_draco<draco::MeshSequentialDecoder>(buffer, limits, place);
    DracoMesh result;
    result.vertices = mesh->num_points();
    result.indices.reserve(size_t{3} * mesh->num_faces());
    for (uint32_t i = 0; i < mesh->num_faces(); ++i)
        for (const draco::PointIndex& corner : mesh->face(draco::FaceIndex(i)))
            result.indices.push_back(corner.value());
    for (int i = 0; i < mesh->num_attributes(); ++i) {
        const draco::PointAttribute& attribute = *mesh->attribute(i);
        // What no accessor can describe is left out, and missed where somebody asks for it.
        if (const auto component = component_of(attribute.data_type()))
            result.attributes[static_cast<int>(attribute.unique_id())] =
                packed(attribute, result.vertices, *component);
    }
    return result;
}

// ---------------------------------------------------------------- meshoptimizer

void check_meshopt(const MeshoptView& view, uint64_t length, const std::string& place) {
    const bool attributes = view.mode == "ATTRIBUTES";
    if (!attributes && view.mode != "TRIANGLES" && view.mode != "INDICES")
        refuse(place + ".mode", in_quotes(view.mode) + " is not a mode");
    const auto filter = [&](const char* name) { return view.filter == name; };
    const bool unit = filter("OCTAHEDRAL") || filter("QUATERNION") || filter("COLOR");
    if (!unit && !filter("NONE") && !filter("EXPONENTIAL"))
        refuse(place + ".filter", in_quotes(view.filter) + " is not a filter");
    if (!attributes && !filter("NONE"))
        refuse(place + ".filter", "indices have none");
    if (attributes ? view.stride % 4 != 0 || view.stride < 4 || view.stride > 256
                   : view.stride != 2 && view.stride != 4)
        refuse(place + ".byteStride", std::to_string(view.stride) + " does not fit the mode");
    if (unit && view.stride != 8 && (view.stride != 4 || filter("QUATERNION")))
        refuse(place + ".byteStride", std::to_string(view.stride) + " does not fit the filter");
    if (view.mode == "TRIANGLES" && view.count % 3 != 0)
        refuse(place + ".count", "is not a multiple of 3");
    if (view.count > length / view.stride || view.count * view.stride != length)
        refuse(place + ".count", "does not fill the buffer view's byteLength");
}

std::vector<unsigned char> decode_meshopt(const MeshoptView& view, const std::string& place) {
    std::vector<unsigned char> result(view.count * view.stride);
    if (view.count == 0)
        return result;
    const bool attributes = view.mode == "ATTRIBUTES";
    if (attributes && !view.bytes.empty() && view.bytes[0] == 0xa1)
        throw Error(ErrorKind::unsupported,
                    place
                        + ": uses version 1 of the vertex codec, which is not supported; "
                          "compress the file with version 0 (gltfpack -c or -cc)");
    if (view.filter == "COLOR")
        throw Error(ErrorKind::unsupported, place
                                                + ".filter: COLOR is not supported; compress the "
                                                  "file without it (gltfpack -c or -cc)");
    using Decode = int(void*, size_t, size_t, const unsigned char*, size_t);
    Decode* decode = meshopt_decodeVertexBuffer;
    if (!attributes)
        decode = view.mode == "TRIANGLES" ? static_cast<Decode*>(meshopt_decodeIndexBuffer)
                                          : static_cast<Decode*>(meshopt_decodeIndexSequence);
    if (decode(result.data(), view.count, view.stride, view.bytes.data(), view.bytes.size()) != 0)
        refuse(place, "the compressed data cannot be decoded");
    if (view.filter == "OCTAHEDRAL")
        meshopt_decodeFilterOct(result.data(), view.count, view.stride);
    else if (view.filter == "QUATERNION")
        meshopt_decodeFilterQuat(result.data(), view.count, view.stride);
    else if (view.filter == "EXPONENTIAL")
        meshopt_decodeFilterExp(result.data(), view.count, view.stride);
    return result;
}

} // namespace lpvbake::scene::gltf
