// One model in the encodings that glTF has for it: all have to give the same light. All keep the
// order of the triangles: another one makes other patches, and moves what is sampled.
#include "bake/bake.h"

#include "gpu/device.h"
#include "image/image.h"
#include "scenes.h"
#include "unit/meshopt_document.h"
#include "volume/compare.h"

#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include <cmath>
#include <random>

namespace lpvbake {
namespace {

using nlohmann::json;

/// A mesh as glTF has it; the positions are multiples of 1/64, at most 1.
struct Model {
    std::vector<float> positions;
    std::vector<float> uv;
    std::vector<uint32_t> indices;

    size_t vertices() const { return uv.size() / 2; }
};

/// Appends n x n squares over corner + [0, 1] u + [0, 1] v, raised by `height` along `up`.
template <typename Height>
void add_sheet(Model& model, int n, glm::vec3 corner, glm::vec3 u, glm::vec3 v, Height height) {
    const auto first = static_cast<uint32_t>(model.vertices());
    const glm::vec3 up = glm::normalize(glm::cross(u, v));
    for (int y = 0; y <= n; ++y)
        for (int x = 0; x <= n; ++x) {
            const glm::vec2 at(float(x) / float(n), float(y) / float(n));
            const glm::vec3 p = corner + at.x * u + at.y * v + height(at) * up;
            for (int k = 0; k < 3; ++k)
                model.positions.push_back(std::round(p[k] * 64.0f) / 64.0f);
            model.uv.insert(model.uv.end(), {at.x, at.y});
        }
    const auto row = static_cast<uint32_t>(n + 1);
    for (uint32_t y = 0; y + 1 < row; ++y)
        for (uint32_t x = 0; x + 1 < row; ++x) {
            const uint32_t a = first + y * row + x;
            for (const uint32_t i : {a, a + 1, a + row, a + row, a + 1, a + row + 1})
                model.indices.push_back(i);
        }
}

/// A closed room, with or without a wavy roof in it, which is black from below.
Model room(bool roof) {
    Model model;
    const auto flat = [](glm::vec2) { return 0.0f; };
    for (int axis = 0; axis < 3; ++axis)
        for (const float side : {-1.0f, 1.0f}) {
            glm::vec3 u(0.0f), v(0.0f), corner(-1.0f);
            u[(axis + 1) % 3] = v[(axis + 2) % 3] = 2.0f;
            corner[axis] = side;
            add_sheet(model, 4, corner, side < 0 ? u : v, side < 0 ? v : u, flat);
        }
    if (roof)
        add_sheet(model, 8, {-0.5f, -0.25f, 0.5f}, {1.25f, 0, 0}, {0, 0, -1},
                  [](glm::vec2 at) { return 0.2f * std::sin(6 * at.x + 2 * at.y); });
    return model;
}

constexpr float turn = 0.5f;
const glm::vec2 offset(0.25f, 0.125f), stretch(2.0f, 1.5f);

/// What KHR_texture_transform makes of the coordinates: offset + R(turn) (stretch uv).
std::vector<float> transformed(std::vector<float> uv) {
    for (size_t i = 0; i < uv.size(); i += 2) {
        const float u = stretch.x * uv[i], v = stretch.y * uv[i + 1];
        uv[i] = offset.x + std::cos(turn) * u + std::sin(turn) * v;
        uv[i + 1] = offset.y - std::sin(turn) * u + std::cos(turn) * v;
    }
    return uv;
}

/// Gives a document material 0, with opaque texels of 16 x 16 colours.
void add_material(GltfDocument& document) {
    image::Pixels pixels{16, 16, 4, {}};
    std::mt19937 random(1);
    for (int i = 0; i < 16 * 16; ++i) {
        for (int k = 0; k < 3; ++k)
            pixels.samples.push_back(0.3f + 0.6f * float(random() % 1000) / 1000.0f);
        pixels.samples.push_back(1.0f);
    }
    const std::vector<unsigned char> file = image::encode_png(pixels, "image");
    document.append("images", {{"uri", "data:image/png;base64," + base64(packed(file))}});
    document.append("textures", {{"source", 0}});
    document.append("materials", {{"pbrMetallicRoughness",
                                   {{"baseColorTexture", {{"index", 0}}}, {"metallicFactor", 0}}}});
}

/// Places a mesh of material 0 by a node.
void place(GltfDocument& document, int positions, int uv, int indices, json node = {},
           const json& extensions = json::object()) {
    node["mesh"] =
        document.append("meshes", {{"primitives",
                                    {{{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", uv}}},
                                      {"indices", indices},
                                      {"material", 0},
                                      {"extensions", extensions}}}}});
    document.place(node);
}

GltfDocument plain(const Model& model, const json& node = json::object()) {
    GltfDocument document;
    add_material(document);
    const int positions = document.accessor(model.positions, real, "VEC3");
    const int uv = document.accessor(model.uv, real, "VEC2");
    place(document, positions, uv, document.accessor(model.indices, uint32, "SCALAR"), node);
    return document;
}

Model mirrored(Model model) {
    for (size_t i = 0; i < model.positions.size(); i += 3)
        model.positions[i] *= -1;
    for (size_t i = 0; i < model.indices.size(); i += 3)
        std::swap(model.indices[i + 1], model.indices[i + 2]);
    return model;
}

/// Positions as normalised int16, padded to four, and the node that undoes the scale.
std::vector<int16_t> quantised(const Model& model) {
    std::vector<int16_t> values;
    for (size_t i = 0; i < model.positions.size(); ++i) {
        values.push_back(static_cast<int16_t>(std::lround(model.positions[i] * 16384.0f)));
        if (i % 3 == 2)
            values.push_back(0);
    }
    return values;
}
const double unscale = 32767.0 / 16384.0;
const json unscaled = {{"scale", {unscale, unscale, unscale}}};

json accessor_of(const Model& model, int view, Type type, const char* shape, int at = 0) {
    return {{"bufferView", view},          {"byteOffset", at},          {"componentType", type},
            {"normalized", type == int16}, {"count", model.vertices()}, {"type", shape}};
}

GltfDocument with_quantised_positions(const Model& model) {
    GltfDocument document;
    add_material(document);
    document.root["extensionsUsed"] =
        document.root["extensionsRequired"] = {"KHR_mesh_quantization"};
    const int view = document.view(packed(quantised(model)));
    document.root["bufferViews"][view]["byteStride"] = 8;
    const int positions = document.append("accessors", accessor_of(model, view, int16, "VEC3"));
    const int uv = document.accessor(model.uv, real, "VEC2");
    place(document, positions, uv, document.accessor(model.indices, uint32, "SCALAR"), unscaled);
    return document;
}

/// One view of 24 bytes a vertex; every fifth position is wrong there and put right by a sparse
/// substitution.
GltfDocument interleaved(const Model& model) {
    GltfDocument document;
    add_material(document);
    std::vector<float> vertices, values;
    std::vector<uint16_t> substituted;
    for (size_t i = 0; i < model.vertices(); ++i) {
        const float* p = &model.positions[3 * i];
        const float wrong = i % 5 == 0 ? 0.5f : 0.0f;
        vertices.insert(vertices.end(), {p[0] + wrong, p[1] - wrong, p[2], model.uv[2 * i],
                                         model.uv[2 * i + 1], NAN});
        if (i % 5 == 0) {
            substituted.push_back(static_cast<uint16_t>(i));
            values.insert(values.end(), p, p + 3);
        }
    }
    const int view = document.view(packed(vertices));
    document.root["bufferViews"][view]["byteStride"] = 24;
    json description = accessor_of(model, view, real, "VEC3");
    description["sparse"] = {
        {"count", substituted.size()},
        {"indices",
         {{"bufferView", document.view(packed(substituted))}, {"componentType", uint16}}},
        {"values", {{"bufferView", document.view(packed(values))}}}};
    const int positions = document.append("accessors", description);
    const int uv = document.append("accessors", accessor_of(model, view, real, "VEC2", 12));
    place(document, positions, uv, document.accessor(model.indices, uint32, "SCALAR"));
    return document;
}

GltfDocument with_texture_transform(const Model& untransformed) {
    GltfDocument document = plain(untransformed);
    document.root["extensionsUsed"] = {"KHR_texture_transform"};
    document.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]
                 ["KHR_texture_transform"] = {
        {"offset", {offset.x, offset.y}}, {"rotation", turn}, {"scale", {stretch.x, stretch.y}}};
    return document;
}

GltfDocument with_opaque_mask(const Model& model) {
    GltfDocument document = plain(model);
    document.root["materials"][0]["alphaMode"] = "MASK";
    return document;
}

GltfDocument with_meshopt(const Model& model) {
    MeshoptDocument document;
    add_material(document);
    const size_t n = model.vertices(), corners = model.indices.size();
    const int view =
        document.compressed(encode_vertices(quantised(model).data(), n, 8), n, 8, "ATTRIBUTES");
    document.root["bufferViews"][view]["byteStride"] = 8;
    const int positions = document.append("accessors", accessor_of(model, view, int16, "VEC3"));
    const int uv = document.attribute(
        document.compressed(encode_vertices(model.uv.data(), n, 8), n, 8, "ATTRIBUTES"), n, "VEC2");
    const int indices = document.attribute(
        document.compressed(encode_indices(model.indices, false), corners, 4, "INDICES"), corners,
        "SCALAR", uint32);
    place(document, positions, uv, indices, unscaled);
    GltfDocument finished = document.finished();
    finished.root["extensionsRequired"].push_back("KHR_mesh_quantization");
    finished.root["extensionsUsed"] = finished.root["extensionsRequired"];
    return finished;
}

GltfDocument with_draco(const Model& model) {
    draco::TriangleSoupMeshBuilder builder;
    const auto faces = static_cast<int>(model.indices.size() / 3);
    builder.Start(faces);
    const int parts[] = {
        builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32),
        builder.AddAttribute(draco::GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32)};
    for (int i = 0; i < faces; ++i)
        for (const int part : parts) {
            const std::vector<float>& values = part == parts[0] ? model.positions : model.uv;
            const auto corner = [&](int k) {
                return &values[(part == parts[0] ? 3 : 2) * model.indices[3 * i + k]];
            };
            builder.SetAttributeValuesForFace(part, draco::FaceIndex(i), corner(0), corner(1),
                                              corner(2));
        }
    const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
    draco::Encoder encoder;
    encoder.SetEncodingMethod(draco::MESH_SEQUENTIAL_ENCODING); // keeps the order
    encoder.SetTrackEncodedProperties(true);
    encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 16);
    encoder.SetAttributeQuantization(draco::GeometryAttribute::TEX_COORD, 16);
    draco::EncoderBuffer buffer;
    EXPECT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());

    GltfDocument document;
    add_material(document);
    document.root["extensionsUsed"] =
        document.root["extensionsRequired"] = {"KHR_draco_mesh_compression"};
    const auto accessor = [&](size_t count, const char* shape, int component) {
        return document.append("accessors",
                               {{"count", count}, {"type", shape}, {"componentType", component}});
    };
    const int positions = accessor(encoder.num_encoded_points(), "VEC3", real);
    const int uv = accessor(encoder.num_encoded_points(), "VEC2", real);
    const int indices = accessor(model.indices.size(), "SCALAR", uint32);
    place(document, positions, uv, indices, json::object(),
          {{"KHR_draco_mesh_compression",
            {{"bufferView", document.view({buffer.data(), buffer.size()})},
             {"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}}}}}});
    return document;
}

class Variants : public testing::DeviceTest {
protected:
    Volume baked(const GltfDocument& document) {
        const auto path =
            std::filesystem::path(::testing::TempDir()) / "lpvbake_variants_test.gltf";
        std::ofstream(path, std::ios::binary) << document.text();
        Scene scene = load_gltf(path.string(), {});
        std::filesystem::remove(path);
        EXPECT_TRUE(scene.warnings.empty()) << scene.warnings.front();
        scene.lights.push_back(scenes::point_light({0.2, 0.6, -0.1}, 100.0));
        bake::BakeSettings settings(*bake::find_solver("gather"));
        settings.grid.resolution = 12;
        settings.solver.set_lighting_rays(1 << 17);
        settings.solver.set("vpls", 4096); // more than there are patches
        Progress silent;
        const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device().info());
        return bake::bake(scene, plan, device(), silent).volume;
    }
};

TEST_F(Variants, OfOneModelGiveTheSameLight) {
    const Model untransformed = room(true);
    Model model = untransformed;
    model.uv = transformed(model.uv);
    const Volume expected = baked(plain(model));
    ASSERT_GT(volume::total_energy(expected), 0.0);
    const json mirror = {{"scale", {-1, 1, 1}}};
    const struct {
        const char* name;
        GltfDocument document;
    } variants[] = {
        {"quantised positions", with_quantised_positions(model)},
        {"interleaved and sparse", interleaved(model)},
        {"texture transform", with_texture_transform(untransformed)},
        {"opaque mask", with_opaque_mask(model)},
        {"meshopt", with_meshopt(model)},
        {"draco", with_draco(model)},
    };
    for (const auto& variant : variants) {
        const double error = volume::compare(baked(variant.document), expected, {}).relative_l1;
        EXPECT_LT(error, 1e-3) << variant.name;
        RecordProperty(variant.name, std::to_string(error));
    }
    // Corners in another order sample other points of the patches: no better than these.
    const Model empty = room(false);
    const double error =
        volume::compare(baked(plain(mirrored(empty), mirror)), baked(plain(empty)), {}).relative_l1;
    EXPECT_LT(error, 5e-3);
    RecordProperty("negative scale", std::to_string(error));
    // What is not the same model is told apart.
    for (const GltfDocument& other : {plain(model, mirror), plain(untransformed)})
        EXPECT_GT(volume::compare(baked(other), expected, {}).relative_l1, 2e-2);
}

} // namespace
} // namespace lpvbake
