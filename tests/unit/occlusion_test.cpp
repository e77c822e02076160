#include "solver/occlusion.h"

#include "scenes.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

Grid grid_of(glm::ivec3 dims) {
    return {glm::dvec3(0.0), 1.0, dims};
}
/// Cells that light from `start` can reach over open links.
std::vector<uint8_t> flood(const solver::Links& links, const Grid& grid, glm::ivec3 start) {
    std::vector<uint8_t> reached(grid.size(), 0);
    std::vector<glm::ivec3> stack{start};
    reached[grid.index(start)] = 1;
    while (!stack.empty()) {
        const glm::ivec3 c = stack.back();
        stack.pop_back();
        for (int axis = 0; axis < 3; ++axis)
            for (const int sign : {1, -1}) {
                glm::ivec3 n = c;
                n[axis] += sign;
                if (!grid.contains(n) || reached[grid.index(n)])
                    continue;
                const glm::ivec3 low = sign > 0 ? c : n;
                if (links.open[3 * grid.index(low) + size_t(axis)] > 0.0f) {
                    reached[grid.index(n)] = 1;
                    stack.push_back(n);
                }
            }
    }
    return reached;
}

TEST(Links, AWallOfAnyOrientationIsTight) {
    std::mt19937 random(1);
    const Grid grid = grid_of({12, 10, 11});
    for (int i = 0; i < 40; ++i) {
        Scene scene;
        const glm::dmat4 turn = i == 0 ? glm::dmat4(1.0) : scenes::random_turn(random);
        const glm::dvec3 through{6.1, 5.2, 5.3};
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {-50, -50, 0},
                         {100, 0, 0}, {0, 100, 0}, glm::translate(glm::dmat4(1.0), through) * turn);
        const solver::Links links =
            solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid);
        const glm::dvec3 normal{turn * glm::dvec4(0, 0, 1, 0)};
        const auto side = [&](glm::ivec3 c) {
            return glm::dot(glm::dvec3(c) + 0.5 - through, normal);
        };
        const std::vector<uint8_t> reached = flood(links, grid, {0, 0, 0});
        size_t count = 0;
        for (int z = 0; z < grid.dims.z; ++z)
            for (int y = 0; y < grid.dims.y; ++y)
                for (int x = 0; x < grid.dims.x; ++x)
                    if (reached[grid.index({x, y, z})]) {
                        ++count;
                        EXPECT_GT(side({x, y, z}) * side({0, 0, 0}), 0.0) << i;
                    }
        EXPECT_GT(count, 50u); // and the near side is not blocked
    }
}

TEST(Links, CellsOnAFloorAreNoPartOfEitherSide) {
    const Grid grid = grid_of({5, 6, 4});
    for (const double snap : {0.0, 1e-6, -1e-6, 1e-4, -1e-4, 1e-2, -1e-2}) {
        Scene scene;
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)),
                         {-9.0f, float(2.5 + snap), -9.0f}, {0, 0, 30}, {30, 0, 0});
        const solver::Links links =
            solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid);
        const std::vector<uint8_t> reached = flood(links, grid, {2, 5, 2});
        for (size_t i = 0; i < grid.size(); ++i) {
            const glm::ivec3 c = grid.cell_at(i);
            EXPECT_EQ(reached[i], c.y > 2 ? 1 : 0) << snap << " " << i;
            EXPECT_EQ(links.validity[i], c.y > 2 ? 1.0f : 0.0f) << snap << " " << i;
            for (int axis = 0; axis < 3; ++axis) {
                const bool closed = c.y == 2 || (axis == 1 && c.y == 1);
                EXPECT_EQ(links.open[3 * i + size_t(axis)], closed ? 0.0f : 1.0f)
                    << snap << " " << i;
            }
        }
    }
}

TEST(Links, ATurnedClosedBoxIsTight) {
    std::mt19937 random(2);
    const Grid grid = grid_of({16, 16, 16});
    for (int i = 0; i < 20; ++i) {
        Scene scene;
        scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), glm::vec3(-4.0f),
                        glm::vec3(4.0f), scenes::Facing::inward,
                        glm::translate(glm::dmat4(1.0), glm::dvec3(8.0))
                            * scenes::random_turn(random));
        const solver::Links links =
            solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid);
        const std::vector<uint8_t> reached = flood(links, grid, {8, 8, 8});
        for (const glm::ivec3 corner : {glm::ivec3(0), glm::ivec3(15), glm::ivec3(15, 0, 0)})
            EXPECT_FALSE(reached[grid.index(corner)]) << i;
        EXPECT_GT(std::count(reached.begin(), reached.end(), 1), 200);
    }
}

TEST(Links, AWallOnCentersOrFacesIsTight) {
    const Grid grid = grid_of({8, 6, 6});
    for (const float x : {4.0f, 4.5f, 4.0001f, 4.4999f, 4.50001f}) {
        Scene scene;
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {x, -5, -5},
                         {0, 20, 0}, {0, 0, 20});
        const solver::Links links =
            solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid);
        const std::vector<uint8_t> reached = flood(links, grid, {0, 0, 0});
        EXPECT_FALSE(reached[grid.index({7, 3, 3})]) << x;
        EXPECT_TRUE(reached[grid.index({3, 5, 5})]) << x;
    }
}

TEST(Links, FarOriginAndTinyScaleMakeNoDifference) {
    Scene scene, far;
    const glm::dmat4 turn = glm::rotate(glm::dmat4(1.0), 0.7, glm::dvec3(1, 2, 3));
    for (Scene* s : {&scene, &far})
        scenes::add_box(*s, scenes::add_material(*s, glm::vec3(0.5f)), glm::vec3(-1.0f),
                        glm::vec3(1.0f), scenes::Facing::outward);
    const double scale = 1e-2;
    const glm::dvec3 offset{1e5, -1e5, 3e5};
    scene.instances[0].to_world = turn;
    far.instances[0].to_world = glm::translate(glm::dmat4(1.0), offset)
                                * glm::scale(glm::dmat4(1.0), glm::dvec3(scale)) * turn;
    const Grid near_grid{glm::dvec3(-2.0), 0.25, glm::ivec3(16)};
    const Grid far_grid{offset - 2.0 * scale, 0.25 * scale, glm::ivec3(16)};
    const solver::Links a =
        solver::trace_links(visibility::Visibility(scene, scene::frame_of(near_grid)), near_grid);
    const solver::Links b =
        solver::trace_links(visibility::Visibility(far, scene::frame_of(far_grid)), far_grid);
    size_t different = 0;
    for (size_t i = 0; i < a.open.size(); ++i)
        different += a.open[i] != b.open[i];
    EXPECT_LT(different, a.open.size() / 1000);
}

TEST(Links, CoverageScalesAnOpenLink) {
    // A quad over half of the face between (1,1,1) and (2,1,1), clear of the centre line.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {2, 1, 1}, {0, 0.45f, 0},
                     {0, 0, 1});
    const Grid grid = grid_of({4, 3, 3});
    const solver::Links links =
        solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid);
    EXPECT_FLOAT_EQ(links.open[3 * grid.index({1, 1, 1})], 0.5f);
    EXPECT_FLOAT_EQ(links.open[3 * grid.index({0, 1, 1})], 1.0f);
    EXPECT_FLOAT_EQ(links.open[3 * grid.index({1, 1, 1}) + 1], 1.0f);
}

TEST(Links, ABlendedPaneLetsItsShareThrough) {
    Scene scene;
    const int glass = scenes::add_material(scene, glm::vec3(0.5f));
    scene.materials[size_t(glass)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(glass)].base_color.w = 0.5f;
    scenes::add_quad(scene, glass, {2, -9, -9}, {0, 30, 0}, {0, 0, 30});
    const Grid grid = grid_of({4, 3, 3});
    const solver::Links links =
        solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid);
    // Lines run through the edge between the pane's two triangles: it counts once all the same.
    for (int y = 0; y < 3; ++y)
        for (int z = 0; z < 3; ++z)
            EXPECT_NEAR(links.open[3 * grid.index({1, y, z})], 0.5f, 1e-6f) << y << ' ' << z;
}

TEST(Validity, TellsSolidsFromRooms) {
    const Grid grid = grid_of({9, 9, 9});
    Scene solid, room, terrain;
    scenes::add_box(solid, scenes::add_material(solid, glm::vec3(0.5f)), glm::vec3(2.2f),
                    glm::vec3(6.7f), scenes::Facing::outward);
    scenes::add_box(room, scenes::add_material(room, glm::vec3(0.5f)), glm::vec3(0.2f),
                    glm::vec3(8.7f), scenes::Facing::inward);
    scenes::add_quad(terrain, scenes::add_material(terrain, glm::vec3(0.5f)), {-9, 4.2f, -9},
                     {0, 0, 40}, {40, 0, 0});
    const auto validity = [&](const Scene& scene) {
        return solver::trace_links(visibility::Visibility(scene, scene::frame_of(grid)), grid)
            .validity;
    };
    const std::vector<float> in_solid = validity(solid), in_room = validity(room),
                             on_terrain = validity(terrain);
    for (int z = 0; z < 9; ++z)
        for (int y = 0; y < 9; ++y)
            for (int x = 0; x < 9; ++x) {
                const glm::vec3 p = glm::vec3(x, y, z) + 0.5f;
                const bool inside = glm::all(glm::greaterThan(p, glm::vec3(2.2f)))
                                    && glm::all(glm::lessThan(p, glm::vec3(6.7f)));
                const size_t i = grid.index({x, y, z});
                EXPECT_EQ(in_solid[i], inside ? 0.0f : 1.0f) << x << ' ' << y << ' ' << z;
                EXPECT_EQ(in_room[i], 1.0f);
                EXPECT_EQ(on_terrain[i], p.y < 4.2f ? 0.0f : 1.0f);
            }
}

TEST(GeometryVolume, AFullWallBlocksThreeQuartersAlongItsNormal) {
    // L1 projection of max(0, cos): 1/4 + 1/2 = 3/4 along the normal, by hand.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {4, -4, -4}, {0, 16, 0},
                     {0, 0, 16});
    const Grid grid = grid_of({8, 8, 8});
    const solver::GeometryVolume geometry = solver::make_geometry_volume(
        surface::make_patches(scene, scene::frame_of(grid), 0.25f), grid);
    EXPECT_NEAR(geometry.blocked({4, 4, 4}, {1, 0, 0}), 0.75f, 0.03f);
    EXPECT_NEAR(geometry.blocked({4, 4, 4}, {-1, 0, 0}), 0.75f, 0.03f);
    EXPECT_NEAR(geometry.blocked({4, 4, 4}, {0, 1, 0}), 0.25f, 0.03f);
    EXPECT_EQ(geometry.blocked({6.5f, 4, 4}, {1, 0, 0}), 0.0f);
}

TEST(GeometryVolume, TheTwoSidesOfAThinWallDoNotCancel) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), {3.95f, -4, -4},
                    {4.05f, 12, 12}, scenes::Facing::outward);
    const Grid grid = grid_of({8, 8, 8});
    const solver::GeometryVolume geometry = solver::make_geometry_volume(
        surface::make_patches(scene, scene::frame_of(grid), 0.25f), grid);
    EXPECT_EQ(geometry.blocked({4, 4, 4}, {1, 0, 0}), 1.0f);
}

TEST(GeometryVolume, FacesAreThirtyDistinctOnes) {
    const auto& faces = solver::lpv_faces();
    for (size_t i = 0; i < faces.size(); ++i) {
        EXPECT_NEAR(glm::length(faces[i].toward), 1.0f, 1e-6f);
        for (size_t j = 0; j < i; ++j)
            EXPECT_GT(glm::distance(faces[i].toward, faces[j].toward), 0.1f);
    }
}

} // namespace
} // namespace lpvbake
