// What of a glTF file is chosen or posed: scenes, variants, visibility, animations, morph targets
// and skins, against values worked out by hand.
#include "scene/material.h"
#include "unit/gltf_document.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lpvbake {
namespace {

using nlohmann::json;
using Document = GltfDocument;
using GltfPose = Gltf;

/// The default material is white, which is always worth a warning.
long warnings_but_albedo(const Scene& scene) {
    return std::ranges::count_if(scene.warnings, [](const std::string& warning) {
        return warning.find("`max_albedo`") == std::string::npos;
    });
}

LoadSettings at_time(double time, const std::string& animation = "") {
    LoadSettings settings;
    settings.time = time;
    settings.animation = animation;
    return settings;
}

/// A triangle whose node an animation moves by one channel.
Document animated(const char* path, const std::vector<float>& times,
                  const std::vector<float>& values, const char* shape, const char* interpolation) {
    Document document;
    document.triangle();
    const int input = document.accessor<float>(times, real, "SCALAR");
    const int output = document.accessor<float>(values, real, shape);
    document.root["animations"] = {
        {{"name", "move"},
         {"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", path}}}}}},
         {"samplers", {{{"input", input}, {"output", output}, {"interpolation", interpolation}}}}}};
    return document;
}

TEST_F(GltfPose, StandsAsTheFileSaysWithoutAnAnimation) {
    Document document = animated("translation", {0, 1}, {5, 5, 5, 6, 6, 6}, "VEC3", "LINEAR");
    document.root["nodes"][0]["translation"] = {1, 2, 3};
    const Scene scene = load(document);
    expect_near(world_positions(scene)[0], {1, 2, 3});
    EXPECT_EQ(warnings_but_albedo(scene), 0);
    ASSERT_EQ(scene.file.animations.size(), 1u);
    EXPECT_EQ(scene.file.animations[0].name, "move");
}

TEST_F(GltfPose, InterpolatesLinearlyAndHoldsTheEnds) {
    Document document = animated("translation", {1, 3}, {0, 0, 0, 10, 20, 0}, "VEC3", "LINEAR");
    for (const auto& [time, x] :
         {std::pair(-5.0, 0.0), {1.0, 0.0}, {1.5, 2.5}, {3.0, 10.0}, {99.0, 10.0}})
        expect_near(world_positions(load(document, at_time(time)))[0], {x, 2 * x, 0});
    LoadSettings by_name;
    by_name.animation = "move"; // time 0, before the first key
    expect_near(world_positions(load(document, by_name))[0], {0, 0, 0});
}

TEST_F(GltfPose, HoldsStepsAndBendsSplines) {
    Document step = animated("scale", {0, 2}, {1, 1, 1, 3, 3, 3}, "VEC3", "STEP");
    expect_near(world_positions(load(step, at_time(1.999)))[1], {1, 0, 0});
    expect_near(world_positions(load(step, at_time(2.0)))[1], {3, 0, 0});
    // Leaves 0 at a speed of 2 a second and reaches 4 at rest, in 2 seconds. At half time a cubic
    // is the mean of its ends plus (T/8)(speed of leaving - speed of arriving).
    Document spline =
        animated("translation", {0, 2}, {9, 9, 9, 0, 0, 0, 2, 0, 0, /**/ 0, 0, 0, 4, 0, 0, 9, 9, 9},
                 "VEC3", "CUBICSPLINE");
    expect_near(world_positions(load(spline, at_time(1.0)))[0], {2.0 + 2.0 / 8.0 * 2.0, 0, 0});
    expect_near(world_positions(load(spline, at_time(0.0)))[0], {0, 0, 0});
    expect_near(world_positions(load(spline, at_time(2.0)))[0], {4, 0, 0});
}

TEST_F(GltfPose, TurnsTheShortWayRound) {
    const auto h = static_cast<float>(std::sqrt(0.5));
    // From none to a quarter turn about z, the second quaternion with its sign turned.
    Document document = animated("rotation", {0, 1}, {0, 0, 0, 1, 0, 0, -h, -h}, "VEC4", "LINEAR");
    const double eighth = std::numbers::pi / 4;
    expect_near(world_positions(load(document, at_time(0.5)))[1],
                {std::cos(eighth), std::sin(eighth), 0});
}

TEST_F(GltfPose, NamesBrokenAnimations) {
    Document document = animated("translation", {0, 0}, {0, 0, 0, 1, 1, 1}, "VEC3", "LINEAR");
    EXPECT_EQ(load(document).meshes.size(), 1u); // nobody asked for it
    expect_error(document, "animations[0].samplers[0].input: its times do not increase",
                 ErrorKind::invalid, at_time(0));
    document = animated("translation", {0, 1}, {0, 0, 0}, "VEC3", "LINEAR");
    expect_error(document, "animations[0].samplers[0].output: has not as many", ErrorKind::invalid,
                 at_time(0));
    document = animated("translation", {0}, {0, 0, 0}, "VEC3", "WOBBLE");
    expect_error(document, "\"WOBBLE\" is not an interpolation", ErrorKind::invalid, at_time(0));
    document.root["animations"][0]["channels"][0]["sampler"] = 4;
    expect_error(document, "sampler 4 is out of range", ErrorKind::invalid, at_time(0));
    document = animated("pointer", {0}, {0, 0, 0}, "VEC3", "STEP");
    expect_warning(load(document, at_time(0)),
                   "animations[0].channels: ignored: 1 channel of other things");
}

TEST_F(GltfPose, ListsWhatThereIsToChooseFrom) {
    Document document = animated("translation", {0, 1}, {0, 0, 0, 1, 1, 1}, "VEC3", "LINEAR");
    try {
        load(document, at_time(0, "dance"));
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::argument);
        EXPECT_STREQ(error.what(), "`animation` dance: the file has no such; it has 0 \"move\"");
    }
    LoadSettings settings;
    settings.variant = "red";
    EXPECT_THROW(load(document, settings), Error);
}

TEST_F(GltfPose, TakesTheSceneThatIsAskedFor) {
    Document document;
    document.triangle();
    document.root["scenes"] = {{{"name", "1"}, {"nodes", {0}}}, {{"nodes", {1}}}};
    document.root["nodes"].push_back({{"name", "nothing"}});
    LoadSettings settings;
    for (const auto& [name, meshes] : {std::pair("", 1u), {"0", 1u}, {"1", 1u}}) {
        settings.scene = name; // a name comes before an index
        EXPECT_EQ(load(document, settings).instances.size(), meshes) << name;
    }
    document.root["scenes"][0]["name"] = "other";
    settings.scene = "1";
    EXPECT_EQ(load(document, settings).instances.size(), 0u);
    EXPECT_EQ(load(document).file.scenes, std::vector<std::string>({"other", ""}));
}

TEST_F(GltfPose, LeavesOutHiddenNodesWithAllBelow) {
    Document document;
    document.triangle();
    document.root["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
    document.root["nodes"] = {
        {{"children", {1}}, {"extensions", {{"KHR_node_visibility", {{"visible", false}}}}}},
        {{"mesh", 0},
         {"extensions",
          {{"KHR_node_visibility", {{"visible", true}}}, {"KHR_lights_punctual", {{"light", 0}}}}}},
        {{"mesh", 0}, {"extensions", {{"KHR_node_visibility", json::object()}}}}};
    document.root["scenes"] = {{{"nodes", {0, 2}}}};
    const Scene scene = load(document);
    EXPECT_EQ(scene.instances.size(), 1u);
    EXPECT_TRUE(scene.lights.empty());
}

TEST_F(GltfPose, TakesAVariantsMaterials) {
    Document document;
    json& primitive = document.triangle();
    primitive["material"] = 0;
    document.root["materials"] = {{{"name", "plain"}}, {{"name", "red"}}, {{"name", "blue"}}};
    document.root["extensions"]["KHR_materials_variants"]["variants"] = {
        {{"name", "a"}}, {{"name", "b"}}, {{"name", "c"}}};
    primitive["extensions"]["KHR_materials_variants"]["mappings"] = {
        {{"material", 1}, {"variants", {0}}}, {{"material", 2}, {"variants", {1}}}};
    for (const auto& [variant, material] :
         {std::pair("", "plain"), {"a", "red"}, {"b", "blue"}, {"1", "blue"}, {"c", "plain"}}) {
        LoadSettings settings;
        settings.variant = variant;
        const Scene scene = load(document, settings);
        EXPECT_EQ(scene.materials[scene.meshes[0].material].name, material) << variant;
    }
    primitive["extensions"]["KHR_materials_variants"]["mappings"][0]["variants"] = {3};
    expect_error(document, "mappings[0].variants[0]: index 3 is out of range");
}

TEST_F(GltfPose, AppliesMorphTargetsByNodeMeshAndAnimation) {
    Document document = animated("weights", {0, 1}, {0, 0, 1, 0.5f}, "SCALAR", "LINEAR");
    json& primitive = document.root["meshes"][0]["primitives"][0];
    primitive["attributes"]["NORMAL"] =
        document.accessor<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}, real, "VEC3");
    const int up = document.accessor<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}, real, "VEC3");
    const int right = document.accessor<float>({1, 0, 0, 1, 0, 0, 1, 0, 0}, real, "VEC3");
    primitive["targets"] = {{{"POSITION", up}, {"NORMAL", right}}, {{"POSITION", right}}};
    document.place({{"mesh", 0}});
    document.place({{"mesh", 0}, {"weights", {1, 0}}});
    document.place({{"mesh", 0}, {"weights", {1, 0}}});
    Scene scene = load(document);
    EXPECT_EQ(warnings_but_albedo(scene), 0);
    EXPECT_EQ(scene.meshes.size(), 2u); // at rest, and raised, which is placed twice
    expect_near(world_positions(scene, 0)[0], {0, 0, 0});
    expect_near(world_positions(scene, 2)[0], {0, 0, 1});
    expect_near(scene.meshes[1].normals[0], {std::sqrt(0.5), 0, std::sqrt(0.5)});
    document.root["meshes"][0]["weights"] = {0, 2};
    expect_near(world_positions(load(document), 0)[1], {3, 0, 0});
    scene = load(document, at_time(0.5));
    expect_near(world_positions(scene, 0)[1], {1.25, 0, 0.5}); // animated
    expect_near(world_positions(scene, 1)[1], {3, 0, 0});      // the mesh's own weights
}

/// Three vertices on a bone of length 1 along y that ends in a joint at (0, 1, 0), far from the
/// origin; `turn` is the joint's rotation about z.
Document skinned(double turn, const std::vector<uint8_t>& joints,
                 const std::vector<float>& weights) {
    Document document;
    const int positions = document.accessor<float>({0, 0, 0, 0, 1, 0, 0, 2, 0}, real, "VEC3");
    const int normals = document.accessor<float>({1, 0, 0, 1, 0, 0, 1, 0, 0}, real, "VEC3");
    const int joint = document.accessor<uint8_t>(joints, uint8, "VEC4");
    const int weight = document.accessor<float>(weights, real, "VEC4");
    document.primitive({{"attributes",
                         {{"POSITION", positions},
                          {"NORMAL", normals},
                          {"JOINTS_0", joint},
                          {"WEIGHTS_0", weight}}}});
    std::vector<float> bind(32, 0.0f);
    for (const int i : {0, 5, 10, 15, 16, 21, 26, 31})
        bind[i] = 1.0f;
    bind[16 + 13] = -1.0f; // the second joint stands at (0, 1, 0) in the mesh
    document.root["nodes"] = {
        {{"mesh", 0}, {"skin", 0}, {"translation", {7, 7, 7}}, {"scale", {9, 9, 9}}},
        {{"translation", {1e6, 0, 0}}, {"children", {2}}},
        {{"translation", {0, 1, 0}}, {"rotation", {0, 0, std::sin(turn / 2), std::cos(turn / 2)}}}};
    document.root["scenes"] = {{{"nodes", {0, 1}}}};
    const int matrices = document.append("accessors", {{"bufferView", document.view(packed(bind))},
                                                       {"componentType", 5126},
                                                       {"count", 2},
                                                       {"type", "MAT4"}});
    document.root["skins"] = {{{"joints", {1, 2}}, {"inverseBindMatrices", matrices}}};
    return document;
}

TEST_F(GltfPose, BendsSkinsByTheirJointsAlone) {
    const double quarter = std::numbers::pi / 2;
    const Document document = skinned(quarter, {0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0},
                                      {1, 0, 0, 0, 0.25f, 0.25f, 0, 0, 2, 0, 0, 0});
    const Scene scene = load(document);
    EXPECT_EQ(warnings_but_albedo(scene), 0);
    const std::vector<glm::dvec3> p = world_positions(scene);
    expect_near(p[0], {1e6, 0, 0});     // the first joint; the mesh's node has no say
    expect_near(p[1], {1e6, 1, 0});     // both joints agree; weights need not sum to 1
    expect_near(p[2], {1e6 - 1, 1, 0}); // a quarter turn about the second joint
    expect_near(scene.meshes[0].normals[2], {0, 1, 0});
}

TEST_F(GltfPose, NamesBrokenSkins) {
    const std::vector<float> weights{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    expect_error(skinned(0, {0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0}, weights),
                 "attributes.JOINTS_0: joint 2 is out of range: skins[0] has 2");
    Document document = skinned(0, std::vector<uint8_t>(12), weights);
    document.root["skins"][0]["joints"] = {1, 2, 0};
    expect_error(document, "skins[0].inverseBindMatrices: has fewer matrices than joints");
    document = skinned(0, std::vector<uint8_t>(12), weights);
    document.root["meshes"][0]["primitives"][0]["attributes"].erase("WEIGHTS_0");
    expect_error(document, "attributes: WEIGHTS_0 is missing");
    document.root["meshes"][0]["primitives"][0]["attributes"].erase("JOINTS_0");
    expect_error(document, "attributes: JOINTS_0 is missing");
    expect_warning(load(skinned(0, std::vector<uint8_t>(12), std::vector<float>(12))),
                   "first joint: 3 vertices");
}

TEST_F(GltfPose, LetsTransmittedLightPass) {
    Document document;
    document.triangle()["material"] = 0;
    document.root["materials"] = {
        {{"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.25, 1, 0.1}}}},
         {"extensions", {{"KHR_materials_transmission", {{"transmissionFactor", 0.8}}}}}}};
    json& extensions = document.root["materials"][0]["extensions"];
    const auto sample = [&] {
        const Scene scene = load(document);
        EXPECT_TRUE(scene.warnings.empty());
        return scene::sample_surface(scene, scene.meshes[0], 0, {0.2f, 0.2f});
    };
    // 0.2 of the light is reflected and 0.8 passes, each in its colour; an opaque material's alpha
    // is nothing.
    EXPECT_NEAR(sample().alpha, 0.2, 1e-6);
    expect_near(sample().tint(), {0.5, 0.25, 1});
    EXPECT_EQ(load(document).materials[0].attenuation, glm::vec3(1.0f));
    for (const auto& [factor, alpha] : {std::pair(7.0, 0.0f), {1.0, 0.0f}, {0.0, 1.0f}}) {
        extensions["KHR_materials_transmission"]["transmissionFactor"] = factor;
        EXPECT_EQ(sample().alpha, alpha) << factor;
    }
    extensions["KHR_materials_transmission"] = json::object(); // by default nothing passes
    EXPECT_EQ(sample().alpha, 1.0f);
    // What a mask cuts out is not glass.
    extensions["KHR_materials_transmission"]["transmissionFactor"] = 0.8;
    document.root["materials"][0]["alphaMode"] = "MASK";
    EXPECT_EQ(sample().alpha, 0.0f);
    expect_near(sample().tint(), {1, 1, 1});
}

TEST_F(GltfPose, VolumesAttenuateByTheirThickness) {
    Document document;
    document.triangle()["material"] = 0;
    document.root["materials"] = {{{"extensions",
                                    {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
                                     {"KHR_materials_volume",
                                      {{"thicknessFactor", 0.06},
                                       {"attenuationDistance", 0.02},
                                       {"attenuationColor", {0.5, 1.5, 0}}}}}}}};
    json& extensions = document.root["materials"][0]["extensions"];
    const auto attenuation = [&] {
        const Scene scene = load(document);
        EXPECT_TRUE(scene.warnings.empty());
        return scene.materials[0].attenuation;
    };
    expect_near(attenuation(), {0.125, 1, 0}); // Beer and Lambert: color^(thickness / distance)
    document.root["nodes"][0]["scale"] = {2, 2, 2};
    const Scene large = load(document);
    expect_near(scene::attenuation_of(large, large.instances[0]), {1 / 64.0, 1, 0});
    // Without thickness, distance or transmission it is a surface; so are numbers that viewers
    // take for none.
    json& volume = extensions["KHR_materials_volume"];
    for (const char* key : {"thicknessFactor", "attenuationDistance", "attenuationColor"}) {
        const json kept = volume[key];
        volume.erase(key);
        EXPECT_EQ(attenuation(), glm::vec3(1.0f)) << key;
        if (kept.is_number()) {
            volume[key] = 0;
            EXPECT_EQ(attenuation(), glm::vec3(1.0f)) << key;
            volume[key] = -1;
            expect_error(document, std::string("KHR_materials_volume.") + key);
        }
        volume[key] = kept;
    }
    extensions.erase("KHR_materials_transmission");
    EXPECT_EQ(attenuation(), glm::vec3(1.0f));
}

} // namespace
} // namespace lpvbake
