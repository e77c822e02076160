#include "surface/elements.h"

#include "scenes.h"
#include "surface/lit_surfaces.h"
#include "visibility/visibility.h"

#include <gtest/gtest.h>

#include <map>

namespace lpvbake {
namespace {

const scene::Frame frame{glm::dvec3(0.0), 1.0, glm::dvec3(8.0)};

/// A square of 8 m, of n x n quads, `bump` of their edge off the plane at random; faces up.
void add_fine_floor(Scene& scene, int n, float y, float bump = 0.0f) {
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    const int index = scenes::add_quad(scene, material, {0, y, 0}, {0, 0, 8}, {8, 0, 0});
    Mesh& mesh = scene.meshes[size_t(index)];
    mesh = {};
    mesh.material = material;
    std::mt19937 random(5);
    std::uniform_real_distribution<float> off(-bump, bump);
    const float edge = 8.0f / float(n);
    for (int z = 0; z <= n; ++z)
        for (int x = 0; x <= n; ++x)
            mesh.positions.push_back({edge * float(x), y + edge * off(random), edge * float(z)});
    const auto at = [&](int x, int z) { return uint32_t(z * (n + 1) + x); };
    for (int z = 0; z < n; ++z)
        for (int x = 0; x < n; ++x) {
            mesh.triangles.push_back({at(x, z), at(x, z + 1), at(x + 1, z)});
            mesh.triangles.push_back({at(x + 1, z), at(x, z + 1), at(x + 1, z + 1)});
        }
}

surface::Elements elements_of(const Scene& scene, std::vector<surface::Patch>& patches) {
    const visibility::Visibility visibility(scene, frame);
    patches = surface::cover_surfaces(scene, frame, visibility, 1.0f).patches;
    return surface::group_sides(patches, visibility, glm::vec3(frame.extent));
}

size_t count_of(const Scene& scene) {
    std::vector<surface::Patch> patches;
    return elements_of(scene, patches).size();
}

/// Of the fronts that are seen.
glm::dvec3 mean_luminance(const Scene& scene) {
    Progress silent;
    const visibility::Visibility visibility(scene, frame);
    surface::LightingSettings settings;
    settings.bounces.reset();
    const surface::LitSurfaces lit =
        surface::light_surfaces(scene, visibility, frame, settings, silent);
    glm::dvec3 sum{0.0};
    double area = 0.0;
    for (size_t i = 0; i < lit.patches.size(); ++i) {
        sum += double(lit.patches[i].area) * glm::dvec3(lit.luminance[2 * i]);
        area += double(lit.patches[i].area);
    }
    return sum / area;
}

TEST(Elements, HoldEverySideThatReflectsOnce) {
    Scene scene = scenes::cornell_box();
    scene.materials.back().double_sided = true;
    scene.materials[0].base_color = glm::vec4(0, 0, 0, 1);
    const scene::Frame cells{glm::dvec3(-1.1, -0.1, -1.1), 0.1, glm::dvec3(22.0)};
    const visibility::Visibility visibility(scene, cells);
    const auto patches = surface::cover_surfaces(scene, cells, visibility, 1.0f).patches;
    const surface::Elements elements =
        surface::group_sides(patches, visibility, glm::vec3(cells.extent));
    std::vector<int> held(2 * patches.size(), 0);
    for (size_t e = 0; e < elements.size(); ++e)
        for (const uint32_t side : elements.members_of(e)) {
            EXPECT_EQ(elements.of_side[side], e);
            ++held[side];
        }
    for (size_t side = 0; side < held.size(); ++side) {
        const surface::Patch& patch = patches[side / 2];
        EXPECT_EQ(held[side],
                  patch.albedo != glm::vec3(0.0f) && (side % 2 == 0 || patch.double_sided));
    }
}

TEST(Elements, ArePickedByArea) {
    Scene scene;
    add_fine_floor(scene, 24, 2.0f, 0.3f);
    std::vector<surface::Patch> patches;
    const surface::Elements elements = elements_of(scene, patches);
    size_t largest = 0;
    for (size_t e = 0; e < elements.size(); ++e)
        if (elements.members_of(e).size() > elements.members_of(largest).size())
            largest = e;
    ASSERT_GT(elements.members_of(largest).size(), 8u);
    std::map<uint32_t, int> picked;
    std::map<uint32_t, double> rest;
    constexpr int tries = 100000;
    for (int i = 0; i < tries; ++i) {
        const auto pick = elements.pick(largest, (float(i) + 0.5f) / tries);
        ++picked[pick.side];
        rest[pick.side] += double(pick.rest);
    }
    double area = 0.0;
    for (const uint32_t side : elements.members_of(largest))
        area += surface::covered_area(patches[side / 2]);
    for (const uint32_t side : elements.members_of(largest)) {
        EXPECT_NEAR(picked[side], tries * surface::covered_area(patches[side / 2]) / area, 2.0);
        EXPECT_NEAR(rest[side] / picked[side], 0.5, 1e-2);
    }
}

TEST(Elements, CostWhatTheGridShowsAndNotWhatAMeshIsMadeOf) {
    std::vector<size_t> counts;
    for (const int n : {16, 64, 256}) {
        Scene scene;
        add_fine_floor(scene, n, 2.0f, 0.1f);
        counts.push_back(count_of(scene));
    }
    EXPECT_LE(counts[2], 2u * 9u * 9u);
    EXPECT_LT(double(counts[2]), 1.5 * double(counts[0]));
    EXPECT_LT(double(counts[2]), 1.5 * double(counts[1]));
}

TEST(Elements, NoSheetNorWallPartsThem) {
    // Shelves an eighth of a cell apart, seen from both sides, and a wall that stands on the upper.
    Scene scene;
    add_fine_floor(scene, 16, 2.0f);
    add_fine_floor(scene, 16, 2.125f);
    for (Material& material : scene.materials)
        material.double_sided = true;
    const int white = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, white, {3.3f, 2.125f, 0}, {0, 2, 0}, {0, 0, 8});
    std::vector<surface::Patch> patches;
    const surface::Elements elements = elements_of(scene, patches);
    for (size_t e = 0; e < elements.size(); ++e) {
        const std::span<const uint32_t> members = elements.members_of(e);
        const surface::Patch& first = patches[members[0] / 2];
        for (const uint32_t side : members) {
            const surface::Patch& patch = patches[side / 2];
            EXPECT_EQ(side % 2, members[0] % 2);
            EXPECT_EQ(patch.instance, first.instance);
            const bool on_top = patch.instance == 1 && side % 2 == 0;
            EXPECT_TRUE(!on_top || (patch.position.x > 3.3f) == (first.position.x > 3.3f));
        }
    }
}

TEST(Elements, WhatIsHiddenIsNotMixedWithWhatHidesIt) {
    // Two closed rooms, each with a wall of its own in the plane between them.
    const auto rooms = [](std::initializer_list<glm::vec3> walls) {
        Scene scene;
        const int white = scenes::add_material(scene, glm::vec3(0.7f), glm::vec3(0.0f), true);
        scenes::add_box(scene, white, {1, 1, 1}, {7, 5, 7}, scenes::Facing::inward);
        for (const glm::vec3 colour : walls) {
            const int own = scenes::add_material(scene, colour, glm::vec3(0.0f), true);
            scenes::add_quad(scene, own, {4, 1, 1}, {0, 4, 0}, {0, 0, 6});
        }
        scene.lights.push_back(scenes::point_light({2.5, 4.0, 3.1}, 500.0));
        return scene;
    };
    const glm::vec3 red(0.7f, 0.1f, 0.1f), green(0.1f, 0.6f, 0.1f);
    const glm::dvec3 both = mean_luminance(rooms({red, green})), one = mean_luminance(rooms({red})),
                     other = mean_luminance(rooms({green}));
    const glm::dvec3 seen = both.x / both.y > one.x / one.y * 0.99 ? one : other;
    EXPECT_GT(one.x / other.x, 1.2);
    for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(both[c] / seen[c], 1.0, 1e-2);
}

TEST(Elements, AFineMeshIsLitAsACoarseOne) {
    const auto room = [](int n) {
        Scene scene;
        add_fine_floor(scene, n, 1.0f);
        const int white = scenes::add_material(scene, glm::vec3(0.6f));
        scenes::add_box(scene, white, {2, 1.5f, 2}, {5, 3, 6}, scenes::Facing::outward);
        scene.sky.luminance = glm::vec3(50.0f);
        scene.lights.push_back(scenes::point_light({6.2, 4.0, 3.1}, 500.0));
        return scene;
    };
    const double coarse = mean_luminance(room(1)).y, fine = mean_luminance(room(96)).y;
    EXPECT_NEAR(fine / coarse, 1.0, 1e-2);
}

} // namespace
} // namespace lpvbake
