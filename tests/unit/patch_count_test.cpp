// What planning counts beside what is made.
#include "surface/patch_count.h"

#include "scenes.h"
#include "surface/patches.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

/// Counted over made; with what stands on surfaces, or by halving alone.
double ratio(const Scene& scene, const scene::Frame& cells, size_t most = 1 << 16,
             bool on_trial = true) {
    const visibility::Visibility visibility(scene, cells);
    const size_t made = surface::cover_surfaces(scene, cells, visibility, 1.0f).patches.size();
    const surface::CutTrial trial(scene);
    return surface::count_patches(surface::sample_triangles(scene, most), cells, 1.0f,
                                  on_trial ? &trial : nullptr)
               .patches
           / double(made);
}

scene::Frame around(glm::dvec3 lo, glm::dvec3 hi, double cell) {
    return {lo, cell, glm::ceil((hi - lo) / cell)};
}

TEST(PatchCount, CountsWhatIsMade) {
    std::mt19937 random(5);
    for (const double cell : {0.31, 0.1, 0.0417}) {
        Scene turned;
        const int white = scenes::add_material(turned, glm::vec3(0.5f));
        scenes::add_box(turned, white, {-1, -0.2f, -0.7f}, {1, 0.3f, 0.8f}, scenes::Facing::outward,
                        scenes::random_turn(random));
        scenes::add_quad(turned, white, {0, 0, 1.4f}, {0.02f, 0, 0}, {0, 0, 9});
        EXPECT_NEAR(ratio(turned, around({-1, -1, -1}, {1, 1, 1}, cell)), 1.0, 0.01) << cell;
        EXPECT_NEAR(ratio(turned, around({-0.4, -1, 0.1}, {1, 0.2, 1.9}, cell)), 1.0, 0.02) << cell;
    }
}

TEST(PatchCount, WhatStandsOnOthersMakesMore) {
    for (const double cell : {0.21, 0.1, 0.0417})
        EXPECT_NEAR(ratio(scenes::cornell_box(), around({-1.1, -0.1, -1.1}, {1.1, 2.1, 1.1}, cell)),
                    1.0, 0.05)
            << cell;
    // Many boxes on a plain, larger than the grid: most of the patches, and more than twice as many
    // as without them.
    Scene town = scenes::floor_quad(60.0f, glm::vec3(0.5f));
    std::mt19937 random(8);
    std::uniform_real_distribution<float> place(-25.0f, 25.0f), size(0.3f, 1.5f);
    for (int i = 0; i < 400; ++i) {
        const glm::vec3 half(size(random), size(random), size(random));
        scenes::add_box(
            town, 0, -half, half, scenes::Facing::outward,
            glm::translate(glm::dmat4(1.0), glm::dvec3(place(random), 0.2, place(random))));
    }
    const scene::Frame cells = around({-8, -1, -8}, {12, 3, 12}, 0.5);
    EXPECT_NEAR(ratio(town, cells), 1.0, 0.05);
    const auto count = [&](const surface::CutTrial* trial) {
        return surface::count_patches(surface::sample_triangles(town), cells, 1.0f, trial).patches;
    };
    const surface::CutTrial trial(town);
    EXPECT_GT(count(&trial), 2.0 * count(nullptr));
}

TEST(PatchCount, LampsMakeMore) {
    Scene scene = scenes::floor_quad(8.0f, glm::vec3(0.5f));
    const int glow = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(100.0f));
    for (int i = 0; i < 6; ++i)
        scenes::add_quad(scene, glow, {float(i) - 3.0f, 0.02f, 0.3f}, {0.5f, 0, 0}, {0, 0, 0.6f});
    EXPECT_NEAR(ratio(scene, around({-4, -1, -4}, {4, 3, 4}, 0.25)), 1.0, 0.05);
    EXPECT_NEAR(ratio(scene, around({-1, -1, -1}, {2, 1, 1}, 0.1)), 1.0, 0.05);
}

TEST(PatchCount, WhatHasNoAreaInTheGridsUnitsIsNone) {
    Scene scene = scenes::floor_quad(8.0f, glm::vec3(0.5f));
    Mesh& mesh = scene.meshes.front();
    const uint32_t first = uint32_t(mesh.positions.size());
    for (const float x : {0.0f, 1e-7f, 2e-7f}) // a triangle of these is one in metres
        mesh.positions.push_back({3.0f + x, 0.1f, 3.0f + x * x * 1e6f});
    mesh.triangles.push_back({first, first + 1, first + 2});
    EXPECT_NEAR(ratio(scene, around({-4, -1, -4}, {4, 3, 4}, 0.25)), 1.0, 0.01);
}

TEST(PatchCount, FarSurfacesHaveLargePatches) {
    for (const float edge : {20.0f, 200.0f, 2000.0f, 20000.0f}) {
        Scene scene = scenes::floor_quad(edge, glm::vec3(0.5f));
        const scene::Frame cells = around({-2, -0.5, -2}, {2, 3, 2}, 0.25);
        EXPECT_NEAR(ratio(scene, cells), 1.0, 0.02) << edge;
        const surface::PatchCount count =
            surface::count_patches(surface::sample_triangles(scene), cells, 1.0f);
        EXPECT_LT(count.patches, 40'000.0);
        EXPECT_NEAR(count.inside, 256.0, 16.0);
    }
}

TEST(PatchCount, ASampleStandsForAll) {
    // A plain, walls, and grass on a part of it.
    Scene scene = scenes::floor_quad(3000.0f, glm::vec3(0.5f));
    for (int i = 0; i < 12; ++i)
        scenes::add_box(scene, 0, {-1, 0, -1}, {1, 6, 1}, scenes::Facing::outward,
                        glm::translate(glm::dmat4(1.0), glm::dvec3(3 * i - 18, 0, i % 3)));
    Mesh grass;
    std::mt19937 random(3);
    std::uniform_real_distribution<float> place(-20.0f, 20.0f);
    for (uint32_t i = 0; i < 40'000; ++i) {
        const glm::vec3 at(place(random), 0.01f, place(random));
        for (const glm::vec3& more : {glm::vec3(0), {0.1f, 0.05f, 0}, {0, 0.3f, 0.1f}})
            grass.positions.push_back(at + more);
        grass.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    }
    scene.instances.push_back({int(scene.meshes.size()), glm::dmat4(1.0)});
    scene.meshes.push_back(grass);
    const scene::Frame cells = around({-20, -0.5, -20}, {20, 8, 20}, 0.6);
    EXPECT_LT(surface::sample_triangles(scene, 2000).triangles.size(), 2001u);
    EXPECT_NEAR(ratio(scene, cells, 2000, false), ratio(scene, cells, 1 << 16, false), 0.04);
}

TEST(PatchCount, IsCheapWhereThereAreMany) {
    // Two hundred million patches, which nobody makes.
    const Scene scene = scenes::furnace(8.0f, 0.5f, 1.0f);
    const auto begin = std::chrono::steady_clock::now();
    const surface::PatchCount count =
        surface::count_patches(surface::sample_triangles(scene),
                               around(glm::dvec3(-0.01), glm::dvec3(8.01), 8.0 / 4001), 1.0f);
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
    EXPECT_NEAR(count.inside / (6 * 4001.0 * 4001.0), 1.0, 1e-4);
    EXPECT_GT(count.patches, 2.0 * count.inside);
    EXPECT_LT(count.patches, 8.0 * count.inside);
}

} // namespace
} // namespace lpvbake
