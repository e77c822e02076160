#include "surface/lit_surfaces.h"

#include "lpvbake/error.h"
#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

namespace lpvbake {
namespace {

const scene::Frame frame{glm::dvec3(0.0), 1.0, glm::dvec3(8.0)};

surface::LitSurfaces light(const Scene& scene, std::optional<int> bounces,
                           const scene::Frame& f = frame) {
    Progress silent;
    const visibility::Visibility visibility(scene, f);
    surface::LightingSettings settings;
    settings.bounces = bounces;
    settings.rays = 1 << 17;
    return surface::light_surfaces(scene, visibility, f, settings, silent);
}

/// Mean luminance leaving the fronts, by area.
double mean_front(const surface::LitSurfaces& lit) {
    double sum = 0.0, area = 0.0;
    for (size_t i = 0; i < lit.patches.size(); ++i) {
        sum += double(lit.patches[i].area) * double(lit.luminance[2 * i].y);
        area += double(lit.patches[i].area);
    }
    return sum / area;
}

/// Mean luminance leaving both sides, by area.
double mean_front_and_back(const surface::LitSurfaces& lit) {
    double sum = 0.0, area = 0.0;
    for (size_t i = 0; i < lit.luminance.size(); ++i) {
        sum += double(lit.patches[i / 2].area) * double(lit.luminance[i].y);
        area += double(lit.patches[i / 2].area);
    }
    return sum / area;
}

TEST(LitSurfaces, FurnaceIsAGeometricSeries) {
    for (const float albedo : {0.0f, 0.5f, 0.8f, 0.95f}) {
        const Scene scene = scenes::furnace(8.0f, albedo, 1.0f);
        double series = 0.0;
        for (int bounces = 0; bounces < 4; ++bounces) {
            series += std::pow(double(albedo), bounces);
            EXPECT_NEAR(mean_front(light(scene, bounces)) / series, 1.0, 5e-3)
                << albedo << " " << bounces;
        }
        const surface::LitSurfaces all = light(scene, std::nullopt);
        EXPECT_NEAR(mean_front(all) * (1.0 - double(albedo)), 1.0, 1e-2) << albedo;
        EXPECT_LE(all.residual, 1e-4);
    }
}

TEST(LitSurfaces, AClosedSceneOfAlbedoOneIsRefused) {
    // A white lamp shade in an open grey room: it is what has no end.
    Scene scene = scenes::furnace(8.0f, 0.5f, 0.0f);
    scene.rules.max_albedo = 1.0f;
    const int white = scenes::add_material(scene, glm::vec3(1.0f));
    scene.materials[size_t(white)].name = "shade";
    scenes::add_box(scene, white, {2, 2, 2}, {5, 4, 3}, scenes::Facing::inward);
    scene.lights.push_back(scenes::point_light({3, 3, 2.5}, 10.0));
    try {
        light(scene, std::nullopt);
        ADD_FAILURE() << "it ended";
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::invalid);
        EXPECT_NE(std::string(error.what()).find("\"shade\""), std::string::npos) << error.what();
    }
    scene.materials[size_t(white)].base_color = glm::vec4(0.98f, 0.9f, 0.97f, 1.0f);
    EXPECT_LE(light(scene, std::nullopt).residual, 1e-4);
    // Open on one side it ends, too.
    scene.materials[size_t(white)].base_color = glm::vec4(1.0f);
    scene.meshes.back().triangles.resize(10);
    EXPECT_LE(light(scene, std::nullopt).residual, 1e-4);
}

TEST(LitSurfaces, WhiteEnclosuresAreLitAtAnyResolution) {
    // A closed box around a light, of any shape and turn. What leaves it is what is absorbed:
    // nothing escapes, so that the sum of all orders is known from the first, but for the noise of
    // rays.
    std::mt19937 random(11);
    for (const glm::vec3 half : {glm::vec3(1, 0.06f, 1), glm::vec3(1), glm::vec3(0.2f, 1, 0.7f)})
        for (const float albedo : {0.93f, 0.95f})
            for (const int resolution : {3, 4, 6, 8, 10, 12}) {
                Scene scene;
                const int white = scenes::add_material(scene, glm::vec3(albedo), {}, true);
                scenes::add_box(scene, white, -half, half, scenes::Facing::outward,
                                scenes::random_turn(random));
                scene.lights.push_back(scenes::point_light({0, 0, 0}, 100.0));
                const scene::Frame cells{glm::dvec3(-1.5), 3.0 / resolution,
                                         glm::dvec3(resolution)};
                const double first = mean_front_and_back(light(scene, 1, cells));
                const surface::LitSurfaces all = light(scene, std::nullopt, cells);
                EXPECT_LE(all.residual, 1e-4);
                EXPECT_LT(all.bounces, 250);
                EXPECT_NEAR(mean_front_and_back(all) / first * (1.0 - double(albedo)), 1.0, 0.08)
                    << half.x << " " << half.y << " " << resolution << " " << albedo;
                if (resolution == 8) {
                    const double longer = mean_front_and_back(light(scene, 400, cells));
                    EXPECT_NEAR(mean_front_and_back(all) / longer, 1.0, 2e-4);
                }
            }
}

TEST(LitSurfaces, ManyReflectionsEndWhereTheSeriesDoes) {
    for (const float albedo : {0.99f, 0.998f}) {
        Scene scene = scenes::furnace(3.0f, albedo, 1.0f);
        scene.rules.max_albedo = 1.0f;
        const surface::LitSurfaces all = light(scene, std::nullopt);
        EXPECT_NEAR(mean_front(all) * (1.0 - double(albedo)), 1.0, 1e-3) << albedo;
    }
}

TEST(LitSurfaces, PointLightFollowsTheInverseSquare) {
    Scene scene = scenes::floor_quad(40.0f, glm::vec3(0.5f));
    scene.lights.push_back(scenes::point_light({0, 3, 0}, 200.0));
    const scene::Frame cells{glm::dvec3(-2.0, -0.5, -2.0), 0.5, glm::dvec3(8.0)};
    const surface::LitSurfaces lit = light(scene, 1, cells);
    ASSERT_GT(lit.patches.size(), 100u);
    for (size_t i = 0; i < lit.patches.size(); ++i) {
        const glm::dvec3 p = cells.to_world(glm::dvec3(lit.patches[i].position));
        if (glm::length(p) > 4.0)
            continue;
        double lux = 0.0; // mean over the patch: centroids of the 64 triangles of its subdivision
        for (int j = 0; j < 8; ++j)
            for (int k = 0; k < 8 - j; ++k)
                for (int half = 0; half < (j + k < 7 ? 2 : 1); ++half) {
                    const glm::vec2 at = (glm::vec2(j, k) + float(1 + half) / 3.0f) / 8.0f;
                    const glm::dvec3 q = cells.to_world(glm::dvec3(lit.patches[i].at(at)));
                    lux += 200.0 * 3.0 / std::pow(q.x * q.x + q.z * q.z + 9.0, 1.5) / 64.0;
                }
        EXPECT_NEAR(double(lit.luminance[2 * i].x) / (0.5 * lux / glm::pi<double>()), 1.0, 2e-3);
        EXPECT_EQ(lit.luminance[2 * i + 1], glm::vec3(0.0f)) << "a single-sided back is black";
    }
}

TEST(LitSurfaces, SpotsOfOneAngleGiveTheFluxOfTheirCone) {
    for (const double angle : {0.5, 1.0, 1.5}) {
        Scene scene = scenes::furnace(8.0f, 0.5f, 0.0f);
        scene.lights.push_back(
            scenes::spot_light({4.1, 4.2, 4.3}, {0.3, -1, 0.2}, 70.0, angle, angle));
        const scene::Frame cells{glm::dvec3(0.0), 0.25, glm::dvec3(32.0)};
        const surface::LitSurfaces lit = light(scene, 1, cells);
        double flux = 0.0;
        for (size_t i = 0; i < lit.patches.size(); ++i)
            flux += glm::pi<double>() / 0.5 * double(lit.luminance[2 * i].y)
                    * double(lit.patches[i].area) * 0.25 * 0.25;
        EXPECT_NEAR(flux / (70.0 * glm::two_pi<double>() * (1.0 - std::cos(angle))), 1.0, 0.01)
            << angle;
    }
}

TEST(LitSurfaces, EmittersLightByTheirFormFactor) {
    // A square lamp of edge 2 at height 2 over the middle of a floor, and the floor's point below.
    Scene scene = scenes::floor_quad(0.2f, glm::vec3(0.5f));
    const int lamp = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(7.0f));
    scenes::add_quad(scene, lamp, {-1, 2, -1}, {2, 0, 0}, {0, 0, 2});
    const double unit = 0.025;
    const scene::Frame cells{glm::dvec3(-0.1), unit, glm::dvec3(8.0)};
    const surface::LitSurfaces lit = light(scene, 1, cells);
    // Four corner-to-corner rectangles of edges 1 x 1 at distance 2 (Howell, A-2).
    const double x = 0.5, root = std::sqrt(1 + x * x);
    const double quarter = 2.0 * (x / root * std::atan(x / root)) / glm::two_pi<double>();
    double sum = 0.0;
    int count = 0;
    for (size_t i = 0; i < lit.patches.size(); ++i)
        if (lit.patches[i].albedo != glm::vec3(0.0f)) {
            sum += double(lit.luminance[2 * i].x);
            ++count;
        }
    ASSERT_GT(count, 0);
    EXPECT_NEAR(sum / count / (0.5 * 7.0 * 4.0 * quarter), 1.0, 0.03);
}

TEST(LitSurfaces, SkyLightsWhatIsOpen) {
    Scene scene = scenes::floor_quad(4.0f, glm::vec3(0.5f));
    scene.sky.luminance = glm::vec3(100.0f);
    const surface::LitSurfaces lit = light(scene, 1, {glm::dvec3(-4.0), 1.0, glm::dvec3(8.0)});
    for (size_t i = 0; i < lit.patches.size(); ++i)
        EXPECT_NEAR(lit.luminance[2 * i].x, 50.0f, 1e-3f);
}

TEST(LitSurfaces, TheFloorBehindAWallStaysDark) {
    // A floor under two closed rooms; the wall between them is far thinner than a patch.
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.8f));
    scenes::add_quad(scene, white, {0, 1, 0}, {0, 0, 8}, {8, 0, 0});
    scenes::add_box(scene, white, {3.35f, 0.9f, -0.1f}, {3.55f, 4.1f, 8.1f},
                    scenes::Facing::outward);
    scenes::add_box(scene, white, {0, 0.5f, 0}, {8, 4, 8}, scenes::Facing::inward);
    scene.lights.push_back(scenes::point_light({1.5, 2.5, 4}, 100.0));
    const surface::LitSurfaces lit = light(scene, std::nullopt);
    double dark = 0.0, bright = 0.0;
    for (size_t i = 0; i < lit.patches.size(); ++i)
        if (lit.patches[i].position.x > 3.45f)
            dark = std::max(dark, double(lit.luminance[2 * i].x));
        else
            bright = std::max(bright, double(lit.luminance[2 * i].x));
    EXPECT_EQ(dark, 0.0);
    EXPECT_GT(bright, 1.0);
}

TEST(LitSurfaces, TheFloorBesideAWallIsLitUpToIt) {
    // A thin black wall stands on a floor under the sky: close to it half of the sky is seen, on
    // both sides, also where a patch lies mostly on the other one.
    for (const float turn : {0.0f, 0.4f}) {
        Scene scene;
        const int grey = scenes::add_material(scene, glm::vec3(0.5f));
        const int black = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(0.0f), true);
        scenes::add_quad(scene, grey, {0, 1, 0}, {0, 0, 8}, {8, 0, 0});
        const glm::vec3 along(std::sin(turn), 0, std::cos(turn)), across(along.z, 0, -along.x);
        scenes::add_quad(scene, black, glm::vec3(3.37f, 0.9f, 4) - 9.0f * along, 18.0f * along,
                         {0, 9, 0});
        scene.sky.luminance = glm::vec3(100.0f);
        const scene::Frame cells{glm::dvec3(0.0), 1.0, glm::dvec3(8.0)};
        const visibility::Visibility visibility(scene, cells);
        Progress silent;
        const surface::LitSurfaces lit =
            surface::light_surfaces(scene, visibility, cells, {.bounces = 1}, silent);
        for (int i = 0; i < 400; ++i) {
            const float beside = (i % 2 != 0 ? -1.0f : 1.0f) * (0.004f + 0.0005f * float(i));
            const glm::vec3 at =
                glm::vec3(3.37f, 1.02f, 4) + beside * across + (0.011f * float(i) - 2.2f) * along;
            const visibility::Ray down{at, {0, -1, 0}};
            EXPECT_NEAR(lit.leaving(visibility.closest(down), down.direction).y, 27.0f, 9.0f)
                << beside << ' ' << i;
        }
    }
}

TEST(LitSurfaces, LightBehindAPanelStaysThere) {
    // A glowing panel close before a wall, at any place and turn: the wall is bright under it, and
    // dark around it.
    std::mt19937 random(21);
    std::uniform_real_distribution<float> number(-1.0f, 1.0f);
    for (const float gap : {4e-4f, 0.012f, 0.05f, 0.1f})
        for (const float size : {0.9f, 1.7f, 3.2f}) {
            const glm::dmat4 turn =
                glm::translate(glm::dmat4(1.0), glm::dvec3(6.0)) * scenes::random_turn(random);
            Scene scene;
            const int grey = scenes::add_material(scene, glm::vec3(0.5f));
            const int lamp = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(100.0f), true);
            scenes::add_quad(scene, grey, {-5, -5, 0}, {10, 0, 0}, {0, 10, 0}, turn);
            const glm::vec3 corner(number(random), number(random), gap);
            scenes::add_quad(scene, lamp, corner, {size, 0, 0}, {0, 1.3f * size, 0}, turn);
            const scene::Frame cells{glm::dvec3(0.0), 1.0, glm::dvec3(12.0)};
            const visibility::Visibility visibility(scene, cells);
            Progress silent;
            const surface::LitSurfaces lit =
                surface::light_surfaces(scene, visibility, cells, {.bounces = 1}, silent);
            const auto seen = [&](glm::vec3 from, glm::vec3 to) {
                const glm::vec3 start(turn * glm::dvec4(from, 1.0)),
                    end(turn * glm::dvec4(to, 1.0));
                const visibility::Ray ray{start, 1.01f * (end - start)};
                return double(lit.leaving(visibility.closest(ray), ray.direction).y);
            };
            double around = 0.0, under = 0.0;
            constexpr int looks = 4000;
            for (int i = 0; i < looks; ++i) {
                // From a ring of a cell, by what is seen of it past the panel.
                const glm::vec2 middle = glm::vec2(corner) + 0.5f * glm::vec2(size, 1.3f * size);
                glm::vec2 half = 0.5f * glm::vec2(size, 1.3f * size) + 1.0f;
                glm::vec2 at = half * glm::vec2(number(random), number(random));
                const bool outside = std::abs(at.x) > half.x - 1.0f + 3.0f * gap
                                     || std::abs(at.y) > half.y - 1.0f + 3.0f * gap;
                const glm::vec3 there(middle + at, 0.0f);
                if (outside)
                    around += seen(there + glm::vec3(0, 0, 0.3f), there) / looks;
                at *= 0.8f * (half - 1.0f) / half;
                const glm::vec3 below(middle + at, 0.0f);
                under += seen(below + glm::vec3(0, 0, 0.5f * gap), below) / looks;
            }
            // Of plates close together as much is lost as leaves through the gap around them.
            const double lost = double(gap * 2.3f / (1.3f * size));
            EXPECT_GT(under / 50.0, 0.95 - lost) << gap << " " << size;
            EXPECT_LT(under / 50.0, 1.05) << gap << " " << size;
            EXPECT_LT(around, 0.15 + 15.0 * double(gap)) << gap << " " << size;
        }
}

/// Illuminance (lux) of a point by a square of luminance 1 and edge 2 * half in a parallel plane,
/// `gap` above it, `at` beside its middle.
double lux_of_square(glm::dvec2 at, double half, double gap) {
    constexpr int n = 100;
    const double edge = 2.0 * half / n;
    double sum = 0.0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const glm::dvec2 way = glm::dvec2(i + 0.5, j + 0.5) * edge - half - at;
            const double square = glm::dot(way, way) + gap * gap;
            sum += gap * gap / (square * square);
        }
    return sum * edge * edge;
}

TEST(LitSurfaces, LightAroundTheEndOfAGapIsAsItFades) {
    // A wall under a square lamp, as light as closed form says in each band around the lamp's rim.
    const double half = 0.8;
    for (const double gap : {0.04, 0.08, 0.16})
        for (const glm::vec2 middle : {glm::vec2(4.59f, 5.02f), glm::vec2(6.27f, 4.71f)}) {
            Scene scene;
            const int grey = scenes::add_material(scene, glm::vec3(0.5f));
            const int lamp = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(100.0f), true);
            scenes::add_quad(scene, grey, {0, 0, 0}, {10, 0, 0}, {0, 10, 0});
            scenes::add_quad(scene, lamp, glm::vec3(middle - float(half), float(gap)),
                             {float(2.0 * half), 0, 0}, {0, float(2.0 * half), 0});
            const scene::Frame cells{glm::dvec3(0.0), 1.0, glm::dvec3(10.0)};
            const visibility::Visibility visibility(scene, cells);
            Progress silent;
            const surface::LitSurfaces lit =
                surface::light_surfaces(scene, visibility, cells, {.bounces = 1}, silent);
            const auto band = [&](double from, double to) {
                double got = 0.0, right = 0.0;
                for (size_t i = 0; i < lit.patches.size(); ++i) {
                    const surface::Patch& patch = lit.patches[i];
                    const glm::dvec2 at = glm::dvec2(patch.position) - glm::dvec2(middle);
                    const glm::dvec2 beyond = glm::abs(at) - half;
                    const double rim = std::max(beyond.x, beyond.y) / gap;
                    if (patch.instance != 0 || rim < from || rim >= to)
                        continue;
                    got += double(patch.area * lit.luminance[2 * i].x);
                    right += double(patch.area) * 0.5 / glm::pi<double>() * 100.0
                             * lux_of_square(at, half, gap);
                }
                return got / right;
            };
            EXPECT_NEAR(band(-4.0, -1.5), 1.0, 0.05) << gap;
            EXPECT_NEAR(band(-1.5, 0.0), 1.0, 0.08) << gap;
            EXPECT_NEAR(band(0.0, 1e3), 1.0, 0.15) << gap;
        }
}

TEST(LitSurfaces, AHitFindsThePatchAroundIt) {
    const Scene scene = scenes::cornell_box_with_point();
    const scene::Frame cells{glm::dvec3(-1.1, -0.1, -1.1), 0.1, glm::dvec3(22.0)};
    const visibility::Visibility visibility(scene, cells);
    const surface::PatchCover cover = surface::cover_surfaces(scene, cells, visibility, 1.0f);
    std::mt19937 random(7);
    std::normal_distribution<float> normal;
    int met = 0;
    std::vector<visibility::Hit> hits;
    for (int i = 0; i < 2000; ++i) {
        const glm::vec3 direction =
            glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
        const visibility::Ray ray{glm::vec3(11.0f, 14.0f, 14.0f), direction, 0.0f, HUGE_VALF};
        const visibility::Hit hit = visibility.closest(ray);
        hits.push_back(hit);
        glm::vec2 weights;
        const uint32_t found = cover.tree.find(hit, weights);
        ASSERT_EQ(hit.instance == visibility::no_hit, found == surface::PatchTree::none);
        if (found == surface::PatchTree::none)
            continue;
        ++met;
        const surface::Patch& patch = cover.patches[found];
        ASSERT_EQ(patch.instance, hit.instance);
        ASSERT_EQ(patch.triangle, hit.triangle);
        ASSERT_GE(std::min({weights.x, weights.y, 1.0f - weights.x - weights.y}), -1e-4f);
        const glm::vec3 point = ray.origin + hit.t * direction;
        ASSERT_LT(glm::distance(point, patch.at(weights)), 1e-3f);
    }
    // Many at once, to the bit; they lie on triangles that are halved more and less often.
    hits.pop_back(); // not a multiple of four
    std::vector<surface::PatchTree::Approach> ways(hits.size());
    cover.tree.approach(hits, ways);
    for (size_t i = 0; i < hits.size(); ++i) {
        const bool back = hits[i].facing == visibility::Facing::back;
        const auto one = back ? surface::PatchTree::Approach{} : cover.tree.approach(hits[i]);
        ASSERT_EQ(ways[i].piece, one.piece);
        ASSERT_EQ(ways[i].weights, one.weights);
    }
    EXPECT_GT(met, 1000);
}

TEST(LitSurfaces, DuplicateSurfacesCountOnce) {
    Scene scene = scenes::floor_quad(6.0f, glm::vec3(0.5f));
    scene.instances.push_back(scene.instances[0]);
    const scene::Frame cells{glm::dvec3(-4.0), 1.0, glm::dvec3(8.0)};
    const visibility::Visibility visibility(scene, cells);
    double area = 0.0;
    for (const surface::Patch& patch :
         surface::cover_surfaces(scene, cells, visibility, 1.0f).patches)
        area += double(patch.area);
    EXPECT_NEAR(area, 36.0, 1e-3);
}

TEST(LitSurfaces, FarSurfacesHaveLargePatches) {
    const Scene scene = scenes::floor_quad(2000.0f, glm::vec3(0.5f));
    const scene::Frame cells{glm::dvec3(-4.0), 1.0, glm::dvec3(8.0)};
    const visibility::Visibility visibility(scene, cells);
    const surface::PatchCover cover = surface::cover_surfaces(scene, cells, visibility, 1.0f);
    double area = 0.0;
    for (const surface::Patch& patch : cover.patches)
        area += double(patch.area);
    EXPECT_NEAR(area / 4e6, 1.0, 1e-4);
    EXPECT_LT(cover.patches.size(), 20000u);
}

TEST(LitSurfaces, SameBitsForAnyNumberOfThreads) {
    Scene scene = scenes::cornell_box_with_point();
    scene.sky.luminance = glm::vec3(3.0f);
    const scene::Frame cells{glm::dvec3(-1.2), 0.15, glm::dvec3(16.0)};
    const surface::LitSurfaces many = light(scene, std::nullopt, cells);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const surface::LitSurfaces single = light(scene, std::nullopt, cells);
    EXPECT_EQ(many.luminance, single.luminance);
}

} // namespace
} // namespace lpvbake
