// What of a scene counts for a box of it.
#include "scene/scene_hash.h"
#include "scene/surroundings.h"
#include "scenes.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

using scene::Surroundings;

/// Cubes of an edge of 1 m that stand along x, each of its own material and mesh, at these places.
Scene cubes_at(const std::vector<glm::dvec3>& places, glm::dvec3 size = glm::dvec3(1.0)) {
    Scene scene;
    for (const glm::dvec3 at : places) {
        const int material = scenes::add_material(scene, glm::vec3(0.5f));
        scenes::add_box(scene, material, at - size / 2.0, at + size / 2.0, scenes::Facing::outward);
    }
    return scene;
}

const Surroundings around{{glm::dvec3(0.0), glm::dvec3(10.0)}, 5.0};

/// Which instances count, by where they end towards +x.
std::vector<double> kept_x(const Scene& scene, const Surroundings& of = around) {
    const scene::Around counts(scene);
    std::vector<double> xs;
    for (const std::size_t i : counts(of))
        xs.push_back(counts.boxes()[i].hi.x);
    return xs;
}

TEST(Surroundings, AreWhatIsWithinReach) {
    const Scene scene =
        cubes_at({{5, 5, 5}, {15.4, 5, 5}, {15.6, 5, 5}, {16.6, 5, 5}, {-30, 5, 5}});
    const std::vector<double> kept = kept_x(scene);
    ASSERT_EQ(kept.size(), 2u);
    EXPECT_NEAR(kept[1], 15.9, 1e-5);
}

TEST(Surroundings, HaveWhatIsAsLargeAsItIsFar) {
    EXPECT_EQ(kept_x(cubes_at({{70, 5, 5}}, glm::dvec3(38.0))).size(), 0u); // 41 m away
    EXPECT_EQ(kept_x(cubes_at({{70, 5, 5}}, glm::dvec3(42.0))).size(), 1u); // 39 m away
}

TEST(Surroundings, HaveWhatEmitsAndWhatStandsInTheSunsWay) {
    Scene scene = cubes_at({{300, 5, 5}, {-300, 5, 5}, {-300, 305, 5}, {300, -295, 5}});
    EXPECT_EQ(kept_x(scene).size(), 0u);
    scene.materials[1].emission = glm::vec3(1.0f);
    EXPECT_EQ(kept_x(scene), (std::vector<double>{-299.5}));
    scene.materials[1].emission = glm::vec3(0.0f);
    Light sun;
    sun.direction = glm::normalize(glm::dvec3(1, -1, 0)); // from -x, high
    scene.lights.push_back(sun);
    EXPECT_EQ(kept_x(scene), (std::vector<double>{-299.5})); // the third: the fourth lies behind
    const scene::Around counts(scene);
    for (const std::size_t i : counts(around))
        EXPECT_GT(counts.boxes()[i].lo.y, 300.0);
    scene.lights.front().type = LightType::point; // has no way of its own
    EXPECT_EQ(kept_x(scene).size(), 0u);
}

TEST(Surroundings, AreASceneOfTheirOwn) {
    Scene scene = cubes_at({{-200, 5, 5}, {5, 5, 5}, {200, 5, 5}, {8, 5, 5}});
    for (int image = 0; image < 4; ++image) {
        scene.images.push_back({"", 1, 1, {uint8_t(image), 0, 0, 255}});
        scene.textures.push_back({image, Wrap::repeat, Wrap::repeat, false});
        scene.materials[std::size_t(image)].base_color_texture = image;
    }
    scene.file.nodes = {{"all", 0, 4}, {"far", 0, 1}};
    const Scene near = scene::within(scene, around);
    EXPECT_NO_THROW(scene::check_scene(near));
    EXPECT_EQ(near.materials.size(), 2u);
    EXPECT_EQ(near.images.size(), 2u);
    EXPECT_EQ(near.images[0].rgba[0], 1);
    EXPECT_EQ(near.images[1].rgba[0], 3);
    EXPECT_EQ(near.instances.size(), 2u);
    ASSERT_EQ(near.file.nodes.size(), 1u);
    EXPECT_EQ(near.file.nodes[0].end, 2u);

    // Its hash is that of the instances in the whole scene, and hears of no other.
    const auto hash_in = [](const Scene& whole) {
        return scene::scene_hash(scene::parts_of(whole), scene::Around(whole)(around));
    };
    EXPECT_EQ(hash_in(scene), scene::scene_hash(near));
    EXPECT_NE(scene::scene_hash(scene), scene::scene_hash(near));
    Scene edited = scene;
    edited.materials[0].base_color.x = 0.1f;
    edited.images[2].rgba[0] = 99;
    EXPECT_EQ(hash_in(edited), hash_in(scene));
    EXPECT_EQ(scene::scene_hash(scene::within(edited, around)), scene::scene_hash(near));
    edited.images[3].rgba[0] = 99;
    EXPECT_NE(hash_in(edited), hash_in(scene));
}

TEST(Surroundings, HaveATextOfTheirOwn) {
    const Surroundings given{{glm::dvec3(0.1, -2, 3), glm::dvec3(4, 5, 6.7)}, 8.25};
    const auto read = scene::parse_surroundings(scene::text_of(given));
    ASSERT_TRUE(read);
    EXPECT_EQ(read->box.lo, given.box.lo);
    EXPECT_EQ(read->box.hi, given.box.hi);
    EXPECT_EQ(read->reach, given.reach);
    EXPECT_FALSE(scene::parse_surroundings("8.25;0,1,2"));
    EXPECT_FALSE(scene::parse_surroundings(scene::text_of(given) + " "));
}

} // namespace
} // namespace lpvbake
