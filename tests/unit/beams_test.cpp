// Direct light by beams, beside closed forms and beside rays from points.
#include "medium/beams.h"

#include "scenes.h"
#include "visibility/walls.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace lpvbake {
namespace {

using medium::BeamSettings;
using medium::DirectLight;

constexpr double y0 = 0.28209479177387814;

scene::Frame cube(int cells, double unit = 1.0) {
    return {glm::dvec3(0), unit, glm::dvec3(cells)};
}

std::size_t index(int cells, glm::ivec3 c) {
    return std::size_t(c.x + cells * (c.y + cells * c.z));
}

/// Far from where anything is asked.
Scene nothing() {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {1e4f, 1e4f, 1e4f},
                     {1e-3f, 0, 0}, {0, 1e-3f, 0});
    return scene;
}

DirectLight lit(const Scene& scene, const Light& light, const scene::Frame& frame,
                const BeamSettings& settings = {}) {
    return medium::direct_light(light, visibility::Visibility(scene, frame), frame, {}, settings);
}

/// Of all directions together, lx.
double illuminance(const DirectLight& light, std::size_t cell, int channel = 0) {
    return double(light.sh[0][cell][channel]) / y0;
}

TEST(Beams, InTheOpenEachCellHasAllOfTheSun) {
    const scene::Frame frame = cube(9, 0.3);
    for (const int k : {1, 2, 4}) {
        const DirectLight light =
            lit(nothing(), scenes::sun({0.37, -0.81, 0.22}, 500), frame, {k, 0.0, 2});
        for (std::size_t cell = 0; cell < 729; ++cell) {
            EXPECT_EQ(light.visibility[cell], 1.0f);
            EXPECT_NEAR(illuminance(light, cell), 500.0, 5e-4);
        }
    }
}

TEST(Beams, BehindAPlateACellHasItsShareOfTheLight) {
    // The plate's rim is at x = 4.3, far above: cells of that column are lit in 70 % of their
    // volume, and at 45 degrees in what the slanted plane leaves of them.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {-50, 20, -50},
                     {54.3f, 0, 0}, {0, 0, 100});
    for (const int k : {4, 16}) {
        const DirectLight straight = lit(scene, scenes::sun({0, -1, 0}, 1), cube(8), {k, 0.0, 1});
        for (int x = 0; x < 8; ++x)
            EXPECT_NEAR(straight.visibility[index(8, {x, 3, 5})],
                        x < 4   ? 0
                        : x > 4 ? 1
                                : 0.7,
                        0.5 / k + 1e-6)
                << x;
        // The light's plane through the rim: x - y = 4.3 - 20 + s; lit beyond it.
        const DirectLight slanted = lit(scene, scenes::sun({1, -1, 0}, 1), cube(8), {k, 0.0, 1});
        double difference = 0;
        for (int x = 0; x < 8; ++x)
            for (int y = 0; y < 8; ++y) {
                const double s = 4.3 + 20 - x - y; // a + b > s in the unit square is lit
                const double share = s <= 0   ? 1
                                     : s <= 1 ? 1 - 0.5 * s * s
                                     : s <= 2 ? 0.5 * (2 - s) * (2 - s)
                                              : 0;
                const double seen = slanted.visibility[index(8, {x, y, 4})];
                EXPECT_NEAR(seen, share, 0.75 / k) << x << ' ' << y;
                difference += seen - share;
            }
        EXPECT_NEAR(difference / 64, 0, 0.02 / k);
    }
}

TEST(Beams, ALampsOwnCellHasTheMeanOfItsLight) {
    // The integral of 1 / r^2 over a cube around its middle is 7.67412 edges.
    const double h = 0.25, candela = 40;
    const DirectLight light =
        lit(nothing(), scenes::point_light(glm::dvec3(4.5 * h), candela), cube(9, h));
    EXPECT_NEAR(illuminance(light, index(9, {4, 4, 4})), 7.67412 * candela / (h * h),
                2e-3 * 7.67412 * candela / (h * h));
    double sum = 0;
    for (std::size_t cell = 0; cell < 729; ++cell) {
        EXPECT_EQ(light.visibility[cell], 1.0f);
        sum += illuminance(light, cell) * h * h * h;
    }
    EXPECT_NEAR(sum, 7.67412 * candela * 9 * h, 1e-3 * 7.67412 * candela * 9 * h);
}

TEST(Beams, ALampBesideTheGridIsExactFromTwoCellsOn) {
    const DirectLight light = lit(nothing(), scenes::point_light({-7, 2, 3}, 10), cube(6));
    for (int x = 0; x < 6; ++x) {
        const glm::dvec3 way = glm::dvec3(-7, 2, 3) - (glm::dvec3(x, 2, 4) + 0.5);
        const std::size_t cell = index(6, {x, 2, 4});
        EXPECT_EQ(light.visibility[cell], 1.0f);
        EXPECT_NEAR(illuminance(light, cell), 10 / glm::dot(way, way),
                    0.01 * 10 / glm::dot(way, way));
        EXPECT_LT(light.sh[3][cell].x, 0.0f); // it comes from -x
    }
}

/// The share of a cell's light that arrives, by rays from points of it to the light.
double by_rays(const visibility::Visibility& visibility, const Light& light, glm::ivec3 cell,
               std::mt19937& random) {
    std::uniform_real_distribution<double> any(0.0, 1.0);
    double arrives = 0, all = 0;
    for (int i = 0; i < 4000; ++i) {
        const glm::dvec3 p = glm::dvec3(cell) + glm::dvec3(any(random), any(random), any(random));
        const bool parallel = light.type == LightType::directional;
        const glm::dvec3 way = parallel ? -100.0 * light.direction : light.position - p;
        const double weight = parallel ? 1 : 1 / glm::dot(way, way);
        all += weight;
        arrives += weight * double(visibility.filter({glm::vec3(p), glm::vec3(way)}).x);
    }
    return arrives / all;
}

TEST(Beams, AgreeWithRaysFromPointsOfCells) {
    // A grid of 12 cells in metres around boxes and a pane that a third of the light passes.
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_box(scene, grey, {2.2f, 0.1f, 3.3f}, {5.7f, 6.4f, 6.1f}, scenes::Facing::outward);
    scenes::add_box(scene, grey, {8.1f, 2.3f, 1.4f}, {9.2f, 3.2f, 9.5f}, scenes::Facing::outward);
    for (const bool pane : {false, true}) {
        if (pane) {
            const int glass = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true);
            scene.materials[std::size_t(glass)].alpha_mode = AlphaMode::blend;
            scene.materials[std::size_t(glass)].base_color.a = 2.0f / 3;
            scenes::add_quad(scene, glass, {6.6f, 0, 0}, {0, 0, 12}, {0, 12, 0});
        }
        const scene::Frame frame = cube(12);
        const visibility::Visibility visibility(scene, frame);
        for (const Light& light :
             {scenes::sun({0.5, -0.7, 0.3}, 1), scenes::point_light({7.1, 9.2, 5.5}, 1)}) {
            const DirectLight beams =
                medium::direct_light(light, visibility, frame, {}, {6, 0.0, 1});
            std::mt19937 random(7);
            double sum = 0;
            for (int i = 0; i < 60; ++i) {
                const glm::ivec3 cell(int(random() % 12), int(random() % 12), int(random() % 12));
                const double share = by_rays(visibility, light, cell, random);
                EXPECT_NEAR(beams.visibility[index(12, cell)], share, 0.08)
                    << cell.x << ' ' << cell.y << ' ' << cell.z;
                sum += double(beams.visibility[index(12, cell)]) - share;
            }
            EXPECT_NEAR(sum / 60, 0, 0.006);
        }
    }
}

TEST(Beams, GlassColoursWhatArrives) {
    Scene scene;
    const int glass = scenes::add_material(scene, {0.9f, 0.5f, 0.1f}, glm::vec3(0), true);
    scene.materials[std::size_t(glass)].transmission = 1.0f;
    scenes::add_quad(scene, glass, {-50, 8.5f, -50}, {0, 0, 100}, {100, 0, 0});
    const DirectLight light = lit(scene, scenes::sun({0.1, -1, 0}, 100), cube(4));
    for (int channel = 0; channel < 3; ++channel)
        EXPECT_NEAR(illuminance(light, 21, channel), 100 * glm::vec3(0.9f, 0.5f, 0.1f)[channel],
                    1e-3);
    EXPECT_NEAR(light.visibility[21], 0.2126 * 0.9 + 0.7152 * 0.5 + 0.0722 * 0.1, 1e-6);
}

TEST(Beams, ASpotHasItsConeAndItsRange) {
    Light spot = scenes::spot_light({8.5, 15, 8.5}, {0, -1, 0}, 100, 0.2, 0.5);
    spot.range = 12;
    const DirectLight light = lit(nothing(), spot, cube(16), {8, 0.0, 1});
    for (int y = 0; y < 11; ++y) {
        const double r = 15 - (y + 0.5);
        const double window = std::max(0.0, 1 - std::pow(r / 12, 4));
        EXPECT_NEAR(illuminance(light, index(16, {8, y, 8})), 100 / (r * r) * window,
                    0.05 * 100 / (r * r));
    }
    EXPECT_EQ(illuminance(light, index(16, {0, 12, 8})), 0.0);
    EXPECT_EQ(light.visibility[index(16, {0, 12, 8})], 0.0f);
    // Beside the cone's rim the way is still clear, for whoever reads between cells.
    EXPECT_EQ(light.visibility[index(16, {8 + 4, 9, 8})], 1.0f);
    EXPECT_EQ(illuminance(light, index(16, {8 + 5, 9, 8})), 0.0);
}

TEST(Beams, ASunWithADiscHasAPenumbra) {
    // Behind a half-plane d above, the share of a disc of angular radius a that is seen t beside
    // the rim's shadow, x = t / (d tan a): 1/2 + (x sqrt(1 - x^2) + asin x) / pi.
    const double angle = 0.3, above = 20;
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)),
                     {-100, float(above) + 4.5f, -100}, {108, 0, 0}, {0, 0, 200});
    const DirectLight light = lit(scene, scenes::sun({0, -1, 0}, 1), cube(16), {8, angle, 2});
    for (int x = 0; x < 16; ++x) {
        double expected = 0, seen = 0;
        for (int i = 0; i < 100; ++i) {
            const double at =
                std::clamp((x + (i + 0.5) / 100 - 8) / (above * std::tan(0.5 * angle)), -1.0, 1.0);
            expected += 0.5 + (at * std::sqrt(1 - at * at) + std::asin(at)) / M_PI;
        }
        for (int z = 0; z < 16; ++z)
            seen += light.visibility[index(16, {x, 4, z})];
        EXPECT_NEAR(seen / 16, expected / 100, 0.01) << x;
    }
    // Its bands are those of a disc: the second falls short of a point's by about a^2 / 2.
    const DirectLight point = lit(nothing(), scenes::sun({0, -1, 0}, 1), cube(1), {4, 0.0, 2});
    const DirectLight disc = lit(nothing(), scenes::sun({0, -1, 0}, 1), cube(1), {4, angle, 2});
    EXPECT_NEAR(disc.sh[1][0].x / point.sh[1][0].x, 0.5 * (1 + std::cos(0.5 * angle)), 1e-5);
    EXPECT_EQ(disc.sh[0][0].x, point.sh[0][0].x);
}

/// The share of a disc that lies on one side of a line, x radii beyond its middle.
double beside_line(double x) {
    x = std::clamp(x, -1.0, 1.0);
    return 0.5 + (x * std::sqrt(1 - x * x) + std::asin(x)) / M_PI;
}

/// How far beyond the middle of the disc as which a sphere is seen from p the line through `edge`
/// along z lies, towards -x, in radii of the disc.
double line_on_disc(glm::dvec3 p, glm::dvec3 edge, glm::dvec3 middle, double radius) {
    const glm::dvec3 normal = glm::normalize(glm::cross(edge - p, glm::dvec3(0, 0, -1)));
    const glm::dvec3 axis = glm::normalize(middle - p);
    const double sine = glm::dot(normal, axis), disc = radius / glm::length(middle - p);
    return sine / std::sqrt(1 - sine * sine) * std::sqrt(1 - disc * disc) / disc;
}

TEST(Beams, ASphereHasAPenumbraBehindAnEdgeAndBehindAPlate) {
    // A lamp of radius 3 at a height of 60, edges at 30: the penumbra is 5 cells wide below.
    const glm::dvec3 middle(8.3, 60, 8);
    const double radius = 3;
    for (const float width : {400.0f, 2.0f}) { // of what shades, from x = 7 to its left
        Scene scene;
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {7 - width, 30, -100},
                         {width, 0, 0}, {0, 0, 200});
        BeamSettings settings{16, 0.0, 2};
        settings.lamp_radii = {{"*", radius}};
        const DirectLight light = lit(scene, scenes::point_light(middle, 1000), cube(16), settings);
        int partly = 0;
        for (int x = 0; x < 16; ++x) {
            double expected = 0, seen = 0;
            constexpr int n = 32;
            for (int z = 0; z < 16; ++z)
                for (int i = 0; i < n; ++i) {
                    const glm::dvec3 p(x + (i + 0.5) / n, 4 + (i * 13 % n + 0.5) / n, z + 0.5);
                    const double right = beside_line(-line_on_disc(p, {7, 30, 0}, middle, radius));
                    const double left =
                        beside_line(line_on_disc(p, {7 - double(width), 30, 0}, middle, radius));
                    expected += (right + left) / (16 * n);
                }
            for (int z = 0; z < 16; ++z)
                seen += light.visibility[index(16, {x, 4, z})] / 16.0;
            EXPECT_NEAR(seen, expected, 0.01) << width << ' ' << x;
            partly += expected > 0.05 && expected < 0.95;
        }
        EXPECT_GT(partly, 3);
    }
}

TEST(Beams, ASphereShinesAsOneOutsideAndAsItsSurfaceInside) {
    // Of all directions together 2 I / R^2 (1 - sqrt(1 - R^2 / r^2)), on what faces it I / r^2.
    const double h = 0.25, candela = 40, radius = 0.8;
    const glm::dvec3 middle(4.4 * h, 4.6 * h, 4.5 * h);
    Light lamp = scenes::point_light(middle, candela);
    lamp.name = "Lamp 1";
    BeamSettings settings;
    settings.lamp_radii = {{"*", 9.0}, {"Lamp*", radius}, {"Other", 7.0}};
    const DirectLight light = lit(nothing(), lamp, cube(9, h), settings);
    for (std::size_t cell = 0; cell < 729; ++cell) {
        const glm::ivec3 at(int(cell) % 9, int(cell) / 9 % 9, int(cell) / 81);
        double all = 0, facing = 0;
        constexpr int n = 6;
        for (int i = 0; i < n * n * n; ++i) {
            const glm::dvec3 p =
                (glm::dvec3(at) + (glm::dvec3(i % n, i / n % n, i / n / n) + 0.5) / double(n)) * h;
            const double r = std::max(glm::length(p - middle), radius);
            all += 2 * candela / (radius * radius) * (1 - std::sqrt(1 - radius * radius / (r * r)))
                   / (n * n * n);
            facing += candela / (r * r) / (n * n * n);
        }
        EXPECT_EQ(light.visibility[cell], 1.0f);
        const glm::dvec3 way = middle - (glm::dvec3(at) + 0.5) * h;
        EXPECT_NEAR(illuminance(light, cell), all, 0.02 * all)
            << at.x << ' ' << at.y << ' ' << at.z;
        if (glm::length(way) < 1.3 * radius)
            continue;
        // Band 1 holds the vector irradiance, sqrt(3 / 4 pi) times it.
        const glm::dvec3 vector(light.sh[3][cell].x, light.sh[1][cell].x, light.sh[2][cell].x);
        EXPECT_NEAR(glm::length(vector) / 0.4886025, facing, 0.01 * facing);
    }
}

TEST(Beams, WhatStandsInsideASphereHidesNothingOfIt) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), {7.5f, 7.5f, 7.5f},
                    {8.5f, 8.5f, 8.5f}, scenes::Facing::outward);
    const Light lamp = scenes::point_light({8, 8, 8}, 10);
    BeamSettings settings;
    const std::size_t beside = index(16, {11, 8, 8});
    EXPECT_EQ(lit(scene, lamp, cube(16), settings).visibility[beside], 0.0f);
    settings.lamp_radii = {{"*", 0.0}};
    EXPECT_EQ(lit(scene, lamp, cube(16), settings).visibility[beside], 0.0f);
    settings.lamp_radii = {{"*", 1.0}};
    EXPECT_EQ(lit(scene, lamp, cube(16), settings).visibility[beside], 1.0f);
    // One that holds the grid and all that is in it.
    settings.lamp_radii = {{"*", 100.0}};
    const DirectLight inside = lit(scene, lamp, cube(16), settings);
    for (std::size_t cell = 0; cell < inside.visibility.size(); ++cell) {
        EXPECT_EQ(inside.visibility[cell], 1.0f);
        if (glm::length(glm::dvec3(cell % 16, cell / 16 % 16, cell / 256) - 7.5) > 2) {
            EXPECT_NEAR(illuminance(inside, cell), 2 * 10 / 1e4, 1e-6);
        }
    }
}

TEST(Beams, WhatStandsBesideASphereHidesWhatRaysFind) {
    // A box just beside the sphere, where a plane across the light would be behind it.
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), {10.4f, 10.2f, 7},
                    {10.8f, 11, 9}, scenes::Facing::outward);
    const glm::dvec3 middle(8, 8, 8);
    const double radius = 3;
    BeamSettings settings{12, 0.0, 0};
    settings.lamp_radii = {{"*", radius}};
    const scene::Frame frame = cube(16);
    const visibility::Visibility visibility(scene, frame);
    const DirectLight light =
        medium::direct_light(scenes::point_light(middle, 1), visibility, frame, {}, settings);
    std::mt19937 random(5);
    std::uniform_real_distribution<double> any(0.0, 1.0);
    int partly = 0;
    for (const glm::ivec3 cell : {glm::ivec3(11, 10, 8), glm::ivec3(12, 10, 8),
                                  glm::ivec3(12, 11, 7), glm::ivec3(14, 11, 8)}) {
        double seen = 0;
        constexpr int n = 20000;
        for (int i = 0; i < n; ++i) { // a direction of the cap that the sphere is seen as
            const glm::dvec3 p =
                glm::dvec3(cell) + glm::dvec3(any(random), any(random), any(random));
            const glm::dvec3 axis = middle - p;
            const double r = glm::length(axis), least = std::sqrt(1 - radius * radius / (r * r));
            const double cosine = least + (1 - least) * any(random), turn = 2 * M_PI * any(random);
            const double sine = std::sqrt(1 - cosine * cosine);
            const glm::dvec3 u = glm::normalize(glm::cross(axis, glm::dvec3(0, 0, 1)));
            const glm::dvec3 v = glm::cross(axis / r, u);
            const double until = r * cosine - std::sqrt(radius * radius - r * r * sine * sine);
            seen +=
                double(
                    visibility
                        .filter({glm::vec3(p),
                                 glm::vec3(until
                                           * (cosine * axis / r
                                              + sine * (std::cos(turn) * u + std::sin(turn) * v)))})
                        .x)
                / n;
        }
        EXPECT_NEAR(light.visibility[index(16, cell)], seen, 0.02)
            << cell.x << ' ' << cell.y << ' ' << cell.z;
        partly += seen > 0.1 && seen < 0.9;
    }
    EXPECT_GT(partly, 2);
}

TEST(Beams, SurfacesSeeTheirShareOfASphere) {
    const glm::dvec3 middle(8.3, 60, 8);
    const double radius = 3;
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {-393, 30, -100},
                     {400, 0, 0}, {0, 0, 200});
    const visibility::Visibility visibility(scene, cube(16));
    std::vector<Light> lights{scenes::point_light(middle, 1000)};
    lights[0].is_static = true;
    BeamSettings settings;
    settings.lamp_radii = {{"*", radius}};
    for (float x = 0; x < 12; x += 0.5f) {
        const glm::vec3 p(x, 0.5f, 6);
        const double seen = beside_line(-line_on_disc(glm::dvec3(p), {7, 30, 0}, middle, radius));
        const glm::dvec3 way = middle - glm::dvec3(p);
        const double all = 1000 * way.y / std::pow(glm::length(way), 3);
        const auto lux = [&](const BeamSettings& sizes) {
            return double(
                medium::static_illuminance(lights, visibility, cube(16), p, {0, 1, 0}, sizes).x);
        };
        EXPECT_NEAR(lux(settings), seen * all, 0.04 * all) << x;
        EXPECT_NEAR(lux({}), seen > 0.5 ? all : 0, 1e-5 * all) << x;
    }
}

TEST(Beams, ASpotOfASizeHasASoftRim) {
    // A cone of a hard edge: a place has the light of what of the disc lies so that the way from
    // there is inside of the cone.
    const double outer = 0.2, radius = 3.5, candela = 100;
    const Light spot = scenes::spot_light({12, 40, 12}, {0, -1, 0}, candela, outer, outer);
    BeamSettings settings{12, 0.0, 1};
    settings.lamp_radii = {{"*", radius}};
    const DirectLight light = lit(nothing(), spot, cube(24), settings);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(0.0, 1.0);
    const double full = candela / (35 * 35.0);
    int partly = 0;
    for (int x = 12; x < 24; ++x) {
        double expected = 0, seen = 0;
        constexpr int n = 40000;
        for (int i = 0; i < n; ++i) {
            const glm::dvec3 p(x + any(random), 5 + any(random), 10 + 4 * any(random));
            const glm::dvec3 way = p - spot.position;
            const double r = glm::length(way), out = radius * std::sqrt(any(random));
            const double turn = 2 * M_PI * any(random);
            const glm::dvec3 u = glm::normalize(glm::cross(way, glm::dvec3(0, 0, 1)));
            const glm::dvec3 v = glm::cross(way / r, u);
            const glm::dvec3 from = way - out * (std::cos(turn) * u + std::sin(turn) * v);
            expected += -from.y > std::cos(outer) * glm::length(from) ? candela / (r * r * n) : 0;
        }
        for (int z = 10; z < 14; ++z)
            seen += illuminance(light, index(24, {x, 5, z})) / 4;
        EXPECT_NEAR(seen, expected, 0.015 * full) << x;
        partly += expected > 0.05 * full && expected < 0.8 * full;
    }
    EXPECT_GT(partly, 1);
}

/// A plate at a height of 12 metres with a slit from x = 7 on along z, turned around the middle of
/// the slit.
Scene plate_with_slit(float width, float turn) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    const float c = std::cos(turn), s = std::sin(turn);
    const glm::vec3 middle(7 + width / 2, 12, 8), along(s, 0, c), across(c, 0, -s);
    for (const float side : {-1.0f, 1.0f})
        scenes::add_quad(scene, grey, middle + side * (width / 2) * across - 50.0f * along,
                         side * 50.0f * across, 100.0f * along);
    return scene;
}

TEST(Beams, ShaftsStandBehindHolesThatAreNarrowEnough) {
    const double unit = 0.5; // 32 cells along an edge
    const scene::Frame frame{glm::dvec3(0), unit, glm::dvec3(32)};
    for (const float turn : {0.0f, 0.6f})
        for (const float width : {1.5f, 2.5f}) { // discs of 2 metres across
            SCOPED_TRACE(testing::Message() << width << ' ' << turn);
            const Scene scene = plate_with_slit(width, turn);
            const visibility::Visibility visibility(scene, frame);
            for (const Light& light : {scenes::sun({0, -1, 0}, 1), scenes::sun({0.5, -1, 0.2}, 1),
                                       scenes::point_light({8.2, 24, 8.1}, 1)}) {
                const DirectLight direct = medium::direct_light(light, visibility, frame, {}, {});
                const std::vector<float> shaft =
                    medium::shaft_share(light, visibility, frame, {}, 4, 1.0, direct.visibility);
                double lit = 0, in_shafts = 0, worst = 0;
                for (std::size_t cell = 0; cell < shaft.size(); ++cell) {
                    const bool below = cell / 32 % 32 < 24;
                    const float expected = below && width < 2 ? direct.visibility[cell] : 0.0f;
                    // A slanted plate closes the slit a little below it.
                    if (cell / 32 % 32 < 21 || cell / 32 % 32 >= 24)
                        worst = std::max(worst, double(std::abs(shaft[cell] - expected)));
                    lit += below ? double(direct.visibility[cell]) : 0;
                    in_shafts += double(shaft[cell]);
                }
                EXPECT_GT(lit, 500);
                if (width < 2)
                    EXPECT_GT(in_shafts, 0.93 * lit);
                else
                    EXPECT_EQ(in_shafts, 0);
                EXPECT_LT(worst, light.type == LightType::directional ? 1e-6 : 0.3);
            }
        }
}

TEST(Beams, WithoutHolesOrWithOpenSidesThereAreNoShafts) {
    // A plate whose one side is open, and beyond the grid a wall that leaves a wide gap.
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_quad(scene, grey, {-50, 12, -50}, {57, 0, 0}, {0, 0, 100});
    scenes::add_quad(scene, grey, {16.5f, 13, -50}, {60, 0, 0}, {0, 0, 100});
    const visibility::Visibility visibility(scene, cube(16));
    for (const Light& light : {scenes::sun({0.1, -1, 0}, 1), scenes::point_light({12, 30, 8}, 1)}) {
        const std::vector<float> none =
            medium::shaft_share(light, visibility, cube(16), {}, 4, 1.0);
        EXPECT_EQ(*std::ranges::max_element(none), 0.0f);
        const std::vector<float> open = lit(scene, light, cube(16)).visibility;
        EXPECT_EQ(none, medium::shaft_share(light, visibility, cube(16), {}, 4, 1.0, open));
        // Closed by more than the gap, whose one side lies beyond the grid.
        const std::vector<float> all = medium::shaft_share(light, visibility, cube(16), {}, 4, 6.0);
        EXPECT_GT(all[index(16, {12, 4, 8})], 0.9f);
        for (const float share : medium::shaft_share(light, visibility, cube(16), {}, 4, 0.0))
            EXPECT_EQ(share, 0.0f);
    }
}

TEST(Beams, ACellCountsAsFarAsItsWalls) {
    // Centres of cells lie on the floor: half of each is in the dark below it.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {-50, 3.5f, -50},
                     {0, 0, 100}, {100, 0, 0});
    const scene::Frame frame = cube(8);
    const visibility::Visibility visibility(scene, frame);
    const Light sun = scenes::sun({0.4, -1, 0.3}, 1);
    const std::vector<float> valid(512, 1.0f);
    const auto walls = visibility::find_walls(visibility, glm::ivec3(8), valid, 3, 2.0f);
    const std::size_t cell = index(8, {4, 3, 4});
    EXPECT_NEAR(medium::direct_light(sun, visibility, frame, {}, {8, 0.0, 1}).visibility[cell], 0.5,
                0.05);
    EXPECT_EQ(medium::direct_light(sun, visibility, frame, walls, {}).visibility[cell], 1.0f);
}

TEST(Beams, NoLightComesIntoAClosedRoom) {
    const Scene scene = scenes::furnace(4, 0.5f, 1);
    const scene::Frame frame{glm::dvec3(0.1), 0.5, glm::dvec3(7)};
    for (const Light& light : {scenes::sun({0.3, -1, 0.2}, 1), scenes::point_light({6, 2, 3}, 9)})
        for (const float share : lit(scene, light, frame).visibility)
            EXPECT_EQ(share, 0.0f);
}

TEST(Beams, SameBitsForAnyNumberOfThreads) {
    const Scene scene = scenes::cornell_box();
    const scene::Frame frame{glm::dvec3(-1, 0, -1), 0.1, glm::dvec3(20)};
    for (const Light& light :
         {scenes::sun({0.3, -1, -0.9}, 1), scenes::point_light({0.1, 1.8, 0.2}, 1)}) {
        DirectLight one, four;
        BeamSettings settings{4, 0.05, 2};
        settings.lamp_radii = {{"*", 0.05}};
        tbb::task_arena(1).execute([&] { one = lit(scene, light, frame, settings); });
        tbb::task_arena(4).execute([&] { four = lit(scene, light, frame, settings); });
        EXPECT_EQ(one.visibility, four.visibility);
        EXPECT_EQ(one.sh, four.sh);
        EXPECT_GT(one.steps, one.beams);
    }
}

} // namespace
} // namespace lpvbake
