#include "colour/colour.h"
#include "scene/frame.h"
#include "scene/material.h"
#include "scene/scene.h"
#include "scenes.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace lpvbake {
namespace {

constexpr double pi = 3.14159265358979323846;

Scene one_quad(const glm::dmat4& to_world) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_quad(scene, material, {0, 0, 0}, {1, 0, 0}, {0, 2, 0}, to_world);
    return scene;
}

/// Adds a texture of one row of texels, given as r, g, b, a bytes.
int add_row_texture(Scene& scene, std::vector<uint8_t> rgba, Wrap wrap, bool nearest) {
    const int width = static_cast<int>(rgba.size() / 4);
    scene.images.push_back({"row", width, 1, std::move(rgba)});
    const int image = static_cast<int>(scene.images.size()) - 1;
    scene.textures.push_back({image, wrap, wrap, nearest});
    return static_cast<int>(scene.textures.size()) - 1;
}

/// Volume that a closed surface encloses by the divergence theorem; negative if its fronts face in.
double signed_volume(const Mesh& mesh) {
    double volume = 0.0;
    for (const glm::uvec3 t : mesh.triangles)
        volume +=
            glm::dot(glm::dvec3(mesh.positions[t.x]),
                     glm::cross(glm::dvec3(mesh.positions[t.y]), glm::dvec3(mesh.positions[t.z])))
            / 6.0;
    return volume;
}

TEST(Bounds, OfATurnedMirroredQuadFarAway) {
    // x -> -3x, turned by 90 degrees about z: corners (0,0) (-3,0) (0,2) (-3,2) -> (-y, x).
    const glm::dmat4 to_world =
        glm::scale(glm::rotate(glm::translate(glm::dmat4(1.0), glm::dvec3(1e6, -2e6, 5.0)), pi / 2,
                               glm::dvec3(0, 0, 1)),
                   glm::dvec3(-3, 1, 1));
    const Bounds bounds = bounds_of(one_quad(to_world));
    EXPECT_NEAR(bounds.lo.x, 1e6 - 2, 1e-8);
    EXPECT_NEAR(bounds.hi.x, 1e6, 1e-8);
    EXPECT_NEAR(bounds.lo.y, -2e6 - 3, 1e-8);
    EXPECT_NEAR(bounds.hi.y, -2e6, 1e-8);
    EXPECT_NEAR(bounds.lo.z, 5, 1e-8);
    EXPECT_NEAR(bounds.hi.z, 5, 1e-8);
}

TEST(Bounds, IgnoreVerticesThatNoTriangleUsesAndMeshesThatAreNotPlaced) {
    Scene scene = one_quad(glm::dmat4(1.0));
    scene.meshes[0].positions.push_back({100, 100, 100});
    scenes::add_quad(scene, 0, {50, 0, 0}, {1, 0, 0}, {0, 1, 0});
    scene.instances.pop_back();
    EXPECT_EQ(bounds_of(scene).hi, glm::dvec3(1, 2, 0));
    scene.instances.clear();
    EXPECT_TRUE(bounds_of(scene).empty());
}

TEST(TriangleCount, CountsEveryPlacement) {
    Scene scene = one_quad(glm::dmat4(1.0));
    scene.instances.push_back({0, glm::dmat4(2.0)});
    scene.instances.push_back({0, glm::dmat4(3.0)});
    EXPECT_EQ(scene::triangle_count(scene), 6u);
}

TEST(HasEmitters, AsksForLightThatIsThere) {
    Scene scene = one_quad(glm::dmat4(1.0));
    EXPECT_FALSE(scene::has_emitters(scene));
    scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(10.0f)); // nothing is made of it
    EXPECT_FALSE(scene::has_emitters(scene));
    Material& material = scene.materials[scene.meshes[0].material];
    material.emission = {0, 5, 0};
    EXPECT_TRUE(scene::has_emitters(scene));
    material.emission_texture =
        add_row_texture(scene, {255, 0, 255, 255}, Wrap::repeat, false); // no green
    EXPECT_FALSE(scene::has_emitters(scene));
    scene.images[0].rgba[1] = 1;
    EXPECT_TRUE(scene::has_emitters(scene));
    scene.instances.clear();
    EXPECT_FALSE(scene::has_emitters(scene));
}

TEST(Frame, GoesThereAndBack) {
    const scene::Frame frame{{1e6, -3, 2}, 0.25, {32, 16, 8}};
    const glm::dvec3 p(1e6 + 1.5, 0, 7);
    EXPECT_EQ(frame.from_world(p), glm::dvec3(6, 12, 20));
    EXPECT_EQ(frame.to_world(frame.from_world(p)), p);
}

TEST(Frame, KeepsPrecisionFarFromTheOriginAndInTinyScenes) {
    for (const double size : {1e-4, 1.0, 1e6})
        for (const double far : {0.0, 1e4, 1e6}) {
            const glm::dvec3 corner = glm::dvec3(far * size);
            Scene scene;
            scenes::add_material(scene, glm::vec3(0.5f));
            scenes::add_quad(scene, 0, {0.25f, 0.5f, 0.75f}, {1, 0, 0}, {0, 1, 0},
                             glm::scale(glm::translate(glm::dmat4(1.0), corner), glm::dvec3(size)));
            const scene::Frame frame{corner, size / 32, glm::dvec3(32)};
            const std::vector<glm::vec3> p =
                scene::positions_in_frame(scene, scene.instances[0], frame);
            ASSERT_EQ(p.size(), 4u);
            EXPECT_LT(glm::distance(p[0], glm::vec3(8, 16, 24)), 1e-5f) << size << " " << far;
            EXPECT_LT(glm::distance(p[2], glm::vec3(40, 48, 24)), 1e-5f) << size << " " << far;
        }
}

TEST(Frame, IsMirroredBySignOfTheDeterminant) {
    const auto scaled = [](glm::dvec3 s) { return Instance{0, glm::scale(glm::dmat4(1.0), s)}; };
    EXPECT_FALSE(scene::is_mirrored(scaled({1, 2, 3})));
    EXPECT_TRUE(scene::is_mirrored(scaled({-1, 2, 3})));
    EXPECT_FALSE(scene::is_mirrored(scaled({-1, -2, 3})));
    EXPECT_TRUE(scene::is_mirrored(scaled({-1, -2, -3})));
    EXPECT_TRUE(scene::is_mirrored(scaled({-1e-6, 1e-6, 1e-6})));
}

TEST(Srgb, UndoesTheEncodingOfTheStandard) {
    for (int i = 0; i <= 1000; ++i) {
        const double linear = i / 1000.0;
        const double encoded =
            linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
        EXPECT_NEAR(colour::srgb_to_linear(encoded), linear, 1e-6);
    }
    EXPECT_EQ(colour::srgb_to_linear(1.0), 1.0);
}

TEST(SampleTexture, LinearisesBeforeItBlends) {
    Scene scene;
    const int texture =
        add_row_texture(scene, {0, 0, 0, 0, 255, 128, 0, 255}, Wrap::clamp_to_edge, false);
    const glm::vec4 middle = scene::sample_texture(scene, texture, {0.5f, 0.5f});
    EXPECT_FLOAT_EQ(middle.r, 0.5f);
    EXPECT_NEAR(middle.g, 0.5 * colour::srgb_to_linear(128 / 255.0), 1e-6);
    EXPECT_FLOAT_EQ(middle.a, 0.5f);
    EXPECT_FLOAT_EQ(scene::sample_texture(scene, texture, {0.25f, 0.0f}).r,
                    0.0f); // centre of texel 0
    EXPECT_FLOAT_EQ(scene::sample_texture(scene, texture, {0.75f, 1.0f}).r,
                    1.0f); // centre of texel 1
    EXPECT_FLOAT_EQ(scene::sample_texture(scene, texture, {-7.0f, 0.5f}).r, 0.0f);
    EXPECT_FLOAT_EQ(scene::sample_texture(scene, texture, {7.0f, 0.5f}).r, 1.0f);
}

TEST(SampleTexture, RowsRunDownwards) {
    Scene scene;
    scene.images.push_back({"column", 1, 2, {255, 255, 255, 255, 0, 0, 0, 255}});
    scene.textures.push_back({0, Wrap::clamp_to_edge, Wrap::clamp_to_edge, false});
    EXPECT_FLOAT_EQ(scene::sample_texture(scene, 0, {0.5f, 0.25f}).r, 1.0f);
    EXPECT_FLOAT_EQ(scene::sample_texture(scene, 0, {0.5f, 0.75f}).r, 0.0f);
}

/// The texel that an endless row shows at `i`, found by walking there step by step.
int texel_by_walking(int i, int size, Wrap wrap) {
    int position = 0, step = 1;
    for (int k = 0; k < std::abs(i); ++k) {
        const int next = position + (i > 0 ? step : -step);
        if (next >= 0 && next < size)
            position = next;
        else if (wrap == Wrap::repeat)
            position = next < 0 ? size - 1 : 0;
        else if (wrap == Wrap::mirrored_repeat)
            step = -step; // the edge texel comes twice
    }
    return position;
}

TEST(SampleTexture, WrapsAsAnEndlessRowOfTexels) {
    for (const Wrap wrap : {Wrap::repeat, Wrap::mirrored_repeat, Wrap::clamp_to_edge}) {
        Scene scene;
        const std::vector<uint8_t> row = {0, 0,  0, 10, 0, 0,
                                          0, 60, 0, 0,  0, 200}; // alpha is linear
        const int smooth = add_row_texture(scene, row, wrap, false);
        const int nearest = add_row_texture(scene, row, wrap, true);
        const auto value = [&](int i) { return row[4 * texel_by_walking(i, 3, wrap) + 3] / 255.0; };
        for (int i = -10; i <= 10; ++i)
            for (const double share : {0.1, 0.4, 0.7}) {
                const auto u = static_cast<float>((i + 0.5 + share) / 3.0);
                const double blend = (1 - share) * value(i) + share * value(i + 1);
                EXPECT_NEAR(scene::sample_texture(scene, smooth, {u, 0.5f}).a, blend, 1e-5)
                    << "wrap " << static_cast<int>(wrap) << " at " << i << " + " << share;
                EXPECT_NEAR(scene::sample_texture(scene, nearest, {u, 0.5f}).a,
                            value(i + (share > 0.5 ? 1 : 0)), 1e-6);
            }
    }
}

TEST(SampleTexture, SurvivesAnyCoordinate) {
    for (const Wrap wrap : {Wrap::repeat, Wrap::mirrored_repeat, Wrap::clamp_to_edge})
        for (const bool nearest : {false, true}) {
            Scene scene;
            const int texture = add_row_texture(scene, {9, 9, 9, 255, 9, 9, 9, 255}, wrap, nearest);
            for (const float u :
                 {1e30f, -1e30f, 16777217.0f, -1e-30f, 1.0f, 0.0f, -0.0f,
                  std::nextafter(1.0f, 0.0f), std::nextafter(2.0f, 0.0f),
                  std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()})
                EXPECT_FLOAT_EQ(scene::sample_texture(scene, texture, {u, u}).a, 1.0f);
        }
}

TEST(SampleSurface, MultipliesFactorTextureAndVertexColour) {
    Scene scene = one_quad(glm::dmat4(1.0));
    Material& material = scene.materials[0];
    material.base_color = {0.8f, 0.5f, 0.25f, 1.0f};
    material.base_color_texture = add_row_texture(scene, {255, 255, 128, 255}, Wrap::repeat, false);
    Mesh& mesh = scene.meshes[0];
    mesh.colors = {{1, 0, 1, 1}, {1, 1, 1, 1}, {1, 0.5f, 1, 1}, {1, 1, 1, 1}};
    const scene::SurfaceSample sample = scene::sample_surface(scene, mesh, 0, {0.25f, 0.5f});
    EXPECT_FLOAT_EQ(sample.albedo.r, 0.8f);
    EXPECT_FLOAT_EQ(sample.albedo.g, 0.5f * 0.5f); // 0.25 * 0 + 0.25 * 1 + 0.5 * 0.5
    EXPECT_NEAR(sample.albedo.b, 0.25 * colour::srgb_to_linear(128 / 255.0), 1e-6);
    EXPECT_EQ(sample.alpha, 1.0f);
}

TEST(SampleSurface, ClampsReflectance) {
    Scene scene = one_quad(glm::dmat4(1.0));
    scene.materials[0].base_color = {2.0f, 1.0f, 0.5f, 1.0f};
    scene.rules.max_albedo = 0.9f;
    const scene::SurfaceSample sample =
        scene::sample_surface(scene, scene.meshes[0], 1, {0.2f, 0.2f});
    EXPECT_EQ(sample.albedo, glm::vec3(0.9f, 0.9f, 0.5f));
}

TEST(SampleSurface, TakesAlphaByTheMode) {
    Scene scene = one_quad(glm::dmat4(1.0));
    Material& material = scene.materials[0];
    material.base_color.a = 0.4f;
    const auto alpha = [&](AlphaMode mode) {
        material.alpha_mode = mode;
        return scene::sample_surface(scene, scene.meshes[0], 0, {0.2f, 0.2f}).alpha;
    };
    EXPECT_EQ(alpha(AlphaMode::opaque), 1.0f);
    EXPECT_EQ(alpha(AlphaMode::blend), 0.4f);
    EXPECT_EQ(alpha(AlphaMode::mask), 0.0f);
    material.alpha_cutoff = 0.4f; // covered from the cutoff on
    EXPECT_EQ(alpha(AlphaMode::mask), 1.0f);
}

TEST(SampleEmission, IsTexturedAndCovered) {
    Scene scene = one_quad(glm::dmat4(1.0));
    Material& material = scene.materials[0];
    material.emission = {100, 200, 0};
    material.emission_texture = add_row_texture(scene, {255, 0, 255, 7}, Wrap::repeat, false);
    const auto emission = [&] {
        return scene::sample_emission(scene, scene.meshes[0], 0, {0.2f, 0.2f});
    };
    EXPECT_EQ(emission(), glm::vec3(100, 0, 0));
    material.base_color.a = 0.25f;
    EXPECT_EQ(emission(), glm::vec3(100, 0, 0));
    material.alpha_mode = AlphaMode::blend;
    EXPECT_EQ(emission(), glm::vec3(25, 0, 0));
    material.alpha_mode = AlphaMode::mask;
    EXPECT_EQ(emission(), glm::vec3(0.0f));
}

TEST(IsSeeThrough, ForMaskBlendAndCulledBacks) {
    Scene scene;
    Material material;
    EXPECT_FALSE(scene::is_see_through(scene, material));
    scene.rules.cull_backfaces = true;
    EXPECT_TRUE(scene::is_see_through(scene, material));
    material.double_sided = true;
    EXPECT_FALSE(scene::is_see_through(scene, material));
    material.alpha_mode = AlphaMode::mask;
    EXPECT_TRUE(scene::is_see_through(scene, material));
    material.alpha_mode = AlphaMode::blend;
    EXPECT_TRUE(scene::is_see_through(scene, material));
}

TEST(Scenes, BoxesFaceAsTheySay) {
    Scene scene;
    scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_box(scene, 0, {1, 2, 3}, {2, 4, 6}, scenes::Facing::outward);
    scenes::add_box(scene, 0, {1, 2, 3}, {2, 4, 6}, scenes::Facing::inward);
    EXPECT_NEAR(signed_volume(scene.meshes[0]), 6.0, 1e-5);
    EXPECT_NEAR(signed_volume(scene.meshes[1]), -6.0, 1e-5);
    for (const Mesh& mesh : scene.meshes)
        for (const glm::uvec3 t : mesh.triangles) {
            const glm::vec3 normal =
                glm::normalize(glm::cross(mesh.positions[t.y] - mesh.positions[t.x],
                                          mesh.positions[t.z] - mesh.positions[t.x]));
            EXPECT_LT(glm::distance(normal, mesh.normals[t.x]), 1e-6f);
        }
}

TEST(Scenes, FurnaceIsClosedAndGlows) {
    const Scene furnace = scenes::furnace(2.0f, 0.5f, 3.0f);
    EXPECT_NEAR(signed_volume(furnace.meshes[0]), -8.0, 1e-5);
    EXPECT_TRUE(scene::has_emitters(furnace));
    EXPECT_EQ(scene::triangle_count(furnace), 12u);
}

TEST(TrimmedBounds, LeaveTheFewOut) {
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    for (int i = 0; i < 100; ++i)
        scenes::add_quad(scene, material, {float(i), 0, 0}, {1, 0, 0}, {0, 1, 0});
    const Bounds all = scene::trimmed_bounds(scene, 0.0);
    EXPECT_EQ(all.lo, glm::dvec3(0.0));
    EXPECT_NEAR(all.hi.x, 100.0, 1e-9);
    // One quad far off to each side: 4 triangles of 204.
    scenes::add_quad(scene, material, {-1000, 0, 0}, {1, 0, 0}, {0, 1, 0});
    scenes::add_quad(scene, material, {3000, 0, 0}, {1, 0, 0}, {0, 1, 0});
    const Bounds trimmed = scene::trimmed_bounds(scene, 0.01);
    EXPECT_NEAR(trimmed.lo.x, 0.0, 4.0);
    EXPECT_NEAR(trimmed.hi.x, 100.0, 4.0);
    EXPECT_NEAR(trimmed.hi.y, 1.0, 1e-9);
    EXPECT_EQ(trimmed.hi.z, 0.0);
    EXPECT_TRUE(scene::trimmed_bounds(Scene{}, 0.01).empty());
}

} // namespace
} // namespace lpvbake
