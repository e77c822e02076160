// Light that comes into a room through a hole, while much more of it falls outside.
#include "surface/spots.h"

#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

constexpr float width = 6.0f, height = 3.0f; ///< of the room, metres

/// A room of albedo 0.5, double-sided, with a square hole in its roof.
Scene room(glm::vec2 at, float hole) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    const auto add = [&](glm::vec3 corner, glm::vec3 u, glm::vec3 v) {
        scenes::add_quad(scene, grey, corner, u, v);
    };
    const glm::vec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1), top = height * y;
    add({}, width * z, width * x);
    for (const glm::vec3 wall : {x, z}) {
        add({}, top, width * wall);
        add(width * (wall == x ? z : x), top, width * wall);
    }
    const glm::vec2 lo = at - 0.5f * hole, hi = at + 0.5f * hole;
    add(top, width * x, lo.y * z);
    add(top + hi.y * z, width * x, (width - hi.y) * z);
    add(top + lo.y * z, lo.x * x, hole * z);
    add(top + lo.y * z + hi.x * x, (width - hi.x) * x, hole * z);
    return scene;
}

/// Light that leaves what faces the middle of the room, lumen.
double inside(const Scene& scene, double cell) {
    const scene::Frame frame{glm::dvec3(0.03, 0.2, 0.05), cell,
                             glm::ceil(glm::dvec3(5.9, 2.6, 5.9) / cell)};
    const visibility::Visibility visibility(scene, frame);
    surface::LightingSettings settings;
    settings.bounces.reset();
    settings.rays = 1 << 18;
    Progress silent;
    const surface::LitSurfaces lit =
        surface::light_surfaces(scene, visibility, frame, settings, silent);
    const glm::vec3 middle(frame.from_world(glm::dvec3(0.5f * width, 0.5f * height, 0.5f * width)));
    double power = 0.0;
    for (size_t side = 0; side < lit.luminance.size(); ++side) {
        const surface::Patch& patch = lit.patches[side / 2];
        const glm::vec3 normal = side % 2 != 0 ? -patch.normal : patch.normal;
        if (glm::dot(middle - patch.position, normal) > 0.0f)
            power += glm::pi<double>() * double(patch.area) * double(lit.luminance[side].y);
    }
    return power * frame.unit * frame.unit;
}

TEST(Spots, WhatComesThroughAHoleIsReflectedToItsEnd) {
    // Each reflection keeps a half; next to nothing finds the hole again.
    double sum = 0.0;
    int count = 0;
    for (const float hole : {0.2f, 0.1f, 0.03f})
        for (const glm::vec2 at : {glm::vec2(3.37f, 3.73f), {1.87f, 2.53f}, {4.4f, 0.81f}}) {
            Scene scene = room(at, hole);
            scene.lights.push_back(scenes::sun({0, -1, 0}, 1e5));
            const double enters = 1e5 * double(hole) * double(hole);
            for (const double cell : {0.8, 0.4, 0.2}) {
                const double share = inside(scene, cell) / enters;
                EXPECT_NEAR(share, 1.0, 0.04) << hole << " " << cell; // texels at the rim
                sum += share;
                ++count;
            }
        }
    EXPECT_NEAR(sum / count, 1.0, 0.005);
}

} // namespace
} // namespace lpvbake
