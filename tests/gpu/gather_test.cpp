// The gather against closed forms, against brute force, and against what its light may not do.
#include "solver/gather/gather.h"

#include "gpu/device.h"
#include "oracles/gather_oracle.h"
#include "scenes.h"
#include "visibility/validity.h"
#include "volume/grid.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <optional>

namespace lpvbake {
namespace {

const double pi = glm::pi<double>();
const double constant = std::sqrt(4.0 * pi); ///< c_0 of luminance 1 from everywhere

/// A scene in its grid.
struct Setting {
    Scene scene;
    Grid grid;
    scene::Frame frame;
    visibility::Visibility visibility;

    Setting(Scene scene_in, const Grid& grid_in)
        : scene(std::move(scene_in)),
          grid(grid_in),
          frame{grid.origin, grid.cell, glm::dvec3(grid.dims)},
          visibility(scene, frame) {}

    Volume volume() const {
        Volume v;
        v.grid = grid;
        v.validity = visibility::trace_validity(visibility, grid.dims);
        return v;
    }
};

Grid fit(const Scene& scene, int resolution) {
    const Bounds box = bounds_of(scene);
    return volume::fit_grid(box.lo, box.hi, {resolution});
}

surface::LitSurfaces light(const Setting& setting, std::optional<int> bounces) {
    surface::LightingSettings settings;
    settings.bounces = bounces;
    Progress silent;
    return surface::light_surfaces(setting.scene, setting.visibility, setting.frame, settings,
                                   silent);
}

/// Two rooms, [0, 2]^3 and what lies beyond a wall of 5 cm; a lamp in the first.
Scene two_rooms(float door) {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.7f));
    scenes::add_box(scene, white, {0, 0, 0}, {4.05f, 2, 2}, scenes::Facing::inward);
    scenes::add_box(scene, white, {2, 0, 0}, {2.05f, 2, 2 - door}, scenes::Facing::outward);
    scene.lights.push_back(scenes::point_light({0.8, 1.7, 0.7}, 100.0));
    return scene;
}

/// A square of side `edge` in the plane z = 0 around (x, x), cut into unit squares of two patches
/// each; shines to +z.
surface::LitSurfaces square(float x, int edge, glm::vec3 luminance) {
    surface::LitSurfaces lit;
    for (int i = 0; i < edge; ++i)
        for (int j = 0; j < edge; ++j)
            for (const float turn : {1.0f, -1.0f}) {
                surface::Patch patch;
                const glm::vec3 middle{x + float(i) + 0.5f - 0.5f * float(edge),
                                       x + float(j) + 0.5f - 0.5f * float(edge), 0.0f};
                patch.edge_u = {turn, 0.0f, 0.0f};
                patch.edge_v = {0.0f, turn, 0.0f};
                patch.position = middle - glm::vec3(turn, turn, 0.0f) / 6.0f;
                patch.normal = {0.0f, 0.0f, 1.0f};
                patch.area = 0.5f;
                lit.patches.push_back(patch);
                lit.luminance.push_back(luminance);
                lit.luminance.push_back(glm::vec3(0.0f));
            }
    return lit;
}

solver::gather::GatherSettings everywhere(int order) {
    solver::gather::GatherSettings settings;
    settings.order = order;
    settings.tolerance = 0.0f;
    return settings;
}

class Gather : public testing::DeviceTest {
protected:
    solver::gather::GatherReport run(const Setting& setting, const surface::LitSurfaces& lit,
                                     Volume& volume, const solver::gather::GatherSettings& settings,
                                     uint64_t window = 0) {
        Progress silent;
        return solver::gather::GatherProgram(device(), settings, window)
            .gather(lit, setting.scene.sky, setting.visibility, volume, silent);
    }

    /// The light at places (frame units), of that validity.
    std::vector<std::vector<glm::vec3>> run_at(const Setting& setting,
                                               const surface::LitSurfaces& lit,
                                               const std::vector<glm::vec3>& places,
                                               const std::vector<float>& validity) {
        Volume volume;
        volume.grid.dims = {int(places.size()), 1, 1};
        volume.validity = validity;
        Progress silent;
        solver::gather::GatherProgram(device(), everywhere(2))
            .gather_at(places, lit, setting.scene.sky, setting.visibility, volume, silent);
        return volume.sh;
    }
};

TEST_F(Gather, LightThroughGlassHasItsColour) {
    for (const bool sky : {false, true}) {
        const Setting setting(scenes::glass_room(sky), {glm::dvec3(1.2), 0.16, glm::ivec3(10)});
        Volume volume = setting.volume();
        run(setting, light(setting, {}), volume, everywhere(2));
        glm::dvec3 mean(0.0);
        for (const glm::vec3& c : volume.sh[0])
            mean += glm::dvec3(c) / constant / double(volume.grid.size());
        for (int channel = 0; channel < 3; ++channel)
            EXPECT_NEAR(mean[channel] / scenes::luminance_in_glass_room()[channel], 1.0, 0.02)
                << sky << ' ' << channel;
    }
    const Setting pane(scenes::clear_pane(), {glm::dvec3(0.0), 0.5, glm::ivec3(8)});
    Volume volume = pane.volume();
    run(pane, light(pane, {}), volume, everywhere(2));
    for (int x = 0; x < 8; ++x) {
        glm::dvec3 mean(0.0);
        for (int i = 0; i < 64; ++i)
            mean +=
                glm::dvec3(volume.sh[0][volume.grid.index({x, i % 8, i / 8})]) / constant / 64.0;
        for (int channel = 0; channel < 3; ++channel)
            EXPECT_NEAR(mean[channel], scenes::luminance_beside_clear_pane()[channel], 0.02)
                << x << ' ' << channel;
    }
}

TEST_F(Gather, HasTheFormFactorOfASquareAtEveryDistance) {
    const Setting empty({}, {glm::dvec3(0.0), 1.0, {9, 9, 60}});
    for (const int edge : {1, 4}) {
        const surface::LitSurfaces lit = square(4.5f, edge, {1.0f, 2.0f, 3.0f});
        Volume volume;
        volume.grid = empty.grid;
        volume.validity.assign(volume.grid.size(), 1.0f);
        run(empty, lit, volume, everywhere(2));
        const double a = 0.5 * edge;
        for (int z = 0; z < 60; ++z) {
            const size_t cell = volume.grid.index({4, 4, z});
            const double d = z + 0.5, s = std::hypot(a, d);
            const double angle = 4.0 * std::asin(a * a / (s * s));
            const double facing = 4.0 * (a / s) * std::atan(a / s); // integral of the cosine
            for (int c = 0; c < 3; ++c) {
                const double l = c + 1.0;
                EXPECT_NEAR(volume.sh[0][cell][c] / (l / constant * angle), 1.0, 4e-3) << z;
                EXPECT_NEAR(volume.sh[2][cell][c] / (-l * std::sqrt(3.0 / pi) / 2.0 * facing), 1.0,
                            1e-2)
                    << z;
                // Symmetric: nothing across.
                for (const size_t k : {1, 3, 4, 5, 7, 8})
                    EXPECT_NEAR(volume.sh[k][cell][c], 0.0, 8e-3 * l * angle) << z << ' ' << k;
            }
        }
        const auto square_of = [&](int z) {
            return volume.sh[0][volume.grid.index({4, 4, z})][0] * (z + 0.5) * (z + 0.5);
        };
        EXPECT_NEAR(square_of(59) / square_of(40), 1.0, 5e-3);
    }
}

TEST_F(Gather, SeesNothingFromBehind) {
    const Setting empty({}, {glm::dvec3(0.0, 0.0, -8.0), 1.0, {9, 9, 8}});
    surface::LitSurfaces lit = square(4.5f, 3, glm::vec3(1.0f));
    for (surface::Patch& patch : lit.patches)
        patch.position.z += 8.0f;
    Volume volume;
    volume.grid = empty.grid;
    volume.validity.assign(volume.grid.size(), 1.0f);
    run(empty, lit, volume, everywhere(2));
    for (const auto& values : volume.sh)
        for (const glm::vec3& value : values)
            ASSERT_EQ(value, glm::vec3(0.0f));
}

TEST_F(Gather, AgreesWithBruteForce) {
    const Scene scene = scenes::cornell_box_with_point();
    const Setting setting(scene, fit(scene, 10));
    const surface::LitSurfaces lit = light(setting, 1);
    std::vector<oracle::Triangle> triangles;
    for (size_t i = 0; i < lit.patches.size(); ++i) {
        const surface::Patch& p = lit.patches[i];
        triangles.push_back(
            {p.at({0, 0}), p.at({1, 0}), p.at({0, 1}), p.normal, glm::dvec3(lit.luminance[2 * i])});
    }
    const oracle::Sees sees = [&](glm::dvec3 from, glm::dvec3 to) {
        return setting.visibility.transmittance({glm::vec3(from), glm::vec3(to - from)}) > 0.0f;
    };
    solver::gather::GatherSettings fine = everywhere(4);
    fine.vpls = 2000;
    fine.kappa = 3.0f;
    solver::gather::GatherSettings usual;
    usual.order = 4;
    usual.tolerance = 0.1f;
    Volume accurate = setting.volume(), quick = setting.volume();
    const solver::gather::GatherReport all = run(setting, lit, accurate, fine);
    run(setting, lit, quick, usual);
    EXPECT_EQ(all.interpolated, 0u);
    std::array<double, 5> off_fine{}, off_usual{}, size{};
    double got = 0.0, there = 0.0;
    for (size_t cell = 7; cell < setting.grid.size(); cell += 67) {
        if (!(accurate.validity[cell] > 0.0f)) {
            for (const auto& values : accurate.sh)
                EXPECT_EQ(values[cell], glm::vec3(0.0f));
            continue;
        }
        const int x = int(cell) % setting.grid.dims.x, rest = int(cell) / setting.grid.dims.x;
        const glm::dvec3 at =
            glm::dvec3(x, rest % setting.grid.dims.y, rest / setting.grid.dims.y) + 0.5;
        std::vector<glm::dvec3> sh(25, glm::dvec3(0.0));
        for (const oracle::Triangle& t : triangles)
            oracle::arrive(t, at, 4, sees, sh);
        for (int l = 0, k = 0; l <= 4; ++l)
            for (int m = -l; m <= l; ++m, ++k)
                for (int c = 0; c < 3; ++c) {
                    const double truth = sh[size_t(k)][c];
                    off_fine[size_t(l)] +=
                        std::abs(double(accurate.sh[size_t(k)][cell][c]) - truth);
                    off_usual[size_t(l)] += std::abs(double(quick.sh[size_t(k)][cell][c]) - truth);
                    size[size_t(l)] += std::abs(sh[0][c]);
                    got += k == 0 ? double(accurate.sh[0][cell][c]) : 0.0;
                    there += k == 0 ? truth : 0.0;
                }
    }
    for (size_t l = 0; l <= 4; ++l) {
        EXPECT_LT(off_fine[l] / size[l], 0.012) << l;
        EXPECT_LT(off_usual[l] / size[l], 0.03) << l;
    }
    EXPECT_NEAR(got / there, 1.0, 0.012);
}

TEST_F(Gather, FurnaceIsOneEverywhereAndInAllDirections) {
    const Scene scene = scenes::furnace(2.0f, 0.5f, 1.0f);
    const Setting setting(scene, fit(scene, 20));
    const surface::LitSurfaces lit = light(setting, 0);
    for (const float tolerance : {0.0f, 0.3f}) {
        solver::gather::GatherSettings settings;
        settings.tolerance = tolerance;
        Volume volume = setting.volume();
        const solver::gather::GatherReport report = run(setting, lit, volume, settings);
        EXPECT_EQ(report.interpolated > 0, tolerance > 0.0f);
        for (int z = 1; z < 19; ++z)
            for (int y = 1; y < 19; ++y)
                for (int x = 1; x < 19; ++x) {
                    const size_t cell = volume.grid.index({x, y, z});
                    EXPECT_NEAR(volume.sh[0][cell].x / constant, 1.0, 0.01);
                    for (size_t k = 1; k < 9; ++k)
                        EXPECT_NEAR(volume.sh[k][cell].x / constant, 0.0, 0.02) << k;
                }
    }
}

TEST_F(Gather, NothingLeaksThroughAClosedWall) {
    for (const int resolution : {9, 24, 33}) {
        const Scene scene = two_rooms(0.0f);
        const Setting setting(scene, fit(scene, resolution));
        Volume volume = setting.volume();
        run(setting, light(setting, 1), volume, {});
        double lit = 0.0;
        for (int z = 0; z < setting.grid.dims.z; ++z)
            for (int y = 0; y < setting.grid.dims.y; ++y)
                for (int x = 0; x < setting.grid.dims.x; ++x) {
                    const size_t cell = setting.grid.index({x, y, z});
                    if (setting.grid.center({x, y, z}).x < 2.0)
                        lit += double(volume.sh[0][cell].x);
                    else
                        for (const auto& values : volume.sh)
                            ASSERT_EQ(values[cell], glm::vec3(0.0f)) << x << ' ' << y << ' ' << z;
                }
        EXPECT_GT(lit, 0.0);
    }
}

TEST_F(Gather, OfTwoSheetsOneBehindTheOtherOnlyTheNearerIsSeen) {
    // A lamp close below a bright ceiling: what is below it sees the lamp alone.
    const auto sum_below = [&](bool ceiling) {
        Scene scene;
        const auto sheet = [&](float y, float nits) {
            scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(nits)),
                             {0.5f, y, 0.5f}, {3, 0, 0}, {0, 0, 3});
        };
        if (ceiling)
            sheet(2.0f, 40.0f);
        sheet(1.99f, 100.0f);
        const Setting setting(scene, {glm::dvec3(0.0), 0.125, {32, 15, 32}});
        Volume volume = setting.volume();
        run(setting, light(setting, 0), volume, {});
        double sum = 0.0;
        for (const glm::vec3& value : volume.sh[0])
            sum += double(value.x);
        return sum;
    };
    EXPECT_NEAR(sum_below(true) / sum_below(false), 1.0, 1e-2);
}

TEST_F(Gather, WhatStandsBesideACellShadesIt) {
    // A small lamp above a black box, whose walls go through centres of cells or between them.
    for (const float off : {0.0f, 0.5f}) {
        const glm::vec3 lo(4.5f + off, 0.5f, 4.5f + off), hi(12.5f + off, 8.5f + off, 12.5f + off);
        Scene scene;
        scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.0f)), lo, hi,
                        scenes::Facing::outward);
        scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(100.0f)),
                         {8.5f, 20.0f, 8.5f}, {1, 0, 0}, {0, 0, 1});
        const Setting setting(scene, {glm::dvec3(0.0), 1.0, {25, 17, 25}});
        Volume volume = setting.volume();
        run(setting, light(setting, 0), volume, everywhere(2));
        int shaded = 0, lit = 0;
        for (size_t i = 0; i < volume.grid.size(); ++i) {
            const glm::vec3 from = setting.visibility.capture(volume.grid.cell_at(i)).point;
            const auto is_shaded = [&](glm::vec3 at) { // it enters the box before it leaves it
                const glm::vec3 a = (lo - from) / (at - from), b = (hi - from) / (at - from);
                const glm::vec3 in = glm::min(a, b), out = glm::max(a, b);
                return std::max({in.x, in.y, in.z, 0.0f}) < std::min({out.x, out.y, out.z});
            };
            if (volume.validity[i] > 0.0f && is_shaded({8.5f, 20, 8.5f})
                && is_shaded({9.5f, 20, 8.5f}) && is_shaded({8.5f, 20, 9.5f})
                && is_shaded({9.5f, 20, 9.5f})) {
                ++shaded;
                lit += volume.sh[0][i] != glm::vec3(0.0f);
            }
        }
        EXPECT_GT(shaded, 200);
        EXPECT_LT(lit, shaded / 10); // at its edges; a third where cells ask those before them
        EXPECT_GT(volume.sh[0][volume.grid.index({8, 12, 8})].x, 0.0f);
    }
}

TEST_F(Gather, FewClustersKeepTheLight) {
    // Glowing ground between fences: of a large cluster cells see the part beside them, which
    // sends most, and not the rest.
    Scene scene;
    const int glow = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(1.0f));
    const int black = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(0.0f), true);
    scenes::add_quad(scene, glow, {0, 0, 0}, {0, 0, 16}, {16, 0, 0});
    for (const float at : {1.9f, 4.1f, 5.9f, 8.1f, 10.3f, 12.2f, 14.0f}) {
        scenes::add_quad(scene, black, {at, 0, 0}, {0, 1.5f, 0}, {0, 0, 16});
        scenes::add_quad(scene, black, {0, 0, at}, {0, 1.5f, 0}, {16, 0, 0});
    }
    const Setting setting(scene, {glm::dvec3(0.25, 0.25, 0.25), 0.5, glm::ivec3(31, 3, 31)});
    const surface::LitSurfaces lit = light(setting, 0);
    const auto energy = [&](int clusters) {
        Volume volume = setting.volume();
        solver::gather::GatherSettings settings = everywhere(1);
        settings.vpls = clusters;
        run(setting, lit, volume, settings);
        double sum = 0.0;
        for (const glm::vec3& c : volume.sh[0])
            sum += double(c.x);
        return sum;
    };
    const double many = energy(8192);
    EXPECT_NEAR(energy(64) / many, 1.0, 0.02);
    EXPECT_NEAR(energy(16) / many, 1.0, 0.04);
}

TEST_F(Gather, LightComesThroughADoor) {
    const Scene scene = two_rooms(0.6f);
    const Setting setting(scene, fit(scene, 24));
    Volume volume = setting.volume();
    run(setting, light(setting, 1), volume, {});
    const glm::ivec3 cell(setting.grid.to_grid({3.0, 1.0, 1.7}));
    EXPECT_GT(volume.sh[0][setting.grid.index(cell)].x, 0.0f);
}

TEST_F(Gather, SameBitsForAnyNumberOfThreadsAndAnyWindow) {
    const Scene scene = scenes::cornell_box_with_point();
    const Setting setting(scene, fit(scene, 14));
    const surface::LitSurfaces lit = light(setting, 1);
    Volume first = setting.volume();
    run(setting, lit, first, {});
    Volume again = setting.volume();
    run(setting, lit, again, {});
    EXPECT_EQ(first.sh, again.sh);
    for (const uint64_t window : {uint64_t(1) << 18, uint64_t(1'000'000)}) {
        run(setting, lit, again, {}, window);
        EXPECT_EQ(first.sh, again.sh) << window;
    }
    const tbb::global_control alone(tbb::global_control::max_allowed_parallelism, 1);
    run(setting, lit, again, {});
    EXPECT_EQ(first.sh, again.sh);
}

TEST_F(Gather, IsLinearOverEighteenOrdersOfMagnitude) {
    const Scene scene = scenes::cornell_box_with_point();
    const Setting setting(scene, fit(scene, 12));
    const surface::LitSurfaces lit = light(setting, 1);
    Volume one = setting.volume(), other = setting.volume();
    run(setting, lit, one, everywhere(2));
    for (const float scale : {1e-9f, 1e9f}) {
        surface::LitSurfaces scaled = lit;
        for (glm::vec3& luminance : scaled.luminance)
            luminance *= scale;
        run(setting, scaled, other, everywhere(2));
        for (size_t cell = 0; cell < setting.grid.size(); ++cell)
            ASSERT_NEAR(other.sh[0][cell].x / scale, one.sh[0][cell].x, 2e-3f * one.sh[0][cell].x);
    }
}

TEST_F(Gather, NoLightCostsNothing) {
    const Scene scene = scenes::cornell_box();
    const Setting setting(scene, fit(scene, 12));
    for (const surface::LitSurfaces& lit : {surface::LitSurfaces{}, light(setting, 1)}) {
        Volume volume = setting.volume();
        const solver::gather::GatherReport report = run(setting, lit, volume, {});
        EXPECT_EQ(report.rays, 0u);
        EXPECT_EQ(report.solved, 0u);
        ASSERT_EQ(volume.sh.size(), 9u);
        for (const auto& values : volume.sh)
            for (const glm::vec3& value : values)
                ASSERT_EQ(value, glm::vec3(0.0f));
    }
}

TEST_F(Gather, OpenSkyIsTheSameFromEverywhere) {
    Setting setting({}, {glm::dvec3(0.0), 1.0, {7, 5, 6}});
    setting.scene.sky.luminance = {1.0f, 2.0f, 4.0f};
    for (const int order : {1, 2, 4}) {
        Volume volume;
        volume.grid = setting.grid;
        volume.validity.assign(volume.grid.size(), 1.0f);
        run(setting, {}, volume, everywhere(order));
        for (size_t cell = 0; cell < setting.grid.size(); ++cell)
            for (size_t k = 0; k < volume.sh.size(); ++k)
                for (int c = 0; c < 3; ++c)
                    ASSERT_NEAR(volume.sh[k][cell][c], k == 0 ? constant * double(1 << c) : 0.0,
                                2e-3 * (1 << c))
                        << k;
    }
}

TEST_F(Gather, GroundHidesHalfOfTheSky) {
    Scene scene = scenes::floor_quad(2000.0f, glm::vec3(0.0f));
    scene.sky.luminance = glm::vec3(1.0f);
    const Setting setting(scene, {glm::dvec3(-4.0, -1.0, -4.0), 1.0, {8, 8, 8}});
    Volume volume = setting.volume();
    run(setting, {}, volume, {});
    for (int x = 0; x < 8; ++x)
        for (int y = 2; y < 8; ++y) {
            const size_t cell = volume.grid.index({x, y, 3});
            EXPECT_NEAR(volume.sh[0][cell].x, 0.5 * constant, 0.02 * constant);
            EXPECT_NEAR(volume.sh[1][cell].x, 0.5 * std::sqrt(3.0 * pi), 0.03);
        }
}

TEST_F(Gather, TakesTheSameDeviceMemoryWhateverTheGrid) {
    EXPECT_LT(solver::gather::gather_device_bytes({}), uint64_t(128) << 20);
}

/// Blocks on the cells of a grid, one after the other along x, of each of which `left_out` is
/// known; and the cells that they solve.
std::pair<std::vector<solver::Block>, std::vector<size_t>> blocks_on(const Volume& grid, int count,
                                                                     int left_out) {
    std::pair<std::vector<solver::Block>, std::vector<size_t>> found;
    const Grid cube{{}, 1, glm::ivec3(solver::Block::edge + 1)};
    std::vector<uint8_t> taken(grid.grid.size());
    for (int i = 0; i < count; ++i) {
        const glm::ivec3 first(solver::Block::edge * i, 0, 0);
        solver::Block block{glm::vec3(first) + 0.5f, 1, {}, {}};
        for (size_t at = 0; at < cube.size(); ++at) {
            const size_t cell = grid.grid.index(first + cube.cell_at(at));
            if (!grid.is_valid(cell))
                continue;
            const bool known = taken[cell]++ || int(cell % 8) < left_out;
            block.places.push_back(
                {uint16_t(at), known ? solver::Block::known : uint32_t(found.second.size())});
            if (!known)
                found.second.push_back(cell);
        }
        found.first.push_back(std::move(block));
    }
    return found;
}

TEST_F(Gather, BlocksShareWhatTheySeeAsAGridsCellsDo) {
    for (const bool sky : {false, true}) {
        Scene scene = two_rooms(0.5f);
        if (sky) {
            scene.instances.erase(scene.instances.begin()); // the wall stands in the open
            scene.sky.luminance = glm::vec3(100.0f);
        }
        const Setting setting(std::move(scene), {glm::dvec3(-0.3, 0.05, 0.05), 0.1, {33, 17, 17}});
        const surface::LitSurfaces lit = light(setting, {});
        Volume grid = setting.volume();
        const solver::gather::GatherReport whole = run(setting, lit, grid, everywhere(2));
        for (const int left_out : {0, 7}) {
            const auto [blocks, cells] = blocks_on(grid, 2, left_out);
            Volume row;
            row.grid.dims = {int(cells.size()), 1, 1};
            row.validity.assign(cells.size(), 1.0f);
            Progress silent;
            const solver::gather::GatherProgram program(device(), everywhere(2));
            const solver::gather::GatherReport report = program.gather_blocks(
                blocks, lit, program.senders(lit, setting.scene.sky, setting.visibility),
                setting.visibility, row, silent);
            double wrong = 0, sum = 0;
            for (size_t i = 0; i < cells.size(); ++i) {
                wrong += double(std::abs(row.sh[0][i].g - grid.sh[0][cells[i]].g));
                sum += double(grid.sh[0][cells[i]].g);
            }
            EXPECT_LT(wrong / sum, 0.005) << sky << left_out;
            EXPECT_EQ(report.solved, cells.size());
            if (left_out == 0) {
                EXPECT_EQ(cells.size(), whole.solved);
                EXPECT_LT(double(report.rays), 1.15 * double(whole.rays));
            }
        }
    }
}

TEST_F(Gather, GivenPlacesAreSolvedAsTheCellsThere) {
    for (const bool sky : {false, true}) {
        Scene scene = two_rooms(0.5f);
        if (sky) {
            scene.instances.erase(scene.instances.begin()); // the wall stands in the open
            scene.sky.luminance = glm::vec3(100.0f);
        }
        const Setting setting(std::move(scene), {glm::dvec3(-0.3, 0.05, 0.05), 0.1, {46, 19, 19}});
        const surface::LitSurfaces lit = light(setting, {});
        Volume grid = setting.volume();
        run(setting, lit, grid, everywhere(2));
        std::vector<glm::vec3> places;
        for (size_t cell = 0; cell < grid.grid.size(); ++cell)
            places.push_back(glm::vec3(grid.grid.cell_at(cell)) + 0.5f);
        const auto points = run_at(setting, lit, places, grid.validity);
        double wrong = 0, sum = 0;
        int same = 0;
        for (size_t cell = 0; cell < grid.grid.size(); ++cell) {
            const glm::ivec3 at = grid.grid.cell_at(cell) % 8;
            wrong += double(std::abs(points[0][cell].g - grid.sh[0][cell].g));
            sum += double(grid.sh[0][cell].g);
            // These test all there is themselves in a grid, too.
            if (!sky && at == glm::ivec3(0) && grid.sh[0][cell].g > 0.0f) {
                ++same;
                for (size_t k = 0; k < grid.sh.size(); ++k)
                    EXPECT_EQ(points[k][cell], grid.sh[k][cell]) << cell << ' ' << k;
            }
        }
        EXPECT_GT(same, sky ? -1 : 20);
        EXPECT_GT(sum, 0.0);
        EXPECT_LT(wrong / sum, 0.002) << sky;
    }
}

TEST_F(Gather, PlacesMayComeInAnyOrderAndTwice) {
    const Setting setting(two_rooms(0.5f), {glm::dvec3(0.0), 0.1, {40, 20, 20}});
    const surface::LitSurfaces lit = light(setting, {});
    std::vector<glm::vec3> places;
    std::vector<float> validity;
    for (uint32_t i = 0; i < 9000; ++i) { // more than one chunk of one zone
        const glm::vec3 at(i * 7919u % 1000u, i * 104729u % 997u, i * 1299709u % 991u);
        places.push_back(at / (i % 3 ? 70.0f : 25.0f));
        validity.push_back(i % 10 ? 1.0f : 0.0f);
    }
    places.push_back({-300.0f, 2000.0f, 5.0f}); // far outside
    validity.push_back(1.0f);
    const auto once = run_at(setting, lit, places, validity);
    const size_t n = places.size();
    for (size_t i = 0; i < n; ++i) {
        places.push_back(places[n - 1 - i]);
        validity.push_back(validity[n - 1 - i]);
    }
    const auto twice = run_at(setting, lit, places, validity);
    for (size_t k = 0; k < once.size(); ++k)
        for (size_t i = 0; i < n; ++i) {
            ASSERT_EQ(twice[k][i], once[k][i]) << i << ' ' << k;
            ASSERT_EQ(twice[k][2 * n - 1 - i], once[k][i]) << i << ' ' << k;
            ASSERT_TRUE(std::isfinite(once[k][i].g));
            ASSERT_TRUE(validity[i] > 0.0f || once[k][i] == glm::vec3(0.0f)) << i;
        }
    EXPECT_GT(once[0][1].g, 0.0f);
}

} // namespace
} // namespace lpvbake
