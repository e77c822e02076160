#include "image/image.h"
#include "scene/scene.h"
#include "unit/gltf_document.h"

#include <cmath>
#include <functional>
#include <optional>
#include <random>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Document = GltfDocument;

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
    expect_warning(scene, "ignored: 4 primitives of points or lines");
    expect_warning(scene, "meshes[4].primitives[0]: not whole triangles: 5 indices");
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
    LoadSettings rules;
    rules.rules.metallic_black = true;
    EXPECT_EQ(load(document, rules).materials[0].base_color, glm::vec4(0.1f, 0.2f, 0.3f, 0.4f));
}

TEST_F(Gltf, MakesMetalBlackOnlyOnDemand) {
    Document document =
        textured({{"pbrMetallicRoughness",
                   {{"metallicFactor", 0.5}, {"metallicRoughnessTexture", {{"index", 0}}}}}});
    EXPECT_EQ(load(document).materials[0].base_color, glm::vec4(1.0f));
    LoadSettings rules;
    rules.rules.metallic_black = true;
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
    EXPECT_EQ(load(document).clamped_materials, 2u);
    // Dark vertices keep a bright material below the limit.
    Document dark;
    json& primitive = dark.triangle();
    primitive["attributes"]["COLOR_0"] =
        dark.accessor<float>(std::vector<float>(9, 0.5f), real, "VEC3");
    EXPECT_EQ(load(dark).clamped_materials, 0u);
    // So does a texture: the PNG has 51 / 255 of blue, and factors take red and green down.
    Document image = textured({{"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.5, 1, 1}}}}});
    EXPECT_EQ(load(image).clamped_materials, 0u);
    // A texture counts by its mean: one white texel of four is clamped without a word.
    const auto grey_and_white = [](int whites) {
        image::Pixels pixels{4, 1, 3, {}};
        for (int texel = 0; texel < 4; ++texel)
            pixels.samples.insert(pixels.samples.end(), 3, texel < whites ? 1.0f : 0.5f);
        Document picture = textured();
        picture.root["images"][0] = {
            {"bufferView", picture.view(packed(image::encode_png(pixels, "image")))}};
        return picture;
    };
    EXPECT_EQ(load(grey_and_white(1)).clamped_materials, 0u);
    EXPECT_EQ(load(grey_and_white(4)).clamped_materials, 1u);
}

TEST_F(Gltf, SkipsTexelsThatOnlyColourSurfaces) {
    image::Pixels pixels{5, 3, 3, std::vector<float>(45, 0.25f)};
    const auto image_of = [&](Document& document) {
        return json{{"bufferView", document.view(packed(image::encode_png(pixels, "image")))},
                    {"name", "grey"}};
    };
    LoadSettings skipping;
    skipping.skip_colors = true;
    Document colored = textured();
    colored.root["images"][0] = image_of(colored);
    const Scene plain = load(colored, skipping);
    ASSERT_EQ(plain.images.size(), 1u);
    EXPECT_EQ(plain.images[0].name, "grey");
    EXPECT_EQ(plain.images[0].width, 5);
    EXPECT_EQ(plain.images[0].height, 3);
    EXPECT_TRUE(plain.images[0].rgba.empty());
    EXPECT_EQ(load(colored).images[0].rgba.size(), 60u);
    // Whether it glows, and how much it lets through, depends on texels.
    Document glowing =
        textured({{"emissiveTexture", {{"index", 0}}}, {"emissiveFactor", {1, 1, 1}}});
    glowing.root["images"][0] = image_of(glowing);
    EXPECT_TRUE(scene::has_emitters(load(glowing, skipping)));
    Document clear =
        textured({{"extensions",
                   {{"KHR_materials_transmission",
                     {{"transmissionFactor", 0.5}, {"transmissionTexture", {{"index", 0}}}}}}}});
    clear.root["images"][0] = image_of(clear);
    EXPECT_LT(load(clear, skipping).materials[0].transmission, 0.4f);
    EXPECT_EQ(load(clear, skipping).materials[0].transmission,
              load(clear).materials[0].transmission);
    // What is no image is left out without a look at texels.
    Document broken = textured();
    write(folder_ / "broken.png", "this is no image");
    broken.root["images"][0] = {{"uri", "broken.png"}};
    expect_warning(load(broken, skipping), "images[0] (broken.png)");
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
    expect_error(with("missing.bin"), "\"missing.bin\": there is no such file", ErrorKind::file);
    expect_error(with("."), "is not a file", ErrorKind::file);
    expect_error(with("data:application/octet-stream;base64,@@@@"), "is not base64");
    expect_error(with("data:application/octet-stream;base64,AAAA"),
                 "does not hold byteLength bytes");
    write(folder_ / "short.bin", "x");
    expect_error(with("short.bin"), "the file has 1 bytes");
    LoadSettings external;
    external.allow_external = true;
    for (const std::string& uri : {"../" + name, outside.string(), std::string("leads_out.bin")})
        EXPECT_EQ(load(with(uri), external).meshes.size(), 1u) << uri;
    expect_error(with("http://localhost/a.bin"), "is not a relative path", ErrorKind::invalid,
                 external);
    fs::remove(outside);
}

TEST_F(Gltf, NamesMissingAndBrokenImages) {
    Document document = textured();
    document.root["images"][0]["uri"] = "missing.png";
    expect_warning(load(document), "images[0].uri: \"missing.png\"");
    document.root["images"][0]["uri"] = "../missing.png";
    expect_error(document, "images[0].uri: \"../missing.png\" leads out");
    write(folder_ / "broken.png", "this is no image");
    document.root["images"][0]["uri"] = "broken.png";
    expect_warning(load(document), "images[0] (broken.png)");
    document.root["images"][0] = {{"bufferView", 0}, {"mimeType", "image/png"}};
    expect_warning(load(document), "images[0]: the image is neither");
}

// ---------------------------------------------------------------- rejection

TEST_F(Gltf, RefusesFilesThatAreNotGltf) {
    expect_error("", ErrorKind::invalid, "is not JSON");
    expect_error("{", ErrorKind::invalid, "is not JSON");
    expect_error("[]", ErrorKind::invalid, "its root is not an object");
    expect_error("{}", ErrorKind::invalid, "asset: is missing");
    expect_error(R"({"asset": {"version": "1.0"}})", ErrorKind::unsupported, "glTF 1.0");
    expect_error(R"({"asset": {"version": "2.0"}})", ErrorKind::invalid, "there is no scene");
    expect_error(R"({"asset": {"version": 2}})", ErrorKind::invalid,
                 "asset.version: must be a string");
    expect_error(R"({"asset": {"version": "2.0"}, "x": )" + std::string(100000, '[') + "}",
                 ErrorKind::invalid, "nested");
    expect_error("glTF", ErrorKind::invalid, "cut off");
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
    expect_error(document, "extensionsRequired: not supported: VENDOR_two", ErrorKind::unsupported);
}

TEST_F(Gltf, WarnsOfWhatItLeavesOut) {
    Document document;
    document.triangle()["material"] = 0;
    document.root["materials"] = {{{"extensions", {{"KHR_materials_unlit", json::object()}}}}};
    document.root["textures"] = {{{"extensions", {{"KHR_texture_basisu", {{"source", 0}}}}}}};
    document.root["images"] = {{{"uri", "there-is-no-such-file.ktx2"}}};
    document.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 0;
    const Scene scene = load(document);
    expect_warning(scene, path_ + ": materials: lit all the same: 1 with");
    expect_warning(scene, path_ + ": textures[0].extensions.KHR_texture_basisu: ");
    EXPECT_EQ(scene.materials[0].base_color_texture, -1);
    expect_error(document, "(and 1 more; `strict`)", ErrorKind::invalid, {.strict = true});
    // With an image to fall back on there is nothing to say.
    document.root["images"].push_back({{"uri", png}});
    document.root["textures"][0]["source"] = 1;
    EXPECT_EQ(load(document).images.at(0).width, 2);
}

TEST_F(Gltf, NamesTheFirstPlacesOfAKindAndCountsTheRest) {
    Document document;
    for (int i = 0; i < 10; ++i)
        document.triangle()["attributes"]["NORMAL"] =
            document.accessor<float>(std::vector<float>(9, 0.0f), real, "VEC3");
    const Scene scene = load(document);
    expect_warning(scene, "meshes[2].primitives[0].attributes.NORMAL: not of length 1");
    expect_warning(scene, "normals: 7 more places of the kind");
    EXPECT_LE(scene.warnings.size(), 5u);
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
        {R"({"scenes": [{"nodes": [0, 0]}]})", "scenes[0].nodes[1]: nodes[0] is listed twice"},
        {R"({"nodes": [{"children": [0]}]})", "nodes[0].children: the node is its own ancestor"},
        {R"({"nodes": [{"children": [1]}, {"children": [0]}]})",
         "nodes[0].children: the node is its own ancestor"},
        {R"({"nodes": [{"children": [1, 1]}, {}]})",
         "nodes[0].children[1]: nodes[1] is a child of nodes[0] already"},
        {R"({"nodes": [{"children": [-1]}]})", "nodes[0].children[0]: must be an index"},
        {R"({"nodes": [{"mesh": 1}]})", "nodes[0].mesh: index 1"},
        {R"({"nodes": [{"mesh": 0.5}]})", "nodes[0].mesh: must be an index"},
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
        {R"({"meshes": [{"primitives": [{"attributes": {"POSITION": 0},
                                         "targets": [{"POSITION": 9}]}]}]})",
         "meshes[0].primitives[0].targets[0].POSITION: index 9"},
        {R"({"skins": [{}]})", "skins[0].joints: is missing"},
        {R"({"skins": [{"joints": [1]}]})", "skins[0].joints[0]: index 1 is out of range"},
        {R"({"animations": [{"channels": [{}], "samplers": []}]})",
         "animations[0].channels[0].sampler: is missing"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}]})",
         "(accessors[0]): its 4 elements run past bufferViews[0]"},
        {R"({"accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3",
                            "count": 6148914691236517206}]})",
         "meshes[0].primitives[0]: has more than 2^31 vertices"},
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
        {R"({"textures": [{"source": "0"}]})", "textures[0].source: must be an index"},
        {R"({"cameras": [3]})", "cameras[0]: must be an object"},
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
            EXPECT_TRUE(error.kind == ErrorKind::invalid || error.kind == ErrorKind::memory)
                << what;
            EXPECT_EQ(what.rfind(path_ + ": ", 0), 0u) << what;
            EXPECT_NE(what.find(flaw.part), std::string::npos) << what << "\nlacks " << flaw.part;
        }
    }
}

/// Files with one fault each, of the kinds that test suites collect, and how each ends.
TEST_F(Gltf, EndsEveryKindOfFaultByItsTable) {
    struct Case {
        const char* kind;
        std::optional<ErrorKind> error; ///< none: it loads, with a warning
        std::string part;
        std::function<void(Document&)> spoil;
    };
    constexpr float nan = NAN, infinity = INFINITY;
    const auto positions = [](std::vector<float> values) {
        return [values](Document& d) {
            d.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] =
                d.accessor<float>(values, real, "VEC3");
        };
    };
    const auto normals = [](std::vector<float> values) {
        return [values](Document& d) {
            d.root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
                d.accessor<float>(values, real, "VEC3");
        };
    };
    const auto patch = [](const char* text) {
        return [text](Document& d) { d.root.merge_patch(json::parse(text)); };
    };
    const Case cases[] = {
        {"normals of length 0", std::nullopt, "1 of 3 normals",
         normals({0, 0, 1, 0, 0, 0, 0, 0, 1})},
        {"normals that are not finite", std::nullopt, "1 of 3 normals",
         normals({0, 0, 1, nan, 0, 0, 0, 0, 1})},
        {"normals of length 2", std::nullopt, "3 of 3 normals",
         normals({0, 0, 2, 0, 0, 2, 0, 0, 2})},
        {"infinite positions", ErrorKind::invalid,
         "meshes[0].primitives[0].attributes.POSITION: value of vertex 1 is not finite",
         positions({0, 0, 0, infinity, 0, 0, 0, 1, 0})},
        {"positions that are no numbers", ErrorKind::invalid,
         "meshes[0].primitives[0].attributes.POSITION: value of vertex 2 is not finite",
         positions({0, 0, 0, 1, 0, 0, 0, nan, 0})},
        {"a view past its buffer", ErrorKind::invalid, "bufferViews[0]: runs past buffers[0]",
         [](Document& d) { d.root["bufferViews"][0]["byteLength"] = 1000; }},
        {"a view past its buffer by overflow", ErrorKind::invalid, "bufferViews[0]: runs past",
         [](Document& d) { d.root["bufferViews"][0]["byteOffset"] = UINT64_MAX - 8; }},
        {"an index past the vertices", ErrorKind::invalid,
         "meshes[0].primitives[0].indices: index 255 at 1 is out of range: there are 3 vertices",
         [](Document& d) {
             d.root["meshes"][0]["primitives"][0]["indices"] =
                 d.accessor<uint8_t>({0, 255, 2}, uint8, "SCALAR");
         }},
        {"a buffer that is missing", ErrorKind::file,
         "buffers[0].uri: \"gone.bin\": there is no such file",
         patch(R"({"buffers": [{"byteLength": 36, "uri": "gone.bin"}]})")},
        {"nodes in a circle", ErrorKind::invalid, "nodes[1].children: the node is its own ancestor",
         patch(R"({"nodes": [{"mesh": 0}, {"children": [2]}, {"children": [1]}]})")},
        {"a scene that is not there", ErrorKind::invalid, "scene: index 3 is out of range",
         patch(R"({"scene": 3})")},
        {"no scene", std::nullopt, "scenes: there is no scene", patch(R"({"scenes": null})")},
        {"a scene of nothing", ErrorKind::invalid, "scenes[0]: has no nodes",
         patch(R"({"scenes": [{}]})")},
        {"an object for an array", ErrorKind::invalid, "meshes[0].primitives: must be an array",
         [](Document& d) {
             d.root["meshes"][0]["primitives"] = {{"not an array", json::object()}};
         }},
        {"a number that is infinite", ErrorKind::invalid, "nodes[0].name: must be a string",
         [](Document& d) { d.root["nodes"][0]["name"] = "@1e999@"; }},
        {"a transform that is infinite", ErrorKind::invalid,
         "nodes[0]: its transform is not finite",
         [](Document& d) {
             d.root["nodes"][0]["scale"] = {1e300, 1, 1};
         }},
        {"a transform that leaves no area", std::nullopt,
         "nodes[0]: its transform is singular and leaves its mesh no area",
         [](Document& d) {
             d.root["nodes"][0]["scale"] = {0, 0, 1};
         }},
        {"more than the memory allows", ErrorKind::memory, "`max_memory`",
         [](Document& d) {
             d.root["accessors"][0]["count"] = 2000000000;
             d.root["accessors"][0].erase("bufferView");
         }},
        {"instances past the memory", ErrorKind::memory, "TRANSLATION: would take",
         [](Document& d) {
             const int many = d.append(
                 "accessors", {{"componentType", 5126}, {"count", 2000000000}, {"type", "VEC3"}});
             d.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
                 {"TRANSLATION", many}};
         }},
        {"an extension that is required and not understood", ErrorKind::unsupported,
         "extensionsRequired: not supported: VENDOR_x",
         patch(R"({"extensionsRequired": ["VENDOR_x"]})")},
    };
    for (const Case& fault : cases) {
        SCOPED_TRACE(fault.kind);
        Document document;
        document.triangle();
        document.triangle(); // so that something is left
        fault.spoil(document);
        std::string text = document.text();
        if (const size_t quoted = text.find("\"@1e999@\""); quoted != std::string::npos)
            text.replace(quoted, 9, "1e999");
        if (fault.error) {
            expect_error(text, *fault.error, fault.part);
            continue;
        }
        const Scene scene = load_text(text);
        expect_warning(scene, path_ + ": ");
        expect_warning(scene, fault.part);
        for (const Mesh& mesh : scene.meshes)
            for (const glm::vec3 normal : mesh.normals)
                EXPECT_NEAR(glm::length(normal), 1.0f, 1e-5f);
        expect_error(text, ErrorKind::invalid, "`strict`", {.strict = true});
    }
}

TEST_F(Gltf, HalvesImagesThatDoNotFitAndRefusesOnesTooLargeToDecode) {
    constexpr int side = 256;
    image::Pixels pixels{side, side, 4, {}};
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x)
            for (const int value : {x, y, (x * 7 + y) % 256, 255 - x})
                pixels.samples.push_back(float(value) / 255.0f);
    const std::vector<unsigned char> file = image::encode_png(pixels, "image");
    Document document;
    for (int i = 0; i < 4; ++i) {
        document.triangle()["material"] = i;
        document.append("images", {{"bufferView", document.view(packed(file))}});
        document.append("textures", {{"source", i}});
        document.append("materials",
                        {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", i}}}}}});
    }
    LoadSettings settings;
    settings.max_memory = 1 << 20;
    settings.max_memory += document.text().size() * 2;
    const Scene scene = load(document, settings);
    expect_warning(scene, "fit into memory: 3 of 4");
    const Image& half = scene.images.at(0);
    ASSERT_EQ(half.width, side / 2);
    for (int y = 0; y < half.height; ++y)
        for (int x = 0; x < half.width; ++x)
            for (int channel = 0; channel < 4; ++channel) {
                double sum = 0;
                for (const int k : {0, 1, 2, 3}) {
                    const int at = ((2 * y + k / 2) * side + 2 * x + k % 2) * 4 + channel;
                    const double value = std::round(pixels.samples[at] * 255.0f) / 255.0;
                    sum += channel == 3       ? value
                           : value <= 0.04045 ? value / 12.92
                                              : std::pow((value + 0.055) / 1.055, 2.4);
                }
                sum /= 4;
                if (channel < 3)
                    sum = sum <= 0.0031308 ? sum * 12.92 : 1.055 * std::pow(sum, 1 / 2.4) - 0.055;
                ASSERT_NEAR(half.rgba[(y * half.width + x) * 4 + channel], 255 * sum, 0.501);
            }
    // A header that promises 16384 x 16384 texels.
    const std::string huge = std::string("\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR", 16)
                             + std::string("\0\0\x40\0\0\0\x40\0\x08\x06\0\0\0", 13);
    document.root["images"][2] = {{"uri", "data:image/png;base64," + base64(huge)}};
    settings.max_memory = 1 << 30;
    expect_error(document, "images[2]: would take", ErrorKind::memory, settings);
}

TEST_F(Gltf, RefusesMaterialsThatMakeNoSense) {
    const auto expect = [&](const json& material, const char* part) {
        Document document;
        document.triangle()["material"] = 0;
        document.root["materials"] = {material};
        expect_error(document, part);
    };
    expect({{"emissiveFactor", {-1, 0, 0}}}, "materials[0].emissiveFactor");
    expect({{"pbrMetallicRoughness", {{"baseColorFactor", {-1, 0, 0, 1}}}}},
           "materials[0].pbrMetallicRoughness.baseColorFactor");
    Document document = textured();
    document.root["textures"] = {{{"extensions", {{"VENDOR_texture", {{"source", 0}}}}}}};
    expect_error(document, "textures[0]: has no source but for VENDOR_texture",
                 ErrorKind::unsupported);
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
            EXPECT_TRUE(error.kind == ErrorKind::invalid || error.kind == ErrorKind::file
                        || error.kind == ErrorKind::unsupported || error.kind == ErrorKind::memory)
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
