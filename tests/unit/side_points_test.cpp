#include "surface/side_points.h"

#include "reference/reference.h"
#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

constexpr double pi = glm::pi<double>();

/// Points, and light at them, of a scene in a frame.
struct Lit {
    Lit(const Scene& scene, const scene::Frame& frame, std::optional<int> bounces,
        const surface::SidePointSettings& settings = {})
        : visibility(scene, frame) {
        Progress silent;
        surface::LightingSettings lighting;
        lighting.bounces = bounces;
        surfaces = surface::light_surfaces(scene, visibility, frame, lighting, silent);
        sides = surface::draw_side_points(surfaces, glm::vec3(frame.extent), settings);
        irradiance =
            surface::irradiance_at(scene, surfaces, sides.points, true, 256, settings.seed, silent);
    }
    double area() const {
        double sum = 0;
        for (const float a : sides.area)
            sum += double(a);
        return sum;
    }
    visibility::Visibility visibility;
    surface::LitSurfaces surfaces;
    surface::SidePoints sides;
    std::vector<glm::vec3> irradiance;
};

TEST(SidePoints, AFurnaceLightsAllOfThemAlike) {
    const scene::Frame frame{glm::dvec3(-1), 0.5, glm::dvec3(20)};
    const Lit lit(scenes::furnace(8, 0.5f, 1.0f), frame, std::nullopt);
    EXPECT_NEAR(lit.area(), 6 * 16 * 16, 1);
    EXPECT_NEAR(double(lit.sides.points.size()), 4 * 6 * 16 * 16, 10);
    std::array<int, 6> walls{};
    for (size_t i = 0; i < lit.sides.points.size(); ++i) {
        for (int c = 0; c < 3; ++c)
            ASSERT_NEAR(lit.irradiance[i][c] / (2 * pi), 1, 2e-2);
        const auto& [p, n] = lit.sides.points[i];
        int wall = 0;
        for (int axis = 0; axis < 3; ++axis)
            for (const float side : {-1.0f, 1.0f}) {
                if (n[axis] * side > 0.5f)
                    ++walls[size_t(2 * axis + (side > 0))];
                wall += std::abs(p[axis] - 10.0f + 8.0f * side) < 1e-3f && n[axis] == side;
            }
        EXPECT_EQ(wall, 1) << "on a wall, and looks inwards";
        // Free for a cell but near an edge.
        const glm::vec3 to_wall = 8.0f - glm::abs(p - 10.0f);
        int near = 0;
        for (int axis = 0; axis < 3; ++axis)
            near += n[axis] == 0.0f && to_wall[axis] < 1.0f;
        if (near > 0) {
            EXPECT_GT(lit.sides.open[i], 0.1f);
        }
        if (near == 0) {
            EXPECT_EQ(lit.sides.open[i], 1.0f);
        }
    }
    for (const int count : walls)
        EXPECT_NEAR(count, 4 * 16 * 16, 4);
}

TEST(SidePoints, LieOnTheSidesThatCanBeSeenAndInTheBox) {
    Scene scene;
    const int one = scenes::add_material(scene, glm::vec3(0.5f));
    const int both = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, one, {0, 0, 0}, {0, 0, 4}, {4, 0, 0}); // faces up
    scenes::add_quad(scene, both, {0, 3, 0}, {0, 0, 4}, {4, 0, 0});
    scenes::add_box(scene, one, {5, 0, 0}, {7, 2, 2}, scenes::Facing::outward);
    scenes::add_box(scene, one, {5.5, 0.5, 0.5}, {6, 1, 1}, scenes::Facing::outward); // buried
    scene.lights.push_back(scenes::sun({0, -1, 0}, 1));
    const auto areas = [&](const scene::Frame& frame, uint32_t seed) {
        const Lit lit(scene, frame, 1, {.density = 16, .seed = seed});
        glm::dvec4 sum(0); // up below, above; down; of boxes
        for (size_t i = 0; i < lit.sides.points.size(); ++i) {
            const auto& [p, n] = lit.sides.points[i];
            const glm::dvec3 at = frame.to_world(glm::dvec3(p));
            EXPECT_EQ(p, glm::clamp(p, glm::vec3(0), glm::vec3(frame.extent)));
            sum[at.x > 4.5 ? 3 : n.y < 0 ? 2 : at.y > 1 ? 1 : 0] += double(lit.sides.area[i]);
        }
        return sum;
    };
    const glm::dvec4 all = areas({glm::dvec3(-1), 1.0, glm::dvec3(9, 5, 6)}, 1);
    EXPECT_NEAR(all[0], 16, 0.3);
    EXPECT_NEAR(all[1], 16, 0.3);
    EXPECT_NEAR(all[2], 16, 0.3);
    EXPECT_NEAR(all[3], 24, 0.3); // without the buried one
    const glm::dvec4 half = areas({glm::dvec3(-1, -1, 2), 1.0, glm::dvec3(9, 5, 6)}, 2);
    EXPECT_NEAR(half[0], 8, 0.3);
}

TEST(SidePoints, AreAsManyAsAllowedAndStandForTheRest) {
    const scene::Frame frame{glm::dvec3(-1), 0.5, glm::dvec3(20)};
    const Lit lit(scenes::furnace(8, 0.5f, 1.0f), frame, 1, {.most_points = 500});
    EXPECT_EQ(lit.sides.points.size(), 500u);
    EXPECT_NEAR(lit.area(), 6 * 16 * 16, 1);
}

TEST(SidePoints, IrradianceIsThatOfTracedPaths) {
    const scene::Frame frame{glm::dvec3(-1.2, -0.2, -1.2), 0.15, glm::dvec3(16)};
    for (const bool sun : {false, true}) {
        const Scene scene = sun ? scenes::cornell_box_with_sun() : scenes::cornell_box_with_point();
        const Lit lit(scene, frame, std::nullopt, {.most_points = 1200, .seed = 5});
        std::vector<glm::vec3> at;
        std::vector<glm::dvec3> own;
        std::vector<uint64_t> keys;
        for (const surface::SidePoint& point : lit.sides.points) {
            at.push_back(point.position + 1e-4f * point.normal);
            own.push_back(glm::normalize(glm::dvec3(point.normal)));
            keys.push_back(keys.size());
        }
        reference::ReferenceSettings settings;
        settings.sh_order = 0;
        settings.rays = 1024;
        settings.paths = {std::nullopt, true};
        Progress silent;
        const reference::ProbeField field = reference::trace_probes(
            scene, lit.visibility, frame, at, keys, settings, silent, {{}, own});
        double off = 0, noise = 0, whole = 0, sum = 0;
        for (size_t i = 0; i < at.size(); ++i)
            for (int c = 0; c < 3; ++c) {
                off += double(std::abs(lit.irradiance[i][c] - field.own_irradiance[i][c]));
                noise += double(field.own_irradiance_error[i][c]);
                whole += double(field.own_irradiance[i][c]);
                sum += double(lit.irradiance[i][c]);
            }
        EXPECT_LT(off / whole, 0.03 + noise / whole) << sun;
        EXPECT_NEAR(sum / whole, 1, 0.01) << sun;
    }
}

} // namespace
} // namespace lpvbake
