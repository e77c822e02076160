// Patches that are cut where a light falls on little of them.
#include "surface/narrow.h"

#include "scenes.h"
#include "surface/flux.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <numeric>
#include <random>

namespace lpvbake {
namespace {

/// A closed hall of 20 x 8 x 20 m.
Scene hall(float albedo = 0.5f) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(albedo));
    scenes::add_box(scene, grey, {-10, 0, -10}, {10, 8, 10}, scenes::Facing::inward);
    return scene;
}

scene::Frame cells_of(double cell) {
    return {glm::dvec3(-10.3, -0.2, -10.4), cell, glm::ceil(glm::dvec3(20.8, 8.5, 20.8) / cell)};
}

surface::LitSurfaces light(const Scene& scene, const visibility::Visibility& visibility,
                           const scene::Frame& frame, std::optional<int> bounces = 1) {
    Progress silent;
    surface::LightingSettings settings;
    settings.bounces = bounces;
    settings.rays = 1 << 18;
    return surface::light_surfaces(scene, visibility, frame, settings, silent);
}

/// Reflected power, lumen of albedo 1 / pi, and where it comes from.
struct Sent {
    double power = 0.0;
    glm::dvec3 from{0.0};

    Sent(const surface::LitSurfaces& lit, const scene::Frame& frame) {
        for (size_t i = 0; i < lit.luminance.size(); ++i) {
            const surface::Patch& patch = lit.patches[i / 2];
            const double part = double(patch.area) * double(lit.luminance[i].y);
            power += part;
            from += part * frame.to_world(glm::dvec3(patch.position));
        }
        from /= power;
        power *= frame.unit * frame.unit;
    }
};

TEST(Narrow, ABeamIsReflectedWhereItFalls) {
    std::mt19937 random(8);
    std::uniform_real_distribution<double> place(-7.0, 7.0), turn(-0.2, 0.2);
    for (const double cell : {2.5, 0.625})
        for (const double degrees : {0.1, 1.0, 2.0})
            for (int i = 0; i < 6; ++i) {
                const glm::dvec3 from(place(random), 7.9, place(random));
                const glm::dvec3 way(turn(random), -1.0, turn(random));
                Scene scene = hall();
                scene.lights.push_back(
                    scenes::spot_light(from, way, 1.0, 0.0, glm::radians(degrees)));
                const scene::Frame frame = cells_of(cell);
                const visibility::Visibility visibility(scene, frame);
                const Sent sent(light(scene, visibility, frame), frame);
                // Whole patches would send it from up to half a cell away.
                EXPECT_LT(glm::distance(sent.from, from + 7.9 * way), 0.1 * cell + 0.01)
                    << cell << " " << degrees;
            }
}

TEST(Narrow, PartsAreTheWholeAndAreFound) {
    Scene scene = hall();
    std::mt19937 random(9);
    std::uniform_real_distribution<double> place(-9.0, 9.0), height(0.01, 7.99);
    for (int i = 0; i < 8; ++i) {
        scene.lights.push_back(scenes::spot_light({place(random), height(random), place(random)},
                                                  {0.3, -1, 0.1 * i}, 1.0, 0.0, 0.01 * (i + 1)));
        scene.lights.push_back(scenes::point_light({place(random), 0.01, place(random)}, 1.0));
    }
    const scene::Frame frame = cells_of(1.0);
    const visibility::Visibility visibility(scene, frame);
    const surface::LitSurfaces lit = light(scene, visibility, frame);
    ASSERT_GT(lit.cut_from.size(), 50u);
    const size_t uncut = lit.patches.size() - lit.cut_from.size();
    EXPECT_EQ(uncut, surface::cover_surfaces(scene, frame, visibility, 1.0f).patches.size());
    double area = 0.0;
    for (const surface::Patch& patch : lit.patches)
        area += double(patch.area);
    EXPECT_NEAR(area / (2 * 400.0 + 4 * 160.0), 1.0, 1e-5);
    for (size_t i = 0; i < lit.cut_from.size(); ++i)
        EXPECT_LT(lit.cut_from[i], uncut + i);
    // Points all over the cut patches, and anywhere.
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    for (int i = 0; i < 4000; ++i) {
        const size_t at =
            i % 2 != 0 ? uncut + size_t(i) % lit.cut_from.size() : random() % lit.patches.size();
        const surface::Patch& patch = lit.patches[at];
        float a = unit(random), b = unit(random);
        if (a + b > 1.0f)
            a = 1.0f - a, b = 1.0f - b;
        const glm::vec3 point = patch.at({a, b});
        const visibility::Hit hit =
            visibility.closest({point + 0.01f * patch.normal, -0.02f * patch.normal});
        glm::vec2 weights;
        const uint32_t found = lit.tree.find(hit, weights);
        ASSERT_LT(found, lit.patches.size());
        EXPECT_LT(glm::distance(lit.patches[found].at(weights), point), 2e-3f);
        if (std::min({a, b, 1.0f - a - b}) > 0.05f) {
            EXPECT_EQ(found, at);
        }
    }
}

TEST(Narrow, OneMoreReflectionKeepsItsLight) {
    // All that a place reflects falls on the other sides of a closed room, and half of that is
    // reflected once more. Rays in all directions would meet what a patch sends by luck, 5 % off
    // and more.
    for (const glm::dvec3 at : {glm::dvec3(1.3, 0, 2.2), {-6.1, 0, 0.4}, {5.2, 0, -7.7}})
        for (const double degrees : {12.0, 4.0, 2.0, 0.5, 0.05}) {
            const double outer = glm::radians(degrees);
            Scene scene = hall();
            scene.lights.push_back(scenes::spot_light(
                at + glm::dvec3(0, 6, 0), {0, -1, 0},
                1.0 / (glm::two_pi<double>() * (1.0 - std::cos(outer))), 0.999 * outer, outer));
            const scene::Frame frame = cells_of(2.5);
            const visibility::Visibility visibility(scene, frame);
            const double once = Sent(light(scene, visibility, frame), frame).power;
            const double twice = Sent(light(scene, visibility, frame, 2), frame).power;
            EXPECT_NEAR(once / (0.5 / glm::pi<double>()), 1.0, 3e-3) << degrees;
            EXPECT_NEAR((twice - once) / once, 0.5, 0.01) << degrees;
        }
}

TEST(Narrow, PartsShareTheirLightWhereFewRaysAsk) {
    Scene scene = hall();
    scene.lights.push_back(scenes::spot_light({1.2, 7, 3.3}, {0, -1, 0}, 1.0, 0.0, 0.005));
    const scene::Frame frame = cells_of(2.0);
    const visibility::Visibility visibility(scene, frame);
    const surface::LitSurfaces lit = light(scene, visibility, frame, std::nullopt);
    ASSERT_EQ(lit.shared.size(), lit.luminance.size());
    double all = 0.0, shared = 0.0, most = 0.0, most_shared = 0.0;
    for (size_t i = 0; i < lit.luminance.size(); ++i) {
        const double area = double(lit.patches[i / 2].area);
        all += area * double(lit.luminance[i].y);
        shared += area * double(lit.shared[i].y);
        most = std::max(most, double(lit.luminance[i].y));
        most_shared = std::max(most_shared, double(lit.shared[i].y));
    }
    EXPECT_NEAR(shared / all, 1.0, 1e-5);
    EXPECT_LT(most_shared, 0.2 * most);
}

TEST(Narrow, NothingIsCutWhereLightIsWide) {
    const scene::Frame frame{glm::dvec3(-1.2), 0.15, glm::dvec3(16.0)};
    const Scene scene = scenes::cornell_box_with_point();
    const visibility::Visibility visibility(scene, frame);
    const surface::LitSurfaces lit = light(scene, visibility, frame);
    EXPECT_TRUE(lit.cut_from.empty());
    EXPECT_TRUE(lit.shared.empty());
}

TEST(Narrow, NoNumberOfLightsCutsWithoutBound) {
    Scene scene = hall();
    std::mt19937 random(6);
    std::uniform_real_distribution<double> place(-9.0, 9.0);
    for (int i = 0; i < 500; ++i)
        scene.lights.push_back(
            scenes::spot_light({place(random), 7.0, place(random)}, {0, -1, 0}, 1.0, 0.0, 0.004));
    const scene::Frame frame = cells_of(5.0);
    const visibility::Visibility visibility(scene, frame);
    const surface::LitSurfaces lit = light(scene, visibility, frame);
    const size_t uncut = lit.patches.size() - lit.cut_from.size();
    EXPECT_GT(lit.cut_from.size(), 1000u);
    EXPECT_LT(lit.cut_from.size(), uncut / 2 + 4096 + 1000);
    EXPECT_NEAR(lit.narrow, 1.0, 1e-6);
}

TEST(Narrow, SameBitsForAnyNumberOfThreads) {
    Scene scene = hall();
    for (int i = 0; i < 4; ++i)
        scene.lights.push_back(
            scenes::spot_light({i, 7, 0.7 * i}, {0.1, -1, 0}, 1.0, 0.0, 0.004 * (i + 1)));
    const scene::Frame frame = cells_of(1.0);
    const visibility::Visibility visibility(scene, frame);
    const surface::LitSurfaces many = light(scene, visibility, frame, std::nullopt);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const surface::LitSurfaces single = light(scene, visibility, frame, std::nullopt);
    EXPECT_EQ(many.cut_from, single.cut_from);
    EXPECT_EQ(many.luminance, single.luminance);
}

} // namespace
} // namespace lpvbake
