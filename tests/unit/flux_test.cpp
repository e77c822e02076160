#include "surface/flux.h"

#include "lpvbake/error.h"
#include "scenes.h"
#include "surface/narrow.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <sys/resource.h>

#include <functional>
#include <random>
#include <tuple>

namespace lpvbake {
namespace {

/// A scene with its patches, and what its lights give them.
struct Lit {
    visibility::Visibility visibility;
    scene::Frame frame;
    surface::LitSurfaces lit;
    surface::PunctualLight light;

    Lit(const Scene& scene, const scene::Frame& in) : visibility(scene, in), frame(in) {
        Progress silent;
        surface::LightingSettings dark;
        dark.bounces = 0;
        lit = surface::light_surfaces(scene, visibility, frame, dark, silent);
        light = surface::illuminate(scene, scene.lights, lit, frame, 0, silent);
    }

    using Wanted = std::function<bool(const surface::Patch&, glm::dvec3)>;
    /// Power (lumen, green) on the patches that `wanted` says, by centroids in the world.
    double power(const Wanted& wanted) const {
        double sum = 0.0;
        for (size_t side = 0; side < light.lux.size(); ++side) {
            const surface::Patch& patch = lit.patches[side / 2];
            if (wanted(patch, frame.to_world(glm::dvec3(patch.position))))
                sum += double(light.lux[side].y) * double(patch.area) * double(patch.alpha)
                       * frame.unit * frame.unit;
        }
        return sum;
    }
    double power() const {
        return power([](const surface::Patch&, glm::dvec3) { return true; });
    }
};

scene::Frame cells_of(glm::dvec3 lo, glm::dvec3 hi, double cell) {
    return {lo - 0.37 * cell, cell, glm::ceil((hi - lo) / cell + 0.74)};
}

/// A room of 6 x 3 x 6 m, closed but for a square hole in its roof.
Scene room_with_hole(glm::dvec2 middle, double edge) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, grey, {-3, 0, -3}, {0, 0, 6}, {6, 0, 0});
    for (const float at : {-3.0f, 3.0f}) {
        scenes::add_quad(scene, grey, {at, 0, -3}, {0, 0, 6}, {0, 3, 0});
        scenes::add_quad(scene, grey, {-3, 0, at}, {6, 0, 0}, {0, 3, 0});
    }
    const float a = float(middle.x - edge / 2), b = float(middle.x + edge / 2);
    const float c = float(middle.y - edge / 2), d = float(middle.y + edge / 2);
    scenes::add_quad(scene, grey, {-3, 3, -3}, {0, 0, 6}, {a + 3, 0, 0});
    scenes::add_quad(scene, grey, {b, 3, -3}, {0, 0, 6}, {3 - b, 0, 0});
    scenes::add_quad(scene, grey, {a, 3, -3}, {0, 0, c + 3}, {b - a, 0, 0});
    scenes::add_quad(scene, grey, {a, 3, d}, {0, 0, 3 - d}, {b - a, 0, 0});
    return scene;
}

/// A closed hall of 20 x 8 x 20 m.
Scene hall() {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_box(scene, grey, {-10, 0, -10}, {10, 8, 10}, scenes::Facing::inward);
    return scene;
}

/// Power of a spot of `candela`, by KHR_lights_punctual's ramp.
double power_of_spot(double candela, double inner, double outer) {
    const double whole = 1.0 - std::cos(inner), ramp = std::cos(inner) - std::cos(outer);
    return glm::two_pi<double>() * candela * (whole + ramp / 3.0);
}

TEST(Flux, SunThroughAHole) {
    std::mt19937 random(4);
    std::uniform_real_distribution<double> place(-2.5, 2.5);
    for (const double edge : {0.1, 0.2, 0.05})
        for (const double cell : {0.75, 0.375, 0.1875})
            for (int i = 0; i < 3; ++i) {
                const glm::dvec2 middle(place(random), place(random));
                Scene scene = room_with_hole(middle, edge);
                scene.lights.push_back(scenes::sun({0, -1, 0}, 1e5));
                const Lit room(scene, cells_of({-3, 0, -3}, {3, 3, 3}, cell));
                const double inside =
                    room.power([](const surface::Patch&, glm::dvec3 p) { return p.y < 2.9; });
                EXPECT_NEAR(inside / (1e5 * edge * edge), 1.0, 0.02)
                    << edge << " " << cell << " " << middle.x << " " << middle.y;
                EXPECT_NEAR(room.power() / 3.6e6, 1.0, 1e-4);
            }
}

TEST(Flux, NoPlaceOfABeamLosesLight) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> place(-6.0, 6.0), turn(-0.4, 0.4);
    for (const double degrees : {20.0, 3.0, 1.0, 0.5, 0.05})
        for (const double cell : {2.5, 0.625})
            for (const double inner : {0.0, 0.9, 0.999}) {
                const double outer = glm::radians(degrees);
                Scene scene = hall();
                scene.lights.push_back(scenes::spot_light({place(random), 7.9, place(random)},
                                                          {turn(random), -1.0, turn(random)}, 1.0,
                                                          inner * outer, outer));
                const Lit lit(scene, cells_of({-10, 0, -10}, {10, 8, 10}, cell));
                const double wanted = power_of_spot(1.0, inner * outer, outer);
                EXPECT_NEAR(lit.power() / wanted, 1.0, 2e-3) << degrees << " " << inner;
                const surface::LightPower& power = lit.light.power[0];
                EXPECT_NEAR(lit.power() / power.sent, 1.0, 1e-4) << degrees << " " << inner;
            }
}

TEST(Flux, ALampJustAboveAFloorLightsItByHalf) {
    for (const double height : {1.0, 0.1, 0.01, 0.001})
        for (const double cell : {1.0, 0.25}) {
            Scene scene = hall();
            scene.lights.push_back(scenes::point_light({0.13, height, 0.27}, 100.0));
            const Lit lit(scene, cells_of({-10, 0, -10}, {10, 8, 10}, cell));
            const auto onto_floor = [](const surface::Patch&, glm::dvec3 p) { return p.y < 0.01; };
            // The floor's solid angle, of four rectangles.
            double angle = 0.0;
            for (const double x : {10 - 0.13, 10 + 0.13})
                for (const double z : {10 - 0.27, 10 + 0.27})
                    angle += std::atan2(x * z, height * std::sqrt(x * x + z * z + height * height));
            EXPECT_NEAR(lit.power(onto_floor) / (100.0 * angle), 1.0, 2e-3)
                << height << " " << cell;
            EXPECT_NEAR(lit.power() / (400.0 * glm::pi<double>()), 1.0, 1e-4) << height;
        }
}

TEST(Flux, LightOnLessThanAPatchIsTold) {
    const auto narrow = [](double height, double degrees) {
        Scene scene = hall();
        if (degrees > 0.0)
            scene.lights.push_back(scenes::spot_light({0.3, height, 0.2}, {0, -1, 0}, 1.0, 0.0,
                                                      glm::radians(degrees)));
        else
            scene.lights.push_back(scenes::point_light({0.3, height, 0.2}, 1.0));
        const Lit lit(scene, cells_of({-10, 0, -10}, {10, 8, 10}, 1.0));
        EXPECT_NEAR(lit.light.landed / lit.light.power[0].sent, 1.0, 1e-6);
        return lit.light.narrow / lit.light.landed;
    };
    EXPECT_NEAR(narrow(7.9, 0.5), 1.0, 1e-6);
    EXPECT_LT(narrow(7.9, 30.0), 0.01);
    EXPECT_LT(narrow(4.0, 0.0), 0.01);
    EXPECT_GT(narrow(0.01, 0.0), 0.4); // the half that falls on the floor just below
}

TEST(Flux, ABeamAlongTheBorderOfCells) {
    // Of a width below float's steps beside a cell's, on the edge of both.
    Scene scene = hall();
    const double outer = glm::radians(0.2);
    scene.lights.push_back(scenes::spot_light({0, 7.9, 0}, {0, -1, 0}, 1.0, 0.0, outer));
    const Lit lit(scene, {glm::dvec3(-10, 0, -10), 0.5, glm::dvec3(40, 16, 40)});
    EXPECT_NEAR(lit.power() / power_of_spot(1.0, 0.0, outer), 1.0, 2e-3);
}

TEST(Flux, ALightThatSeesNothing) {
    Scene scene = scenes::floor_quad(4.0f, glm::vec3(0.5f));
    scene.lights.push_back(scenes::spot_light({0, 3, 0}, {0, 1, 0}, 1.0, 0.2, 0.4)); // away
    scene.lights.push_back(scenes::point_light({0, -3, 0}, 1.0));                    // a back
    scene.lights.push_back(scenes::point_light({0, 3, 0}, 1.0));
    scene.lights.back().range = 2.0; // not so far
    const Lit lit(scene, cells_of({-2, 0, -2}, {2, 2, 2}, 0.5));
    EXPECT_EQ(lit.power(), 0.0);
    for (const surface::LightPower& power : lit.light.power) {
        EXPECT_GT(power.sent, 0.1);
        EXPECT_EQ(power.landed + power.lost, 0.0);
    }
    EXPECT_GT(lit.light.power[1].black, 0.5);
}

TEST(Flux, WhatOneFaceOfAMapAloneSees) {
    // A tile straight ahead of each of the six faces of a lamp's cube of maps, and at the edges and
    // the corners between them; all else is dark.
    for (int z = -1; z <= 1; ++z)
        for (int y = -1; y <= 1; ++y)
            for (int x = -1; x <= 1; ++x) {
                if (x == 0 && y == 0 && z == 0)
                    continue;
                const glm::vec3 out = glm::normalize(glm::vec3(x, y, z));
                const glm::vec3 aside =
                    std::abs(out.y) < 0.9f ? glm::vec3(0, 1, 0) : glm::vec3(1, 0, 0);
                const glm::vec3 u = 0.2f * glm::normalize(glm::cross(aside, out));
                const glm::vec3 v = glm::cross(u, out); // faces the lamp
                Scene scene;
                const int grey = scenes::add_material(scene, glm::vec3(0.5f));
                scenes::add_quad(scene, grey, 3.0f * out - 0.5f * (u + v), u, v);
                scene.lights.push_back(scenes::point_light({0, 0, 0}, 100.0));
                const Lit lit(scene, cells_of(glm::dvec3(-3.3), glm::dvec3(3.3), 0.5));
                const double half = 0.1, far = 3.0;
                const double angle =
                    4.0 * std::atan2(half * half, far * std::sqrt(2 * half * half + far * far));
                EXPECT_NEAR(lit.power() / (100.0 * angle), 1.0, 0.01) << x << y << z;
                const surface::LightPower& power = lit.light.power[0];
                EXPECT_NEAR(power.sent / (400.0 * glm::pi<double>()), 1.0, 1e-4);
                EXPECT_NEAR((power.landed + power.missed) / power.sent, 1.0, 1e-6);
            }
}

TEST(Flux, AMapKeepsWhatItsSidesNeed) {
    // A sun on a quarter of a million patches: a few rays each, and memory for what they hold, not
    // for the texels.
    Scene scene = scenes::floor_quad(250.0f, glm::vec3(0.5f));
    scene.lights.push_back(scenes::sun({0.3, -1, 0.2}, 1.0));
    const scene::Frame frame = cells_of({-125, 0, -125}, {125, 3, 125}, 1.0);
    const visibility::Visibility visibility(scene, frame);
    surface::LitSurfaces lit;
    lit.visibility = &visibility;
    surface::PatchCover cover = surface::cover_surfaces(scene, frame, visibility, 1.0f);
    lit.patches = std::move(cover.patches);
    lit.tree = std::move(cover.tree);
    const size_t patches = lit.patches.size();
    ASSERT_GT(patches, 200'000u);
    rusage before, after;
    getrusage(RUSAGE_SELF, &before);
    surface::LightMapper mapper(scene, lit, frame, scene.lights);
    const surface::LightMap map = mapper.draw(scene.lights[0], 0);
    getrusage(RUSAGE_SELF, &after);
    EXPECT_EQ(map.sides.size(), patches);
    EXPECT_LT(map.rays, 12 * patches);
    const double bytes = 1024.0 * double(after.ru_maxrss - before.ru_maxrss);
    EXPECT_LT(bytes, 500.0 * double(patches) + 0x1p24);
}

TEST(Flux, AMapDrawnAgainIsThatOfPatchesThatWereCut) {
    Scene scene = hall();
    scene.lights.push_back(scenes::point_light({1.3, 5.0, -2.1}, 100.0));
    const scene::Frame frame = cells_of({-10, 0, -10}, {10, 8, 10}, 0.25);
    const visibility::Visibility visibility(scene, frame);
    surface::LitSurfaces lit;
    lit.visibility = &visibility;
    surface::PatchCover cover = surface::cover_surfaces(scene, frame, visibility, 1.0f);
    lit.patches = std::move(cover.patches);
    lit.tree = std::move(cover.tree);
    surface::LightMapper mapper(scene, lit, frame, scene.lights);
    const surface::LightMap before = mapper.draw(scene.lights[0], 0);
    std::vector<surface::NarrowLight> spots; // beside each other, and one elsewhere
    for (const size_t i : {size_t(7), size_t(8), size_t(9), before.sides.size() / 2}) {
        const surface::SideFlux& side = before.sides[i];
        spots.push_back({side.side, glm::vec2(side.weights / side.flux), 0.05f});
    }
    ASSERT_GT(surface::cut_to_light(spots, mapper, lit), 8u);
    const surface::LightMap again = mapper.draw_again(scene.lights[0], 0, before, lit.cut_from);
    const surface::LightMap all = mapper.draw(scene.lights[0], 0);
    EXPECT_GT(again.tiles.size(), 8u);
    EXPECT_GT(again.sides.size(), before.sides.size());
    ASSERT_EQ(again.sides.size(), all.sides.size());
    for (size_t i = 0; i < all.sides.size(); ++i) {
        const surface::SideFlux &a = again.sides[i], &b = all.sides[i];
        ASSERT_EQ(std::tuple(a.side, a.edged, a.flux, a.squares, a.peak),
                  std::tuple(b.side, b.edged, b.flux, b.squares, b.peak));
        ASSERT_EQ(a.tinted, b.tinted);
        ASSERT_EQ(a.weights, b.weights);
        ASSERT_EQ(a.squared_weights, b.squared_weights);
    }
    EXPECT_EQ(again.met, all.met);
    EXPECT_EQ(again.rays, all.rays);
    EXPECT_EQ(again.power.landed, all.power.landed);
    EXPECT_EQ(again.power.sent, all.power.sent);
}

TEST(Flux, ALampInAShade) {
    // The shade is a tube of 4 cm that is open below; a table under it stands in the hall.
    Scene scene = hall();
    const int shade = scenes::add_material(scene, glm::vec3(0.2f), glm::vec3(0.0f), true);
    const float low = 3.0f, high = 3.2f, half = 0.02f;
    for (const float at : {-half, half}) {
        scenes::add_quad(scene, shade, {at, low, -half}, {0, 0, 2 * half}, {0, high - low, 0});
        scenes::add_quad(scene, shade, {-half, low, at}, {2 * half, 0, 0}, {0, high - low, 0});
    }
    scenes::add_quad(scene, shade, {-half, high, -half}, {2 * half, 0, 0}, {0, 0, 2 * half});
    scene.lights.push_back(scenes::point_light({0.0, 3.15, 0.0}, 100.0));
    for (const double cell : {1.0, 0.25}) {
        const Lit lit(scene, cells_of({-10, 0, -10}, {10, 8, 10}, cell));
        const double out = lit.power([&](const surface::Patch&, glm::dvec3 p) {
            return p.y < 2.9 || glm::length(glm::dvec2(p.x, p.z)) > 0.1;
        });
        const double a = 0.02, d = 0.15; // solid angle of the opening
        const double open = 400.0 * std::atan2(a * a, d * std::sqrt(2 * a * a + d * d));
        EXPECT_NEAR(out / open, 1.0, 0.02) << cell;
        EXPECT_NEAR(lit.power() / (400.0 * glm::pi<double>()), 1.0, 1e-4);
    }
}

TEST(Flux, ATinyRoomFarFromItsLight) {
    // 10 km off, all of it in one texel of one face of a cube, were the map not cut to it.
    Scene scene = scenes::floor_quad(2.0f, glm::vec3(0.5f));
    scene.lights.push_back(scenes::point_light({6000, 8000, 0}, 1e8));
    const Lit lit(scene, cells_of({-1, 0, -1}, {1, 1, 1}, 0.25));
    EXPECT_NEAR(lit.power() / (4.0 * 0.8), 1.0, 1e-3);
}

TEST(Flux, TheGridOfALargeWorldHasItsLight) {
    // A ground of 8 km with a grid of 4 m, and a house in it.
    Scene scene = scenes::floor_quad(8000.0f, glm::vec3(0.5f));
    const int white = scenes::add_material(scene, glm::vec3(0.8f));
    scenes::add_box(scene, white, {-0.5f, 0, -0.5f}, {0.5f, 1, 0.5f}, scenes::Facing::outward);
    scene.lights.push_back(scenes::sun({1, -1, 0}, 1.0));
    const Lit lit(scene, cells_of({-2, 0, -2}, {2, 2, 2}, 0.25));
    const double roof = lit.power([](const surface::Patch&, glm::dvec3 p) { return p.y > 0.99; });
    EXPECT_NEAR(roof / std::sqrt(0.5), 1.0, 0.02);
    const double around = lit.power([](const surface::Patch&, glm::dvec3 p) {
        return p.y < 0.01 && std::abs(p.x) < 2.0 && std::abs(p.z) < 2.0;
    });
    EXPECT_NEAR(around / ((16.0 - 2.0) * std::sqrt(0.5)), 1.0, 0.03); // 1 below, 1 in the shadow
    EXPECT_LT(lit.lit.patches.size(), 50000u);
}

TEST(Flux, AThousandLights) {
    Scene scene = hall();
    std::mt19937 random(6);
    std::uniform_real_distribution<double> place(-9.0, 9.0), height(0.5, 7.5);
    for (int i = 0; i < 1000; ++i)
        scene.lights.push_back(
            scenes::point_light({place(random), height(random), place(random)}, 1.0));
    const Lit lit(scene, cells_of({-10, 0, -10}, {10, 8, 10}, 5.0));
    EXPECT_NEAR(lit.power() / (4000.0 * glm::pi<double>()), 1.0, 1e-4);
}

TEST(Flux, PartlyTransparentSurfacesShareALight) {
    // A pane of alpha 0.4 before one half of a floor.
    Scene scene = scenes::floor_quad(8.0f, glm::vec3(0.5f));
    const int pane = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
    scene.materials[size_t(pane)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(pane)].base_color.a = 0.4f;
    scenes::add_quad(scene, pane, {0, 1, -4}, {0, 0, 8}, {4, 0, 0});
    scene.lights.push_back(scenes::sun({0, -1, 0}, 1.0));
    const Lit lit(scene, cells_of({-4, 0, -4}, {4, 2, 4}, 0.5));
    const auto part = [&](float from, float to) {
        return lit.power([&](const surface::Patch& patch, glm::dvec3 p) {
            return patch.instance == 0 && p.x > from && p.x < to;
        });
    };
    EXPECT_NEAR(part(-4.0f, 0.0f) / 32.0, 1.0, 0.01);
    EXPECT_NEAR(part(0.0f, 4.0f) / (32.0 * 0.6), 1.0, 0.02);
    EXPECT_NEAR(lit.power() / 64.0, 1.0, 1e-3);
    // Each patch under it is as bright as the next: no noise.
    for (size_t i = 0; i < lit.lit.patches.size(); ++i) {
        const surface::Patch& patch = lit.lit.patches[i];
        if (patch.instance == 0 && lit.frame.to_world(glm::dvec3(patch.position)).x > 1.0) {
            EXPECT_NEAR(lit.light.lux[2 * i].y, 0.6f, 0.02f);
        }
    }
}

TEST(Flux, SameBitsForAnyNumberOfThreads) {
    Scene scene = scenes::cornell_box_with_point();
    scene.lights.push_back(scenes::sun({1, -2, -1}, 300.0));
    const scene::Frame cells{glm::dvec3(-1.2), 0.15, glm::dvec3(16.0)};
    const Lit many(scene, cells);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const Lit single(scene, cells);
    EXPECT_EQ(many.light.lux, single.light.lux);
}

} // namespace
} // namespace lpvbake
