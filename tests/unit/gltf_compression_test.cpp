// Compressed glTF, made with the encoders of Draco and meshoptimizer and compared with what went
// in.
#include "unit/meshopt_document.h"

#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace lpvbake {
namespace {

using nlohmann::json;
using Document = GltfDocument;
using GltfCompression = Gltf;

/// A bent sheet of n x n vertices.
struct Sheet {
    std::vector<float> positions;
    std::vector<float> normals;
    std::vector<uint32_t> indices;
};

Sheet sheet(uint32_t n) {
    Sheet result;
    for (uint32_t y = 0; y < n; ++y)
        for (uint32_t x = 0; x < n; ++x) {
            const float u = float(x) / float(n - 1), v = float(y) / float(n - 1);
            result.positions.insert(result.positions.end(), {u, std::sin(3 * u), v});
            const glm::vec3 normal = glm::normalize(glm::vec3(-3 * std::cos(3 * u), 1, 0));
            result.normals.insert(result.normals.end(), {normal.x, normal.y, normal.z});
        }
    for (uint32_t y = 0; y + 1 < n; ++y)
        for (uint32_t x = 0; x + 1 < n; ++x) {
            const uint32_t a = y * n + x;
            for (const uint32_t i : {a, a + n, a + 1, a + 1, a + n, a + n + 1})
                result.indices.push_back(i);
        }
    return result;
}

template <typename T>
std::vector<float> flat(const std::vector<T>& vectors) {
    std::vector<float> result;
    for (const T& v : vectors)
        for (int k = 0; k < T::length(); ++k)
            result.push_back(v[k]);
    return result;
}

// ---------------------------------------------------------------- meshoptimizer

MeshoptDocument compressed_sheet(const Sheet& source, bool as_triangles = true) {
    MeshoptDocument document;
    const size_t vertices = source.positions.size() / 3;
    const int positions = document.attribute(
        document.compressed(encode_vertices(source.positions.data(), vertices, 12), vertices, 12,
                            "ATTRIBUTES"),
        vertices, "VEC3");
    const int indices = document.attribute(
        document.compressed(encode_indices(source.indices, as_triangles), source.indices.size(), 4,
                            as_triangles ? "TRIANGLES" : "INDICES"),
        source.indices.size(), "SCALAR", 5125);
    document.primitive({{"attributes", {{"POSITION", positions}}}, {"indices", indices}});
    return document;
}

TEST_F(GltfCompression, DecodesMeshoptToTheBit) {
    const Sheet source = sheet(40);
    for (const bool as_triangles : {true, false}) {
        const Scene scene = load(compressed_sheet(source, as_triangles).finished());
        EXPECT_EQ(flat(scene.meshes.at(0).positions), source.positions);
        // The codec may turn a triangle's corners round, but neither its order nor its winding.
        ASSERT_EQ(scene.meshes[0].triangles.size(), source.indices.size() / 3);
        for (size_t i = 0; i < scene.meshes[0].triangles.size(); ++i) {
            glm::uvec3 t = scene.meshes[0].triangles[i];
            while (t.x != source.indices[3 * i])
                t = {t.y, t.z, t.x};
            EXPECT_EQ(t, glm::uvec3(source.indices[3 * i], source.indices[3 * i + 1],
                                    source.indices[3 * i + 2]));
        }
        EXPECT_TRUE(scene.warnings.empty());
    }
}

TEST_F(GltfCompression, NeverReadsAMeshoptFallback) {
    const Sheet source = sheet(8);
    for (const char* name : {"EXT_meshopt_compression", "KHR_meshopt_compression"}) {
        Document document = compressed_sheet(source).finished();
        std::string text = document.root.dump();
        for (size_t at = 0; (at = text.find("EXT_meshopt", at)) != std::string::npos; ++at)
            text.replace(at, 3, name, 3);
        document.root = json::parse(text);
        document.root["buffers"][1]["uri"] = "there-is-no-such-file.bin";
        document.root["buffers"][1]["extensions"][name]["fallback"] = true;
        EXPECT_EQ(flat(load(document).meshes.at(0).positions), source.positions) << name;
    }
}

TEST_F(GltfCompression, AppliesMeshoptFilters) {
    const Sheet source = sheet(20);
    const size_t vertices = source.positions.size() / 3;
    MeshoptDocument document;
    std::vector<float> padded;
    for (size_t i = 0; i < vertices; ++i)
        padded.insert(padded.end(), {source.normals[3 * i], source.normals[3 * i + 1],
                                     source.normals[3 * i + 2], 0});
    std::vector<int8_t> octahedral(4 * vertices);
    meshopt_encodeFilterOct(octahedral.data(), vertices, 4, 8, padded.data());
    std::vector<uint32_t> exponential(3 * vertices);
    meshopt_encodeFilterExp(exponential.data(), vertices, 12, 15, source.positions.data());
    const int positions =
        document.attribute(document.compressed(encode_vertices(exponential.data(), vertices, 12),
                                               vertices, 12, "ATTRIBUTES", "EXPONENTIAL"),
                           vertices, "VEC3");
    const int normals =
        document.attribute(document.compressed(encode_vertices(octahedral.data(), vertices, 4),
                                               vertices, 4, "ATTRIBUTES", "OCTAHEDRAL"),
                           vertices, "VEC3", 5120);
    document.root["accessors"][normals]["normalized"] = true;
    document.root["bufferViews"][1]["byteStride"] = 4;
    document.root["extensionsUsed"] = {"KHR_mesh_quantization"};
    document.primitive({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}}});
    const Scene scene = load(document.finished());
    for (size_t i = 0; i < vertices; ++i)
        for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(scene.meshes[0].positions[i][k], source.positions[3 * i + k], 1e-4);
            EXPECT_NEAR(scene.meshes[0].normals[i][k], source.normals[3 * i + k], 0.02);
        }
}

TEST_F(GltfCompression, RefusesBrokenMeshoptViews) {
    const Document good = compressed_sheet(sheet(8)).finished();
    const auto expect = [&](const char* patch, const std::string& part,
                            ErrorKind kind = ErrorKind::invalid) {
        Document document = good;
        json& view = document.root["bufferViews"][0];
        view.merge_patch(json::parse(patch));
        expect_error(document, part, kind);
    };
    const std::string place = "bufferViews[0].extensions.EXT_meshopt_compression";
    expect(R"({"extensions": {"EXT_meshopt_compression": {"mode": "X"}}})", place + ".mode");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"filter": "X"}}})", place + ".filter");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"byteStride": 7}}})",
           place + ".byteStride");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"byteStride": 512}}})",
           place + ".byteStride");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"filter": "QUATERNION"}}})",
           place + ".byteStride");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"count": 65}}})", place + ".count");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"count": 1537228672809129302}}})",
           place + ".count");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"byteLength": 9}}})",
           place + ": the compressed data cannot be decoded");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"byteLength": 99999}}})",
           place + ": runs past buffers[0]");
    expect(R"({"extensions": {"EXT_meshopt_compression": {"buffer": 1}}})",
           "buffers[1]: has neither a uri nor a chunk of a binary file, and " + place);
    expect(R"({"extensions": null})", "buffers[1]: has neither");
    // A bomb: little data, many vertices.
    expect(R"({"byteLength": 12884901888,
               "extensions": {"EXT_meshopt_compression": {"count": 1073741824}}})",
           "bufferViews[0]: would take the scene past", ErrorKind::memory);
}

// ---------------------------------------------------------------- Draco

std::string encode_draco(const Sheet& source, draco::MeshEncoderMethod method) {
    draco::TriangleSoupMeshBuilder builder;
    const auto faces = static_cast<int>(source.indices.size() / 3);
    builder.Start(faces);
    const int position =
        builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
    const int normal = builder.AddAttribute(draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
    for (int i = 0; i < faces; ++i) {
        const auto corner = [&](const std::vector<float>& values, int k) {
            return &values[3 * source.indices[3 * i + k]];
        };
        const auto set = [&](int attribute, const std::vector<float>& values) {
            builder.SetAttributeValuesForFace(attribute, draco::FaceIndex(i), corner(values, 0),
                                              corner(values, 1), corner(values, 2));
        };
        set(position, source.positions);
        set(normal, source.normals);
    }
    const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
    draco::Encoder encoder;
    encoder.SetEncodingMethod(method);
    encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 14);
    encoder.SetAttributeQuantization(draco::GeometryAttribute::NORMAL, 10);
    draco::EncoderBuffer buffer;
    EXPECT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
    return {buffer.data(), buffer.size()};
}

Document draco_document(const std::string& data, size_t vertices, size_t indices) {
    Document document;
    const auto accessor = [&](size_t count, const char* shape, int component) {
        return document.append("accessors",
                               {{"count", count}, {"type", shape}, {"componentType", component}});
    };
    const int positions = accessor(vertices, "VEC3", 5126);
    const int normals = accessor(vertices, "VEC3", 5126);
    const int index = accessor(indices, "SCALAR", 5125);
    document.primitive({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}},
                        {"indices", index},
                        {"extensions",
                         {{"KHR_draco_mesh_compression",
                           {{"bufferView", document.view(data)},
                            {"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}}}}}});
    document.root["extensionsRequired"] = {"KHR_draco_mesh_compression"};
    return document;
}

TEST_F(GltfCompression, DecodesDracoWithinItsQuantisation) {
    const Sheet source = sheet(26);
    const size_t vertices = source.positions.size() / 3;
    for (const auto method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING}) {
        const Scene scene =
            load(draco_document(encode_draco(source, method), vertices, source.indices.size()));
        const Mesh& mesh = scene.meshes.at(0);
        ASSERT_EQ(mesh.positions.size(), vertices);
        ASSERT_EQ(mesh.triangles.size(), source.indices.size() / 3);
        double area = 0, expected = 0;
        for (const glm::uvec3& t : mesh.triangles)
            area += glm::cross(mesh.positions[t.y] - mesh.positions[t.x],
                               mesh.positions[t.z] - mesh.positions[t.x])
                        .y; // signed: the winding counts
        for (size_t i = 0; i < source.indices.size(); i += 3) {
            const auto p = [&](size_t k) {
                const float* v = &source.positions[3 * source.indices[i + k]];
                return glm::vec3(v[0], v[1], v[2]);
            };
            expected += glm::cross(p(1) - p(0), p(2) - p(0)).y;
        }
        EXPECT_NEAR(area, expected, 1e-3);
        for (size_t i = 0; i < vertices; ++i) {
            const float u = mesh.positions[i].x;
            EXPECT_NEAR(mesh.positions[i].y, std::sin(3 * u), 1e-3);
            EXPECT_LT(glm::distance(mesh.normals[i],
                                    glm::normalize(glm::vec3(-3 * std::cos(3 * u), 1, 0))),
                      0.02f);
        }
    }
}

TEST_F(GltfCompression, ChecksDracosCountsBeforeItTakesMemory) {
    const Sheet source = sheet(10);
    const size_t vertices = source.positions.size() / 3, indices = source.indices.size();
    for (const auto method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING}) {
        const std::string data = encode_draco(source, method);
        const std::string place = "meshes[0].primitives[0].extensions.KHR_draco_mesh_compression: ";
        expect_error(draco_document(data, vertices, indices - 3),
                     place + "the Draco mesh holds 162 triangles, its indices say 161");
        expect_error(draco_document(data, vertices - 1, indices), "the Draco mesh holds 100");
        expect_error(draco_document(data, vertices + 1, indices), "the Draco mesh holds 100");
        expect_error(draco_document(data.substr(0, data.size() / 2), vertices, indices),
                     place + "the Draco data cannot be decoded");
        expect_error(draco_document("DRACO", vertices, indices), "does not hold a Draco mesh");
        // What the document says is believed only as far as memory goes.
        expect_error(draco_document(data, 2000000000, indices), "`max_memory`", ErrorKind::memory);
        Document missing = draco_document(data, vertices, indices);
        missing.root["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]
                    ["attributes"]["NORMAL"] = 7;
        expect_error(missing, "attributes.NORMAL: the Draco data have no attribute 7");
    }
}

TEST_F(GltfCompression, SurvivesDamagedData) {
    const Sheet source = sheet(10);
    std::mt19937 random(7);
    int refused = 0;
    const auto try_document = [&](const Document& document) {
        try {
            load(document);
        } catch (const Error& error) {
            EXPECT_TRUE(error.kind == ErrorKind::invalid || error.kind == ErrorKind::unsupported
                        || error.kind == ErrorKind::memory)
                << error.what();
            ++refused;
        }
    };
    for (const auto method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING}) {
        const std::string data = encode_draco(source, method);
        for (int round = 0; round < 200; ++round) {
            std::string damaged = data;
            damaged[random() % data.size()] = static_cast<char>(random());
            try_document(draco_document(damaged, 100, source.indices.size()));
        }
    }
    const MeshoptDocument meshopt = compressed_sheet(source);
    for (int round = 0; round < 200; ++round) {
        MeshoptDocument damaged = meshopt;
        damaged.bytes[random() % damaged.bytes.size()] = static_cast<char>(random());
        try_document(damaged.finished());
    }
    EXPECT_GT(refused, 50);
}

} // namespace
} // namespace lpvbake
