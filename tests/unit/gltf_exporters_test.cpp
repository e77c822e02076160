// What exporters write against glTF 2.0, or at the edge of it, and viewers show all the same.
#include "image/image.h"
#include "unit/gltf_document.h"

#include <cmath>
#include <functional>

#include <fcntl.h>
#include <unistd.h>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Document = GltfDocument;

class Exporters : public Gltf {
protected:
    /// Loads a document with one warning, which holds `part`, and which `strict` takes for an
    /// error.
    Scene load_warned(const std::string& text, const std::string& part) {
        const Scene scene = load_text(text);
        EXPECT_EQ(scene.warnings.size(), 1u) << part;
        for (const std::string& warning : scene.warnings) {
            EXPECT_EQ(warning.find(path_ + ": "), 0u) << warning;
            EXPECT_NE(warning.find(part), std::string::npos) << warning << "\nlacks: " << part;
        }
        expect_error(text, ErrorKind::invalid, "`strict`", {.strict = true});
        return scene;
    }
    Scene load_warned(const Document& document, const std::string& part) {
        return load_warned(document.text(), part);
    }

    /// Loads a document without a word.
    Scene load_clean(const std::string& text) { return load_text(text, {.strict = true}); }
    Scene load_clean(const Document& document) { return load_clean(document.text()); }
};

Document with_nodes(const json& nodes, const json& roots) {
    Document document;
    document.triangle();
    document.root["nodes"] = nodes;
    document.root["scenes"][0]["nodes"] = roots;
    return document;
}

// ---------------------------------------------------------------- scenes and nodes

TEST_F(Exporters, RootsThatAreChildrenArePlacedOnce) {
    const json moved_parent = {{"children", {1}}, {"translation", {10, 0, 0}}},
               mesh = {{"mesh", 0}};
    const json plain_parent = {{"children", {1}}};
    Scene scene = load_warned(with_nodes({plain_parent, mesh}, {1}),
                              "scenes[0].nodes[0]: nodes[1] is a child of nodes[0], which is not "
                              "in the scene");
    ASSERT_EQ(scene.instances.size(), 1u);
    expect_near(world_positions(scene)[0], {0, 0, 0});
    // What the scene does not hold does not move what it holds.
    scene = load_warned(with_nodes({moved_parent, mesh}, {1}), "is placed without it");
    ASSERT_EQ(scene.instances.size(), 1u);
    expect_near(world_positions(scene)[0], {0, 0, 0});
    // In the scene by its parent and as a root, in any order.
    for (const json& roots : {json{0, 1}, json{1, 0}}) {
        scene = load_warned(with_nodes({moved_parent, mesh}, roots),
                            "nodes[1] is a child of nodes[0] as well: it is placed once, there");
        ASSERT_EQ(scene.instances.size(), 1u);
        expect_near(world_positions(scene)[0], {10, 0, 0});
    }
    // A grandchild; and a root cut off above another one.
    const json chain = {moved_parent, {{"children", {2}}, {"translation", {0, 5, 0}}}, mesh};
    scene = load_warned(with_nodes(chain, {0, 2}), "scenes[0].nodes[1]: nodes[2] is a child of");
    ASSERT_EQ(scene.instances.size(), 1u);
    expect_near(world_positions(scene)[0], {10, 5, 0});
    scene = load(with_nodes(chain, {1, 2}));
    ASSERT_EQ(scene.instances.size(), 1u);
    expect_near(world_positions(scene)[0], {0, 5, 0});
    EXPECT_EQ(scene.warnings.size(), 2u);
    // What cannot be placed once stays an error.
    expect_error(with_nodes({plain_parent, mesh, {{"children", {1}}}}, {0, 2}),
                 "nodes[1] is a child of nodes[0] already");
    expect_error(with_nodes({plain_parent, {{"children", {0}}}}, {0}), "is its own ancestor");
    expect_error(with_nodes(json::array({mesh}), {0, 0}), "is listed twice");
}

TEST_F(Exporters, NodesWithoutAScene) {
    const json nodes = {{{"children", {1}}}, {{"mesh", 0}}, {{"mesh", 0}}};
    for (const char* patch : {R"({"scenes": null})", R"({"scenes": []})",
                              R"({"scenes": null, "scene": 0})", R"({"scenes": [], "scene": 3})"}) {
        Document document = with_nodes(nodes, {0});
        document.root.merge_patch(json::parse(patch));
        const Scene scene = load_warned(document, "scenes: there is no scene: all nodes are taken");
        EXPECT_EQ(scene.instances.size(), 2u) << patch;
        EXPECT_THROW(load(document, {.scene = "x"}), Error);
    }
    Document document = with_nodes(nodes, {0});
    document.root["scene"] = 1;
    expect_error(document, "scene: index 1 is out of range"); // there is one
}

TEST_F(Exporters, MatricesThatAreAffineButForRounding) {
    const auto with = [](double x, double w) {
        return with_nodes(
            {{{"mesh", 0}, {"matrix", {1, 0, 0, x, 0, 1, 0, -x, 0, 0, 1, 0, 3, 0, 0, w}}}}, {0});
    };
    for (const auto& [x, w] : {std::pair(1e-9, 1.0), std::pair(0.0, 1 - 1e-9),
                               std::pair(-1.2e-7, 1 + 1.2e-7), std::pair(2e-6, 0.999999)}) {
        const Scene scene = load_clean(with(x, w));
        EXPECT_EQ(scene.instances.at(0).to_world[3], glm::dvec4(3, 0, 0, 1));
        EXPECT_EQ(scene.instances[0].to_world[0][3], 0.0);
    }
    expect_error(with(1e-3, 1), "is not affine");
    expect_error(with(0, 2), "is not affine");
}

TEST_F(Exporters, CamerasThatMakeNoSenseAreLeftOut) {
    const json good = {{"type", "perspective"}, {"perspective", {{"yfov", 0.5}}}};
    struct Case {
        const char* camera;
        const char* warning;
    };
    const Case cases[] = {
        {R"({"type": "perspective", "perspective": {"yfov": 49.13, "znear": 0.1}})",
         "cameras[1].perspective.yfov: 49.13 does not lie between 0 and pi radians: the camera"},
        {R"({"type": "perspective", "perspective": {"yfov": 0, "znear": 0.1}})",
         "cameras[1].perspective.yfov: 0 does not lie"},
        {R"({"type": "perspective", "perspective": {"yfov": -0.5}})", "yfov: -0.5 does not lie"},
        {R"({"type": "perspective", "perspective": {"yfov": "wide"}})", "yfov: is no number"},
        {R"({"type": "perspective", "perspective": {}})", "yfov: is no number"},
        {R"({"type": "perspective"})", "cameras[1].perspective.yfov: is no number"},
        {R"({"type": "oblique"})", "cameras[1].type: \"oblique\" is not a type of camera"},
        {R"({"type": 3})", "cameras[1].type: the type is not a type of camera"},
        {R"({"perspective": {"yfov": 0.5}})", "cameras[1].type: the type is not"},
    };
    for (const Case& each : cases)
        for (const bool is_placed : {true, false}) {
            SCOPED_TRACE(each.camera);
            Document document;
            document.triangle();
            document.root["cameras"] = {good, json::parse(each.camera), good};
            document.place({{"camera", 2}, {"translation", {7, 0, 0}}});
            if (is_placed)
                document.place({{"camera", 1}});
            const Scene scene = load_warned(document, each.warning);
            ASSERT_EQ(scene.cameras.size(), 1u);
            EXPECT_EQ(scene.cameras[0].to_world[3].x, 7.0);
            EXPECT_EQ(scene.instances.size(), 1u);
        }
    // Without a near plane a camera serves as well.
    Document document;
    document.triangle();
    document.root["cameras"] = {good};
    document.place({{"camera", 0}});
    EXPECT_EQ(load_clean(document).cameras.size(), 1u);
    document.root["nodes"].back()["camera"] = 1;
    expect_error(document, "camera: index 1 is out of range");
}

// ---------------------------------------------------------------- lights

Document with_light(const json& light) {
    Document document;
    document.triangle();
    document.root["extensions"]["KHR_lights_punctual"]["lights"] = {light};
    document.place({{"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
    return document;
}

TEST_F(Exporters, SpotsWithAHardEdge) {
    const auto spot = [](double inner, double outer) {
        return with_light(
            {{"type", "spot"}, {"spot", {{"innerConeAngle", inner}, {"outerConeAngle", outer}}}});
    };
    // Blender at blend 0, three.js at penumbra 0, and what rounding makes of them.
    for (const auto& [inner, outer] :
         {std::pair(0.5, 0.5), std::pair(0.5235987901687622, 0.5235987901687622),
          std::pair(0.5235988, 0.5235987901687622), std::pair(M_PI / 2, M_PI / 2),
          std::pair(0.7, 0.6)}) {
        const Scene scene =
            load_warned(spot(inner, outer), "extensions.KHR_lights_punctual.lights[0].spot."
                                            "innerConeAngle: is not below outerConeAngle: the "
                                            "spot has a hard edge");
        EXPECT_EQ(scene.lights.at(0).inner_cone, outer);
        EXPECT_EQ(scene.lights[0].outer_cone, outer);
    }
    const Scene soft = load_clean(spot(0.4999999, 0.5));
    EXPECT_EQ(soft.lights.at(0).inner_cone, 0.4999999);
    // An inner angle that is the default outer one.
    load_warned(with_light({{"type", "spot"}, {"spot", {{"innerConeAngle", 0.7853982}}}}),
                "the spot has a hard edge");
    expect_error(spot(0, 0), "outerConeAngle: must be above 0");
    expect_error(spot(0, 2), "outerConeAngle: must be at most pi/2");
    expect_error(spot(-0.1, 0.5), "innerConeAngle: must be at least 0");
}

TEST_F(Exporters, SpotsWithoutAngles) {
    for (const json& light : {json{{"type", "spot"}}, json{{"type", "spot"}, {"intensity", 5}}}) {
        const Scene scene = load_warned(with_light(light), "lights[0].spot: is missing");
        EXPECT_EQ(scene.lights.at(0).type, LightType::spot);
        EXPECT_EQ(scene.lights[0].inner_cone, 0.0);
        EXPECT_NEAR(scene.lights[0].outer_cone, M_PI / 4, 1e-9);
        EXPECT_EQ(scene.lights[0].intensity, light.value("intensity", 1.0));
    }
    // Nobody places it; an empty object has the defaults by the extension.
    Document unplaced = with_light({{"type", "spot"}});
    unplaced.root["nodes"].back().erase("extensions");
    load_warned(unplaced, "lights[0].spot: is missing");
    EXPECT_NEAR(load_clean(with_light({{"type", "spot"}, {"spot", json::object()}}))
                    .lights.at(0)
                    .outer_cone,
                M_PI / 4, 1e-9);
    expect_error(with_light({{"type", "spot"}, {"spot", 3}}), "lights[0].spot: must be an object");
    load_clean(with_light({{"type", "point"}}));
}

// ---------------------------------------------------------------- numbers and names

/// Every integer as a real.
json in_reals(const json& value) {
    if (value.is_number_integer())
        return value.get<double>();
    json copy = value;
    if (copy.is_structured())
        for (json& child : copy)
            child = in_reals(child);
    return copy;
}

TEST_F(Exporters, WholeNumbersWrittenAsReals) {
    Document document = textured({{"normalTexture", {{"index", 0}}}});
    json& primitive = document.root["meshes"][0]["primitives"][0];
    primitive["indices"] = document.accessor<uint16_t>({2, 0, 1}, uint16, "SCALAR");
    primitive["mode"] = 4;
    document.root["textures"][0]["sampler"] =
        document.append("samplers", {{"wrapS", 33071}, {"magFilter", 9728}, {"minFilter", 9729}});
    document.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 0;
    document.root["accessors"][0]["sparse"] = {
        {"count", 1},
        {"indices",
         {{"bufferView", document.view(packed<uint16_t>({2}))}, {"componentType", 5123}}},
        {"values", {{"bufferView", document.view(packed<float>({5, 6, 7}))}}}};
    document.root["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
    document.root["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 1}}}}};
    document.place({{"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}, {"camera", 0}});
    document.root["scene"] = 0;
    const Scene whole = load_clean(document);
    const std::string reals = in_reals(json::parse(document.text())).dump();
    ASSERT_NE(reals.find("\"count\":3.0"), std::string::npos) << reals;
    std::string exponents = reals;
    for (size_t at = 0; (at = exponents.find(".0", at)) != std::string::npos; ++at)
        if (std::string(",]}").find(exponents[at + 2]) != std::string::npos) // not in the version
            exponents.replace(at, 2, at % 2 ? "e0" : "E+0");
    for (const std::string& text : {reals, exponents}) {
        const Scene scene = load_clean(text);
        EXPECT_EQ(scene.meshes.at(0).triangles, whole.meshes.at(0).triangles);
        EXPECT_EQ(scene.meshes[0].positions, whole.meshes[0].positions);
        EXPECT_EQ(scene.meshes[0].positions[2], glm::vec3(5, 6, 7));
        EXPECT_EQ(scene.textures.at(0).wrap_u, Wrap::clamp_to_edge);
        EXPECT_EQ(scene.lights.size(), 1u);
        EXPECT_EQ(scene.cameras.size(), 1u);
    }
    const auto with_mesh = [&](const char* number) {
        std::string text = document.text();
        const std::string place = "\"mesh\":0";
        return text.replace(text.find(place), place.size(), std::string("\"mesh\":") + number);
    };
    for (const char* number : {"-0", "-0.0", "0e5", "0.0e-3"})
        EXPECT_EQ(load_clean(with_mesh(number)).instances.size(), 1u) << number;
    for (const char* number : {"0.5", "-1.0", "1e-9", "\"0\"", "null", "1e400", "true"})
        expect_error(with_mesh(number), ErrorKind::invalid, "nodes[0].mesh: must be an index");
    for (const char* number : {"1.0", "1e300"})
        expect_error(with_mesh(number), ErrorKind::invalid,
                     number[1] == '.' ? "nodes[0].mesh: index 1 is out of range" : "nodes[0].mesh");
}

TEST_F(Exporters, NumbersThatNobodyReads) {
    Document document = textured();
    const std::string many_digits(400, '7');
    for (const std::string& number : {std::string("1e400"), std::string("-1E+999"), many_digits,
                                      std::string("NaN"), std::string("-Infinity")}) {
        for (const char* place : {"", "/nodes/0", "/materials/0", "/meshes/0/primitives/0",
                                  "/textures/0", "/asset", "/accessors/0"}) {
            Document spoiled = document;
            spoiled.root[json::json_pointer(place)]["extras"] = {
                {"a", {{"b", {1, "@", "a \"quoted\" 1e400 in a text"}}}}};
            std::string text = spoiled.text();
            text.replace(text.find("\"@\""), 3, number);
            EXPECT_EQ(load_clean(text).instances.size(), 1u) << number << " in " << place;
        }
        document.root["nodes"][0]["translation"] = {0, "@", 0};
        std::string text = document.text();
        text.replace(text.find("\"@\""), 3, number);
        expect_error(text, ErrorKind::invalid,
                     "nodes[0].translation: must be an array of 3 numbers");
        document.root["nodes"][0].erase("translation");
    }
    expect_error(R"({"asset": {"version": "2.0"}, "extras": Nan})", ErrorKind::invalid,
                 "is not JSON");
}

TEST_F(Exporters, NamesThatAreNoUtf8) {
    const auto with_name = [](const char* array, const std::string& name) {
        Document document = textured();
        document.root[array][0]["name"] = "@name@";
        std::string text = document.text();
        return text.replace(text.find("@name@"), 6, name);
    };
    const std::string latin = "B\xfcro", utf8 = "B\xc3\xbcro";
    for (const char* array : {"nodes", "meshes", "materials", "images"}) {
        const Scene scene = load_warned(with_name(array, latin), "read as Latin-1");
        EXPECT_EQ(scene.instances.size(), 1u);
        EXPECT_EQ(scene.meshes[0].name, array == std::string("meshes") ? utf8 : "");
    }
    EXPECT_EQ(load_clean(with_name("meshes", utf8)).meshes[0].name, utf8);
    load_warned(with_name("meshes", "\xe9t\xe9 \xff\xfe \xe2\x82"), "read as Latin-1");
    // Half of a surrogate pair has no UTF-8.
    EXPECT_EQ(load_clean(with_name("meshes", R"(a\ud83d\ude00b\ud83dc\udc00)")).meshes[0].name,
              "a\xf0\x9f\x98\x80"
              "b\xef\xbf\xbd"
              "c\xef\xbf\xbd");
    expect_error(with_name("meshes", "\xfc\n"), ErrorKind::invalid, "is not JSON");
}

TEST_F(Exporters, VersionOneIsNamed) {
    const auto refused = [&](const std::string& text, const std::string& part) {
        expect_error(text, ErrorKind::unsupported, part);
    };
    refused(R"({"asset": {"version": "1.0"}, "buffers": {}, "meshes": {}})", "glTF 1.0");
    refused(R"({"asset": {"version": 1.0}, "buffers": {}})", "glTF 1.0");
    refused(R"({"asset": {"version": 1}, "meshes": {"m": {}}})", "glTF 1");
    refused(R"({"asset": {"version": "0.8"}, "nodes": {}})", "glTF 0.8");
    refused(R"({"scene": "s", "scenes": {"s": {"nodes": []}}, "nodes": {}})", "glTF 1.0");
    refused(R"({"asset": {"generator": "x"}, "meshes": {}})", "glTF 1.0");
    refused(R"({"asset": {"version": "2.0", "minVersion": "2.1"}})", "glTF \"2.1\"");
    refused(std::string("glTF\1\0\0\0\x14\0\0\0\0\0\0\0\0\0\0\0", 20),
            "version 1, glTF 1.0, is not supported");
    expect_error(R"({"asset": {"version": 2}})", ErrorKind::invalid, "must be a string");
    expect_error(R"({"meshes": []})", ErrorKind::invalid, "asset: is missing");
}

// ---------------------------------------------------------------- references that lead nowhere

TEST_F(Exporters, ReferencesToImagesThatAreNotThere) {
    const Document document = textured({{"emissiveFactor", {0, 0, 0}}});
    const auto with_texture = [&](const json& texture, bool is_used) {
        Document spoiled = document;
        spoiled.root["textures"].push_back(texture);
        if (is_used)
            spoiled.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 1;
        return spoiled;
    };
    const json sources[] = {
        {{"source", 1}},
        {{"source", 7.0}},
        {{"extensions", {{"EXT_texture_webp", {{"source", 9}}}}}},
        {{"extensions", {{"KHR_texture_basisu", {{"source", 1}}}}}},
    };
    for (const json& texture : sources) {
        Scene scene = load_warned(with_texture(texture, false),
                                  "is out of range: images has 1 elements: the texture is without "
                                  "an image");
        EXPECT_EQ(scene.textures.size(), 1u);
        scene = load(with_texture(texture, true));
        expect_warning(scene, "textures[1]: has no source: materials use their factors alone");
        EXPECT_EQ(scene.materials.at(0).base_color_texture, -1);
    }
    // The image to fall back on.
    Scene scene = load_warned(
        with_texture({{"source", 0}, {"extensions", {{"EXT_texture_webp", {{"source", 5}}}}}},
                     true),
        "textures[1].extensions.EXT_texture_webp.source: index 5 is out of range");
    EXPECT_EQ(scene.images.at(0).width, 2);
    // A sampler, and the bytes of an image.
    scene = load_warned(with_texture({{"source", 0}, {"sampler", 0}}, true),
                        "textures[1].sampler: index 0 is out of range: samplers has 0 elements: "
                        "the texture is repeated");
    EXPECT_EQ(scene.textures.at(0).wrap_u, Wrap::repeat);
    Document unused = document;
    unused.root["images"].push_back({{"bufferView", 99}});
    load_warned(unused, "images[1].bufferView: index 99 is out of range");
    Document wrong = document;
    wrong.root["textures"].push_back({{"source", "0"}});
    expect_error(wrong, "textures[1].source: must be an index");
}

TEST_F(Exporters, BuffersThatNothingUses) {
    Document document;
    document.triangle();
    document.root["buffers"] = {
        {{"byteLength", document.bytes.size()}, {"uri", "data:;base64," + base64(document.bytes)}}};
    const auto with_buffer = [&](const json& buffer) {
        Document spoiled = document;
        spoiled.root["buffers"].push_back(buffer);
        return spoiled;
    };
    load_warned(with_buffer({{"byteLength", 4}, {"uri", "gone.bin"}}),
                "buffers[1].uri: \"gone.bin\": there is no such file: left out");
    load_warned(with_buffer({{"byteLength", 4}, {"uri", "data:;base64,@@@@"}}),
                "buffers[1].uri: the data URI is not base64: left out");
    load_warned(with_buffer({{"byteLength", 400}, {"uri", "data:;base64,AAAA"}}),
                "buffers[1].uri: does not hold byteLength bytes: left out");
    load_warned(with_buffer({{"byteLength", 4}, {"uri", "http://localhost/a.bin"}}), "left out");
    EXPECT_EQ(load_clean(with_buffer({{"byteLength", 4}})).meshes.size(), 1u);
    // By a view that nothing uses, of a buffer and past one.
    Document view = with_buffer({{"byteLength", 4}, {"uri", "gone.bin"}});
    view.append("bufferViews", {{"buffer", 1}, {"byteLength", 4}});
    load_warned(view, "\"gone.bin\"");
    view.append("accessors",
                {{"bufferView", 1}, {"componentType", 5126}, {"count", 1}, {"type", "SCALAR"}});
    load_warned(view, "\"gone.bin\"");
    Document past = document;
    past.append("bufferViews", {{"buffer", 0}, {"byteLength", 1000}});
    expect_error(past, "bufferViews[1]: runs past buffers[0], which has 36 bytes");
    // By an animation that nobody asks for.
    view.root["animations"] = {
        {{"samplers", {{{"input", 1}, {"output", 1}}}},
         {"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", "scale"}}}}}}}};
    load_warned(view, "\"gone.bin\"");
    expect_error(view, "\"gone.bin\": there is no such file", ErrorKind::file, {.time = 0.0});
    // Once something does use them, they are missed.
    view.root["accessors"][1]["type"] = "VEC3";
    view.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 1;
    expect_error(view, "buffers[1].uri: \"gone.bin\": there is no such file", ErrorKind::file);
}

// ---------------------------------------------------------------- images

std::string grey_png() {
    return packed(image::encode_png({4, 4, 3, std::vector<float>(48, 0.5f)}, "image"));
}

/// Files that are no image that can be read.
std::vector<std::pair<const char*, std::string>> broken_images() {
    const std::string whole = grey_png();
    std::string checksum = whole, stream = whole;
    const size_t data = whole.find("IDAT");
    checksum[whole.find("IEND") - 5] ^= 1;
    stream[data + 4] ^= 0x0f;
    return {
        {"empty", ""},
        {"text", "this is no image"},
        {"half a PNG", whole.substr(0, whole.size() / 2)},
        {"a PNG without its end", whole.substr(0, whole.size() - 12)},
        {"a PNG's checksum", checksum},
        {"a PNG's stream", stream},
        {"GIF",
         std::string("GIF89a\1\0\1\0\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0\1\0\1\0\0\2\2D\1\0;", 35)},
        {"KTX2", std::string("\xabKTX 20\xbb\r\n\x1a\n\0\0\0\0", 16)},
        {"BMP", std::string("BM\x3a\0\0\0\0\0\0\0", 10)},
        {"DDS", std::string("DDS |\0\0\0", 8)},
        {"half a JPEG", std::string("\xff\xd8\xff\xe0\0\x10JFIF\0\1\1\0\0\1\0\1\0\0", 20)},
        {"WebP", std::string("RIFF\x1a\0\0\0WEBPVP8L\x0d\0\0\0\x2f\0\0\0\x10\x07\x10\x11", 28)}};
}

TEST_F(Exporters, ImagesThatCannotBeReadLeaveTheFactor) {
    const json red = {{"pbrMetallicRoughness",
                       {{"baseColorFactor", {0.8, 0.1, 0.1, 1}}, {"metallicFactor", 0.5}}},
                      {"emissiveFactor", {0, 2, 0}}};
    for (const auto& [kind, bytes] : broken_images()) {
        SCOPED_TRACE(kind);
        Document document = textured(red);
        document.root["images"][0] = {{"uri", "data:image/png;base64," + base64(bytes)}};
        Scene scene = load_warned(document, "images[0]: the image ");
        expect_warning(scene, ": materials use their factors alone");
        ASSERT_EQ(scene.materials.size(), 1u);
        EXPECT_EQ(scene.materials[0].base_color_texture, -1);
        EXPECT_EQ(scene.materials[0].base_color, glm::vec4(0.8f, 0.1f, 0.1f, 1));
        EXPECT_TRUE(scene.textures.empty());
        EXPECT_TRUE(scene.images.empty());
        // In a file, and where it emits, is metal or lets light through.
        write(folder_ / "broken.png", bytes);
        document.root["images"][0] = {{"uri", "broken.png"}};
        scene = load_warned(document, "images[0] (broken.png): the image ");
        json& material = document.root["materials"][0];
        material["emissiveTexture"] = {{"index", 0}};
        material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {{"index", 0}};
        material["extensions"]["KHR_materials_transmission"] = {
            {"transmissionFactor", 0.0}, {"transmissionTexture", {{"index", 0}}}};
        LoadSettings black_metal;
        black_metal.rules.metallic_black = true;
        scene = load(document, black_metal);
        EXPECT_EQ(scene.warnings.size(), 1u);
        EXPECT_EQ(scene.materials[0].emission, glm::vec3(0, 2, 0));
        EXPECT_EQ(scene.materials[0].emission_texture, -1);
        EXPECT_FLOAT_EQ(scene.materials[0].base_color.r, 0.4f);
    }
}

TEST_F(Exporters, ImagesThatAreNotThereLeaveTheFactor) {
    fs::create_directories(folder_ / "folder.png");
    Document document = textured();
    struct Case {
        json image;
        const char* warning;
    };
    const Case cases[] = {
        {{{"uri", "gone.png"}}, "images[0].uri: \"gone.png\": there is no such file: materials"},
        {{{"uri", "folder.png"}}, "images[0].uri: is not a file"},
        {{{"uri", "C:\\textures\\brick.png"}}, "is not a relative path: materials use"},
        {{{"uri", "http://localhost/a.png"}}, "is not a relative path: materials use"},
        {{{"uri", "data:image/png;base64,@"}}, "images[0].uri: the data URI is not base64"},
        {{{"name", "nothing"}}, "images[0]: has neither a uri nor a bufferView"},
    };
    for (const Case& each : cases) {
        document.root["images"][0] = each.image;
        const Scene scene = load_warned(document, each.warning);
        EXPECT_EQ(scene.materials.at(0).base_color_texture, -1) << each.warning;
        EXPECT_TRUE(load(document, {.skip_colors = true}).images.empty()) << each.warning;
    }
    // In a buffer that is not there.
    document.root["buffers"] = {
        {{"byteLength", document.bytes.size()}, {"uri", "data:;base64," + base64(document.bytes)}},
        {{"byteLength", 4}, {"uri", "gone.bin"}}};
    document.root["images"][0] = {
        {"bufferView", document.append("bufferViews", {{"buffer", 1}, {"byteLength", 4}})}};
    const Scene scene = load(document);
    EXPECT_EQ(scene.warnings.size(), 2u);
    expect_warning(scene, "buffers[1].uri: \"gone.bin\": there is no such file: materials use");
    // What a user may allow is asked for.
    document.root["images"][0] = {{"uri", "../a.png"}};
    expect_error(document, "images[0].uri: \"../a.png\" leads out through \"..\"");
}

TEST_F(Exporters, TheNextImageStandsInForABrokenOne) {
    const auto with = [&](const json& webp, const json& fallback) {
        Document document = textured();
        document.root["images"] = {webp, fallback};
        document.root["textures"] = {
            {{"source", 1}, {"extensions", {{"EXT_texture_webp", {{"source", 0}}}}}}};
        return document;
    };
    const json good = {{"uri", "data:image/png;base64," + base64(grey_png())}};
    for (const auto& [kind, bytes] : broken_images()) {
        const json broken = {{"uri", "data:image/webp;base64," + base64(bytes)}};
        const Scene scene = load_warned(with(broken, good), ": the image to fall back on is taken");
        ASSERT_EQ(scene.images.size(), 1u) << kind;
        EXPECT_EQ(scene.images[0].width, 4);
        EXPECT_EQ(scene.textures.at(scene.materials[0].base_color_texture).image, 0);
    }
    const json gone = {{"uri", "gone.webp"}};
    EXPECT_EQ(load_warned(with(gone, good), "\"gone.webp\"").images.size(), 1u);
    const Scene neither = load(with(gone, {{"uri", "gone.png"}}));
    EXPECT_EQ(neither.warnings.size(), 2u);
    EXPECT_EQ(neither.materials.at(0).base_color_texture, -1);
    // The fallback is nobody's business where the first one reads.
    EXPECT_EQ(load_clean(with(good, gone)).images.at(0).width, 4);
    // One image fails for one texture, another shares it with its own fallback.
    Document shared = with(gone, good);
    shared.root["textures"].push_back({{"source", 0}});
    shared.root["materials"][0]["emissiveTexture"] = {{"index", 1}};
    shared.root["materials"][0]["emissiveFactor"] = {1, 1, 1};
    const Scene scene = load(shared);
    EXPECT_EQ(scene.materials.at(0).base_color_texture, 0);
    EXPECT_EQ(scene.materials[0].emission_texture, -1);
}

TEST_F(Exporters, WarningsOfImagesStandInTheirOrder) {
    std::vector<std::string> first;
    for (int round = 0; round < 3; ++round) {
        Document document;
        for (int i = 0; i < 3; ++i) {
            document.triangle()["material"] = i;
            document.root["images"].push_back(
                {{"uri", "data:image/png;base64," + base64(broken_images()[2 + i].second)}});
            document.root["textures"].push_back({{"source", i}});
            document.root["materials"].push_back(
                {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 2 - i}}}}}});
        }
        const std::vector<std::string> warnings = load(document).warnings;
        ASSERT_EQ(warnings.size(), 3u);
        for (size_t i = 0; i < 3; ++i)
            EXPECT_NE(warnings[i].find(": images[" + std::to_string(i) + "]"), std::string::npos);
    }
}

// ---------------------------------------------------------------- URIs

TEST_F(Exporters, DataUrisInEveryForm) {
    Document document;
    document.triangle();
    std::string digits = base64(document.bytes);
    const auto with = [&](const std::string& uri) {
        Document other = document;
        other.root["buffers"] = {{{"byteLength", document.bytes.size()}, {"uri", uri}}};
        return other;
    };
    const auto broken_every = [&](size_t count, const std::string& by) {
        std::string text;
        for (size_t i = 0; i < digits.size(); i += count)
            text += digits.substr(i, count) + by;
        return text;
    };
    std::string escaped;
    for (const char c : digits)
        escaped += c == '/' ? "%2F" : c == '+' ? "%2b" : c == '=' ? "%3D" : std::string(1, c);
    std::string raw;
    for (const char c : document.bytes) {
        char byte[4];
        std::snprintf(byte, sizeof byte, "%%%02X", static_cast<unsigned char>(c));
        raw += byte;
    }
    const std::string type = "data:application/octet-stream;base64,";
    for (const std::string& uri :
         {type + digits, type + broken_every(76, "\n"), type + broken_every(64, "\r\n"),
          type + " " + broken_every(5, " \t"), type + broken_every(8, "%0D%0A"), type + escaped,
          "DATA:application/octet-stream;BASE64," + digits, "Data:;Base64," + digits,
          "data:application/gltf-buffer;charset=x;base64," + digits,
          type + digits.substr(0, digits.find('=')), "data:application/octet-stream," + raw}) {
        EXPECT_EQ(load_clean(with(uri)).meshes.at(0).positions.at(1), glm::vec3(1, 0, 0)) << uri;
    }
    expect_error(with(type + "@@@@"), "is not base64");
    expect_error(with(type + digits.substr(0, 8) + "=" + digits.substr(8)), "is not base64");
    expect_error(with("data:application/octet-stream;base64"), "has no comma");
    Document picture = textured();
    picture.root["images"][0]["uri"] = "DATA:IMAGE/PNG;BASE64,\n" + base64(grey_png()) + "\n";
    EXPECT_EQ(load_clean(picture).images.at(0).width, 4);
}

TEST_F(Exporters, PathsThatStayInside) {
    Document document;
    document.triangle();
    fs::create_directories(folder_ / "sub" / "deep");
    write(folder_ / "own.bin", document.bytes);
    write(folder_ / "sub" / "own.bin", document.bytes);
    write(folder_ / "sub" / "deep" / "A b.BIN", document.bytes);
    const auto with = [&](const std::string& uri) {
        Document other = document;
        other.root["buffers"] = {{{"byteLength", document.bytes.size()}, {"uri", uri}}};
        return other;
    };
    for (const char* uri :
         {"sub\\own.bin", "sub/../own.bin", "./sub/./own.bin", "sub\\..\\own.bin", ".\\own.bin",
          "sub/deep/../../own.bin", "sub\\deep\\A%20b.BIN", "sub/deep/A b.BIN",
          "nowhere/../own.bin", "sub//own.bin", "sub%5Cown.bin"})
        EXPECT_EQ(load_clean(with(uri)).meshes.size(), 1u) << uri;
    struct Hint {
        const char* uri;
        const char* part;
    };
    const Hint hints[] = {
        {"OWN.bin", "\"OWN.bin\": there is no such file; there is \"own.bin\""},
        {"own.bin?v=1", "there is \"own.bin\""},
        {"own.bin#part", "there is \"own.bin\""},
        {"Sub/Deep/a b.bin", "there is \"sub/deep/A b.BIN\""},
        {"SUB\\own.BIN?x", "there is \"sub/own.bin\""},
        {"sub/../Own.Bin", "there is \"own.bin\""},
    };
    for (const Hint& hint : hints)
        expect_error(with(hint.uri), hint.part, ErrorKind::file);
    for (const char* uri : {"other.bin", "sub/other.bin?own.bin", "own.bi"})
        try {
            load(with(uri));
            ADD_FAILURE() << uri;
        } catch (const Error& error) {
            EXPECT_EQ(std::string(error.what()).find("there is \""), std::string::npos)
                << error.what();
        }
    for (const char* uri : {"../own.bin", "sub/../../x.bin", "sub\\..\\..\\x.bin", "..\\x.bin",
                            "sub/..%5c..%2fx.bin"})
        expect_error(with(uri), "leads out through \"..\"");
    // Beside the folder there is no hint either.
    const fs::path outside = folder_.parent_path() / (folder_.filename().string() + "_Outside.bin");
    write(outside, document.bytes);
    fs::create_symlink(folder_.parent_path(), folder_ / "up");
    std::string name = "up/" + outside.filename().string();
    expect_error(with(name), "is a link that leads out");
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return std::tolower(c); });
    try {
        load(with(name));
        ADD_FAILURE();
    } catch (const Error& error) {
        EXPECT_EQ(std::string(error.what()).find("Outside"), std::string::npos) << error.what();
    }
    fs::remove(outside);
}

// ---------------------------------------------------------------- strides, modes, brightness

TEST_F(Exporters, StridesThatGltfDoesNotAllow) {
    const auto with = [](int stride, int padding) {
        Document document;
        json& primitive = document.triangle();
        std::string bytes;
        for (const uint8_t value : {10, 20, 30}) {
            bytes += std::string(2, static_cast<char>(value));
            bytes += std::string(static_cast<size_t>(padding), '\0');
        }
        const int view = document.view(bytes);
        document.root["bufferViews"][view]["byteStride"] = stride;
        primitive["attributes"]["TEXCOORD_0"] =
            document.append("accessors", {{"bufferView", view},
                                          {"componentType", 5121},
                                          {"count", 3},
                                          {"type", "VEC2"},
                                          {"normalized", true}});
        primitive["material"] = document.append(
            "materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
        document.root["images"] = {{{"uri", png}}};
        document.root["textures"] = {{{"source", 0}}};
        return document;
    };
    for (const auto& [stride, padding] : {std::pair(2, 0), std::pair(3, 1), std::pair(6, 4),
                                          std::pair(256, 254), std::pair(1, 0)}) {
        const Scene scene = load_warned(with(stride, padding),
                                        "bufferViews[1].byteStride: " + std::to_string(stride)
                                            + " is not a multiple of 4 up to 252");
        ASSERT_EQ(scene.meshes.at(0).uv.size(), 3u);
        EXPECT_FLOAT_EQ(scene.meshes[0].uv[2].x, 30 / 255.0f) << stride;
    }
    EXPECT_FLOAT_EQ(load_clean(with(4, 2)).meshes.at(0).uv.at(2).y, 30 / 255.0f);
    // Of indices, too; and a valid stride that does not fit stays an error.
    Document document;
    document.triangle()["indices"] = document.accessor<uint16_t>({2, 1, 0}, uint16, "SCALAR");
    document.root["bufferViews"][0]["byteStride"] = 2; // the assigned value comes first
    EXPECT_EQ(load_warned(document, "bufferViews[0].byteStride: 2").meshes.at(0).triangles.at(0),
              glm::uvec3(2, 1, 0));
    document.root["bufferViews"][0].erase("byteStride");
    document.root["bufferViews"][1]["byteStride"] = 8;
    expect_error(document, "byteStride 8 is less than an element");
}

TEST_F(Exporters, ModesThatGltfDoesNotKnow) {
    for (const char* mode : {"mask", "GLASS", "Blend", ""}) {
        Document document;
        document.triangle()["material"] = 0;
        document.root["materials"] = {{{"alphaMode", mode}, {"alphaCutoff", 0.25}}};
        const Scene scene = load_warned(
            document, std::string("materials[0].alphaMode: \"") + mode
                          + "\" is not an alpha mode: the material is taken for opaque");
        EXPECT_EQ(scene.materials.at(0).alpha_mode, AlphaMode::opaque);
    }
    for (const int mode : {10496, 3, 0, 33069}) {
        Document document = textured();
        document.root["samplers"] = {{{"wrapS", mode}, {"wrapT", 33071}}};
        document.root["textures"][0]["sampler"] = 0;
        const Scene scene = load_warned(document, "samplers[0].wrapS: " + std::to_string(mode)
                                                      + " is not a wrap mode: the texture is "
                                                        "repeated");
        EXPECT_EQ(scene.textures.at(0).wrap_u, Wrap::repeat);
        EXPECT_EQ(scene.textures[0].wrap_v, Wrap::clamp_to_edge);
    }
}

TEST_F(Exporters, BrightMaterialsAreNoFault) {
    Document document;
    document.triangle()["material"] = 0;
    document.triangle();
    document.root["materials"] = {{{"pbrMetallicRoughness", {{"metallicFactor", 0}}}}};
    EXPECT_EQ(load_clean(document).clamped_materials, 2u);
    LoadSettings white;
    white.rules.max_albedo = 1.0f;
    EXPECT_EQ(load(document, white).clamped_materials, 0u);
}

// ---------------------------------------------------------------- messages

TEST_F(Exporters, MessagesAreShortAndOnOneLine) {
    const auto check = [&](const std::string& text, const std::string& part) {
        const auto expect_readable = [&](const std::string& message) {
            EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks: " << part;
            EXPECT_LT(message.size(), path_.size() + 800) << message.substr(0, 1000);
            for (const char c : message)
                ASSERT_TRUE(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f) << message;
        };
        try {
            const Scene scene = load_text(text);
            EXPECT_FALSE(scene.warnings.empty());
            for (const std::string& warning : scene.warnings)
                expect_readable(warning);
        } catch (const Error& error) {
            expect_readable(error.what());
        }
    };
    const auto patched = [](const json& patch) {
        Document document = textured();
        document.root.merge_patch(patch);
        return document.text();
    };
    const std::string nul("tex\0.png", 8), long_text(4 << 20, 'a');
    const std::string lines = "a\nb\r\x1b[31m\x7f\xc2\x9b";
    for (const auto& [text, part] :
         {std::pair(nul, std::string("\"tex\\u0000.png\"")),
          std::pair("X:" + long_text, "\"X:" + std::string(100, 'a')),
          std::pair(lines, std::string(R"("a\u000ab\u000d\u001b[31m\u007f\u009b")"))}) {
        const std::string inner = part.substr(1, part.size() - 1 - (part.back() == '"'));
        check(patched({{"images", {{{"uri", text}}}}}), part);
        check(patched({{"materials", {{{"alphaMode", text}}}}}), part);
        check(patched({{"extensionsUsed", {text}}}), inner);
        check(patched({{"extensionsRequired", {text}}}), inner);
        check(patched({{"cameras", {{{"type", text}}}}}), part);
        check(patched({{"asset", {{"version", text}}}}), inner);
        check(patched({{"meshes", {{{"primitives", {{{"attributes", {{text, "x"}}}}}}}}}}), inner);
        check(with_light({{"type", text}}).text(), part);
        check("{\"asset\": {\"version\": \"2.0\"}, \"x\": " + std::string(1 << 20, '7') + "x",
              "is");
    }
    // A name in a URI's bytes.
    Document document = textured();
    document.root["images"][0]["uri"] = "%FF%0a.png";
    check(document.text(), R"("\xff\u000a.png")");
    // What it cuts, it cuts between characters.
    document.root["images"][0]["uri"] = std::string(119, 'a') + "\xc3\xbc\xc3\xbc.png";
    check(document.text(), std::string(119, 'a') + "\xc3\xbc...");
}

// ---------------------------------------------------------------- standard input

/// Puts a file in the place of standard input while it lives.
class StandardInput {
public:
    explicit StandardInput(const fs::path& path) : before_(dup(STDIN_FILENO)) {
        const int file = open(path.c_str(), O_RDONLY);
        dup2(file, STDIN_FILENO);
        close(file);
    }
    ~StandardInput() {
        dup2(before_, STDIN_FILENO);
        close(before_);
    }

private:
    int before_;
};

TEST_F(Exporters, ReadsAWholeSceneFromStandardInput) {
    Document document = textured();
    for (const std::string& bytes : {document.text(), document.glb()}) {
        write(path_, bytes);
        const StandardInput input(path_);
        const Scene scene = load_gltf("-", {.strict = true});
        EXPECT_EQ(scene.meshes.size(), 1u);
        EXPECT_EQ(scene.images.at(0).width, 2);
        EXPECT_EQ(scene.path, "standard input");
    }
    const auto refusal = [&](const std::string& text, const LoadSettings& settings = {}) {
        write(path_, text);
        const StandardInput input(path_);
        try {
            load_gltf("-", settings);
        } catch (const Error& error) {
            EXPECT_EQ(std::string(error.what()).find("standard input: "), 0u) << error.what();
            return std::string(error.what());
        }
        return std::string("accepted");
    };
    EXPECT_NE(refusal("").find("is not JSON"), std::string::npos);
    write(folder_ / "own.bin", document.bytes);
    document.root["buffers"] = {{{"byteLength", document.bytes.size()}, {"uri", "own.bin"}}};
    EXPECT_NE(refusal(document.text()).find("standard input has none; embed it"),
              std::string::npos);
    EXPECT_NE(refusal(std::string(3 << 20, ' '), {.max_memory = 1 << 20}).find("`max_memory`"),
              std::string::npos);
}

} // namespace
} // namespace lpvbake
