// Cells whose centres lie on surfaces, or within a hair of them: on which side they count.

#include "visibility/capture.h"

#include "scenes.h"
#include "visibility/validity.h"
#include "visibility/walls.h"
#include "volume/sampler.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

using visibility::Capture;
using visibility::Visibility;

/// How far, in cells, a lattice is off one whose centres lie on surfaces.
constexpr double snaps[] = {0.0, 1e-6, -1e-6, 1e-4, -1e-4, 1e-2, -1e-2};

Grid lattice(glm::ivec3 dims) {
    return {glm::dvec3(0.0), 1.0, dims};
}

Visibility seen(const Scene& scene, const Grid& grid) {
    return Visibility(scene, scene::frame_of(grid));
}

/// A closed room whose walls go through the centres of the cells 1 and 5, but for the snap.
Scene room(double snap, bool double_sided, scenes::Facing facing = scenes::Facing::inward) {
    Scene scene;
    scenes::add_box(scene,
                    scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), double_sided),
                    glm::vec3(0.0f), glm::vec3(4.0f), facing,
                    glm::translate(glm::dmat4(1.0), glm::dvec3(1.5 + snap)));
    return scene;
}

int place(int i) { // before the lower wall, on it, between, on the upper one, behind that
    return i == 1 ? -1 : i == 5 ? 1 : 0;
}

TEST(Capture, CellsOnTheWallsOfARoomStandInsideIt) {
    const Grid grid = lattice(glm::ivec3(7));
    for (const bool double_sided : {false, true})
        for (const double snap : snaps) {
            const Scene scene = room(snap, double_sided);
            const Visibility visibility = seen(scene, grid);
            const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);
            for (size_t i = 0; i < grid.size(); ++i) {
                const glm::ivec3 cell = grid.cell_at(i);
                const glm::vec3 centre = glm::vec3(cell) + 0.5f;
                const Capture capture = visibility.capture(cell);
                const bool inside = glm::all(glm::greaterThan(cell, glm::ivec3(0)))
                                    && glm::all(glm::lessThan(cell, glm::ivec3(6)));
                EXPECT_TRUE(capture.open);
                const glm::ivec3 within = glm::ivec3(glm::greaterThan(cell, glm::ivec3(1)))
                                          * glm::ivec3(glm::lessThan(cell, glm::ivec3(5)));
                if (inside || double_sided) {
                    EXPECT_EQ(validity[i], 1.0f) << snap << " " << i;
                } else if (within.x + within.y + within.z == 2) { // behind a wall
                    EXPECT_EQ(validity[i], 0.0f) << snap << " " << i;
                }
                for (int axis = 0; axis < 3; ++axis) {
                    const int wall = inside ? place(cell[axis]) : 0;
                    const double expected =
                        wall == 0 ? double(centre[axis])
                                  : double(centre[axis]) + snap - wall * double(surface_margin);
                    ASSERT_NEAR(capture.point[axis], expected, 2e-6) << snap << " " << i;
                }
            }
        }
}

TEST(Capture, WhatIsNotOnASurfaceStaysWhereItIs) {
    const Grid grid = lattice(glm::ivec3(7));
    for (const double off : {1.1 * double(surface_margin), -1.1 * double(surface_margin), 0.4}) {
        const Scene scene = room(off, false);
        const Visibility visibility = seen(scene, grid);
        EXPECT_TRUE(visibility::cells_on_surfaces(visibility, grid.dims).empty());
        for (size_t i = 0; i < grid.size(); ++i)
            ASSERT_EQ(visibility.capture(grid.cell_at(i)).point, glm::vec3(grid.cell_at(i)) + 0.5f);
        // And cells behind walls are no longer in the room.
        const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);
        EXPECT_EQ(validity[grid.index({1, 3, 3})], off > 0 ? 0.0f : 1.0f);
        EXPECT_EQ(validity[grid.index({5, 3, 3})], off > 0 ? 1.0f : 0.0f);
    }
}

TEST(Capture, CellsOnABoxStandOutsideIt) {
    const Grid grid = lattice(glm::ivec3(7));
    for (const double snap : snaps) {
        const Scene scene = room(snap, false, scenes::Facing::outward);
        const Visibility visibility = seen(scene, grid);
        const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);
        for (size_t i = 0; i < grid.size(); ++i) {
            const glm::ivec3 cell = grid.cell_at(i);
            const bool within = glm::all(glm::greaterThan(cell, glm::ivec3(1)))
                                && glm::all(glm::lessThan(cell, glm::ivec3(5)));
            ASSERT_EQ(validity[i], within ? 0.0f : 1.0f) << snap << " " << i;
        }
    }
}

TEST(Capture, ValidityAndWallsAreTheSameHoweverRoundingFalls) {
    const Grid grid = lattice(glm::ivec3(7));
    std::mt19937 random(1);
    std::uniform_real_distribution<double> hair(-1e-6, 1e-6);
    std::vector<float> first;
    for (int i = 0; i < 20; ++i) {
        Scene scene;
        const int material = scenes::add_material(scene, glm::vec3(0.5f));
        // A room, a box in it, and a screen, each off by a hair of its own.
        for (const auto& [lo, hi, facing] :
             {std::tuple(glm::vec3(1.5f), glm::vec3(5.5f), scenes::Facing::inward),
              std::tuple(glm::vec3(2.5f, 2.5f, 2.5f), glm::vec3(3.5f, 4.5f, 3.5f),
                         scenes::Facing::outward),
              std::tuple(glm::vec3(4.5f, 2.2f, 4.2f), glm::vec3(4.5f + 1e-4f, 4.7f, 5.2f),
                         scenes::Facing::outward)})
            scenes::add_box(
                scene, material, lo, hi, facing,
                glm::translate(glm::dmat4(1.0), {hair(random), hair(random), hair(random)}));
        const Visibility visibility = seen(scene, grid);
        const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);
        const auto walls =
            visibility::find_walls(visibility, grid.dims, validity, most_walls, walls_reach);
        if (first.empty())
            first = validity;
        EXPECT_EQ(validity, first) << i;
        for (size_t cell = 0; cell < grid.size(); ++cell)
            if (const glm::vec3 wall = walls[0][cell]; wall != glm::vec3(0.0f)) {
                EXPECT_GT(glm::length(wall), 0.9f * surface_margin);
            }
    }
    EXPECT_EQ(first[grid.index({4, 3, 4})], 0.0f); // in the screen
    EXPECT_EQ(first[grid.index({2, 2, 2})], 1.0f); // on the corner of the box
    EXPECT_EQ(first[grid.index({1, 5, 5})], 1.0f); // in the room's corner
}

/// Validity and walls as each instruction set of the processor has them.
void expect_alike(const Scene& scene, const Grid& grid, const char* what) {
    std::vector<float> validity;
    std::vector<std::vector<glm::vec3>> walls;
    for (const visibility::Isa isa : visibility::isas) {
        if (isa == visibility::Isa::automatic || !visibility::processor_has(isa))
            continue;
        const Visibility own(scene, scene::frame_of(grid), isa);
        std::vector<float> valid = visibility::trace_validity(own, grid.dims);
        auto around = visibility::find_walls(own, grid.dims, valid, most_walls, walls_reach);
        if (validity.empty()) {
            validity = std::move(valid);
            walls = std::move(around);
            continue;
        }
        EXPECT_EQ(valid, validity) << what << " " << visibility::name_of(isa);
        EXPECT_TRUE(around == walls) << what << " " << visibility::name_of(isa);
    }
}

TEST(Capture, InstructionSetsAgreeOnARoomWhoseWallsAreOnCentres) {
    for (const int cells : {8, 16, 32, 48})
        for (const double snap : snaps) {
            if (cells > 16 && snap != 0.0)
                continue; // a matter of seconds
            const double cell = 4.0 / cells;
            Scene scene;
            const int white = scenes::add_material(scene, glm::vec3(0.5f));
            scenes::add_box(scene, white, {-2, 0, -2}, {2, 3, 2}, scenes::Facing::inward);
            scenes::add_box(scene, white, {-1, 0, -1.5f}, {0.5f, 1, 0}, scenes::Facing::outward);
            const glm::dvec3 lo = glm::dvec3(-2, 0, -2) + (snap - 0.5) * cell;
            expect_alike(scene, {lo, cell, glm::ivec3(cells + 1, 3 * cells / 4 + 1, cells + 1)},
                         "room");
        }
}

TEST(Capture, InstructionSetsAgreeOnStreetsAndFurniture) {
    std::mt19937 random(3);
    const auto at = [&](int from, int to) {
        return float(std::uniform_int_distribution<int>(from, to)(random)) / 4.0f;
    };
    for (const double turn : {0.0, 0.25, 0.1})
        for (const double snap : {0.0, 1e-6, 1e-4}) {
            // Boxes on quarters of metres that stand on the ground, on and in each other.
            Scene scene;
            const glm::dmat4 there =
                glm::rotate(glm::dmat4(1.0), turn * glm::pi<double>(), glm::dvec3(0, 1, 0));
            const int brick = scenes::add_material(scene, glm::vec3(0.5f));
            const int leaf = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
            scenes::add_quad(scene, brick, {-6, 0, -6}, {0, 0, 12}, {12, 0, 0}, there);
            for (int i = 0; i < 40; ++i) {
                const glm::vec3 lo(at(-20, 16), i % 3 == 0 ? at(0, 8) : 0.0f, at(-20, 16));
                scenes::add_box(scene, i % 4 == 0 ? leaf : brick, lo,
                                lo + glm::vec3(at(1, 8), at(1, 8), at(1, 8)),
                                scenes::Facing::outward, there);
            }
            expect_alike(scene,
                         {glm::dvec3(-5.125 + snap, -0.625 + snap, -5.125), 0.25, {41, 20, 41}},
                         "street");
        }
}

TEST(Capture, ASlopeIsLeftByItsFront) {
    const Grid grid = lattice(glm::ivec3(8));
    for (const glm::dvec3 normal :
         {glm::dvec3(0, 1, 1), glm::dvec3(0, -1, -1), glm::dvec3(1, 1, 1), glm::dvec3(-1, 2, 0)})
        for (const double snap : snaps) {
            // Through the centre of cell (4, 4, 4).
            const glm::dvec3 n = glm::normalize(normal);
            const glm::dvec3 u = glm::normalize(glm::cross(n, glm::dvec3(0.3, 0.5, 0.7)));
            const glm::dvec3 v = glm::cross(n, u);
            Scene scene;
            scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)),
                             glm::vec3(4.5 + snap * n - 9.0 * u - 9.0 * v), glm::vec3(18.0 * u),
                             glm::vec3(18.0 * v));
            const Visibility visibility = seen(scene, grid);
            const Capture capture = visibility.capture({4, 4, 4});
            ASSERT_TRUE(capture.open);
            const glm::dvec3 off = glm::dvec3(capture.point) - 4.5;
            EXPECT_NEAR(glm::dot(off, n), snap + double(surface_margin), 3e-6);
            EXPECT_NEAR(glm::length(off), snap + double(surface_margin), 3e-6);
        }
}

/// A room of double-sided walls, and in its midst a wall of two rooms: one sheet with two fronts,
/// or two that show their fronts to either side, `thick` apart.
Scene two_rooms(double snap, bool one_sheet, float thick) {
    Scene scene = room(0.4, true);
    const int material = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), one_sheet);
    const glm::dmat4 there = glm::translate(glm::dmat4(1.0), glm::dvec3(snap, 0, 0));
    scenes::add_quad(scene, material, {3.5f + 0.5f * thick, 1.9f, 1.9f}, {0, 4, 0}, {0, 0, 4},
                     there);
    if (!one_sheet)
        scenes::add_quad(scene, material, {3.5f - 0.5f * thick, 1.9f, 1.9f}, {0, 0, 4}, {0, 4, 0},
                         there);
    return scene;
}

TEST(Capture, InAWallBetweenRoomsACellIsOnNoSideAndReadersAreOnTheirs) {
    const Grid grid = lattice(glm::ivec3(7));
    for (const auto& [one_sheet, thick] :
         {std::pair(true, 0.0f), std::pair(false, 0.0f), std::pair(false, 1e-3f)})
        for (const double snap : snaps) {
            const Scene scene = two_rooms(snap, one_sheet, thick);
            const Visibility visibility = seen(scene, grid);
            Volume volume;
            volume.grid = grid;
            volume.validity = visibility::trace_validity(visibility, grid.dims);
            volume.walls = visibility::find_walls(visibility, grid.dims, volume.validity,
                                                  most_walls, walls_reach);
            volume.sh_order = 0;
            volume.sh.assign(1, std::vector<glm::vec3>(grid.size(), glm::vec3(0.0f)));
            for (size_t i = 0; i < grid.size(); ++i) {
                const glm::ivec3 cell = grid.cell_at(i);
                // Bright left of it, and the brighter the farther up.
                if (cell.x < 3)
                    volume.sh[0][i] = glm::vec3(float(double(cell.y) / double(volume::sh_y0)));
                if (glm::all(glm::greaterThan(cell, glm::ivec3(2)))
                    && glm::all(glm::lessThan(cell, glm::ivec3(5)))) {
                    EXPECT_EQ(volume.validity[i], cell.x == 3 ? 0.0f : 1.0f) << snap;
                }
            }
            for (double y = 2.6; y < 5.0; y += 0.1) {
                const glm::dvec3 at(3.5 + snap, y, 3.7);
                EXPECT_NEAR(read_irradiance(volume, at, {-1, 0, 0}, Reading::facing).x,
                            glm::pi<double>() * (y - 0.5), 0.25); // 1.6 by the nearest
                EXPECT_EQ(read_irradiance(volume, at, {1, 0, 0}, Reading::facing).x, 0.0);
            }
        }
}

TEST(Capture, OpenGroundOfTwoFrontsIsLeftByItsTriangles) {
    const Grid grid = lattice(glm::ivec3(9));
    for (const bool with_house : {false, true})
        for (const double snap : snaps) {
            Scene scene;
            const int both = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
            scenes::add_quad(scene, both, {-99, 4.5f, -99}, {0, 0, 200}, {200, 0, 0},
                             glm::translate(glm::dmat4(1.0), {0, snap, 0}));
            if (with_house) // one ray meets it
                scenes::add_box(scene, both, {12, 4.5f, -99}, {14, 9, 99}, scenes::Facing::outward,
                                glm::translate(glm::dmat4(1.0), {0, snap, 0}));
            const Visibility visibility = seen(scene, grid);
            const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);
            for (size_t i = 0; i < grid.size(); ++i) {
                const glm::ivec3 cell = grid.cell_at(i);
                ASSERT_EQ(validity[i], 1.0f) << snap << " " << i;
                if (cell.y == 4) {
                    ASSERT_NEAR(visibility.capture(cell).point.y,
                                4.5 + snap + double(surface_margin), 2e-6);
                }
            }
        }
}

TEST(Capture, InANookWithoutRoomACellTakesNoLight) {
    // Between a floor and a sheet a hundredth of a cell above it that faces down.
    const Grid grid = lattice(glm::ivec3(5));
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_quad(scene, material, {0, 2.495f, 0}, {0, 0, 5}, {5, 0, 0});
    scenes::add_quad(scene, material, {0, 2.505f, 0}, {5, 0, 0}, {0, 0, 5});
    const Visibility visibility = seen(scene, grid);
    EXPECT_FALSE(visibility.capture({2, 2, 2}).open);
    EXPECT_EQ(visibility::trace_validity(visibility, grid.dims)[grid.index({2, 2, 2})], 0.0f);
}

} // namespace
} // namespace lpvbake
