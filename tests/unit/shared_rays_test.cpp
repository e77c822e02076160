#include "surface/shared_rays.h"

#include "scenes.h"
#include "surface/side_points.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <algorithm>

namespace lpvbake {
namespace {

TEST(SharedRays, WeighsWhatRaysMeetByThePointsOwnWays) {
    // One ray that meets a surface, and one that leaves, from two points that look up and aslant.
    const std::vector<surface::SidePoint> points{{{0, 0, 0}, {0, 0, 1}},
                                                 {{1, 0, 0}, {0.6f, 0, 0.8f}}};
    const std::vector<surface::SharedRay> rays{{{0, 0, 2}, {0, 0, -1}, {3, 0, 0}},
                                               {{0, 0.6f, 0.8f}, {0, 0, 0}, {0, 5, 0}}};
    std::vector<glm::vec3> lux(2, glm::vec3(1.0f));
    surface::add_shared(points, rays, 8, lux);
    // cos * cos / r^2 there; pi L of that over 8 times its sum.
    const float a = 2 * 2 / 16.0f, b = 1 * 2 / 25.0f;
    const float c = 0.8f, d = 0.64f, pi = glm::pi<float>();
    EXPECT_NEAR(lux[0].x, 1 + 3 * pi * a / (8 * (a + b)), 1e-5);
    EXPECT_NEAR(lux[1].x, 1 + 3 * pi * b / (8 * (a + b)), 1e-5);
    EXPECT_NEAR(lux[0].y, 1 + 5 * pi * c / (8 * (c + d)), 1e-5);
    EXPECT_NEAR(lux[1].y, 1 + 5 * pi * d / (8 * (c + d)), 1e-5);
    EXPECT_EQ(lux[0].z, 1.0f);
}

/// A floor with a thin wall across, over which something is bright on one side.
struct Parted {
    static Scene make() {
        Scene scene;
        const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
        scenes::add_quad(scene, grey, {0, 0, 0}, {0, 0, 8}, {8, 0, 0});
        scenes::add_quad(scene, grey, {4.3f, 0, 0}, {0, 8, 0}, {0, 0, 8});
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(1.0f), true),
                         {0, 4, 0}, {4.3f, 0, 0}, {0, 0, 8});
        return scene;
    }
    Scene scene = make();
    scene::Frame frame{glm::dvec3(-1), 1.0, glm::dvec3(10)};
    visibility::Visibility visibility{scene, frame};
};

TEST(SharedRays, GroupsAreNearFaceAlikeAndNoWallPartsThem) {
    const Parted parted;
    Progress silent;
    const surface::LitSurfaces lit =
        surface::light_surfaces(parted.scene, parted.visibility, parted.frame, {}, silent);
    const auto points =
        surface::draw_side_points(lit, glm::vec3(parted.frame.extent), {.looks = 0}).points;
    const surface::PointGroups groups = surface::group_points(parted.visibility, points, 16);
    std::vector<uint32_t> all = groups.order;
    std::ranges::sort(all);
    for (uint32_t i = 0; i < points.size(); ++i)
        ASSERT_EQ(all[i], i);
    size_t across = 0; // near the wall, on its two sides
    for (size_t g = 0; g + 1 < groups.first.size(); ++g) {
        ASSERT_LT(groups.first[g], groups.first[g + 1]);
        ASSERT_LE(groups.first[g + 1] - groups.first[g], 16u);
        const surface::SidePoint& one = points[groups.order[groups.first[g]]];
        for (uint32_t k = groups.first[g]; k < groups.first[g + 1]; ++k) {
            const surface::SidePoint& other = points[groups.order[k]];
            EXPECT_LT(glm::length(one.position - other.position), 3 * 1.7321f);
            EXPECT_GT(glm::dot(one.normal, other.normal), 0.9f);
            if (one.normal.y > 0.5f) {
                EXPECT_EQ(one.position.x < 5.3f, other.position.x < 5.3f);
            }
            across += std::abs(other.position.x - 5.3f) < 1.0f && other.normal.y > 0.5f;
        }
    }
    EXPECT_GT(across, 50u);
    EXPECT_LT(groups.first.size(), points.size() / 8);
}

TEST(SharedRays, GiveWhatManyOfEachPointGive) {
    const Parted parted;
    Progress silent;
    const surface::LitSurfaces lit = surface::light_surfaces(
        parted.scene, parted.visibility, parted.frame, {.bounces = std::nullopt}, silent);
    const auto sides = surface::draw_side_points(lit, glm::vec3(parted.frame.extent), {});
    const auto& points = sides.points;
    const auto error = [&](std::span<const glm::vec3> lux, std::span<const glm::vec3> truth) {
        double off = 0, whole = 0;
        for (size_t i = 0; i < points.size(); ++i) {
            off += double(std::abs(lux[i].x - truth[i].x));
            whole += double(truth[i].x);
        }
        return off / whole;
    };
    for (const bool emitters : {true, false}) {
        const auto lux_of = [&](int rays, uint32_t seed) {
            return surface::irradiance_at(parted.scene, lit, parted.frame, points, emitters, rays,
                                          seed, silent);
        };
        const auto truth = lux_of(2048, 3);
        std::vector<glm::vec3> shared;
        const auto light = surface::shared_irradiance_at(parted.scene, lit, parted.frame, points,
                                                         emitters, 16, 1, silent);
        for (size_t i = 0; i < light.size(); ++i) {
            shared.push_back(light[i].irradiance);
            EXPECT_NEAR(light[i].open, sides.open[i], 0.2);
        }
        // What emitters give directly is each point's own.
        EXPECT_LT(error(shared, truth), (emitters ? 0.9 : 0.3) * error(lux_of(16, 1), truth));
    }
}

} // namespace
} // namespace lpvbake
