#include "error.h"
#include "scene/gltf/load.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// PNG of 2 x 1 texels: (255, 0, 0, 255) and (0, 255, 51, 128).
constexpr const char* png =
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR42mP4z8Dwn+G/"
    "cQMAEN8DsebGrcEAAAAASUVORK5CYII=";

enum Type { int8 = 5120, uint8 = 5121, int16 = 5122, uint16 = 5123, uint32 = 5125, real = 5126 };

std::string base64(const std::string& bytes) {
    const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t bits = 0;
        for (size_t k = 0; k < 3; ++k)
            bits =
                bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
        for (size_t k = 0; k < 4; ++k)
            text += i + k <= bytes.size() ? digits[bits >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}

template <typename T>
std::string packed(const std::vector<T>& values) {
    return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

/// A glTF document in the making; its one buffer is written as a data URI.
struct Document {
    json root = {{"asset", {{"version", "2.0"}}}, {"scenes", {{{"nodes", json::array()}}}}};
    std::string bytes;

    int append(const char* array, const json& value) {
        root[array].push_back(value);
        return static_cast<int>(root[array].size()) - 1;
    }

    int view(const std::string& data) {
        bytes.resize((bytes.size() + 3) / 4 * 4);
        const size_t offset = bytes.size();
        bytes += data;
        return append("bufferViews",
                      {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", data.size()}});
    }

    template <typename T>
    int accessor(const std::vector<T>& values, Type type, const std::string& shape,
                 bool normalized = false) {
        const size_t width = shape == "SCALAR" ? 1 : shape.back() - '0';
        return append("accessors", {{"bufferView", view(packed(values))},
                                    {"componentType", type},
                                    {"count", values.size() / width},
                                    {"type", shape},
                                    {"normalized", normalized}});
    }

    /// A node of the default scene.
    int place(const json& node) {
        const int index = append("nodes", node);
        root["scenes"][0]["nodes"].push_back(index);
        return index;
    }

    /// Places a mesh of one primitive.
    json& primitive(const json& primitive) {
        const int mesh = append("meshes", {{"primitives", {primitive}}});
        place({{"mesh", mesh}});
        return root["meshes"][mesh]["primitives"][0];
    }

    /// Places a right triangle (0,0,0) (1,0,0) (0,1,0).
    json& triangle() {
        return primitive(
            {{"attributes",
              {{"POSITION", accessor<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}, real, "VEC3")}}}});
    }

    std::string text() const {
        json copy = root;
        if (!bytes.empty() && !copy.contains("buffers"))
            copy["buffers"] = {{{"byteLength", bytes.size()},
                                {"uri", "data:application/octet-stream;base64," + base64(bytes)}}};
        return copy.dump();
    }

    std::string glb() const {
        json copy = root;
        copy["buffers"] = {{{"byteLength", bytes.size()}}};
        std::string text = copy.dump(), data = bytes;
        text.resize((text.size() + 3) / 4 * 4, ' ');
        data.resize((data.size() + 3) / 4 * 4);
        const auto word = [](size_t value) {
            const auto number = static_cast<uint32_t>(value);
            return std::string(reinterpret_cast<const char*>(&number), 4);
        };
        return "glTF" + word(2) + word(28 + text.size() + data.size()) + word(text.size()) + "JSON"
               + text + word(data.size()) + std::string("BIN\0", 4) + data;
    }
};

class Gltf : public testing::Test {
protected:
    void SetUp() override {
        const auto* test = testing::UnitTest::GetInstance()->current_test_info();
        folder_ = fs::path(testing::TempDir()) / (std::string("lpvbake_gltf_") + test->name());
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        path_ = (folder_ / "scene.gltf").string();
    }
    void TearDown() override { fs::remove_all(folder_); }

    void write(const fs::path& path, const std::string& bytes) {
        std::ofstream(path, std::ios::binary) << bytes;
    }

    Scene load_text(const std::string& text, const MaterialRules& rules = {}) {
        write(path_, text);
        return load_gltf(path_, rules);
    }

    Scene load(const Document& document, const MaterialRules& rules = {}) {
        return load_text(document.text(), rules);
    }

    /// Checks that a text is refused in one line that names the file and holds `part`.
    void expect_error(const std::string& text, ExitCode code, const std::string& part) {
        try {
            load_text(text);
            ADD_FAILURE() << "was accepted; expected: " << part;
        } catch (const Error& error) {
            const std::string what = error.what();
            EXPECT_EQ(error.code, code) << what;
            EXPECT_EQ(what.rfind(path_, 0), 0u) << what;
            EXPECT_NE(what.find(part), std::string::npos) << what << "\nlacks: " << part;
            EXPECT_EQ(what.find('\n'), std::string::npos) << what;
        }
    }

    void expect_error(const Document& document, const std::string& part,
                      ExitCode code = ExitCode::invalid) {
        expect_error(document.text(), code, part);
    }

    static void expect_warning(const Scene& scene, const std::string& part) {
        for (const std::string& warning : scene.warnings)
            if (warning.find(part) != std::string::npos)
                return;
        ADD_FAILURE() << "no warning holds: " << part;
    }

    fs::path folder_;
    std::string path_;
};

std::vector<glm::dvec3> world_positions(const Scene& scene, size_t instance = 0) {
    std::vector<glm::dvec3> result;
    for (const glm::vec3 p : scene.meshes[scene.instances[instance].mesh].positions)
        result.emplace_back(scene.instances[instance].to_world * glm::dvec4(p, 1.0));
    return result;
}

void expect_near(glm::dvec3 a, glm::dvec3 b, double tolerance = 1e-6) {
    EXPECT_LT(glm::distance(a, b), tolerance) << a.x << " " << a.y << " " << a.z;
}

using Triangles = std::vector<glm::uvec3>;

// ---------------------------------------------------------------- geometry

TEST_F(Gltf, ReadsTextAndBinary) {
    Document document;
    document.triangle()["indices"] = document.accessor<uint16_t>({2, 0, 1}, uint16, "SCALAR");
    for (const std::string& bytes : {document.text(), document.glb()}) {
        const Scene scene = load_text(bytes);
        ASSERT_EQ(scene.meshes.size(), 1u);
        EXPECT_EQ(scene.meshes[0].triangles, Triangles({{2, 0, 1}}));
        EXPECT_EQ(scene.meshes[0].positions[1], glm::vec3(1, 0, 0));
        EXPECT_TRUE(scene.meshes[0].normals.empty());
        EXPECT_TRUE(scene.meshes[0].uv.empty());
        EXPECT_EQ(scene.path, path_);
    }
}

TEST_F(Gltf, ReadsIndicesOfEveryWidth) {
    Document document;
    document.triangle()["indices"] = document.accessor<uint8_t>({2, 1, 0}, uint8, "SCALAR");
    document.triangle()["indices"] = document.accessor<uint16_t>({2, 1, 0}, uint16, "SCALAR");
    document.triangle()["indices"] = document.accessor<uint32_t>({2, 1, 0}, uint32, "SCALAR");
    const Scene scene = load(document);
    ASSERT_EQ(scene.meshes.size(), 3u);
    for (const Mesh& mesh : scene.meshes)
        EXPECT_EQ(mesh.triangles, Triangles({{2, 1, 0}}));
}

TEST_F(Gltf, ReadsTriangleModesAndCountsTheOthers) {
    Document document;
    const int positions =
        document.accessor<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0}, real, "VEC3");
    for (int mode = 0; mode <= 6; ++mode)
        document.primitive({{"attributes", {{"POSITION", positions}}}, {"mode", mode}});
    const Scene scene = load(document);
    ASSERT_EQ(scene.meshes.size(), 3u);
    EXPECT_EQ(scene.meshes[0].triangles, Triangles({{0, 1, 2}}));
    EXPECT_EQ(scene.meshes[1].triangles, Triangles({{0, 1, 2}, {1, 3, 2}, {2, 3, 4}}));
    EXPECT_EQ(scene.meshes[2].triangles, Triangles({{1, 2, 0}, {2, 3, 0}, {3, 4, 0}}));
    expect_warning(scene, "4 primitives of points or lines");
    expect_warning(scene, "meshes[4].primitives[0]: 5 indices do not make whole triangles");
}

TEST_F(Gltf, ReadsInterleavedAttributes) {
    Document document;
    std::string vertices;
    for (float i = 0; i < 3; ++i)
        vertices += packed<float>({i, i * i, 0, 0, 0, 1, 99});
    const int view = document.view(vertices);
    document.root["bufferViews"][view]["byteStride"] = 28;
    const auto part = [&](int offset) {
        return document.append("accessors", {{"bufferView", view},
                                             {"byteOffset", offset},
                                             {"componentType", 5126},
                                             {"count", 3},
                                             {"type", "VEC3"}});
    };
    document.primitive({{"attributes", {{"POSITION", part(0)}, {"NORMAL", part(12)}}}});
    const Scene scene = load(document);
    EXPECT_EQ(scene.meshes[0].positions[2], glm::vec3(2, 4, 0));
    EXPECT_EQ(scene.meshes[0].normals, std::vector<glm::vec3>(3, {0, 0, 1}));
}

TEST_F(Gltf, AppliesSparseSubstitutions) {
    for (const bool has_base : {true, false}) {
        Document document;
        json& primitive = document.triangle();
        json& accessor = document.root["accessors"][0];
        if (!has_base)
            accessor.erase("bufferView");
        const json sparse = {
            {"count", 1},
            {"indices",
             {{"bufferView", document.view(packed<uint16_t>({2}))}, {"componentType", 5123}}},
            {"values", {{"bufferView", document.view(packed<float>({5, 6, 7}))}}}};
        document.root["accessors"][0]["sparse"] = sparse;
        EXPECT_EQ(primitive["attributes"]["POSITION"], 0);
        const Scene scene = load(document);
        EXPECT_EQ(scene.meshes[0].positions[1], glm::vec3(has_base ? 1 : 0, 0, 0));
        EXPECT_EQ(scene.meshes[0].positions[2], glm::vec3(5, 6, 7));
    }
}

TEST_F(Gltf, ReadsQuantizedPositionsOnlyWhereTheExtensionIsUsed) {
    Document document;
    const int positions = document.accessor<int16_t>(
        {-32768, 0, 16384, 0, 32767, 0, 0, 0, 0, 0, 0, 0}, int16, "VEC4", true);
    document.root["accessors"][positions]["type"] = "VEC3";
    document.root["accessors"][positions]["count"] = 3;
    document.root["bufferViews"][0]["byteStride"] = 8;
    document.primitive({{"attributes", {{"POSITION", positions}}}});
    expect_error(document, "meshes[0].primitives[0].attributes.POSITION: must be of floats");
    document.root["extensionsUsed"] = {"KHR_mesh_quantization"};
    document.root["extensionsRequired"] = {"KHR_mesh_quantization"};
    const Scene scene = load(document);
    EXPECT_EQ(scene.meshes[0].positions[0].x, -1.0f);
    EXPECT_FLOAT_EQ(scene.meshes[0].positions[0].z, 16384 / 32767.0f);
    EXPECT_EQ(scene.meshes[0].positions[1].x, 1.0f);
}

TEST_F(Gltf, ReadsVertexColoursOfEveryType) {
    const auto color = [&](auto values, Type type, const char* shape) {
        Document document;
        json& primitive = document.triangle();
        const int accessor = document.accessor(values, type, shape, type != real);
        primitive["attributes"]["COLOR_0"] = accessor;
        return load(document).meshes[0].colors.at(1);
    };
    EXPECT_EQ(color(std::vector<float>{0, 0, 0, 1, 0.5f, 0.25f, 0, 0, 0}, real, "VEC3"),
              glm::vec4(1, 0.5f, 0.25f, 1));
    EXPECT_EQ(color(std::vector<uint8_t>{0, 0, 0, 0, 255, 51, 0, 102, 0, 0, 0, 0}, uint8, "VEC4"),
              glm::vec4(1, 0.2f, 0, 0.4f));
    EXPECT_EQ(
        color(std::vector<uint16_t>{0, 0, 0, 0, 65535, 13107, 0, 0, 0, 0, 0, 0}, uint16, "VEC4"),
        glm::vec4(1, 0.2f, 0, 0));
}

// ---------------------------------------------------------------- nodes

TEST_F(Gltf, ComposesTransformsDownTheTree) {
    Document document;
    document.triangle();
    document.root["scenes"][0]["nodes"] = {1};
    const double h = std::sqrt(0.5);
    // The parent turns +X to +Y; the child mirrors x and moves by 1 along (its parent's) x.
    document.append("nodes",
                    {{"children", {2}}, {"translation", {10, 0, 0}}, {"rotation", {0, 0, h, h}}});
    document.append("nodes",
                    {{"mesh", 0}, {"matrix", {-2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1}}});
    const Scene scene = load(document);
    ASSERT_EQ(scene.instances.size(), 1u);
    const std::vector<glm::dvec3> p = world_positions(scene);
    expect_near(p[0], {10, 1, 0});
    expect_near(p[1], {10, -1, 0});
    expect_near(p[2], {9, 1, 0});
}

TEST_F(Gltf, WalksDeepHierarchies) {
    Document document;
    document.triangle();
    const int depth = 200000;
    json& nodes = document.root["nodes"];
    for (int i = 1; i <= depth; ++i)
        nodes.push_back({{"children", {i + 1}}, {"translation", {0, 0, 1}}});
    nodes.push_back({{"mesh", 0}});
    document.root["scenes"][0]["nodes"] = {1};
    expect_near(world_positions(load(document))[0], {0, 0, depth});
}

TEST_F(Gltf, PlacesInstances) {
    Document document;
    document.triangle();
    const double h = std::sqrt(0.5);
    const int translation = document.accessor<float>({0, 0, 0, 5, 0, 0}, real, "VEC3");
    const int rotation =
        document.accessor<float>({0, 0, 0, 1, 0, 0, float(h), float(h)}, real, "VEC4");
    const int scale = document.accessor<float>({1, 1, 1, 2, 2, 2}, real, "VEC3");
    json& node = document.root["nodes"][0];
    node["scale"] = {10, 10, 10};
    node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
        {"TRANSLATION", translation}, {"ROTATION", rotation}, {"SCALE", scale}};
    const Scene scene = load(document);
    ASSERT_EQ(scene.instances.size(), 2u);
    EXPECT_EQ(scene.meshes.size(), 1u);
    expect_near(world_positions(scene, 0)[1], {10, 0, 0});
    expect_near(world_positions(scene, 1)[1], {50, 20, 0}, 1e-5);
}

TEST_F(Gltf, TakesTheDefaultScene) {
    Document document;
    document.triangle();
    document.root["scenes"].push_back({{"nodes", {0}}});
    document.root["scenes"][0]["nodes"] = {1};
    document.root["nodes"].push_back({{"name", "nothing"}});
    EXPECT_EQ(load(document).instances.size(), 0u);
    document.root["scene"] = 1;
    EXPECT_EQ(load(document).instances.size(), 1u);
}

TEST_F(Gltf, PlacesLightsAndCameras) {
    Document document;
    document.root["extensions"]["KHR_lights_punctual"]["lights"] = {
        {{"type", "directional"}, {"intensity", 1000}, {"color", {1, 0.5, 0}}, {"name", "sun"}},
        {{"type", "point"}, {"intensity", 40}, {"range", 3}},
        {{"type", "spot"}, {"spot", {{"innerConeAngle", 0.25}, {"outerConeAngle", 0.5}}}}};
    document.root["cameras"] = {
        {{"type", "perspective"}, {"perspective", {{"yfov", 0.7}, {"znear", 0.1}}}},
        {{"type", "orthographic"},
         {"orthographic", {{"xmag", 1}, {"ymag", 1}, {"zfar", 2}, {"znear", 1}}}}};
    const double h = std::sqrt(0.5);
    const auto light = [](int index) { return json{{"KHR_lights_punctual", {{"light", index}}}}; };
    document.place({{"rotation", {-h, 0, 0, h}}, {"extensions", light(0)}, {"scale", {3, 3, -3}}});
    document.place({{"translation", {1, 2, 3}}, {"extensions", light(1)}});
    document.place({{"rotation", {-h, 0, 0, h}}, {"extensions", light(2)}});
    document.place({{"extensions", light(2)}, {"scale", {0, 0, 0}}});
    document.place({{"camera", 0}, {"translation", {0, 0, 9}}});
    document.place({{"camera", 1}});
    const Scene scene = load(document);
    ASSERT_EQ(scene.lights.size(), 3u);
    EXPECT_EQ(scene.lights[0].name, "sun");
    EXPECT_EQ(scene.lights[0].intensity, 1000.0);      // scale does not change it
    expect_near(scene.lights[0].direction, {0, 1, 0}); // -Z mirrored, then turned
    EXPECT_EQ(scene.lights[0].color, glm::vec3(1, 0.5f, 0));
    EXPECT_EQ(scene.lights[1].position, glm::dvec3(1, 2, 3));
    EXPECT_EQ(scene.lights[1].range, 3.0);
    expect_near(scene.lights[2].direction, {0, -1, 0});
    EXPECT_EQ(scene.lights[2].inner_cone, 0.25);
    EXPECT_EQ(scene.lights[2].outer_cone, 0.5);
    expect_warning(scene, "nodes[3]: the scale is 0");
    ASSERT_EQ(scene.cameras.size(), 1u);
    EXPECT_EQ(scene.cameras[0].yfov, 0.7);
    EXPECT_EQ(scene.cameras[0].to_world[3].z, 9.0);
    expect_warning(scene, "cameras[1]: orthographic");
}

// ---------------------------------------------------------------- materials

/// A triangle with UVs and one material with the PNG above as base colour.
Document textured(const json& material_extra = json::object()) {
    Document document;
    json& primitive = document.triangle();
    primitive["attributes"]["TEXCOORD_0"] =
        document.accessor<float>({0.25f, 0.5f, 0.75f, 0.5f, 1, 1}, real, "VEC2");
    primitive["material"] = 0;
    json material = {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
    material.merge_patch(material_extra);
    document.root["materials"] = {material};
    document.root["images"] = {{{"uri", png}}};
    document.root["textures"] = {{{"source", 0}}};
    return document;
}

TEST_F(Gltf, DecodesTexturesOnceAndOnlyIfUsed) {
    Document document = textured({{"emissiveTexture", {{"index", 1}}},
                                  {"emissiveFactor", {1, 1, 1}},
                                  {"normalTexture", {{"index", 2}}}});
    document.root["images"].push_back({{"uri", "there-is-no-such-file.png"}});
    document.root["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33648}, {"magFilter", 9728}}};
    document.root["textures"] = {{{"source", 0}}, {{"source", 0}, {"sampler", 0}}, {{"source", 1}}};
    const Scene scene = load(document);
    ASSERT_EQ(scene.images.size(), 1u);
    EXPECT_EQ(scene.images[0].width, 2);
    EXPECT_EQ(scene.images[0].height, 1);
    EXPECT_EQ(scene.images[0].rgba, std::vector<uint8_t>({255, 0, 0, 255, 0, 255, 51, 128}));
    ASSERT_EQ(scene.textures.size(), 2u);
    const Texture& plain = scene.textures[scene.materials[0].base_color_texture];
    EXPECT_EQ(plain.wrap_u, Wrap::repeat);
    EXPECT_FALSE(plain.nearest);
    const Texture& sampled = scene.textures[scene.materials[0].emission_texture];
    EXPECT_EQ(sampled.wrap_u, Wrap::clamp_to_edge);
    EXPECT_EQ(sampled.wrap_v, Wrap::mirrored_repeat);
    EXPECT_TRUE(sampled.nearest);
    EXPECT_EQ(sampled.image, plain.image);
}

TEST_F(Gltf, ReadsMaterials) {
    Document document;
    document.triangle()["material"] = 1;
    document.triangle();
    document.root["materials"] = {
        {{"name", "unused"}},
        {{"name", "lamp"},
         {"alphaMode", "MASK"},
         {"alphaCutoff", 0.25},
         {"doubleSided", true},
         {"emissiveFactor", {1, 0.5, 0}},
         {"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.25, 0.125, 0.75}}}},
         {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 200}}}}}}};
    const Scene scene = load(document);
    ASSERT_EQ(scene.materials.size(), 2u);
    const Material& lamp = scene.materials[scene.meshes[0].material];
    EXPECT_EQ(lamp.name, "lamp");
    EXPECT_EQ(lamp.base_color, glm::vec4(0.5f, 0.25f, 0.125f, 0.75f)); // metallic 1 by default
    EXPECT_EQ(lamp.alpha_mode, AlphaMode::mask);
    EXPECT_EQ(lamp.alpha_cutoff, 0.25f);
    EXPECT_TRUE(lamp.double_sided);
    EXPECT_EQ(lamp.emission, glm::vec3(200, 100, 0));
    const Material& standard = scene.materials[scene.meshes[1].material];
    EXPECT_EQ(standard.base_color, glm::vec4(1.0f));
    EXPECT_EQ(standard.emission, glm::vec3(0.0f));
    EXPECT_FALSE(standard.double_sided);
    EXPECT_EQ(standard.alpha_mode, AlphaMode::opaque);
}

TEST_F(Gltf, ReadsDiffuseOfSpecularGlossiness) {
    Document document;
    document.triangle()["material"] = 0;
    document.root["materials"] = {
        {{"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 1, 1}}}},
         {"extensions",
          {{"KHR_materials_pbrSpecularGlossiness", {{"diffuseFactor", {0.1, 0.2, 0.3, 0.4}}}}}}}};
    MaterialRules rules;
    rules.metallic_black = true;
    EXPECT_EQ(load(document, rules).materials[0].base_color, glm::vec4(0.1f, 0.2f, 0.3f, 0.4f));
}

TEST_F(Gltf, MakesMetalBlackOnlyOnDemand) {
    Document document =
        textured({{"pbrMetallicRoughness",
                   {{"metallicFactor", 0.5}, {"metallicRoughnessTexture", {{"index", 0}}}}}});
    EXPECT_EQ(load(document).materials[0].base_color, glm::vec4(1.0f));
    MaterialRules rules;
    rules.metallic_black = true;
    const double metallic = 0.5 * (0 + 51) / 2 / 255; // factor times mean of blue
    EXPECT_FLOAT_EQ(load(document, rules).materials[0].base_color.r,
                    static_cast<float>(1 - metallic));
}

TEST_F(Gltf, CountsMaterialsThatReflectTooMuch) {
    Document document;
    for (const double albedo : {0.2, 0.94, 0.96, 1.0}) {
        document.triangle()["material"] = document.append(
            "materials", {{"pbrMetallicRoughness", {{"baseColorFactor", {0.1, albedo, 0.1, 1}}}}});
    }
    expect_warning(load(document), "materials: 2 can reflect more than 0.95");
    // Dark vertices keep a bright material below the limit.
    Document dark;
    json& primitive = dark.triangle();
    primitive["attributes"]["COLOR_0"] =
        dark.accessor<float>(std::vector<float>(9, 0.5f), real, "VEC3");
    EXPECT_TRUE(load(dark).warnings.empty());
    // So does a texture: the PNG has 51 / 255 of blue, and factors take red and green down.
    Document image = textured({{"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.5, 1, 1}}}}});
    EXPECT_TRUE(load(image).warnings.empty());
}

TEST_F(Gltf, AppliesTextureTransformsAndSets) {
    Document document = textured();
    json& info = document.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    info["extensions"]["KHR_texture_transform"] = {
        {"offset", {0.5, 0.25}}, {"scale", {2, 4}}, {"rotation", std::acos(0.0)}};
    // Scaled to (0.5, 2); a quarter turn counter-clockwise on screen, where v points down, takes
    // u to -v and v to u.
    Scene scene = load(document);
    EXPECT_LT(glm::distance(scene.meshes[0].uv[0], glm::vec2(2 + 0.5f, -0.5f + 0.25f)), 1e-6f);

    const int second =
        document.accessor<uint8_t>({255, 0, 0, 0, 51, 0, 0, 0, 0, 0, 0, 0}, uint8, "VEC4", true);
    document.root["accessors"][second]["type"] = "VEC2";
    document.root["bufferViews"].back()["byteStride"] = 4;
    document.root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_3"] = second;
    info.erase("extensions");
    info["texCoord"] = 3;
    scene = load(document);
    EXPECT_EQ(scene.meshes[0].uv[0], glm::vec2(1, 0));
    EXPECT_EQ(scene.meshes[0].uv[1], glm::vec2(0.2f, 0));

    info["texCoord"] = 4;
    scene = load(document);
    EXPECT_EQ(scene.meshes[0].uv, std::vector<glm::vec2>(3, glm::vec2(0.0f)));
    expect_warning(scene, "TEXCOORD_4 is missing, which a texture of materials[0] needs");
}

// ---------------------------------------------------------------- files

TEST_F(Gltf, ReadsFilesBesideTheSceneByDecodedNames) {
    fs::create_directories(folder_ / "a b");
    for (const auto& [name, uri] :
         {std::pair("a b/ü+❤.bin", "a%20b/%C3%BC+❤.bin"), std::pair("plain.bin", "plain.bin")}) {
        Document document;
        document.triangle();
        write(folder_ / name, document.bytes + "more than is needed");
        document.root["buffers"] = {{{"byteLength", document.bytes.size()}, {"uri", uri}}};
        EXPECT_EQ(load(document).meshes[0].positions[2], glm::vec3(0, 1, 0)) << uri;
    }
}

TEST_F(Gltf, KeepsUrisInsideTheFolder) {
    Document document;
    document.triangle();
    const fs::path outside = folder_.parent_path() / (folder_.filename().string() + "_outside.bin");
    write(outside, document.bytes);
    write(folder_ / "inside.bin", document.bytes);
    fs::create_symlink(outside, folder_ / "leads_out.bin");
    fs::create_symlink(folder_ / "inside.bin", folder_ / "stays.bin");
    const auto with = [&](const std::string& uri) {
        document.root["buffers"] = {{{"byteLength", document.bytes.size()}, {"uri", uri}}};
        return document;
    };
    EXPECT_EQ(load(with("stays.bin")).meshes.size(), 1u);
    EXPECT_EQ(load(with("./inside.bin")).meshes.size(), 1u);
    const std::string name = outside.filename().string();
    expect_error(with("../" + name), "buffers[0].uri: \"../");
    expect_error(with("%2e%2E/" + name), "\"..\"");
    expect_error(with("%2e%2e%2f" + name), "\"..\"");
    expect_error(with(outside.string()), "is an absolute path");
    expect_error(with("file://" + outside.string()), "is not a relative path");
    expect_error(with("http://localhost/a.bin"), "is not a relative path");
    expect_error(with("leads_out.bin"), "is a link that leads out");
    expect_error(with("a%00b"), "is not a file name");
    expect_error(with("missing.bin"), "\"missing.bin\": there is no such file", ExitCode::file);
    expect_error(with("."), "is not a file", ExitCode::file);
    expect_error(with("data:application/octet-stream;base64,@@@@"), "is not base64");
    expect_error(with("data:application/octet-stream;base64,AAAA"),
                 "does not hold byteLength bytes");
    write(folder_ / "short.bin", "x");
    expect_error(with("short.bin"), "the file has 1 bytes");
    fs::remove(outside);
}

TEST_F(Gltf, NamesMissingAndBrokenImages) {
    Document document = textured();
    document.root["images"][0]["uri"] = "missing.png";
    expect_error(document, "images[0].uri: \"missing.png\"", ExitCode::file);
    document.root["images"][0]["uri"] = "../missing.png";
    expect_error(document, "images[0].uri: \"../missing.png\" leads out");
    write(folder_ / "broken.png", "this is no image");
    document.root["images"][0]["uri"] = "broken.png";
    expect_error(document, "images[0] (broken.png)");
    document.root["images"][0] = {{"bufferView", 0}, {"mimeType", "image/png"}};
    expect_error(document, "images[0]");
}

// ---------------------------------------------------------------- rejection

TEST_F(Gltf, RefusesFilesThatAreNotGltf) {
    expect_error("", ExitCode::invalid, "is not JSON");
    expect_error("{", ExitCode::invalid, "is not JSON");
    expect_error("[]", ExitCode::invalid, "its root is not an object");
    expect_error("{}", ExitCode::invalid, "asset: is missing");
    expect_error(R"({"asset": {"version": "1.0"}})", ExitCode::unsupported, "glTF 1.0");
    expect_error(R"({"asset": {"version": "2.0"}})", ExitCode::invalid, "there is no scene");
    expect_error(R"({"asset": {"version": 2}})", ExitCode::invalid,
                 "asset.version: must be a string");
    expect_error(R"({"asset": {"version": "2.0"}, "x": )" + std::string(100000, '[') + "}",
                 ExitCode::invalid, "nested");
    expect_error("glTF", ExitCode::invalid, "cut off");
    const std::string missing = path_ + ".missing";
    EXPECT_THROW(load_gltf(missing, {}), Error);
    EXPECT_THROW(load_gltf(folder_.string(), {}), Error);
}

TEST_F(Gltf, RefusesRequiredExtensionsAndNamesTheOthers) {
    Document document;
    document.triangle();
    document.root["extensionsUsed"] = {"KHR_texture_transform", "VENDOR_one", "VENDOR_two"};
    expect_warning(load(document), "ignored: VENDOR_one, VENDOR_two");
    document.root["extensionsRequired"] = {"KHR_texture_transform", "VENDOR_two"};
    expect_error(document, "extensionsRequired: not supported: VENDOR_two", ExitCode::unsupported);
}

TEST_F(Gltf, WarnsOfWhatItLeavesOut) {
    Document document;
    json& primitive = document.triangle();
    primitive["targets"] = {{{"POSITION", 0}}};
    primitive["material"] = 0;
    document.root["materials"] = {{{"extensions", {{"KHR_materials_unlit", json::object()}}}}};
    const int matrices = document.accessor<float>(std::vector<float>(16), real, "VEC4");
    document.root["skins"] = {{{"joints", {0}}, {"inverseBindMatrices", matrices}}};
    document.root["nodes"][0]["skin"] = 0;
    document.root["animations"] = {{{"channels", json::array()}, {"samplers", json::array()}}};
    const Scene scene = load(document);
    expect_warning(scene, "1 skinned meshes");
    expect_warning(scene, "morph targets");
    expect_warning(scene, "animations");
    expect_warning(scene, "1 are unlit");
}

/// A document that reads well, a change to it, and what the error has to say.
struct Flaw {
    const char* patch; ///< JSON merge patch
    const char* part;
};

TEST_F(Gltf, NamesThePlaceOfAFlaw) {
    const Flaw flaws[] = {
        {R"({"scene": 1})", "scene: index 1 is out of range: scenes has 1 elements"},
        {R"({"scene": "0"})", "scene: must be an index"},
        {R"({"scenes": [{"nodes": [7]}]})", "scenes[0].nodes[0]: index 7 is out of range"},
        {R"({"scenes": [{"nodes": []}]})", "scenes[0]: has no nodes"},
        {R"({"scenes": [{"nodes": [0, 0]}]})", "nodes[0]: is placed twice"},
        {R"({"nodes": [{"children": [0]}]})", "nodes[0]: is placed twice"},
        {R"({"nodes": [{"children": [-1]}]})", "nodes[0].children[0]: must be an index"},
        {R"({"nodes": [{"mesh": 1}]})", "nodes[0].mesh: index 1"},
        {R"({"nodes": [{"mesh": 0.0}]})", "nodes[0].mesh: must be an index"},
        {R"({"nodes": [{"mesh": 0, "skin": 0}]})", "nodes[0].skin: index 0"},
        {R"({"nodes": [{"matrix": [1, 2]}]})", "nodes[0].matrix: must be an array of 16 numbers"},
        {R"({"nodes": [{"matrix": [1,0,0,1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}]})", "is not affine"},
        {R"({"nodes": [{"scale": [1, 1, "1"]}]})", "nodes[0].scale: must be an array of 3"},
        {R"({"nodes": [{"scale": [1e308, 1, 1]}]})", "nodes[0]: its transform is not finite"},
        {R"({"nodes": [{"rotation": [0, 0, 0, 0]}]})", "nodes[0].rotation: is not a quaternion"},
        {R"({"nodes": 3})", "nodes: must be an array"},
        {R"({"nodes": [3]})", "nodes[0]: must be an object"},
        {R"({"nodes": [{"extensions": {"KHR_lights_punctual": {"light": 0}}}]})", "light: index 0"},
        {R"({"meshes": [{}]})", "meshes[0].primitives: is missing"},
        {R"({"meshes": [{"primitives": [{}]}]})", "meshes[0].primitives[0].attributes: is missing"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 9}}]}]})",
         "meshes[0].primitives[0].attributes.POSITION: index 9"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 1}}]}]})",
         "meshes[0].primitives[0].attributes.POSITION"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 7}]}]})",
         "meshes[0].primitives[0].mode: 7 is not a mode"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 0}]}]})",
         "meshes[0].primitives[0].indices (accessors[0]): must be a SCALAR"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 2}]}]})",
         "meshes[0].primitives[0].indices: index 3 at 1 is out of range: there are 3 vertices"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}]})",
         "meshes[0].primitives[0].material: index 0"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 3}}]}]})",
         "attributes.POSITION: value of vertex 1 is not finite"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 4}}]}]})",
         "attributes.NORMAL: has another count than POSITION"},
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 0}}]}]})",
         "attributes.NORMAL: the normal of vertex 0 has length 0"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}]})",
         "(accessors[0]): its 4 elements run past bufferViews[0]"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3",
                            "count": 6148914691236517206}]})",
         "meshes: hold more than 268435456 vertices"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                            "byteOffset": 18446744073709551615}]})",
         "run past bufferViews[0]"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5124, "count": 3, "type": "VEC3"}]})",
         "componentType 5124"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5130, "count": 1, "type": "VEC3"}]})",
         "componentType 5130"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 0, "type": "VEC3"}]})",
         "count must be at least 1"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "count": -3, "type": "VEC3"}]})",
         "accessors[0].count: must be an integer that is not negative"},
        {R"({"accessors": [{"bufferView": 9, "componentType": 5126, "count": 3, "type": "VEC3"}]})",
         "accessors[0].bufferView: index 9"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC9"}]})",
         "VEC9"},
        {R"({"bufferViews": [{"buffer": 0, "byteOffset": 18446744073709551600, "byteLength": 36}]})",
         "bufferViews[0]: runs past buffers[0]"},
        {R"({"bufferViews": [{"buffer": 0, "byteLength": 1000000}]})",
         "bufferViews[0]: runs past buffers[0]"},
        {R"({"bufferViews": [{"buffer": 0, "byteLength": 36, "byteStride": 8}]})",
         "byteStride 8 is less than an element"},
        {R"({"buffers": [{"byteLength": 36}]})", "buffers[0]: has neither a uri nor a chunk"},
        {R"({"buffers": [{"byteLength": 0, "uri": ""}]})", "buffers[0].byteLength"},
        {R"({"materials": [{"alphaMode": 3}]})", "materials[0].alphaMode: must be a string"},
        {R"({"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]})",
         "materials[0].pbrMetallicRoughness.baseColorTexture.index: index 0 is out of range"},
        {R"({"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1]}}]})",
         "materials[0].pbrMetallicRoughness.baseColorFactor: must be an array of 4 numbers"},
        {R"({"textures": [{"source": 0}]})", "textures[0].source: index 0"},
        {R"({"cameras": [{"type": "perspective", "perspective": {}}]})",
         "cameras[0].perspective.yfov"},
        {R"({"extensions": {"KHR_lights_punctual": {"lights": [{}]}}})",
         "lights[0].type: is missing"},
    };
    Document good;
    good.triangle();                                                        // accessor 0
    good.accessor<float>({1, 2, 3}, real, "SCALAR");                        // 1
    good.accessor<uint8_t>({0, 3, 1}, uint8, "SCALAR");                     // 2
    good.accessor<float>({0, 0, 0, 0, INFINITY, 0, 0, 0, 0}, real, "VEC3"); // 3
    good.accessor<float>({0, 0, 1}, real, "VEC3");                          // 4
    EXPECT_EQ(load(good).meshes.size(), 1u);
    const json complete = json::parse(good.text());
    for (const Flaw& flaw : flaws) {
        SCOPED_TRACE(flaw.patch);
        json broken = complete;
        broken.merge_patch(json::parse(flaw.patch));
        // A patch replaces whole arrays; what it does not mention of the first one stays.
        const json patch = json::parse(flaw.patch);
        for (const auto& [key, value] : patch.items())
            if (value.is_array() && complete.contains(key))
                for (size_t i = value.size(); i < complete[key].size(); ++i)
                    broken[key].push_back(complete[key][i]);
        write(path_, broken.dump());
        try {
            load_gltf(path_, {});
            ADD_FAILURE() << "was accepted";
        } catch (const Error& error) {
            const std::string what = error.what();
            EXPECT_TRUE(error.code == ExitCode::invalid || error.code == ExitCode::memory) << what;
            EXPECT_EQ(what.rfind(path_ + ": ", 0), 0u) << what;
            EXPECT_NE(what.find(flaw.part), std::string::npos) << what << "\nlacks " << flaw.part;
        }
    }
}

TEST_F(Gltf, RefusesMaterialsThatMakeNoSense) {
    const auto expect = [&](const json& material, const char* part) {
        Document document;
        document.triangle()["material"] = 0;
        document.root["materials"] = {material};
        expect_error(document, part);
    };
    expect({{"alphaMode", "GLASS"}}, "materials[0].alphaMode: \"GLASS\"");
    expect({{"emissiveFactor", {-1, 0, 0}}}, "materials[0].emissiveFactor");
    expect({{"pbrMetallicRoughness", {{"baseColorFactor", {-1, 0, 0, 1}}}}},
           "materials[0].pbrMetallicRoughness.baseColorFactor");
    Document document = textured();
    document.root["samplers"] = {{{"wrapS", 3}}};
    document.root["textures"][0]["sampler"] = 0;
    expect_error(document, "samplers[0].wrapS: 3 is not a wrap mode");
    document = textured();
    document.root["textures"] = {{{"extensions", {{"KHR_texture_basisu", {{"source", 0}}}}}}};
    expect_error(document, "textures[0]: has no source but for KHR_texture_basisu",
                 ExitCode::unsupported);
}

TEST_F(Gltf, SurvivesDamagedFiles) {
    Document document = textured();
    document.root["extensionsUsed"] = {"KHR_lights_punctual"};
    document.root["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
    document.place({{"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
    std::mt19937 random(1);
    int accepted = 0, refused = 0;
    const auto try_bytes = [&](const std::string& bytes) {
        try {
            load_text(bytes);
            ++accepted;
        } catch (const Error& error) {
            EXPECT_TRUE(error.code == ExitCode::invalid || error.code == ExitCode::file
                        || error.code == ExitCode::unsupported || error.code == ExitCode::memory)
                << error.what();
            ++refused;
        }
    };
    for (const std::string& whole : {document.text(), document.glb()}) {
        for (size_t length = 0; length < whole.size(); length += 37)
            try_bytes(whole.substr(0, length));
        for (int round = 0; round < 400; ++round) {
            std::string bytes = whole;
            for (int change = 0; change < 1 + round % 3; ++change)
                bytes[random() % bytes.size()] =
                    static_cast<char>(round % 2 ? random() : '0' + random() % 10);
            try_bytes(bytes);
        }
    }
    EXPECT_GT(accepted, 20); // changes inside of names, numbers and pixels
    EXPECT_GT(refused, 200);
}

} // namespace
} // namespace lpvbake
