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

TEST(SharedRays, TellApartWhatDiffersBeyondNoise) {
    // A row of eight; by the rays of all each has 4.
    std::vector<surface::SidePoint> points;
    for (int i = 0; i < 8; ++i)
        points.push_back({{float(i), 0, 0}, {0, 1, 0}});
    const auto told = [&](const std::vector<float>& alone, float deviation) {
        std::vector<surface::OwnLight> own;
        for (const float lux : alone)
            own.push_back({glm::vec3(lux), glm::vec3(deviation * deviation)});
        std::vector<glm::vec3> lux(8, glm::vec3(4.0f));
        surface::tell_apart(points, own, lux);
        std::vector<float> result;
        for (const glm::vec3& e : lux)
            result.push_back(e.y);
        return result;
    };
    const std::vector<float> noisy{5, 3, 4.5f, 3.5f, 3, 5, 3.5f, 4.5f};
    EXPECT_EQ(told(noisy, 1.0f), std::vector<float>(8, 4.0f));
    // The same is no noise, if rays are sure of it.
    const auto sure = told(noisy, 0.01f);
    for (size_t i = 0; i < 8; ++i)
        EXPECT_NEAR(sure[i], noisy[i], 0.01) << i;
    // A shadow over one half shows in the sum of its points, in none of them alone.
    const auto half = told({6.5f, 7.5f, 5.5f, 6.5f, 0.5f, 1.5f, 2.5f, 1.5f}, 1.5f);
    for (size_t i = 0; i < 8; ++i)
        EXPECT_NEAR(half[i], i < 4 ? 6.5 : 1.5, 0.5) << i;
    EXPECT_EQ(told(std::vector<float>(8, 0.0f), 0.0f), std::vector<float>(8, 0.0f));
}

TEST(SharedRays, KnowTheNoiseOfAPointsOwn) {
    // Two rays of eight met light: mean of x 3 / 4, of its square 5 / 2.
    const std::vector<surface::SharedRay> rays{{{}, {0, 0, 1}, {2, 0, 1}}, {{}, {}, {4, 0, 1}}};
    const surface::OwnLight own = surface::light_alone(rays, 8);
    const float pi = glm::pi<float>();
    EXPECT_NEAR(own.irradiance.x, 0.75f * pi, 1e-5);
    EXPECT_NEAR(own.variance.x, pi * pi * (2.5f - 0.75f * 0.75f) / 8, 1e-5);
    EXPECT_EQ(own.variance.y, 0.0f);
    EXPECT_NEAR(own.variance.z, pi * pi * (0.25f - 0.0625f) / 8, 1e-5);
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
            return surface::irradiance_at(parted.scene, lit, points, emitters, rays, seed, silent);
        };
        const auto truth = lux_of(2048, 3);
        std::vector<glm::vec3> shared;
        const auto light =
            surface::shared_irradiance_at(parted.scene, lit, points, emitters, 16, 1, silent);
        for (size_t i = 0; i < light.size(); ++i) {
            shared.push_back(light[i].irradiance);
            EXPECT_NEAR(light[i].open, sides.open[i], 0.2);
        }
        // What emitters give directly is each point's own.
        EXPECT_LT(error(shared, truth), (emitters ? 0.9 : 0.3) * error(lux_of(16, 1), truth));
    }
}

TEST(SharedRays, SeeWhatHidesTheEndsOfNeighbours) {
    // Slats above a bright floor of patches, a unit wide and a unit apart.
    Scene scene = Parted::make();
    const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    for (int i = 0; i < 4; ++i)
        scenes::add_quad(scene, grey, {0.3f + float(i), 0.4f, 0}, {0.5f, 0, 0}, {0, 0, 8});
    const scene::Frame frame{glm::dvec3(-1), 1.0, glm::dvec3(10)};
    const visibility::Visibility visibility(scene, frame);
    Progress silent;
    const surface::LitSurfaces lit =
        surface::light_surfaces(scene, visibility, frame, {.bounces = std::nullopt}, silent);
    const auto points = surface::draw_side_points(lit, glm::vec3(frame.extent), {}).points;
    const auto truth = surface::irradiance_at(scene, lit, points, false, 1024, 3, silent);
    const auto light = surface::shared_irradiance_at(scene, lit, points, false, 32, 1, silent);
    double off = 0, whole = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        off += double(std::abs(light[i].irradiance.x - truth[i].x));
        whole += double(truth[i].x);
    }
    EXPECT_LT(off, 0.1 * whole);
}

} // namespace
} // namespace lpvbake
