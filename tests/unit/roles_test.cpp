// Which surfaces of a file have a role, and what roles are to the rest.
#include "unit/gltf_document.h"

#include "scene/roles.h"
#include "scene/scene.h"
#include "scene/scene_hash.h"

namespace lpvbake {
namespace {

/// A node "hall" with a node "door" of two primitives (wood, glass) and a lamp below it, and a node
/// "cat" beside it.
GltfDocument house() {
    GltfDocument document;
    const int positions = document.accessor<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}, real, "VEC3");
    const auto primitive = [&](int material) {
        return nlohmann::json{{"attributes", {{"POSITION", positions}}}, {"material", material}};
    };
    document.root["materials"] = {{{"name", "wood"}},
                                  {{"name", "glass"}, {"extras", {{"lpv", "pane"}}}}};
    document.root["meshes"] = {{{"name", "leaf"}, {"primitives", {primitive(0), primitive(1)}}},
                               {{"name", "fur"},
                                {"primitives", {primitive(0)}},
                                {"extras", {{"moves", true}, {"speed", 2}}}}};
    document.root["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
    document.root["extensionsUsed"] = {"KHR_lights_punctual"};
    document.root["nodes"] = {
        {{"name", "door"}, {"mesh", 0}},
        {{"name", "lamp"}, {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}},
        {{"name", "hall"}, {"children", {0, 1}}},
        {{"name", "cat"}, {"mesh", 1}, {"translation", {5, 0, 0}}}};
    document.root["scenes"][0]["nodes"] = {2, 3};
    return document;
}

class Roles : public Gltf {
protected:
    Scene with(std::vector<RoleRule> rules) {
        LoadSettings settings;
        settings.roles = std::move(rules);
        return load(house(), settings);
    }
    /// Of wood, glass and fur, in the order of the file.
    std::vector<Role> roles_with(std::vector<RoleRule> rules) {
        std::vector<Role> roles;
        const Scene scene = with(std::move(rules));
        EXPECT_TRUE(scene.warnings.empty());
        for (const Instance& instance : scene.instances)
            roles.push_back(instance.role);
        return roles;
    }
};

constexpr Role full = Role::full, receive = Role::receive_only, cast = Role::cast_only,
               lights = Role::lights_only;
using Are = std::vector<Role>;

TEST_F(Roles, GoByNodesMeshesMaterialsAndExtras) {
    EXPECT_EQ(roles_with({}), Are({full, full, full}));
    EXPECT_EQ(roles_with({{"hall", cast}}), Are({cast, cast, full}));
    EXPECT_EQ(roles_with({{"d*r", cast}}), Are({cast, cast, full}));
    EXPECT_EQ(roles_with({{"fur", lights}}), Are({full, full, lights}));
    EXPECT_EQ(roles_with({{"mesh:[fl]*", receive}}), Are({receive, receive, receive}));
    EXPECT_EQ(roles_with({{"glass", receive}}), Are({full, receive, full}));
    EXPECT_EQ(roles_with({{"material:wo?d", receive}}), Are({receive, full, receive}));
    EXPECT_EQ(roles_with({{"extras:moves", receive}}), Are({full, full, receive}));
    EXPECT_EQ(roles_with({{"extras:moves=true", receive}}), Are({full, full, receive}));
    EXPECT_EQ(roles_with({{"extras:speed=2", receive}}), Are({full, full, receive}));
    EXPECT_EQ(roles_with({{"extras:lpv=pan*", receive}}), Are({full, receive, full}));
}

TEST_F(Roles, TheLastPatternThatFitsCounts) {
    EXPECT_EQ(roles_with({{"hall", cast}, {"glass", receive}}), Are({cast, receive, full}));
    EXPECT_EQ(roles_with({{"glass", receive}, {"hall", cast}}), Are({cast, cast, full}));
    EXPECT_EQ(roles_with({{"hall", cast}, {"door", receive}}), Are({receive, receive, full}));
    EXPECT_EQ(roles_with({{"glass", {}}, {"door", receive}}), Are({receive, full}));
}

TEST_F(Roles, WhatIsExcludedIsNotLoaded) {
    const Scene scene = with({{"hall", {}}});
    EXPECT_EQ(scene.instances.size(), 1u);
    EXPECT_EQ(scene.meshes.size(), 1u);
    EXPECT_TRUE(scene.lights.empty());
    EXPECT_EQ(bounds_of(scene).lo.x, 5);
    ASSERT_EQ(scene.file.nodes.size(), 1u);
    EXPECT_EQ(scene.file.nodes[0].name, "cat");
    EXPECT_EQ(scene.file.nodes[0].begin, 0u);
    EXPECT_EQ(with({{"material:glass", {}}}).lights.size(), 1u);
    EXPECT_EQ(with({{"material:glass", {}}}).materials.size(), 1u);
    EXPECT_EQ(with({{"mesh:leaf", {}}}).instances.size(), 1u);
}

TEST_F(Roles, APatternThatFitsNothingIsNamed) {
    for (const char* pattern : {"Door", "node:leaf", "mesh:door", "material:fur",
                                "extras:moves=false", "extras:gone", "extras:"}) {
        const Scene scene = with({{"cat", receive}, {pattern, cast}, {pattern, {}}});
        expect_warning(scene, std::string("`cast_only`: \"") + pattern + "\" fits no node");
        expect_warning(scene, std::string("`exclude`: \"") + pattern + "\"");
        EXPECT_EQ(scene.warnings.size(), 2u) << pattern;
    }
    LoadSettings strict;
    strict.strict = true;
    strict.roles = {{"Door", cast}};
    expect_error(house(), "\"Door\" fits no", ErrorKind::invalid, strict);
}

TEST_F(Roles, BoxesAreOfWhatIsAsked) {
    EXPECT_EQ(bounds_of(with({{"cat", cast}})).hi.x, 1);
    EXPECT_EQ(bounds_of(with({{"cat", lights}})).hi.x, 1);
    EXPECT_EQ(bounds_of(with({{"cat", receive}})).hi.x, 6);
    EXPECT_EQ(bounds_of(with({{"*", cast}})).hi.x, 6) << "nothing is asked";
    EXPECT_EQ(scene::trimmed_bounds(with({{"cat", cast}}), 0.01).hi.x, 1);
}

TEST_F(Roles, AreOfTheHash) {
    const std::string plain = scene::scene_hash(with({}));
    EXPECT_EQ(scene::scene_hash(with({})), plain);
    EXPECT_NE(scene::scene_hash(with({{"cat", cast}})), plain);
    EXPECT_NE(scene::scene_hash(with({{"cat", cast}})),
              scene::scene_hash(with({{"cat", receive}})));
}

TEST_F(Roles, NodesBoundVolumesByTheSamePatterns) {
    GltfDocument document = house();
    document.root["nodes"].push_back(
        {{"name", "hall box"},
         {"scale", {4, 2, 6}},
         {"rotation", {0, 0.6, 0, 0.8}},
         {"translation", {1, 2, 3}},
         {"extras", {{"volume", true}, {"priority", 3}, {"cell", 0.25}}}});
    document.root["nodes"][3]["children"] = {4};
    const auto boxes = [&](const std::string& pattern, std::vector<RoleRule> roles = {}) {
        LoadSettings settings;
        settings.boxes = pattern;
        settings.roles = std::move(roles);
        return load(document, settings).file.boxes;
    };
    EXPECT_TRUE(boxes("").empty());
    EXPECT_TRUE(boxes("nobody").empty());
    // Those that fit, not what is below them; an empty one is a unit cube.
    const std::vector<SceneFile::Box> halls = boxes("*hall*");
    ASSERT_EQ(halls.size(), 2u);
    EXPECT_EQ(halls[0].name, "hall");
    EXPECT_EQ(halls[1].lo, glm::dvec3(-0.5));
    EXPECT_EQ(halls[1].hi, glm::dvec3(0.5));
    EXPECT_EQ(halls[1].to_world[3], glm::dvec4(6, 2, 3, 1));
    EXPECT_FALSE(halls[0].priority);
    const std::vector<SceneFile::Box> of_extras = boxes("extras:volume=true");
    ASSERT_EQ(of_extras.size(), 1u);
    EXPECT_EQ(of_extras[0].priority, 3.0);
    EXPECT_EQ(of_extras[0].cell, 0.25);
    EXPECT_FALSE(of_extras[0].falloff);
    // Of a mesh its bounds; though it is left out of the scene.
    for (const std::vector<RoleRule>& left_out : {std::vector<RoleRule>{}, {{"door", {}}}}) {
        const std::vector<SceneFile::Box> of_mesh = boxes("mesh:leaf", left_out);
        ASSERT_EQ(of_mesh.size(), 1u);
        EXPECT_EQ(of_mesh[0].name, "door");
        EXPECT_EQ(of_mesh[0].lo, glm::dvec3(0));
        EXPECT_EQ(of_mesh[0].hi, glm::dvec3(1, 1, 0));
    }
}

} // namespace
} // namespace lpvbake
