// Light of one side of a wall read on its other side: none, whatever the walls' angle to the cells.

#include "visibility/walls.h"

#include "scenes.h"
#include "volume/sampler.h"
#include "volume/sh.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <numbers>
#include <random>

namespace lpvbake {
namespace {

using std::numbers::pi;

/// A field of the same luminance from all sides in each cell, that of where its light is taken, and
/// the walls that the scene has.
template <class Luminance>
Volume lit_around(const Scene& scene, const Grid& grid, const Luminance& luminance) {
    Volume volume;
    volume.grid = grid;
    volume.sh_order = 0;
    volume.sh.assign(1, std::vector<glm::vec3>(grid.size()));
    volume.validity.assign(grid.size(), 1.0f);
    const visibility::Visibility visibility(scene, {grid.origin, grid.cell, glm::dvec3(grid.dims)});
    for (size_t i = 0; i < grid.size(); ++i) {
        const visibility::Capture capture = visibility.capture(grid.cell_at(i));
        const glm::dvec3 at = grid.origin + grid.cell * glm::dvec3(capture.point);
        volume.sh[0][i] = glm::vec3(float(luminance(at) / double(volume::sh_y0)));
        volume.validity[i] = capture.open ? 1.0f : 0.0f;
    }
    volume.walls =
        visibility::find_walls(visibility, grid.dims, volume.validity, most_walls, walls_reach);
    return volume;
}

/// The largest irradiance, over pi, that is read on the inside of a box's six walls. `inset`: how
/// far from the edges the outermost points are.
double brightest_inside(const Volume& volume, glm::dvec3 half, const glm::dmat4& to_world,
                        double inset, int points, Reading reading) {
    double most = 0;
    for (int axis = 0; axis < 3; ++axis)
        for (const double side : {-1.0, 1.0})
            for (int i = 0; i < points; ++i)
                for (int j = 0; j < points; ++j) {
                    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
                    glm::dvec3 p, n(0.0);
                    p[axis] = side * half[axis];
                    p[u] = (2.0 * i / (points - 1) - 1) * (half[u] - inset);
                    p[v] = (2.0 * j / (points - 1) - 1) * (half[v] - inset);
                    n[axis] = -side;
                    const glm::dvec3 e =
                        read_irradiance(volume, glm::dvec3(to_world * glm::dvec4(p, 1)),
                                        glm::dvec3(to_world * glm::dvec4(n, 0)), reading);
                    most = std::max(most, e.x / pi);
                }
    return most;
}

/// What `brightest_inside` reads of a dark box, in 1e4 nits: at resolutions, places and angles of
/// all kinds, up to a thousandth of a cell from its edges: black, and 1e-4 of what is outside there
/// at most. `make` builds the scene: the box's walls, and more around them or not.
template <class Make>
void expect_dark_inside(const Make& make) {
    std::mt19937 random(1);
    const glm::dvec3 half(1.0, 0.8, 0.7);
    for (const int dims : {8, 13, 20})
        for (int turn = 0; turn < 6; ++turn) {
            std::uniform_real_distribution<double> offset(-0.2, 0.2);
            glm::dmat4 to_world = glm::translate(
                glm::dmat4(1.0), glm::dvec3(offset(random), offset(random), offset(random)));
            if (turn > 1)
                to_world = to_world * scenes::random_turn(random);
            const Grid grid{glm::dvec3(-2), 4.0 / dims, glm::ivec3(dims)};
            const glm::dmat4 to_box = glm::inverse(to_world);
            const Volume volume = lit_around(make(half, to_world), grid, [&](glm::dvec3 p) {
                const glm::dvec3 q = glm::abs(glm::dvec3(to_box * glm::dvec4(p, 1)));
                return glm::all(glm::lessThan(q, half)) ? 0.0 : 1e4;
            });
            const auto brightest = [&](double cells, Reading reading) {
                return brightest_inside(volume, half, to_world, cells * grid.cell, 25, reading);
            };
            for (const auto& [inset, limit] : {std::pair{1e-3, 1.0}, {0.2, 1e-6}})
                EXPECT_LT(brightest(inset, Reading::facing), limit)
                    << dims << " cells, turn " << turn << ", " << inset << " cells off the edges";
            EXPECT_GT(brightest(1e-3, Reading::trilinear), 5000);
        }
}

TEST(Walls, ASealedBoxIsBlackWithin) {
    expect_dark_inside([](glm::dvec3 half, const glm::dmat4& to_world) {
        Scene scene;
        const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
        scenes::add_box(scene, grey, -half, half, scenes::Facing::inward, to_world);
        return scene;
    });
}

// Every wall goes on beyond the box: 26 lit rooms around a dark one.
TEST(Walls, ADarkRoomAmongLitOnesIsBlack) {
    expect_dark_inside([](glm::dvec3 half, const glm::dmat4& to_world) {
        Scene scene;
        const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
        for (int axis = 0; axis < 3; ++axis)
            for (const double side : {-1.0, 1.0}) {
                glm::vec3 corner(-5), u(0), v(0);
                corner[axis] = float(side * half[axis]);
                u[(axis + 1) % 3] = v[(axis + 2) % 3] = 10;
                scenes::add_quad(scene, grey, corner, u, v, to_world);
            }
        return scene;
    });
}

TEST(Walls, ArePlanesThroughTheNearestOfWhatIsLeft) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_quad(scene, grey, {-9, 1.2f, -9}, {0, 0, 40}, {40, 0, 0}); // floor
    scenes::add_quad(scene, grey, {3, -9, -9}, {0, 40, 0}, {0, 0, 40});    // wall
    const Grid grid{glm::dvec3(0), 1.0, {8, 6, 4}};
    const visibility::Visibility visibility(scene, {grid.origin, grid.cell, glm::dvec3(grid.dims)});
    std::vector<float> validity(grid.size(), 1.0f);
    validity[grid.index({4, 2, 0})] = 0;
    const auto walls =
        visibility::find_walls(visibility, grid.dims, validity, most_walls, walls_reach);
    ASSERT_EQ(walls.size(), 3u);
    const auto expect = [&](glm::ivec3 cell, glm::vec3 first, glm::vec3 second) {
        const std::size_t i = grid.index(cell);
        for (int a = 0; a < 3; ++a) {
            EXPECT_NEAR(walls[0][i][a], first[a], 1e-5) << cell.x << ' ' << cell.y;
            EXPECT_NEAR(walls[1][i][a], second[a], 1e-5) << cell.x << ' ' << cell.y;
        }
        EXPECT_EQ(walls[2][i], glm::vec3(0));
    };
    expect({3, 1, 2}, {0, -0.3f, 0}, {-0.5f, 0, 0});
    expect({2, 2, 2}, {0.5f, 0, 0}, {0, -1.3f, 0});
    expect({1, 2, 2}, {0, -1.3f, 0}, {1.5f, 0, 0});
    expect({6, 0, 1}, {0, 0.7f, 0}, {0, 0, 0}); // the wall is too far
    expect({6, 4, 1}, {0, 0, 0}, {0, 0, 0});
    expect({4, 2, 0}, {0, 0, 0}, {0, 0, 0}); // not valid
}

TEST(Walls, ACentreOnASurfaceIsReadOnItsOpenSideAlone) {
    for (const bool double_sided : {false, true}) {
        Scene scene;
        scenes::add_quad(
            scene, scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), double_sided),
            {-9, 1.5f, -9}, {0, 0, 40}, {40, 0, 0});
        const Grid grid{glm::dvec3(0), 1.0, {4, 4, 4}};
        const Volume volume = lit_around(
            scene, grid, [](glm::dvec3 p) { return std::abs(p.y - 1.5) < 0.1 ? 1e4 : 1.0; });
        const auto read = [&](double y, double side) {
            return read_irradiance(volume, {2.2, y, 1.9}, {side, 0, 0}, Reading::facing).x;
        };
        for (const double side : {-1.0, 1.0}) {
            EXPECT_NEAR(read(1.3, side), pi, 1e-4); // on a wall that hangs below the surface
            EXPECT_GT(read(1.7, side), 1e3);        // on one that stands on it
        }
    }
}

TEST(Walls, WhatIsMostlyNotThereIsNone) {
    Scene scene;
    const int pane = scenes::add_material(scene, glm::vec3(0.5f));
    scene.materials[size_t(pane)].alpha_mode = AlphaMode::blend;
    scenes::add_quad(scene, pane, {-9, 1.2f, -9}, {0, 0, 40}, {40, 0, 0});
    const scene::Frame frame{glm::dvec3(0), 1.0, glm::dvec3(4)};
    for (const auto& [alpha, there] : {std::pair{0.4f, false}, {0.6f, true}}) {
        scene.materials[size_t(pane)].base_color.a = alpha;
        EXPECT_EQ(visibility::find_walls(visibility::Visibility(scene, frame), glm::ivec3(4), {},
                                         most_walls, walls_reach)[0][5]
                      != glm::vec3(0),
                  there);
    }
}

} // namespace
} // namespace lpvbake
