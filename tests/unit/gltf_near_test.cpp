// Files of which what counts for boxes is decoded: within() takes of them what it takes of all.
#include "scene/gltf/near.h"
#include "scene/scene_hash.h"
#include "unit/gltf_document.h"

#include <random>

namespace lpvbake {
namespace {

using nlohmann::json;
using scene::Surroundings;
using scene::gltf::Near;

class GltfNear : public Gltf {
protected:
    /// A mesh of one triangle of its own, between `at` and `at` + `size`, of a material with a
    /// picture of its own.
    int mesh(glm::vec3 at, float size, const json& material = json::object()) {
        const json position = document_.accessor<float>(
            {at.x, at.y, at.z, at.x + size, at.y, at.z, at.x, at.y + size, at.z + size}, real,
            "VEC3");
        const int uv = document_.accessor<float>({0.25f, 0.5f, 0.75f, 0.5f, 1, 1}, real, "VEC2");
        document_.append("images", {{"uri", png}, {"name", std::to_string(++count_)}});
        const int texture = document_.append("textures", {{"source", count_ - 1}});
        json own{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", texture}}}}}};
        own.merge_patch(material);
        return document_.append("meshes",
                                {{"name", std::to_string(count_)},
                                 {"primitives",
                                  {{{"attributes", {{"POSITION", position}, {"TEXCOORD_0", uv}}},
                                    {"material", document_.append("materials", own)}}}}});
    }
    void place(int mesh, glm::vec3 at = glm::vec3(0)) {
        document_.place({{"mesh", mesh}, {"translation", {at.x, at.y, at.z}}});
    }
    /// As rows of a world have them.
    Scene whole() { return lit(load(document_)); }
    Scene decoded_for(const std::vector<Surroundings>& boxes) {
        load(document_); // writes it
        return lit(scene::gltf::load_near(path_, {}, {boxes, scene::directions_of(suns_)}));
    }
    void expect_alike(const std::vector<Surroundings>& boxes) {
        const Scene all = whole(), some = decoded_for(boxes);
        ASSERT_EQ(all.meshes.size(), some.meshes.size());
        for (const Surroundings& box : boxes) {
            const Scene a = scene::within(all, box), b = scene::within(some, box);
            EXPECT_EQ(scene::scene_hash(a), scene::scene_hash(b));
            ASSERT_EQ(a.meshes.size(), b.meshes.size());
            for (std::size_t i = 0; i < a.meshes.size(); ++i) {
                EXPECT_EQ(a.meshes[i].name, b.meshes[i].name);
                EXPECT_EQ(a.meshes[i].positions, b.meshes[i].positions);
                EXPECT_EQ(a.meshes[i].uv, b.meshes[i].uv);
                EXPECT_EQ(a.meshes[i].triangles, b.meshes[i].triangles);
                EXPECT_EQ(a.meshes[i].material, b.meshes[i].material);
            }
            ASSERT_EQ(a.images.size(), b.images.size());
            for (std::size_t i = 0; i < a.images.size(); ++i) {
                EXPECT_EQ(a.images[i].name, b.images[i].name);
                EXPECT_EQ(a.images[i].rgba, b.images[i].rgba);
            }
            ASSERT_EQ(a.textures.size(), b.textures.size());
            for (std::size_t i = 0; i < a.textures.size(); ++i)
                EXPECT_EQ(a.textures[i].image, b.textures[i].image);
            ASSERT_EQ(a.materials.size(), b.materials.size());
            for (std::size_t i = 0; i < a.materials.size(); ++i)
                EXPECT_EQ(a.materials[i].base_color_texture, b.materials[i].base_color_texture);
        }
    }
    /// Names of the meshes that are decoded.
    static std::vector<std::string> decoded(const Scene& scene) {
        std::vector<std::string> names;
        for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
            const Mesh& mesh = scene.meshes[i];
            if (!mesh.triangles.empty())
                names.push_back(mesh.name);
            const Material& material = scene.materials[std::size_t(mesh.material)];
            const Image& image = scene.images[std::size_t(
                scene.textures[std::size_t(material.base_color_texture)].image)];
            EXPECT_EQ(image.rgba.empty(), mesh.triangles.empty()) << mesh.name;
            EXPECT_EQ(image.width, 2);
        }
        return names;
    }

    GltfDocument document_;
    std::vector<Light> suns_;

private:
    Scene lit(Scene scene) const {
        scene.lights.insert(scene.lights.end(), suns_.begin(), suns_.end());
        return scene;
    }
    int count_ = 0;
};

const Surroundings around{{glm::dvec3(0.0), glm::dvec3(10.0)}, 5.0};

TEST_F(GltfNear, WhatCountsIsDecodedAndNothingElse) {
    Light sun;
    sun.type = LightType::directional;
    sun.direction = glm::normalize(glm::dvec3(1, -1, 0)); // from -x, high
    suns_.push_back(sun);
    place(mesh({100, 5, 50}, 1)); // 1: far
    place(mesh({5, 5, 5}, 1));    // 2
    const int shared = mesh({0, 0, 0}, 1);
    place(shared, {4, 4, 4});                                      // 3: both near
    place(shared, {400, 4, 4});                                    // and far
    place(mesh({300, 5, 50}, 1, {{"emissiveFactor", {1, 0, 0}}})); // 4: glows
    place(mesh({300, 5, 100}, 400));                               // 5: large
    place(mesh({-300, 305, 5}, 1));                                // 6: in the sun's way
    place(mesh({300, -295, 5}, 1));                                // 7: behind
    const int lying = mesh({6, 6, 6}, 1);
    place(lying); // 8: near, though its accessor says otherwise
    const int accessor = document_.root["meshes"][lying]["primitives"][0]["attributes"]["POSITION"];
    document_.root["accessors"][accessor]["min"] = {900, 900, 900};
    document_.root["accessors"][accessor]["max"] = {901, 901, 901};
    const int morphed = mesh({100, 5, 80}, 1);
    place(morphed); // 9: nobody knows
    document_.root["meshes"][morphed]["weights"] = {0.5};
    document_.root["meshes"][morphed]["primitives"][0]["targets"] = {
        {{"POSITION", document_.accessor<float>(std::vector<float>(9, 1), real, "VEC3")}}};
    place(mesh({-500, 5, 90}, 1)); // 10: far
    expect_alike({around});
    EXPECT_EQ(decoded(decoded_for({around})),
              (std::vector<std::string>{"2", "3", "4", "5", "6", "8", "9"}));
    suns_.clear();
    EXPECT_EQ(decoded(decoded_for({around})),
              (std::vector<std::string>{"2", "3", "4", "5", "8", "9"}));
    // Of a strict scene all is.
    EXPECT_EQ(decoded(scene::gltf::load_near(path_, {.strict = true}, {{around}, {}})).size(), 10u);
}

TEST_F(GltfNear, ManyBoxesOfManyMeshes) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> place_in(-200, 200), size_in(0.5f, 60);
    for (int i = 0; i < 40; ++i) {
        const int own =
            mesh({place_in(random), place_in(random), place_in(random)}, size_in(random));
        for (int k = 0; k < 1 + i % 3; ++k)
            document_.place(
                {{"mesh", own},
                 {"translation", {place_in(random), place_in(random), place_in(random)}},
                 {"rotation", {0.5, 0.5, 0.5, 0.5}},
                 {"scale", {1, 2, 0.5}}});
    }
    Light sun;
    sun.type = LightType::directional;
    sun.direction = glm::normalize(glm::dvec3(0.2, -1, 0.1));
    suns_.push_back(sun);
    std::vector<Surroundings> boxes;
    for (int i = 0; i < 40; ++i) {
        const glm::dvec3 at(place_in(random), place_in(random), place_in(random));
        boxes.push_back({{at, at + 16.0}, 8.0});
        expect_alike({boxes.back()});
    }
    expect_alike(boxes);
    EXPECT_LT(decoded(decoded_for({boxes.front()})).size(), 25u);
    EXPECT_GT(decoded(decoded_for(boxes)).size(), decoded(decoded_for({boxes.front()})).size());
}

} // namespace
} // namespace lpvbake
