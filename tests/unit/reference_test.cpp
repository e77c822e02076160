// The reference against closed forms and against quadrature that shares nothing with it.

#include "reference/reference.h"

#include "lpvbake/error.h"
#include "scene/sky.h"
#include "scenes.h"
#include "solver/occlusion.h"
#include "volume/compare.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <functional>

namespace lpvbake {
namespace {

constexpr double pi = glm::pi<double>();
const double y0 = 0.5 * std::sqrt(1.0 / pi), y1 = 0.5 * std::sqrt(3.0 / pi);

/// A cube of n^3 cells over [lo, lo + edge]^3.
Grid cube(glm::dvec3 lo, double edge, int n) {
    return {lo, edge / n, glm::ivec3(n)};
}

reference::ReferenceSettings settings_of(std::optional<int> bounces, uint64_t rays,
                                         uint64_t seed = 1) {
    reference::ReferenceSettings settings;
    settings.paths.bounces = bounces;
    settings.rays = rays;
    settings.seed = seed;
    return settings;
}

reference::Reference reference(const Scene& scene, const Grid& grid,
                               const reference::ReferenceSettings& settings) {
    Progress silent;
    return reference::make_reference(scene, grid, settings, silent);
}

/// How many stored numbers lie beyond three of their own standard errors.
struct Tally {
    int values = 0;
    int beyond = 0;

    /// `truth` gives the coefficients of a cell centre (metres). Single precision costs 1e-6.
    void add(const reference::Reference& r,
             const std::function<std::array<glm::dvec3, 4>(glm::dvec3)>& truth) {
        const Grid& grid = r.volume.grid;
        for (int z = 0; z < grid.dims.z; ++z)
            for (int y = 0; y < grid.dims.y; ++y)
                for (int x = 0; x < grid.dims.x; ++x) {
                    const size_t cell = grid.index({x, y, z});
                    const std::array<glm::dvec3, 4> expected = truth(grid.center({x, y, z}));
                    for (size_t k = 0; k < 4; ++k)
                        for (int c = 0; c < 3; ++c) {
                            const double off =
                                std::abs(double(r.volume.sh[k][cell][c]) - expected[k][c]);
                            const double floor = 1e-6 * (1e-30 + expected[0][c]);
                            ++values;
                            beyond += off > 3.0 * double(r.error.sh[k][cell][c]) + floor;
                        }
                }
    }
};

/// The furnace, turned so that no wall lies along an axis, and a grid inside.
Scene turned_furnace(float albedo, float emission = 1.0f) {
    Scene scene = scenes::furnace(2.0f, albedo, emission);
    glm::dmat4 turn = glm::rotate(glm::dmat4(1.0), 0.7, glm::dvec3(1, 2, 3));
    scene.instances[0].to_world = glm::translate(turn, glm::dvec3(-1.0));
    return scene;
}
const Grid inside_furnace = cube(glm::dvec3(-0.55), 1.1, 6);

/// Over all cells and directions, green.
double mean_luminance(const reference::Reference& r) {
    double sum = 0;
    for (const glm::vec3& c : r.volume.sh[0])
        sum += double(c.y) * y0 / double(r.volume.sh[0].size());
    return sum;
}

// ---------------------------------------------------------------- closed forms

TEST(Reference, FurnaceIsTheGeometricSeries) {
    Tally tally;
    for (const float albedo : {0.0f, 0.5f, 0.8f, 0.95f}) {
        const reference::Reference r =
            reference(turned_furnace(albedo), inside_furnace, settings_of(std::nullopt, 512));
        const double expected = 1.0 / (1.0 - double(albedo)) / y0;
        const auto truth = [&](glm::dvec3) {
            return std::array{glm::dvec3(expected), glm::dvec3(0), glm::dvec3(0), glm::dvec3(0)};
        };
        EXPECT_LT(r.noise, 0.05) << albedo;
        tally.add(r, truth);
        // Much tighter than any single cell: nothing is lost in corners.
        EXPECT_NEAR(mean_luminance(r) * (1.0 - double(albedo)), 1.0, 2e-3) << albedo;
    }
    EXPECT_LE(tally.beyond, 0.005 * tally.values) << tally.values;
    RecordProperty("beyond", std::to_string(tally.beyond) + " of " + std::to_string(tally.values));
}

TEST(Reference, BouncesCountReflections) {
    double expected = 0;
    for (int bounces = 0; bounces < 4; ++bounces) {
        expected += std::pow(0.5, bounces);
        const reference::Reference r =
            reference(turned_furnace(0.5f), inside_furnace, settings_of(bounces, 256));
        EXPECT_NEAR(mean_luminance(r) / expected, 1.0, 3e-3) << bounces;
    }
}

/// A sphere of radius 2, seen from inside, around (1, 2, 3).
Scene sphere(float albedo) {
    Scene scene;
    Mesh mesh;
    mesh.material = scenes::add_material(scene, glm::vec3(albedo));
    constexpr uint32_t rings = 80, spokes = 160;
    for (uint32_t i = 0; i <= rings; ++i)
        for (uint32_t j = 0; j <= spokes; ++j) {
            const double t = pi * i / rings, p = 2 * pi * (j % spokes) / spokes;
            mesh.positions.push_back(glm::dvec3(1, 2, 3)
                                     + 2.0
                                           * glm::dvec3(std::sin(t) * std::sin(p), std::cos(t),
                                                        std::sin(t) * std::cos(p)));
        }
    for (uint32_t i = 0; i < rings; ++i)
        for (uint32_t j = 0; j < spokes; ++j) {
            const uint32_t a = i * (spokes + 1) + j, b = a + spokes + 1;
            mesh.triangles.push_back({a, b + 1, b});
            mesh.triangles.push_back({a, a + 1, b + 1});
        }
    scene.meshes.push_back(mesh);
    scene.instances.push_back({0, glm::dmat4(1.0)});
    return scene;
}

TEST(Reference, PointLightInAnIntegratingSphere) {
    Scene scene = sphere(0.6f);
    scene.lights.push_back(scenes::point_light({1, 2, 3}, 40, {1.0f, 0.5f, 0.0f}));
    const Grid grid = cube({0, 1, 2}, 2.0, 3);
    const double direct = 40.0 / 4.0 / pi; // I / R^2 / pi
    for (const std::optional<int> bounces :
         {std::optional(1), std::optional(2), std::optional(3), std::optional<int>()}) {
        double series = 0;
        for (int k = 1; k <= bounces.value_or(60); ++k)
            series += std::pow(0.6, k);
        const reference::Reference r = reference(scene, grid, settings_of(bounces, 1024));
        EXPECT_LT(r.noise, 0.035);
        for (size_t i = 0; i < r.volume.sh[0].size(); ++i) {
            const glm::vec3 c = r.volume.sh[0][i];
            const double error = double(r.error.sh[0][i].x / c.x);
            ASSERT_NEAR(double(c.x) * y0 / (direct * series), 1.0, 4 * error + 5e-4);
            ASSERT_NEAR(c.y, 0.5f * c.x, 1e-5f * c.x);
            ASSERT_EQ(c.z, 0.0f);
        }
    }
}

/// A rectangle that faces up, its corners in turn.
const std::array<glm::dvec3, 4> patch{glm::dvec3(-0.8, 0.1, 0.9), glm::dvec3(1.2, 0.1, 0.9),
                                      glm::dvec3(1.2, 0.1, -0.7), glm::dvec3(-0.8, 0.1, -0.7)};

/// Coefficients of a patch of luminance 1 seen from x: the constant one from its solid angle (Van
/// Oosterom and Strackee 1983), the linear ones from Lambert's polygon formula, whose vector
/// sum of theta_i gamma_i / 2 gives a plane's irradiance by its product with the normal.
std::array<double, 4> patch_seen_from(glm::dvec3 x) {
    if (x.y <= patch[0].y)
        return {};
    std::array<glm::dvec3, 4> w;
    for (size_t i = 0; i < 4; ++i)
        w[i] = glm::normalize(patch[i] - x);
    const auto triangle = [](glm::dvec3 a, glm::dvec3 b, glm::dvec3 c) {
        return 2.0
               * std::atan2(std::abs(glm::dot(a, glm::cross(b, c))),
                            1.0 + glm::dot(a, b) + glm::dot(b, c) + glm::dot(c, a));
    };
    const double omega = triangle(w[0], w[1], w[2]) + triangle(w[0], w[2], w[3]);
    glm::dvec3 flux(0.0);
    for (size_t i = 0; i < 4; ++i) {
        const glm::dvec3 a = w[i], b = w[(i + 1) % 4];
        flux += 0.5 * std::acos(glm::dot(a, b)) * glm::normalize(glm::cross(b, a));
    }
    if (glm::dot(flux, w[0]) < 0.0)
        flux = -flux;
    return {y0 * omega, y1 * flux.y, y1 * flux.z, y1 * flux.x};
}

Scene patch_scene(glm::vec3 albedo, glm::vec3 emission) {
    Scene scene;
    const int material = scenes::add_material(scene, albedo, emission);
    scenes::add_quad(scene, material, patch[0], patch[1] - patch[0], patch[3] - patch[0]);
    return scene;
}

TEST(Reference, PatchAgreesWithItsPolygonFormFactor) {
    // Glowing, and lit by a sun at 60 degrees from its normal: luminance albedo E cos / pi.
    Scene lit = patch_scene({0.9f, 0.5f, 0.2f}, glm::vec3(0.0f));
    lit.lights.push_back(scenes::sun({std::sqrt(3.0), -1, 0}, 1000));
    const std::pair<Scene, glm::dvec3> cases[] = {
        {patch_scene(glm::vec3(0.5f), {7.0f, 3.0f, 1.0f}), {7, 3, 1}},
        {lit, glm::dvec3(0.9f, 0.5f, 0.2f) * 500.0 / pi}};
    Tally tally;
    uint64_t seed = 1;
    for (const auto& [scene, luminance] : cases) {
        const reference::Reference r =
            reference(scene, cube({-1.4, -0.6, -1.5}, 3.0, 9), settings_of(1, 8192, seed++));
        EXPECT_LT(r.noise, 0.03);
        tally.add(r, [&, l = luminance](glm::dvec3 x) {
            const std::array<double, 4> seen = patch_seen_from(x);
            return std::array{seen[0] * l, seen[1] * l, seen[2] * l, seen[3] * l};
        });
    }
    EXPECT_LE(tally.beyond, 0.005 * tally.values) << tally.values;
    RecordProperty("beyond", std::to_string(tally.beyond) + " of " + std::to_string(tally.values));
}

/// Coefficients above a floor y = 0 of half-edge 100 and the given luminance, by the midpoint rule
/// over the directions that look down.
std::array<double, 4> above_floor(glm::dvec3 x,
                                  const std::function<double(glm::dvec3)>& luminance) {
    constexpr int heights = 300, turns = 300;
    std::array<double, 4> sum{};
    for (int i = 0; i < heights; ++i)
        for (int j = 0; j < turns; ++j) {
            const double down = (i + 0.5) / heights, turn = 2 * pi * (j + 0.5) / turns;
            const double across = std::sqrt(1 - down * down);
            const glm::dvec3 w{across * std::cos(turn), -down, across * std::sin(turn)};
            const glm::dvec3 p = x + x.y / down * w;
            if (std::max(std::abs(p.x), std::abs(p.z)) > 100)
                continue;
            const double part = luminance(p) * 2 * pi / heights / turns;
            sum[0] += y0 * part;
            sum[1] += y1 * w.y * part;
            sum[2] += y1 * w.z * part;
            sum[3] += y1 * w.x * part;
        }
    return sum;
}

TEST(Reference, PunctualLightsOverAFloorAgreeWithQuadrature) {
    const glm::dvec3 place{0.3, 1.4, -0.2};
    struct Case {
        const char* name;
        Light light;
        std::function<double(glm::dvec3)> illuminance;
    };
    const auto point = [&](glm::dvec3 p) {
        const double d = glm::distance(p, place);
        return 50.0 * place.y / (d * d * d);
    };
    std::vector<Case> cases{{"point", scenes::point_light(place, 50), point}};
    cases.push_back({"range", scenes::point_light(place, 50), [&](glm::dvec3 p) {
                         const double share = glm::distance(p, place) / 2.5;
                         return point(p) * std::max(0.0, 1 - share * share * share * share);
                     }});
    cases.back().light.range = 2.5;
    const glm::dvec3 axis = glm::normalize(glm::dvec3(0.4, -1, 0.2));
    cases.push_back({"spot", scenes::spot_light(place, axis, 50, 0.3, 0.9), [&](glm::dvec3 p) {
                         const double angle = std::acos(glm::dot(glm::normalize(p - place), axis));
                         const double ramp = std::clamp((std::cos(angle) - std::cos(0.9))
                                                            / (std::cos(0.3) - std::cos(0.9)),
                                                        0.0, 1.0);
                         return point(p) * ramp * ramp;
                     }});
    for (const Case& c : cases) {
        Scene scene = scenes::floor_quad(200, glm::vec3(0.5f));
        scene.lights.push_back(c.light);
        Tally own;
        const auto truth = [&](glm::dvec3 x) {
            const std::array<double, 4> floor =
                above_floor(x, [&](glm::dvec3 p) { return 0.5 / pi * c.illuminance(p); });
            std::array<glm::dvec3, 4> all;
            for (size_t k = 0; k < 4; ++k)
                all[k] = glm::dvec3(floor[k]);
            return all;
        };
        for (uint64_t seed = 1; seed <= 4; ++seed) {
            const reference::Reference r =
                reference(scene, cube({-1, 0.1, -1}, 2.0, 3), settings_of(1, 8192, seed));
            own.add(r, truth);
            EXPECT_LT(r.noise, 0.03) << c.name;
        }
        EXPECT_LE(own.beyond, 0.01 * own.values) << c.name;
    }
}

/// A lamp of 1 cm above a table in a dark hall of 20 m: half of its light is on a spot that is a
/// millionth of what a cell sees.
TEST(Reference, WhatSmallLampsLightIsAimedAt) {
    Scene scene = scenes::furnace(20.0f, 0.5f, 0.0f);
    scene.lights.push_back(scenes::point_light({7, 0.01, 7}, 10));
    const reference::Reference r = reference(scene, cube({2, 2, 2}, 10.0, 3), settings_of(1, 1024));
    EXPECT_LT(r.noise, 0.08);
    // Seen from afar the spot is a lamp of cosine that gives half the flux times the albedo.
    const glm::dvec3 way = r.volume.grid.center({0, 2, 0}) - glm::dvec3(7, 0, 7);
    const double spot = 0.5 * (2 * pi * 10) / pi * (way.y / glm::length(way)) / glm::dot(way, way);
    const double all = double(r.volume.sh[0][r.volume.grid.index({0, 2, 0})].x) / y0 / (4 * pi);
    EXPECT_GT(all * 4 * pi, spot);
    EXPECT_LT(all * 4 * pi, 2 * spot);
}

/// A lamp of 1 mm above a plate, seen from below it: what the lamp shines on beside it, which no
/// ray from the ceiling would find, comes from there.
TEST(Reference, WhatIsBesideALampIsAimedAtFromSurfacesToo) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.8f), glm::vec3(0.0f));
    scene.materials[size_t(grey)].double_sided = true;
    scenes::add_quad(scene, grey, {-1, 0, -1}, {2, 0, 0}, {0, 0, 2});
    scenes::add_quad(scene, grey, {-10, 4, -10}, {20, 0, 0}, {0, 0, 20});
    scene.lights.push_back(scenes::point_light({0, 0.001, 0}, 10));
    const reference::Reference r =
        reference(scene, cube({2.5, -1, -0.5}, 1.0, 1), settings_of(2, 4096));
    EXPECT_LT(r.noise, 0.03);
    // The ceiling has the lamp's light, and that of the spot: a lamp of cosine of half the flux.
    double sum = 0.0;
    const double step = 0.02;
    for (double x = -10 + step / 2; x < 10; x += step)
        for (double z = -10 + step / 2; z < 10; z += step) {
            const double square = x * x + 16 + z * z, cosine = 4 / std::sqrt(square);
            const double illuminance = 10 * cosine / square * (1 + 2 * 0.8 * cosine);
            const glm::dvec3 way(x - 3, 4.5, z);
            const double far = glm::dot(way, way);
            sum += 0.8 / pi * illuminance * (way.y / std::sqrt(far)) / far * step * step;
        }
    EXPECT_NEAR(double(r.volume.sh[0][0].x), y0 * sum, 0.02 * y0 * sum);
}

// ---------------------------------------------------------------- surfaces

TEST(Reference, BlendedSurfacesReflectAndTransmitByTheirAlpha) {
    // Inside a black room of luminance 1 a box of alpha a, albedo r and emission e, seen from
    // within: L = a e + a r L + (1 - a).
    Scene scene = scenes::furnace(4.0f, 0.0f, 1.0f);
    const int glass = scenes::add_material(scene, glm::vec3(0.8f), glm::vec3(3.0f));
    scene.materials[size_t(glass)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(glass)].base_color.a = 0.25f;
    scenes::add_box(scene, glass, glm::vec3(1.0f), glm::vec3(3.0f), scenes::Facing::inward);
    const reference::Reference r =
        reference(scene, cube(glm::dvec3(1.2), 1.6, 3), settings_of(std::nullopt, 4096));
    EXPECT_NEAR(mean_luminance(r), (0.25 * 3 + 0.75) / (1 - 0.25 * 0.8), 0.01);
}

TEST(Reference, FindsWhatATextureLights) {
    // A wall with four windows in its texture, or with four quads before it.
    const auto wall = [](bool texture) {
        Scene scene;
        const int grey = scenes::add_material(scene, glm::vec3(0.4f));
        const int lamp = scenes::add_material(scene, glm::vec3(0.4f), glm::vec3(200.0f));
        scenes::add_quad(scene, texture ? lamp : grey, {-8, 0, 0}, {16, 0, 0}, {0, 8, 0});
        Image image{"windows", 512, 256, std::vector<uint8_t>(4 * 512 * 256, 0)};
        for (const glm::ivec2 at : {glm::ivec2(61, 40), {330, 40}, {61, 170}, {331, 170}}) {
            for (int y = at.y; y < at.y + 21; ++y)
                for (int x = at.x; x < at.x + 13; ++x)
                    for (int c = 0; c < 4; ++c)
                        image.rgba[size_t(4 * (512 * y + x) + c)] = 255;
            if (!texture)
                scenes::add_quad(scene, lamp,
                                 glm::vec3(float(at.x) / 32.0f - 8.0f, float(at.y) / 32.0f, 1e-3f),
                                 {13 / 32.0f, 0, 0}, {0, 21 / 32.0f, 0});
        }
        if (texture) {
            scene.images.push_back(image);
            scene.textures.push_back({0, Wrap::repeat, Wrap::repeat, false});
            scene.materials[size_t(lamp)].emission_texture = 0;
            scene.meshes[0].uv_emission = scene.meshes[0].uv;
        }
        return scene;
    };
    const Grid grid = volume::fit_grid({-4, 1, 0.5}, {4, 7, 4}, {6, 0.0, 1});
    const reference::Reference of_texture = reference(wall(true), grid, settings_of(0, 4096));
    const reference::Reference of_quads = reference(wall(false), grid, settings_of(0, 4096));
    EXPECT_NEAR(mean_luminance(of_texture) / mean_luminance(of_quads), 1.0, 0.01);
    EXPECT_LT(of_texture.noise, 0.02); // that of the quads is 0.005
}

TEST(Reference, DuplicateEmittersGlowOnce) {
    // Every triangle of the furnace twice, each of the copies with some of zero area.
    Scene scene = turned_furnace(0.5f);
    Mesh& mesh = scene.meshes[0];
    const size_t count = mesh.triangles.size();
    for (size_t i = 0; i < count; ++i) {
        mesh.triangles.push_back(mesh.triangles[i]);
        mesh.triangles.push_back(glm::uvec3(mesh.triangles[i].x));
    }
    scene.instances.push_back(scene.instances[0]);
    EXPECT_NEAR(mean_luminance(reference(scene, inside_furnace, settings_of(std::nullopt, 256))),
                2.0, 0.01);
}

TEST(Reference, SmallLampsAreAimedAt) {
    // A lamp that one ray in 10^6 would meet, direct and after one reflection from the floor.
    Scene scene = scenes::floor_quad(200, glm::vec3(0.5f));
    const int lamp = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(1e6f));
    const glm::dvec3 place{0, 2, 0};
    const double area = 0.004 * 0.004, intensity = 1e6 * area; // along its normal
    scenes::add_quad(scene, lamp, {-0.002f, 2, -0.002f}, {0.004f, 0, 0}, {0, 0, 0.004f});
    const Grid grid = cube({-0.6, 0.5, -0.5}, 1, 3);
    const reference::Reference r = reference(scene, grid, settings_of(1, 2048));
    EXPECT_LT(r.noise, 0.035);
    for (const glm::ivec3 c : {glm::ivec3(0, 0, 0), glm::ivec3(1, 1, 1), glm::ivec3(2, 0, 1)}) {
        const glm::dvec3 x = grid.center(c), w = glm::normalize(place - x);
        std::array<double, 4> expected = above_floor(x, [&](glm::dvec3 p) {
            const glm::dvec3 way = place - p;
            const double d2 = glm::dot(way, way);
            return 0.5 / pi * intensity * way.y * way.y / (d2 * d2);
        });
        const double direct = intensity * w.y / glm::dot(place - x, place - x);
        const double basis[] = {y0, y1 * w.y, y1 * w.z, y1 * w.x};
        for (size_t k = 0; k < 4; ++k)
            EXPECT_NEAR(r.volume.sh[k][grid.index(c)].x, expected[k] + direct * basis[k],
                        0.01 * direct * y0)
                << k;
    }
}

TEST(Reference, BacksAreBlackOrCulledAndDoubleSidesGlow) {
    // A glowing quad below the grid, facing away, and a glowing room's wall far below it.
    const auto seen = [](bool double_sided, bool cull) {
        Scene scene;
        const int quad =
            scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(1.0f), double_sided);
        const int wall = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(4.0f));
        scenes::add_quad(scene, quad, {-500, 0, -500}, {1000, 0, 0}, {0, 0, 1000});  // faces down
        scenes::add_quad(scene, wall, {-500, -1, 500}, {1000, 0, 0}, {0, 0, -1000}); // faces up
        scene.rules.cull_backfaces = cull;
        const reference::Reference r =
            reference(scene, cube({-1, 0.5, -1}, 1, 3), settings_of(0, 1024));
        return double(r.volume.sh[0][0].x) * y0 * 2; // over the half that is not empty
    };
    EXPECT_EQ(seen(false, false), 0.0);
    EXPECT_NEAR(seen(true, false), 1.0, 0.01);
    EXPECT_NEAR(seen(true, true), 1.0, 0.01);
    EXPECT_NEAR(seen(false, true), 4.0, 0.04);
}

TEST(Reference, FrameDoesNotMatter) {
    // The same box at the origin, a thousand kilometres away, and of a tenth of a millimetre.
    const auto l0 = [](glm::dvec3 offset, double scale) {
        Scene scene = turned_furnace(0.5f);
        glm::dmat4& placed = scene.instances[0].to_world;
        placed = glm::scale(glm::dmat4(1.0), glm::dvec3(scale)) * placed;
        placed[3] += glm::dvec4(offset, 0.0);
        const reference::Reference r =
            reference(scene, cube(offset - 0.5 * scale, scale, 3), settings_of(std::nullopt, 256));
        return r.volume.sh;
    };
    const auto here = l0({0, 0, 0}, 1);
    for (const auto& there : {l0({1e6, -1e6, 1e6}, 1), l0({0, 0, 0}, 1e-4), l0({0, 0, 0}, 1e4)})
        for (size_t k = 0; k < 4; ++k)
            for (size_t i = 0; i < there[k].size(); ++i)
                ASSERT_NEAR(there[k][i].x, here[k][i].x, 0.02);
}

// ---------------------------------------------------------------- statistics

TEST(Reference, StatedErrorIsTheSpreadOverSeeds) {
    Scene scene = scenes::cornell_box_with_point();
    const int glow = scenes::add_material(scene, glm::vec3(0.2f), glm::vec3(30.0f));
    scenes::add_quad(scene, glow, {-0.9f, 0.3f, -0.9f}, {0, 0, 0.6f}, {0, -0.25f, 0});
    const Grid grid = volume::fit_grid({-1, 0, -1}, {1, 2, 1}, {8, 0.0, 1});
    double spread[2], stated[2];
    for (int doubled = 0; doubled < 2; ++doubled) {
        constexpr int seeds = 16;
        std::vector<glm::dvec3> sum(4 * grid.size()), squares(4 * grid.size());
        stated[doubled] = 0;
        size_t n = 0;
        for (int seed = 0; seed < seeds; ++seed) {
            reference::ReferenceSettings settings =
                settings_of(2, doubled ? 512 : 256, uint64_t(seed));
            const reference::Reference r = reference(scene, grid, settings);
            n = 0;
            for (size_t k = 0; k < 4; ++k)
                for (size_t i = 0; i < grid.size(); ++i, ++n) {
                    const glm::dvec3 value{r.volume.sh[k][i]}, error{r.error.sh[k][i]};
                    sum[n] += value;
                    squares[n] += value * value;
                    stated[doubled] += glm::dot(error, error) / seeds;
                }
        }
        spread[doubled] = 0;
        for (size_t i = 0; i < n; ++i) {
            const glm::dvec3 off = squares[i] - sum[i] * sum[i] / double(seeds);
            spread[doubled] += (off.x + off.y + off.z) / (seeds - 1);
        }
        EXPECT_NEAR(std::sqrt(stated[doubled] / spread[doubled]), 1.0, 0.2);
        RecordProperty(doubled ? "ratio512" : "ratio256",
                       std::to_string(std::sqrt(stated[doubled] / spread[doubled])));
    }
    // What the rays after the first are drawn from is stratified, so that twice as many give more
    // than half the variance; the estimates of both scatter by about a percent.
    EXPECT_LT(spread[1], 0.5 * spread[0]);
    EXPECT_LT(stated[1], 0.5 * stated[0]);
    RecordProperty("spread_ratio", std::to_string(spread[0] / spread[1]));
    RecordProperty("stated_ratio", std::to_string(stated[0] / stated[1]));
}

TEST(Reference, SkyComesFromWhereNothingIs) {
    // Half of what a cell high above a wide floor sees is the sky, the other half what the floor
    // reflects of it.
    Scene scene = scenes::floor_quad(1e4f, glm::vec3(0.25f));
    scene.sky.luminance = {1, 2, 4};
    const Grid grid = cube(glm::dvec3(-1, 1, -1), 2, 2);
    for (const int bounces : {0, 1, 2}) {
        const reference::Reference r = reference(scene, grid, settings_of(bounces, 4096));
        const double below = bounces == 0 ? 0.0 : 0.25;
        EXPECT_NEAR(r.volume.sh[0][0].y, 2 * y0 * 2 * pi * (1 + below), 0.02);
        EXPECT_NEAR(r.volume.sh[1][0].z, 4 * y1 * pi * (1 - below), 0.05);
        EXPECT_NE(r.volume.metadata.at("content").find("sky"), std::string::npos);
    }
}

TEST(Reference, ASmallSunInAPictureIsAimedAt) {
    // A texel of 5.6e-5 sr over a wide floor: pi times what the floor reflects is its illuminance.
    constexpr int width = 512, height = 256;
    std::vector<glm::vec3> texels(size_t(width * height), glm::vec3(1.0f));
    const int row = 40;
    texels[size_t(row * width + 100)] = glm::vec3(1e6f);
    Scene scene = scenes::floor_quad(1e4f, glm::vec3(0.25f));
    scene.sky = scene::make_sky(width, height, texels, 0.0);
    const double top = pi * row / height, bottom = pi * (row + 1) / height;
    const double sun = 1e6 * 2 * pi / width * (std::cos(top) - std::cos(bottom));
    const double sun_lux =
        1e6 * pi / width * (std::pow(std::cos(top), 2) - std::pow(std::cos(bottom), 2));
    const Grid grid = cube(glm::dvec3(-1, 1, -1), 2, 2);
    const reference::Reference r = reference(scene, grid, settings_of(1, 4096));
    const double expected = y0 * (sun + 2 * pi + 2 * pi * 0.25 / pi * (sun_lux + pi));
    EXPECT_NEAR(r.volume.sh[0][0].y / expected, 1.0, 0.01);
    EXPECT_LT(r.noise, 0.035);
}

TEST(Reference, StopsAtTheWantedNoise) {
    const Scene scene = scenes::cornell_box_with_point();
    const Grid grid = volume::fit_grid({-1, 0, -1}, {1, 2, 1}, {8, 0.0, 1});
    reference::ReferenceSettings settings = settings_of(1, 1 << 20);
    settings.noise = 0.06;
    const reference::Reference r = reference(scene, grid, settings);
    EXPECT_LE(r.noise, 0.06);
    EXPECT_GT(r.noise, 0.06 / 6); // it was not far beyond
    EXPECT_LT(r.rays, settings.rays);
    EXPECT_TRUE(r.warnings.empty());
    EXPECT_EQ(r.volume.metadata.at("rays"), std::to_string(r.rays));
    settings.rays = 500; // 256, then what is left of 512
    settings.noise = 1e-4;
    const reference::Reference cut = reference(scene, grid, settings);
    EXPECT_EQ(cut.rays, 512u);
    ASSERT_EQ(cut.warnings.size(), 1u);
    EXPECT_NE(cut.warnings[0].find("`rays`"), std::string::npos);
}

TEST(Reference, SameBitsForAnyNumberOfThreads) {
    const Scene scene = scenes::cornell_box_with_sun();
    const Grid grid = volume::fit_grid({-1, 0, -1}, {1, 2, 1}, {9, 0.0, 1});
    const auto with_threads = [&](size_t threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        return reference(scene, grid, settings_of(std::nullopt, 128));
    };
    const reference::Reference one = with_threads(1), two = with_threads(2), five = with_threads(5);
    EXPECT_TRUE(one.volume.sh == two.volume.sh);
    EXPECT_TRUE(one.error.sh == two.error.sh);
    EXPECT_TRUE(one.volume.sh == five.volume.sh);
    EXPECT_EQ(one.volume.metadata, two.volume.metadata);
    EXPECT_EQ(one.traced, five.traced);
    const reference::Reference other = reference(scene, grid, settings_of(std::nullopt, 128, 2));
    EXPECT_TRUE(one.volume.sh != other.volume.sh);
}

// ---------------------------------------------------------------- cells

TEST(Reference, ProbesAreCellsOfTheWholeReference) {
    const Scene scene = scenes::cornell_box_with_point();
    const Grid grid = volume::fit_grid({-1, 0, -1}, {1, 2, 1}, {12, 0.0, 1});
    const reference::Reference all = reference(scene, grid, settings_of(1, 64));
    reference::ReferenceSettings settings = settings_of(1, 64);
    settings.probes = 100;
    const reference::Reference some = reference(scene, grid, settings);
    EXPECT_EQ(some.probes, 100u);
    EXPECT_EQ(some.volume.metadata.at("probes"), "100");
    const scene::Frame frame{grid.origin, grid.cell, glm::dvec3(grid.dims)};
    EXPECT_EQ(all.volume.validity,
              solver::trace_links(visibility::Visibility(scene, frame), grid).validity);
    int evaluated = 0;
    for (size_t i = 0; i < grid.size(); ++i) {
        if (some.volume.validity[i] == 0.0f) {
            EXPECT_EQ(some.volume.sh[0][i], glm::vec3(0.0f));
            continue;
        }
        ++evaluated;
        EXPECT_EQ(all.volume.validity[i], 1.0f);
        for (size_t k = 0; k < 4; ++k)
            EXPECT_EQ(some.volume.sh[k][i], all.volume.sh[k][i]);
    }
    EXPECT_EQ(evaluated, 100);
    settings.seed = 7;
    EXPECT_NE(reference(scene, grid, settings).volume.validity, some.volume.validity);
    settings.probes = 1'000'000;
    const reference::Reference most = reference(scene, grid, settings);
    EXPECT_EQ(most.volume.validity, all.volume.validity);
    EXPECT_EQ(most.warnings.size(), 1u);
}

TEST(Reference, SecondOrderAddsABand) {
    const Scene scene = patch_scene(glm::vec3(0.0f), glm::vec3(1.0f));
    const Grid grid = cube({-1.4, 0.2, -1.5}, 3.0, 3);
    const reference::Reference first = reference(scene, grid, settings_of(0, 4096));
    reference::ReferenceSettings settings = settings_of(0, 4096);
    settings.sh_order = 2;
    const reference::Reference second = reference(scene, grid, settings);
    ASSERT_EQ(second.volume.sh.size(), 9u);
    EXPECT_EQ(second.volume.sh_order, 2);
    for (size_t k = 0; k < 4; ++k)
        EXPECT_EQ(first.volume.sh[k], second.volume.sh[k]);
    // Just above the middle of a wide floor: Y_20 of the lower half-space along y, by hand.
    Scene floor = scenes::floor_quad(1e3f, glm::vec3(0.0f));
    floor.materials[0].emission = glm::vec3(1.0f);
    const reference::Reference half = reference(floor, cube({-0.5, 0.05, -0.5}, 1.0, 3), settings);
    EXPECT_NEAR(half.volume.sh[1][0].x, -y1 * pi, 0.03);
    EXPECT_NEAR(half.volume.sh[6][0].x, 0.0, 0.03);
    EXPECT_NEAR(half.volume.sh[8][0].x, 0.0, 0.03);
}

// ---------------------------------------------------------------- irradiance

TEST(Reference, IrradianceIsNotCutToTheBands) {
    // Half of what a plane sees is the patch's, by its form factor; SH L1 is far from it.
    const Scene scene = patch_scene(glm::vec3(0.5f), {7.0f, 3.0f, 1.0f});
    const scene::Frame frame;
    const visibility::Visibility visibility(scene, frame);
    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    std::vector<glm::dvec3> own;
    for (int i = 0; i < 300; ++i) {
        points.push_back({-1.5f + 0.01f * float(i), 0.3f + 0.002f * float(i), 0.2f});
        keys.push_back(uint64_t(i));
        own.push_back(volume::neighbour_normals()[size_t(i) % 26]);
    }
    reference::ReferenceSettings settings = settings_of(0, 2048);
    Progress silent;
    const reference::ProbeField field =
        reference::trace_probes(scene, visibility, frame, points, keys, settings, silent,
                                {volume::neighbour_normals(), own});
    ASSERT_EQ(field.irradiance.size(), 26u);
    ASSERT_EQ(field.own_irradiance.size(), points.size());
    const size_t down = 10; // (0, -1, 0): the patch lies wholly on its side
    ASSERT_NEAR(volume::neighbour_normals()[down].y, -1.0, 1e-12);
    int beyond = 0;
    double off_bands = 0, off_rays = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        const std::array<double, 4> seen = patch_seen_from(points[i]);
        const double expected = -7.0 * seen[1] / y1;
        const double off = std::abs(double(field.irradiance[down][i].x) - expected);
        beyond += off > 3.0 * double(field.irradiance_error[down][i].x);
        off_rays += off;
        off_bands += std::abs(pi * y0 * double(field.sh[0][i].x)
                              - 2 * pi / 3 * y1 * double(field.sh[1][i].x) - expected);
        // What is asked for alone and what is asked for everywhere are summed alike.
        EXPECT_EQ(field.own_irradiance[i], field.irradiance[i % 26][i]);
        EXPECT_EQ(field.own_irradiance_error[i], field.irradiance_error[i % 26][i]);
    }
    EXPECT_LE(beyond, 4);
    EXPECT_LT(10 * off_rays, off_bands);

    // The rest has the same bits without.
    const reference::ProbeField bare =
        reference::trace_probes(scene, visibility, frame, points, keys, settings, silent);
    EXPECT_TRUE(bare.irradiance.empty());
    EXPECT_TRUE(bare.own_irradiance.empty());
    EXPECT_EQ(bare.sh, field.sh);
    EXPECT_EQ(bare.error, field.error);
    EXPECT_EQ(bare.point_noise, field.point_noise);
}

TEST(Reference, FurnaceIlluminatesEveryPlaneAlike) {
    const Scene scene = turned_furnace(0.8f);
    const scene::Frame frame;
    const visibility::Visibility visibility(scene, frame);
    const std::vector<glm::vec3> points{{0.1f, 0.2f, -0.3f}, {-0.5f, 0.0f, 0.4f}};
    const std::vector<uint64_t> keys{1, 2};
    const std::vector<glm::dvec3> own{glm::normalize(glm::dvec3(1, 5, -2)), glm::dvec3(0, 0, 1)};
    Progress silent;
    const reference::ProbeField field = reference::trace_probes(
        scene, visibility, frame, points, keys, settings_of(std::nullopt, 4096), silent,
        {volume::neighbour_normals(), own});
    const double expected = pi / (1 - double(0.8f));
    for (size_t i = 0; i < points.size(); ++i) {
        EXPECT_LT(field.own_irradiance_error[i].x, 0.02 * expected);
        EXPECT_NEAR(field.own_irradiance[i].x, expected, 4 * field.own_irradiance_error[i].x);
        for (size_t n = 0; n < 26; ++n)
            EXPECT_NEAR(field.irradiance[n][i].y, expected, 4 * field.irradiance_error[n][i].y);
    }
}

// ---------------------------------------------------------------- refusals

void expect_refusal(const Scene& scene, const reference::ReferenceSettings& settings,
                    const char* text) {
    try {
        reference(scene, cube(glm::dvec3(-0.5), 1.0, 3), settings);
        ADD_FAILURE() << "accepted: " << text;
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::invalid);
        EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
    }
}

TEST(Reference, ClosedSceneOfAlbedoOneIsRefused) {
    Scene scene = turned_furnace(1.0f);
    scene.rules.max_albedo = 1.0f;
    expect_refusal(scene, settings_of(std::nullopt, 64), "material 0 of mesh 0; set `max_albedo`");
    const reference::Reference finite = reference(scene, inside_furnace, settings_of(3, 256));
    EXPECT_NEAR(mean_luminance(finite), 4.0, 0.02);
    // Open, it has an answer.
    Scene open = scenes::cornell_box_with_point();
    open.rules.max_albedo = 1.0f;
    for (Material& material : open.materials)
        material.base_color = glm::vec4(1.0f);
    const Grid grid = volume::fit_grid({-1, 0, -1}, {1, 2, 1}, {5, 0.0, 1});
    EXPECT_LT(reference(open, grid, settings_of(std::nullopt, 256)).noise, 0.2);
}

TEST(Reference, ScenesWithoutAnswerAreRefused) {
    expect_refusal(Scene{}, settings_of(1, 64), "no triangles");
    expect_refusal(scenes::cornell_box(), settings_of(1, 64), "`lights`");
    expect_refusal(scenes::cornell_box_with_point(), settings_of(0, 64), "`bounces`");
    reference::ReferenceSettings settings = settings_of(1, 64);
    settings.paths.emitters = false;
    expect_refusal(scenes::furnace(2, 0.5f, 1), settings, "`lights`");
    Scene solid; // its inside
    scenes::add_box(solid, scenes::add_material(solid, glm::vec3(0.5f)), glm::vec3(-1),
                    glm::vec3(1), scenes::Facing::outward);
    solid.lights.push_back(scenes::sun({0, -1, 0}, 1));
    settings = settings_of(1, 64);
    settings.probes = 5;
    expect_refusal(solid, settings, "outside geometry");
}

} // namespace
} // namespace lpvbake
