// Reflective shadow maps against closed forms: what a map reflects must not depend on its size.
#include "solver/vpl/rsm.h"

#include "device.h"
#include "scenes.h"

#include <glm/gtc/matrix_transform.hpp>

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

namespace lpvbake {
namespace {

using std::numbers::pi;

class RsmTest : public testing::DeviceTest {
protected:
    struct Seen {
        glm::dvec3 power{0.0};
        std::size_t texels = 0;
        std::size_t lit = 0;
        std::vector<solver::vpl::Rsm> tiles;
    };

    static Seen render(const Scene& scene, const scene::Frame& frame, const Light& light,
                       int size) {
        Seen seen;
        solver::vpl::RsmPass pass(device(), scene, frame);
        pass.render(light, size, [&](const solver::vpl::Rsm& rsm) {
            EXPECT_LE(rsm.width, 1024);
            EXPECT_LE(rsm.height, 1024);
            const std::size_t texels = std::size_t(rsm.width) * rsm.height;
            ASSERT_EQ(rsm.position.size(), texels);
            ASSERT_EQ(rsm.normal.size(), texels);
            ASSERT_EQ(rsm.power.size(), texels);
            seen.texels += texels;
            bool finite = true;
            for (std::size_t i = 0; i < texels; ++i) {
                const glm::vec3 sum = rsm.position[i] + rsm.normal[i] + rsm.power[i];
                finite = finite && std::isfinite(sum.x + sum.y + sum.z);
                seen.power += glm::dvec3(rsm.power[i]);
                seen.lit += rsm.power[i] != glm::vec3(0);
            }
            EXPECT_TRUE(finite);
            seen.tiles.push_back(rsm);
        });
        return seen;
    }

    static glm::dvec3 power(const Scene& scene, const scene::Frame& frame, const Light& light,
                            int size) {
        return render(scene, frame, light, size).power;
    }

    /// A frame of cells of `unit` metres around the scene, some cells to spare.
    static scene::Frame frame_around(const Scene& scene, double unit) {
        const Bounds bounds = bounds_of(scene);
        scene::Frame frame;
        frame.unit = unit;
        frame.origin = bounds.lo - 2 * unit;
        frame.extent = glm::ceil((bounds.hi - bounds.lo) / unit) + 4.0;
        return frame;
    }
};

void expect_relative(glm::dvec3 value, glm::dvec3 expected, double tolerance) {
    for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(value[c], expected[c], tolerance * expected[c]) << "channel " << c;
}

const glm::vec3 grey(0.5f);
const glm::vec3 tinted(0.8f, 0.5f, 0.2f);

Scene room(glm::vec3 albedo) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, albedo), {-1, -2, -1.5}, {2, 1, 3},
                    scenes::Facing::inward);
    return scene;
}

TEST_F(RsmTest, DirectionalPowerIsIlluminanceTimesProjectedArea) {
    const Scene scene = scenes::floor_quad(3, tinted);
    const scene::Frame frame = frame_around(scene, 0.1);
    // The floor fills the map exactly where the sun stands in the plane of two axes.
    const Light light = scenes::sun({0.0, -2.0, -1.0}, 1000, {1.0f, 0.9f, 0.5f});
    const double incident = 1000 * 9 * 2 / std::sqrt(5.0);
    for (const int size : {64, 256, 1024, 4096})
        expect_relative(power(scene, frame, light, size),
                        incident * glm::dvec3(tinted) * glm::dvec3(1, 0.9, 0.5), 2e-6);
}

TEST_F(RsmTest, DirectionalPowerOnATiltedPlane) {
    Scene scene;
    const glm::dmat4 turned = glm::rotate(glm::dmat4(1.0), 0.7, glm::dvec3(1, 2, 3));
    scenes::add_quad(scene, scenes::add_material(scene, grey), {-1, 0, 1}, {2, 0, 0}, {0, 0, -3},
                     turned);
    const scene::Frame frame = frame_around(scene, 0.2);
    const glm::dvec3 travel = glm::normalize(glm::dvec3(0.3, -1, 0.1));
    const glm::dvec3 normal = glm::dmat3(turned) * glm::dvec3(0, 1, 0);
    const double expected = 0.5 * 800 * 6 * -glm::dot(normal, travel);
    ASSERT_GT(expected, 0);
    // What is left is the sampling of the slanted edges.
    for (const int size : {64, 256, 1024, 4096})
        expect_relative(power(scene, frame, scenes::sun(travel, 800), size), glm::dvec3(expected),
                        0.2 / size);
}

TEST_F(RsmTest, PointPowerInAClosedRoom) {
    const Scene scene = room(tinted);
    const scene::Frame frame = frame_around(scene, 0.15);
    const Light light = scenes::point_light({0.3, -0.4, 1.1}, 50);
    for (const int size : {64, 256, 1024, 4096}) {
        const Seen seen = render(scene, frame, light, size);
        EXPECT_EQ(seen.texels, 6u * size * size);
        EXPECT_EQ(seen.lit, seen.texels);
        expect_relative(seen.power, 4 * pi * 50 * glm::dvec3(tinted), 1e-6);
    }
}

TEST_F(RsmTest, TilesMakeUpTheWholeMap) {
    const Scene scene = room(grey);
    const scene::Frame frame = frame_around(scene, 0.3);
    const Seen seen = render(scene, frame, scenes::point_light({0, 0, 0}, 1), 1500);
    EXPECT_EQ(seen.tiles.size(), 24u);
    EXPECT_EQ(seen.lit, 6u * 1500 * 1500);
    expect_relative(seen.power, glm::dvec3(2 * pi), 1e-6);
}

/// The same cells around levels of finer ones in the middle, ten across each.
scene::Frame with_levels(const scene::Frame& all, int levels) {
    if (levels == 1)
        return all;
    const double ratio = 1 << (levels - 1);
    scene::Frame frame;
    frame.unit = all.unit / ratio;
    frame.extent = glm::dvec3(10);
    const glm::dvec3 half = 0.5 * all.extent * ratio;
    frame.origin = all.origin + frame.unit * (half - 5.0);
    for (int level = 1; level < levels; ++level) {
        const float cell = float(1 << level);
        const bool last = level + 1 == levels;
        const glm::vec3 around = last ? glm::vec3(half) : glm::vec3(5 * cell);
        frame.coarser.push_back({5.0f - around, 5.0f + around, cell});
    }
    return frame;
}

TEST_F(RsmTest, CascadesReflectWhatOneMapDoes) {
    const Scene closed = room(tinted), open = scenes::floor_quad(3, tinted);
    struct Case {
        const char* name;
        const Scene& scene;
        Light light;
        double reflected;
    };
    const double ramp = // of a smooth cone, by the map that is tested elsewhere
        power(closed, frame_around(closed, 0.2),
              scenes::spot_light({0.3, -0.4, 1.1}, {-1, -1, -2}, 70, 0.3, 0.6), 1024)
            .x;
    const Case cases[] = {
        {"sun", open, scenes::sun({0.0, -2.0, -1.0}, 1000), 1000 * 9 * 2 / std::sqrt(5.0) * 0.8},
        {"lamp", closed, scenes::point_light({0.3, -0.4, 1.1}, 50), 4 * pi * 50 * 0.8},
        {"lamp in the finest", closed, scenes::point_light({-0.8, -1.8, -1.3}, 50),
         4 * pi * 50 * 0.8},
        {"spot", closed, scenes::spot_light({0.3, -0.4, 1.1}, {-1, -1, -2}, 70, 0.3, 0.6), ramp}};
    for (const Case& each : cases) {
        const scene::Frame frame = frame_around(each.scene, 0.2);
        std::size_t before = 0;
        for (const int levels : {1, 2, 3, 4}) {
            const scene::Frame nested = with_levels(frame, levels);
            const Seen seen = render(each.scene, nested, each.light, 64);
            EXPECT_NEAR(seen.power.x, each.reflected, 1e-4 * each.reflected)
                << each.name << ", " << levels;
            EXPECT_TRUE(levels == 1 || seen.texels > before) << each.name; // there are more of them
            before = levels == 1 ? seen.texels : before;
            std::vector<solver::vpl::Vpl> vpls;
            for (const solver::vpl::Rsm& rsm : seen.tiles)
                solver::vpl::cluster_vpls(rsm, nested, 4, vpls);
            double clustered = 0;
            for (const solver::vpl::Vpl& vpl : vpls)
                clustered += double(vpl.power.x);
            EXPECT_NEAR(clustered, each.reflected, 1e-4 * each.reflected) << each.name;
        }
    }
}

TEST_F(RsmTest, HardSpotPowerIsThatOfItsCone) {
    const Scene scene = room(grey);
    const scene::Frame frame = frame_around(scene, 0.15);
    for (const double angle : {0.02, 0.5, 1.2, 1.39})
        for (const int size : {64, 256, 1024, 4096}) {
            const Light light = scenes::spot_light({0.3, -0.4, 1.1}, {1, -2, 3}, 70, angle, angle);
            expect_relative(power(scene, frame, light, size),
                            glm::dvec3(0.5 * 70 * 2 * pi * (1 - std::cos(angle))),
                            angle < 1.3 ? 3e-4 : 2e-3);
        }
}

TEST_F(RsmTest, SoftSpotPowerIsTheIntegralOfItsRamp) {
    const Scene scene = room(grey);
    const scene::Frame frame = frame_around(scene, 0.15);
    for (const auto& [inner, outer] :
         {std::pair(0.0, 0.6), std::pair(0.4, 0.5), std::pair(0.2, 1.3)})
        for (const int size : {64, 256, 1024, 4096}) {
            const Light light =
                scenes::spot_light({0.3, -0.4, 1.1}, {-1, 0.1, 0.2}, 70, inner, outer);
            // Within `inner` all, then the square of a ramp in the cosine, whose mean is 1/3.
            const double steradians =
                2 * pi * (1 - std::cos(inner) + (std::cos(inner) - std::cos(outer)) / 3);
            expect_relative(power(scene, frame, light, size), glm::dvec3(0.5 * 70 * steradians),
                            2e-4);
        }
}

TEST_F(RsmTest, WideSpotsAreSeenThroughACube) {
    const Scene scene = room(grey);
    const scene::Frame frame = frame_around(scene, 0.15);
    for (const double outer : {1.45, pi / 2})
        for (const double inner : {0.3, outer}) {
            const Light light = scenes::spot_light({0.3, -0.4, 1.1}, {1, -2, 3}, 70, inner, outer);
            const double steradians =
                2 * pi * (1 - std::cos(inner) + (std::cos(inner) - std::cos(outer)) / 3);
            for (const int size : {64, 256, 1024})
                expect_relative(power(scene, frame, light, size), glm::dvec3(0.5 * 70 * steradians),
                                3e-4);
        }
}

TEST_F(RsmTest, RangeFadesByTheFourthPower) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, grey), {-1, -1, -1}, {1, 1, 1},
                    scenes::Facing::inward);
    const scene::Frame frame = frame_around(scene, 0.1);
    Light light = scenes::point_light({0, 0, 0}, 10);
    for (const double range : {0.9, 1.3, 2.0, 10.0}) {
        light.range = range;
        double sum = 0; // over a quarter of a face
        const int n = 2000;
        for (int j = 0; j < n; ++j)
            for (int i = 0; i < n; ++i) {
                const double x = (i + 0.5) / n, y = (j + 0.5) / n, d2 = 1 + x * x + y * y;
                const double fade = std::max(0.0, 1 - d2 * d2 / std::pow(range, 4));
                sum += fade / (d2 * std::sqrt(d2)) / (double(n) * n);
            }
        const double expected = 24 * sum * 10 * 0.5;
        EXPECT_NEAR(power(scene, frame, light, 256).x, expected, 2e-4 * expected + 1e-12) << range;
    }
}

TEST_F(RsmTest, PowerOfASmallSquareFallsWithItsDistanceSquared) {
    for (const double distance : {0.5, 1.0, 4.0}) {
        Scene scene;
        scenes::add_quad(scene, scenes::add_material(scene, grey), {-0.2, 0, 0.2}, {0.4, 0, 0},
                         {0, 0, -0.4});
        // Solid angle of a square of edge a at distance d: 4 atan(a^2 / (2 d sqrt(4 d^2 + 2 a^2))).
        const double a = 0.4, solid_angle =
                                  4
                                  * std::atan(a * a
                                              / (2 * distance
                                                 * std::sqrt(4 * distance * distance + 2 * a * a)));
        const Light light =
            scenes::spot_light({0, distance, 0}, {0, -1, 0}, 100, std::atan(0.3 / distance),
                               std::atan(0.3 / distance));
        expect_relative(power(scene, frame_around(scene, 0.05), light, 768),
                        glm::dvec3(0.5 * 100 * solid_angle), 1e-5);
    }
}

TEST_F(RsmTest, PositionsLieOnTheSurfaceAndNormalsFaceTheLight) {
    Scene scene = room(grey);
    const scene::Frame frame = frame_around(scene, 0.1);
    const Seen seen = render(scene, frame, scenes::point_light({1.9, 0.9, 2.9}, 1), 128);
    const glm::dvec3 light = frame.from_world({1.9, 0.9, 2.9});
    const glm::vec3 lo(frame.from_world({-1, -2, -1.5})), hi(frame.from_world({2, 1, 3}));
    for (const solver::vpl::Rsm& rsm : seen.tiles)
        for (std::size_t i = 0; i < rsm.position.size(); ++i) {
            const glm::vec3 p = rsm.position[i], n = rsm.normal[i];
            ASSERT_NEAR(glm::length(n), 1, 1e-6);
            ASSERT_GT(glm::dot(n, glm::vec3(light) - p), 0);
            const glm::vec3 wall = glm::vec3(glm::greaterThan(n, glm::vec3(0))) * lo
                                   + glm::vec3(glm::lessThan(n, glm::vec3(0))) * hi;
            ASSERT_NEAR(glm::dot(p - wall, n), 0, 1e-4);
            for (int c = 0; c < 3; ++c) {
                ASSERT_GE(p[c], lo[c] - 1e-4);
                ASSERT_LE(p[c], hi[c] + 1e-4);
            }
        }
}

/// A floor, and above it a smaller sheet that faces down onto it.
Scene sheet_over_floor(glm::vec3 sheet_albedo, bool double_sided) {
    Scene scene = scenes::floor_quad(4, grey);
    const int material = scenes::add_material(scene, sheet_albedo, glm::vec3(0), double_sided);
    scenes::add_quad(scene, material, {-1, 1, -1}, {2, 0, 0}, {0, 0, 2});
    return scene;
}

const Light noon = scenes::sun({0, -1, 0}, 100);

TEST_F(RsmTest, BacksOfSingleSidedSurfacesAreBlackAndBlock) {
    const Scene scene = sheet_over_floor(grey, false);
    expect_relative(power(scene, frame_around(scene, 0.1), noon, 256), glm::dvec3(0.5 * 100 * 12),
                    1e-5);
}

TEST_F(RsmTest, BacksOfDoubleSidedSurfacesReflect) {
    const Scene scene = sheet_over_floor(glm::vec3(0.25f), true);
    const Seen seen = render(scene, frame_around(scene, 0.1), noon, 256);
    expect_relative(seen.power, glm::dvec3(0.5 * 100 * 12 + 0.25 * 100 * 4), 1e-5);
    for (const glm::vec3 normal : seen.tiles[0].normal)
        ASSERT_EQ(normal, glm::vec3(0, 1, 0));
}

TEST_F(RsmTest, CulledBacksLetLightThrough) {
    Scene scene = sheet_over_floor(grey, false);
    scene.rules.cull_backfaces = true;
    expect_relative(power(scene, frame_around(scene, 0.1), noon, 256), glm::dvec3(0.5 * 100 * 16),
                    1e-5);
}

TEST_F(RsmTest, SheetsModelledTwiceShowTheirFront) {
    for (const bool front_first : {false, true}) {
        Scene scene = scenes::floor_quad(4, grey);
        const int material = scenes::add_material(scene, glm::vec3(0.25f));
        const auto sheet = [&](bool up) {
            const glm::vec3 along(1.9f, 0.1f, 0.2f), across(-0.2f, 0.1f, 1.8f), corner(-1, 1, -1);
            if (up)
                scenes::add_quad(scene, material, corner, across, along);
            else
                scenes::add_quad(scene, material, corner, along, across);
        };
        sheet(front_first);
        sheet(!front_first);
        const double area = glm::cross(glm::dvec3(-0.2, 0.1, 1.8), glm::dvec3(1.9, 0.1, 0.2)).y;
        expect_relative(power(scene, frame_around(scene, 0.1), noon, 1024),
                        glm::dvec3(0.5 * 100 * (16 - area) + 0.25 * 100 * area), 1e-3);
        const Light bulb = scenes::spot_light({0, 4, 0}, {0, -1, 0}, 100, 0.2, 0.2);
        expect_relative(power(scene, frame_around(scene, 0.1), bulb, 256),
                        glm::dvec3(0.25 * 100 * 2 * pi * (1 - std::cos(0.2))), 1e-3);
    }
}

TEST_F(RsmTest, MirroredInstancesKeepTheirFront) {
    Scene scene;
    const int material = scenes::add_material(scene, grey);
    const glm::dmat4 mirror = glm::scale(glm::dmat4(1.0), glm::dvec3(-1, 1, 1));
    scenes::add_quad(scene, material, {-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, mirror);
    expect_relative(power(scene, frame_around(scene, 0.1), noon, 64), glm::dvec3(0.5 * 100 * 4),
                    1e-5);
    const Light from_below = scenes::sun({0, 1, 0}, 100);
    EXPECT_EQ(power(scene, frame_around(scene, 0.1), from_below, 64), glm::dvec3(0));
}

TEST_F(RsmTest, ReflectanceIsClamped) {
    Scene scene = scenes::floor_quad(2, {1.0f, 0.97f, 0.3f});
    scene.rules.max_albedo = 0.95f;
    expect_relative(power(scene, frame_around(scene, 0.1), noon, 64),
                    400.0 * glm::dvec3(0.95, 0.95, 0.3), 1e-5);
}

/// Gives the scene's last material a texture; texels are RGBA.
void add_texture(Scene& scene, int width, int height, std::vector<uint8_t> rgba, bool nearest) {
    scene.images.push_back({"texture", width, height, std::move(rgba)});
    Texture texture;
    texture.image = int(scene.images.size()) - 1;
    texture.nearest = nearest;
    scene.textures.push_back(texture);
    scene.materials.back().base_color_texture = int(scene.textures.size()) - 1;
}

TEST_F(RsmTest, TextureColourKeepsItsLinearMean) {
    std::mt19937 random(7);
    std::vector<uint8_t> rgba(4 * 61 * 37);
    glm::dvec3 mean(0);
    for (std::size_t i = 0; i < rgba.size(); ++i) {
        rgba[i] = uint8_t(random() % 256);
        const double code = rgba[i] / 255.0;
        const double linear =
            code <= 0.04045 ? code / 12.92 : std::pow((code + 0.055) / 1.055, 2.4);
        if (i % 4 < 3)
            mean[int(i % 4)] += linear / (61 * 37);
    }
    Scene scene = scenes::floor_quad(2, glm::vec3(0.9f));
    scene.rules.max_albedo = 1;
    add_texture(scene, 61, 37, rgba, false);
    // At 16 texels a side, four of the texture fall into one of the map: mips, and their rounding.
    for (const int size : {16, 64, 512})
        expect_relative(power(scene, frame_around(scene, 0.1), noon, size), 100 * 4 * 0.9 * mean,
                        1e-2);
}

TEST_F(RsmTest, VertexColoursAreInterpolated) {
    Scene scene = scenes::floor_quad(2, glm::vec3(0.8f));
    scene.meshes[0].colors.assign(scene.meshes[0].positions.size(), glm::vec4(0.5f));
    for (std::size_t i = 0; i < scene.meshes[0].colors.size(); ++i)
        if (scene.meshes[0].positions[i].x > 0)
            scene.meshes[0].colors[i] = glm::vec4(1, 0.5, 0, 1);
    expect_relative(power(scene, frame_around(scene, 0.1), noon, 256),
                    100 * 4 * 0.8 * glm::dvec3(0.75, 0.5, 0.25), 1e-4);
}

TEST_F(RsmTest, MaskCutsOut) {
    for (const float cutoff : {0.3f, 0.7f}) {
        Scene scene = scenes::floor_quad(4, grey);
        scenes::add_material(scene, glm::vec3(0.25f));
        scene.materials.back().alpha_mode = AlphaMode::mask;
        scene.materials.back().alpha_cutoff = cutoff;
        scenes::add_quad(scene, 1, {-2, 1, 2}, {4, 0, 0}, {0, 0, -4});
        // Alpha 0, 128, 255, 128 in four columns: half a sheet at the high cutoff, three at the
        // low: a quarter, three quarters.
        add_texture(scene, 4, 1,
                    {255, 255, 255, 0, 255, 255, 255, 128, 255, 255, 255, 255, 255, 255, 255, 128},
                    true);
        const double covered = cutoff < 0.5f ? 0.75 : 0.25;
        expect_relative(power(scene, frame_around(scene, 0.1), noon, 256),
                        glm::dvec3(100 * 16 * (0.25 * covered + 0.5 * (1 - covered))), 1e-5);
    }
}

TEST_F(RsmTest, HiddenColoursDoNotBleedIntoWhatMaskShows) {
    Scene scene;
    scenes::add_material(scene, glm::vec3(1.0f));
    scene.rules.max_albedo = 1;
    scene.materials.back().alpha_mode = AlphaMode::mask;
    scenes::add_quad(scene, 0, {-2, 1, 2}, {4, 0, 0}, {0, 0, -4});
    std::vector<uint8_t> rgba;
    for (int i = 0; i < 64 * 64; ++i) {
        const bool shown = i / 2 % 2 == 0;
        for (const int v : shown ? std::array{0, 188, 0, 255} : std::array{255, 255, 255, 0})
            rgba.push_back(uint8_t(v));
    }
    add_texture(scene, 64, 64, rgba, true);
    const glm::dvec3 reflected = power(scene, frame_around(scene, 0.1), noon, 13);
    EXPECT_GT(reflected.y, 0);
    EXPECT_LT(reflected.x, 1e-3 * reflected.y);
}

TEST_F(RsmTest, BlendReflectsItsShareAndPassesTheRest) {
    Scene scene = scenes::floor_quad(4, glm::vec3(0.9f, 0, 0));
    const glm::vec3 colours[] = {{0, 0.9f, 0}, {0, 0, 0.9f}};
    const float alphas[] = {0.3f, 0.6f};
    for (int layer = 0; layer < 2; ++layer) {
        const int material = scenes::add_material(scene, colours[layer]);
        scene.materials[material].alpha_mode = AlphaMode::blend;
        scene.materials[material].base_color.a = alphas[layer];
        scenes::add_quad(scene, material, {-2, 1.0f + float(layer), 2}, {4, 0, 0}, {0, 0, -4});
    }
    // Light meets blue (0.6), then green (0.3), then red.
    const glm::dvec3 expected = 100 * 16 * 0.9 * glm::dvec3(0.4 * 0.7, 0.4 * 0.3, 0.6);
    for (const int size : {64, 512})
        // Five standard deviations of the rarest.
        expect_relative(power(scene, frame_around(scene, 0.1), noon, size), expected,
                        5 * std::sqrt(0.88 / 0.12) / size);
    scene.materials[1].base_color.a = 0;
    scene.materials[2].base_color.a = 1;
    expect_relative(power(scene, frame_around(scene, 0.1), noon, 64) + 1.0,
                    glm::dvec3(1, 1, 1 + 100 * 16 * 0.9), 1e-5);
}

TEST_F(RsmTest, GlassColoursWhatIsSeenThroughIt) {
    Scene scene = scenes::floor_quad(4, glm::vec3(0.9f));
    const glm::dvec3 amber(0.8, 0.4, 0.2);
    const int glass = scenes::add_material(scene, glm::vec3(amber));
    scene.materials[glass].transmission = 0.6f;
    for (int layer = 0; layer < 2; ++layer)
        scenes::add_quad(scene, glass, {-2, 1.0f + float(layer), 2}, {4, 0, 0}, {0, 0, -4});
    const scene::Frame frame = frame_around(scene, 0.1);
    const visibility::Visibility visibility(scene, frame);
    const glm::dvec3 through = 0.6 * amber;
    const glm::dvec3 expected = 1600.0 * (0.4 * amber * (1.0 + through) + 0.9 * through * through);
    glm::dvec3 sum(0.0);
    solver::vpl::RsmPass pass(device(), scene, frame, &visibility);
    pass.render(noon, 512, [&](const solver::vpl::Rsm& rsm) {
        for (const glm::vec3& power : rsm.power)
            sum += glm::dvec3(power);
    });
    expect_relative(sum, expected, 0.015);
    // Without word of what light has passed, the map is as bright and has no tint.
    expect_relative(power(scene, frame, noon, 512),
                    1600.0 * (0.4 * amber * 1.6 + glm::dvec3(0.9 * 0.36)), 0.015);
}

TEST_F(RsmTest, WhatStandsOutsideTheGridShadows) {
    Scene scene = scenes::floor_quad(4, grey);
    const int roof = scenes::add_material(scene, glm::vec3(0.0f));
    scenes::add_quad(scene, roof, {-2, 500, 2}, {2, 0, 0}, {0, 0, -4});
    scene::Frame frame;
    frame.origin = {-2.5, -0.5, -2.5};
    frame.unit = 0.1;
    frame.extent = glm::dvec3(50);
    expect_relative(power(scene, frame, noon, 256), glm::dvec3(0.5 * 100 * 8), 1e-5);
}

TEST_F(RsmTest, FarAwayAndTinyScenesLookAlike) {
    const auto scene_at = [](glm::dvec3 offset, double scale) {
        Scene scene = scenes::cornell_box();
        for (Instance& instance : scene.instances)
            instance.to_world = glm::translate(glm::dmat4(1.0), offset)
                                * glm::scale(glm::dmat4(1.0), glm::dvec3(scale))
                                * instance.to_world;
        return scene;
    };
    const auto light_at = [](Light light, glm::dvec3 offset, double scale) {
        light.position = offset + scale * light.position;
        return light;
    };
    const Light lights[] = {scenes::point_light({0, 1.8, 0}, 10), scenes::sun({0.2, -0.5, -1}, 100),
                            scenes::spot_light({0, 1.8, 0}, {0.3, -1, 0}, 10, 0.2, 0.5)};
    for (const Light& light : lights) {
        const glm::dvec3 reference =
            power(scene_at({}, 1), frame_around(scene_at({}, 1), 0.07), light, 128);
        for (const auto& [offset, scale] :
             {std::pair(glm::dvec3(1e6, -1e6, 2e6), 1.0), std::pair(glm::dvec3(0), 1e-4),
              std::pair(glm::dvec3(1, 2, 3), 1e-4), std::pair(glm::dvec3(0), 1e6)}) {
            const Scene scene = scene_at(offset, scale);
            const double area = light.type == LightType::directional ? scale * scale : 1;
            expect_relative(power(scene, frame_around(scene, 0.07 * scale),
                                  light_at(light, offset, scale), 128),
                            reference * area, 2e-3);
        }
    }
}

TEST_F(RsmTest, HardCasesStayFinite) {
    Scene scene = scenes::cornell_box();
    Mesh degenerate;
    degenerate.positions = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0.5, 0.5, 0.5}};
    degenerate.triangles = {{0, 1, 2}, {3, 3, 3}, {0, 0, 1}};
    scene.meshes.push_back(degenerate);
    scene.instances.push_back({int(scene.meshes.size()) - 1, glm::dmat4(1.0)});
    const scene::Frame frame = frame_around(scene, 0.07);
    const Light lights[] = {scenes::point_light({0, 0, 0}, 1e9),
                            scenes::point_light({-1, 1, 0}, 1e-9),
                            scenes::point_light({-0.35, 0.3, -0.3}, 1),
                            scenes::point_light({1e5, 1e5, 1e5}, 1),
                            scenes::sun({1, 0, 0}, 1),
                            scenes::sun({1, -1e-7, 0}, 1e5),
                            scenes::sun({0, 0, -1}, 1),
                            scenes::spot_light({0, 0, 0}, {1, 0, 0}, 1, 0, 1),
                            scenes::spot_light({0, 1, 0}, {0, 1, 0}, 1, 0, 0)};
    for (const Light& light : lights)
        for (const int size : {1, 3, 64})
            render(scene, frame, light, size); // looks for NaN
}

TEST_F(RsmTest, NothingIsSeenOfNothing) {
    const scene::Frame frame;
    EXPECT_EQ(power(Scene(), frame, noon, 64), glm::dvec3(0));
    EXPECT_EQ(power(Scene(), frame, scenes::point_light({0, 0, 0}, 1), 64), glm::dvec3(0));
    const Scene floor = scenes::floor_quad(1, grey); // on edge towards the sun
    EXPECT_EQ(power(floor, frame_around(floor, 0.1), scenes::sun({1, 0, 0}, 1), 64), glm::dvec3(0));
    scene::Frame elsewhere;
    elsewhere.origin = glm::dvec3(100);
    EXPECT_EQ(power(floor, elsewhere, noon, 64), glm::dvec3(0));
}

TEST_F(RsmTest, RunsAreAlikeToTheBit) {
    Scene scene = scenes::cornell_box();
    scene.materials[0].alpha_mode = AlphaMode::blend;
    scene.materials[0].base_color.a = 0.5f;
    const scene::Frame frame = frame_around(scene, 0.07);
    const Light light = scenes::point_light({0, 1.8, 0}, 10);
    const Seen once = render(scene, frame, light, 200), again = render(scene, frame, light, 200);
    ASSERT_EQ(once.tiles.size(), again.tiles.size());
    const auto same = [](const std::vector<glm::vec3>& a, const std::vector<glm::vec3>& b) {
        return a.size() == b.size()
               && std::memcmp(a.data(), b.data(), a.size() * sizeof(glm::vec3)) == 0;
    };
    for (std::size_t i = 0; i < once.tiles.size(); ++i) {
        EXPECT_TRUE(same(once.tiles[i].position, again.tiles[i].position));
        EXPECT_TRUE(same(once.tiles[i].normal, again.tiles[i].normal));
        EXPECT_TRUE(same(once.tiles[i].power, again.tiles[i].power));
    }
}

} // namespace
} // namespace lpvbake
