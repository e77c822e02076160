// The sweep against a recursive oracle, closed forms, and path-traced probes.
#include "solver/sn/sn.h"

#include "gpu/device.h"
#include "oracles/sn_oracle.h"
#include "reference/reference.h"
#include "scenes.h"
#include "solver/sn/directions.h"
#include "solver/sn/occupancy.h"
#include "visibility/validity.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <utility>

namespace lpvbake {
namespace {

const double pi = glm::pi<double>();

/// All directions of a set, by permutation and sign.
std::vector<glm::dvec3> all_directions(int count) {
    std::vector<glm::dvec3> all;
    for (const glm::dvec2 xy : solver::sn::sn_base_directions(count)) {
        const double value[] = {xy.x, xy.y, std::sqrt(1.0 - xy.x * xy.x - xy.y * xy.y)};
        for (int first = 0; first < 3; ++first)
            for (const int turn : {1, 2})
                for (int sign = 0; sign < 8; ++sign)
                    all.push_back({(sign & 1 ? -1 : 1) * value[first],
                                   (sign & 2 ? -1 : 1) * value[(first + turn) % 3],
                                   (sign & 4 ? -1 : 1) * value[(first + 2 * turn) % 3]});
    }
    return all;
}

double legendre(int l, double x) {
    double before = 1.0, here = x;
    for (int n = 2; n <= l; ++n) {
        const double next = ((2 * n - 1) * x * here - (n - 1) * before) / n;
        before = here;
        here = next;
    }
    return l == 0 ? 1.0 : here;
}

glm::dmat4 odd_turn() {
    return glm::rotate(glm::dmat4(1.0), 0.54, glm::normalize(glm::dvec3(1, 3, 2)));
}

void turn(Scene& scene) {
    for (Instance& instance : scene.instances)
        instance.to_world = odd_turn() * instance.to_world;
    for (Light& light : scene.lights) {
        light.position = glm::dvec3(odd_turn() * glm::dvec4(light.position, 1.0));
        light.direction = glm::dvec3(odd_turn() * glm::dvec4(light.direction, 0.0));
    }
}

/// A scene in a grid, lit.
struct Setting {
    Scene scene;
    Grid grid;
    scene::Frame frame;
    visibility::Visibility visibility;
    surface::LitSurfaces lit;
    std::vector<float> validity;

    Setting(Scene scene_in, const Grid& grid_in, surface::LightingSettings lighting = {})
        : scene(std::move(scene_in)),
          grid(grid_in),
          frame{grid.origin, grid.cell, glm::dvec3(grid.dims)},
          visibility(scene, frame),
          lit(light(lighting)),
          validity(visibility::trace_validity(visibility, grid.dims)) {}
    Setting(Scene scene_in, int resolution, surface::LightingSettings lighting = {})
        : Setting(scene_in, grid_around(scene_in, resolution), lighting) {}

    static Grid grid_around(const Scene& scene, int resolution) {
        const Bounds box = bounds_of(scene);
        return volume::fit_grid(box.lo, box.hi, {resolution});
    }
    surface::LitSurfaces light(const surface::LightingSettings& lighting) const {
        Progress silent;
        return surface::light_surfaces(scene, visibility, frame, lighting, silent);
    }
    glm::ivec3 cell(size_t index) const {
        const size_t nx = size_t(grid.dims.x), ny = size_t(grid.dims.y);
        return glm::ivec3(index % nx, index / nx % ny, index / (nx * ny));
    }
};

surface::LightingSettings emission_only() {
    surface::LightingSettings lighting;
    lighting.bounces = 0;
    return lighting;
}

/// Of a binding: what the device allows.
constexpr unsigned long long all_that_binds = std::numeric_limits<uint64_t>::max();

class Sn : public testing::DeviceTest {
protected:
    Volume run(const Setting& setting, const solver::sn::SnSettings& settings,
               uint64_t window = 0) {
        Volume volume = empty(setting);
        const solver::sn::SnProgram program(device(), setting.grid, settings, window);
        const float limit = program.gather_peaks(setting.lit, setting.visibility, setting.scene.sky,
                                                 silent, volume);
        program.sweep(setting.lit, setting.visibility, setting.scene.sky, limit, silent, volume);
        return volume;
    }
    /// Without a gather.
    Volume sweep(const Setting& setting, const solver::sn::SnSettings& settings,
                 float limit = HUGE_VALF, uint64_t window = 0) {
        Volume volume = empty(setting);
        volume.sh_order = settings.order;
        volume.sh.assign(size_t(volume::sh_count(settings.order)),
                         std::vector<glm::vec3>(setting.grid.size(), glm::vec3(0.0f)));
        solver::sn::SnProgram(device(), setting.grid, settings, window)
            .sweep(setting.lit, setting.visibility, setting.scene.sky, limit, silent, volume);
        return volume;
    }
    /// Only that, and the limit.
    std::pair<Volume, float> peaks(const Setting& setting) {
        Volume volume = empty(setting);
        const float limit =
            solver::sn::SnProgram(device(), setting.grid, {})
                .gather_peaks(setting.lit, setting.visibility, setting.scene.sky, silent, volume);
        return {std::move(volume), limit};
    }
    static Volume empty(const Setting& setting) {
        Volume volume;
        volume.grid = setting.grid;
        volume.validity = setting.validity;
        return volume;
    }

    Progress silent;
};

/// What the oracle has to know of a setting.
oracle::SnWorld world_of(const Setting& setting, const solver::sn::Occupancy& occupancy,
                         float limit) {
    oracle::SnWorld world;
    world.dims = setting.grid.dims;
    world.surface_between = [&occupancy](glm::ivec3 a, glm::ivec3 b) {
        return occupancy.is_occupied(glm::max(a, b));
    };
    world.seen = [&setting, limit](glm::ivec3 cell, glm::dvec3 d) {
        const glm::vec3 towards(-d);
        const visibility::Hit hit = setting.visibility.closest(
            {setting.visibility.capture(cell).point, towards, 0.0f, HUGE_VALF});
        if (hit.instance == visibility::no_hit)
            return limit < 2.0f ? glm::dvec3(0.0) : glm::dvec3(setting.scene.sky.luminance);
        const glm::dvec3 all(setting.lit.leaving(hit, towards));
        return all * std::min(1.0, 3.0 * double(limit) / (all.x + all.y + all.z + 1e-30));
    };
    return world;
}

TEST(SnDirections, IntegrateHarmonicsExactly) {
    const glm::dvec3 poles[] = {
        glm::normalize(glm::dvec3(1, 2, 3)), glm::normalize(glm::dvec3(-5, 1, 2)), {0, 0, 1}};
    for (const int count : solver::sn::sn_direction_counts()) {
        const std::vector<glm::dvec3> all = all_directions(count);
        ASSERT_EQ(int(all.size()), count);
        EXPECT_GE(solver::sn::sn_exact_band(count), 7);
        for (int l = 1; l <= solver::sn::sn_exact_band(count); ++l)
            for (const glm::dvec3& pole : poles) {
                double mean = 0.0;
                for (const glm::dvec3& d : all)
                    mean += legendre(l, glm::dot(d, pole)) / count;
                EXPECT_NEAR(mean, 0.0, 1e-12) << count << " directions, band " << l;
            }
    }
}

TEST(SnDirections, OfAnOctantAreAllPermutations) {
    for (const int count : solver::sn::sn_direction_counts()) {
        glm::dvec3 sum{0.0};
        const std::vector<glm::dvec3> octant = solver::sn::sn_octant_directions(count);
        EXPECT_EQ(int(octant.size()) * 8, count);
        for (const glm::dvec3& d : octant) {
            EXPECT_NEAR(glm::length(d), 1.0, 1e-14);
            EXPECT_GT(std::min({d.x, d.y, d.z}), 0.0);
            sum += d;
        }
        EXPECT_NEAR(sum.x, sum.y, 1e-12);
        EXPECT_NEAR(sum.x, sum.z, 1e-12);
    }
    EXPECT_EQ(solver::sn::sn_direction_count(1), 48);
    EXPECT_EQ(solver::sn::sn_direction_count(192), 192);
    EXPECT_EQ(solver::sn::sn_direction_count(193), 240);
    EXPECT_EQ(solver::sn::sn_direction_count(1 << 20), solver::sn::sn_direction_counts().back());
}

TEST(SnOccupancy, OccupiedCubesAreThoseThatHoldASurface) {
    Scene scene = scenes::cornell_box();
    turn(scene);
    const Setting setting(scene, 12, emission_only());
    const solver::sn::Occupancy occupancy =
        solver::sn::find_occupied(setting.lit.patches, setting.grid.dims);
    // Points all over the surfaces.
    std::vector<float> nearest(occupancy.occupied.size(),
                               1e9f); // to a cube's centre, greatest axis
    for (const surface::Patch& patch : setting.lit.patches)
        for (int i = 0; i <= 40; ++i)
            for (int j = 0; j <= 40 - i; ++j) {
                const glm::vec3 p = patch.at(glm::vec2(i, j) / 40.0f);
                for (int corner = 0; corner < 8; ++corner) {
                    const glm::ivec3 cube = glm::ivec3(glm::floor(p))
                                            + glm::ivec3(corner & 1, corner >> 1 & 1, corner >> 2);
                    if (glm::any(glm::lessThan(cube, glm::ivec3(0)))
                        || glm::any(glm::greaterThan(cube, setting.grid.dims)))
                        continue;
                    const glm::vec3 off = glm::abs(p - glm::vec3(cube));
                    float& least =
                        nearest[size_t(cube.x)
                                + size_t(setting.grid.dims.x + 1)
                                      * (size_t(cube.y)
                                         + size_t(setting.grid.dims.y + 1) * size_t(cube.z))];
                    least = std::min(least, std::max({off.x, off.y, off.z}));
                }
            }
    int occupied = 0;
    for (size_t i = 0; i < nearest.size(); ++i) {
        if (nearest[i] < 0.5f) {
            EXPECT_EQ(occupancy.occupied[i], 1) << nearest[i];
        }
        if (nearest[i] > 0.54f) {
            EXPECT_EQ(occupancy.occupied[i], 0) << nearest[i];
        }
        occupied += occupancy.occupied[i];
    }
    EXPECT_GT(occupied, 300);
    EXPECT_LT(occupied, int(nearest.size()) * 3 / 4);
}

TEST_F(Sn, AgreesWithTheOracle) {
    // Surfaces of one luminance each, none on another, so that nothing hangs on what of a place a
    // ray meets.
    Scene scene = scenes::cornell_box();
    for (size_t box = scene.instances.size() - 2; box < scene.instances.size(); ++box)
        scene.instances[box].to_world =
            glm::translate(glm::dmat4(1.0), {0, 0.1, 0}) * scene.instances[box].to_world;
    for (size_t i = 0; i < scene.materials.size(); ++i)
        scene.materials[i].emission = glm::vec3(2.0f, 3.0f, 1.0f) * float(i + 1);
    turn(scene);
    scene.sky.luminance = {1.0f, 2.0f, 4.0f};
    const Grid around = Setting::grid_around(scene, 9);
    // Cut off, so that surfaces lie beyond the grid, and with each axis the longest.
    for (const glm::ivec3 dims : {glm::ivec3(7, 5, 4), glm::ivec3(3, 5, 4), glm::ivec3(4, 3, 5)}) {
        const glm::dvec3 origin = around.origin + around.cell * (dims.x > 5 ? 1.0 : 3.0);
        Setting setting(scene, Grid{origin, around.cell, dims}, emission_only());
        setting.validity.clear(); // all cells count
        const solver::sn::Occupancy occupancy =
            solver::sn::find_occupied(setting.lit.patches, setting.grid.dims);
        for (const auto& [directions, order, limit, window] : {std::tuple{48, 2, HUGE_VALF, 0ull},
                                                               {96, 1, 1.5f, all_that_binds},
                                                               {96, 4, 3.0f, 0ull},
                                                               {96, 3, 3.0f, all_that_binds}}) {
            const Volume ours = sweep(setting, {directions, order}, limit, window);
            ASSERT_EQ(int(ours.sh.size()), volume::sh_count(order));
            const oracle::SnWorld world = world_of(setting, occupancy, limit);
            std::vector<std::vector<glm::dvec3>> theirs(
                size_t(volume::sh_count(order)), std::vector<glm::dvec3>(setting.grid.size()));
            for (const glm::dvec3& d : all_directions(directions)) {
                oracle::SnDirection along(world, d);
                const volume::ShValues basis = volume::sh_basis(order, glm::vec3(-d));
                for (size_t i = 0; i < setting.grid.size(); ++i) {
                    const glm::dvec3 luminance = along.at(setting.cell(i));
                    for (size_t k = 0; k < theirs.size(); ++k)
                        theirs[k][i] += 4.0 * pi / directions * double(basis[k]) * luminance;
                }
            }
            double largest = 0.0, off = 0.0;
            for (size_t k = 0; k < theirs.size(); ++k)
                for (size_t i = 0; i < setting.grid.size(); ++i) {
                    largest = std::max(largest, glm::length(theirs[k][i]));
                    off = std::max(off, glm::length(theirs[k][i] - glm::dvec3(ours.sh[k][i])));
                }
            EXPECT_GT(largest, 1.0);
            EXPECT_LT(off / largest, 1e-5) << dims.x << ' ' << directions << ' ' << order;
        }
    }
}

TEST_F(Sn, AFurnaceOfAnyOrientationReadsItsLuminance) {
    for (const bool turned : {false, true})
        for (const bool gathered : {false, true}) {
            Scene scene = scenes::furnace(3.0f, 0.5f, 2.0f);
            if (turned)
                turn(scene);
            const Setting setting(scene, 14, emission_only());
            const Volume volume = gathered ? run(setting, {192, 2}) : sweep(setting, {192, 2});
            size_t inside = 0;
            for (size_t i = 0; i < setting.grid.size(); ++i) {
                const glm::dvec3 p =
                    glm::dvec3(glm::inverse(turned ? odd_turn() : glm::dmat4(1.0))
                               * glm::dvec4(setting.grid.center(setting.cell(i)), 1.0));
                if (glm::any(glm::lessThan(p, glm::dvec3(0.0)))
                    || glm::any(glm::greaterThan(p, glm::dvec3(3.0))))
                    continue;
                ++inside;
                const double slack = gathered ? 0.05 : 1e-4;
                ASSERT_NEAR(double(volume.sh[0][i].r), 2.0 * std::sqrt(4.0 * pi), slack);
                for (size_t k = 1; k < 9; ++k)
                    ASSERT_NEAR(double(volume.sh[k][i].r), 0.0, slack) << k;
            }
            EXPECT_GT(inside, turned ? 300u : 1000u);
        }
}

TEST_F(Sn, LightThroughGlassHasItsColour) {
    surface::LightingSettings all;
    all.bounces = {};
    const auto expect_mean = [&](const Volume& volume, int from, int to, glm::dvec3 expected) {
        glm::dvec3 mean(0.0);
        for (int z = from; z < to; ++z)
            for (int y = from; y < to; ++y)
                for (int x = from; x < to; ++x)
                    mean += glm::dvec3(volume.sh[0][volume.grid.index({x, y, z})])
                            / std::sqrt(4.0 * pi) / std::pow(to - from, 3.0);
        for (int channel = 0; channel < 3; ++channel)
            EXPECT_NEAR(mean[channel] / expected[channel], 1.0, 0.02) << channel;
    };
    for (const bool sky : {false, true}) {
        const Setting setting(scenes::glass_room(sky), Grid{glm::dvec3(0.4), 0.2, glm::ivec3(16)},
                              all);
        expect_mean(run(setting, {}), 3, 13, scenes::luminance_in_glass_room());
    }
    // What covers nothing tints all the same.
    const Setting pane(scenes::clear_pane(), Grid{glm::dvec3(0.0), 0.25, glm::ivec3(16)}, all);
    expect_mean(run(pane, {}), 0, 8, scenes::luminance_beside_clear_pane());
    expect_mean(run(pane, {}), 9, 16, scenes::luminance_beside_clear_pane());
}

TEST_F(Sn, NoSurfaceShowsTheSky) {
    Scene scene;
    scene.sky.luminance = {1.0f, 10.0f, 0.1f};
    const Setting setting(scene, Grid{glm::dvec3(0.0), 1.0, {9, 4, 6}});
    const Volume volume = run(setting, {});
    for (size_t i = 0; i < setting.grid.size(); ++i) {
        EXPECT_NEAR(volume.sh[0][i].g, 10.0 * std::sqrt(4.0 * pi), 1e-4);
        for (size_t k = 1; k < 9; ++k)
            EXPECT_NEAR(volume.sh[k][i].g, 0.0f, 1e-4);
    }
}

TEST_F(Sn, AFloorThatEndsFarBeyondTheGridFillsHalfTheSphere) {
    Scene scene;
    const int bright = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(3.0f));
    scenes::add_quad(scene, bright, {-200, 0, -200}, {0, 0, 400}, {400, 0, 0});
    for (const double floor : {0.7, 2.3}) // in the grid, and below it
    {
        const Grid grid{{0.0, floor - 2.0, 0.0}, 1.0, {6, 6, 6}};
        const Setting setting(scene, grid, emission_only());
        const Volume volume = sweep(setting, {192, 2});
        for (size_t i = 0; i < grid.size(); ++i) {
            const bool above = grid.center(setting.cell(i)).y > 0.0;
            // Half of the directions, and the mean of |y| over them.
            EXPECT_NEAR(double(volume.sh[0][i].r), above ? 3.0 * std::sqrt(pi) : 0.0, 1e-4);
            EXPECT_NEAR(double(volume.sh[1][i].r), above ? -3.0 * std::sqrt(0.75 * pi) : 0.0, 0.03);
            EXPECT_NEAR(double(volume.sh[6][i].r), 0.0, 0.03);
        }
    }
}

TEST_F(Sn, ASealedBoxLeaksNothing) {
    for (const bool bright : {false, true})
        for (const bool turned : {false, true}) {
            // A thin closed box, two-sided, in a bright room.
            Scene scene = scenes::furnace(4.0f, 0.5f, 1.0f);
            const int dark = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), true);
            scenes::add_box(scene, dark, {1.1f, 1.2f, 1.3f}, {2.9f, 2.8f, 2.7f},
                            scenes::Facing::outward);
            if (bright) { // a lamp beside it
                const int lamp =
                    scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(1e4f), true);
                scenes::add_quad(scene, lamp, {0.9f, 1.8f, 1.8f}, {0, 0.2f, 0}, {0, 0, 0.2f});
            }
            if (turned)
                turn(scene);
            const Setting setting(scene, 18, emission_only());
            const Volume volume = run(setting, {96, 2});
            size_t sealed = 0;
            for (size_t i = 0; i < setting.grid.size(); ++i) {
                const glm::dvec3 p =
                    glm::dvec3(glm::inverse(turned ? odd_turn() : glm::dmat4(1.0))
                               * glm::dvec4(setting.grid.center(setting.cell(i)), 1.0));
                const double slack = 1e-3;
                if (glm::any(glm::lessThan(p, glm::dvec3(1.1, 1.2, 1.3) + slack))
                    || glm::any(glm::greaterThan(p, glm::dvec3(2.9, 2.8, 2.7) - slack)))
                    continue;
                ++sealed;
                for (size_t k = 0; k < 9; ++k)
                    ASSERT_EQ(volume.sh[k][i], glm::vec3(0.0f));
            }
            EXPECT_GT(sealed, 50u);
        }
}

TEST_F(Sn, IsLinearOverEighteenOrdersOfMagnitude) {
    Setting setting(scenes::cornell_box_with_sun(), 8);
    const Volume one = run(setting, {96, 2});
    const std::vector<glm::vec3> luminance = setting.lit.luminance;
    for (const float scale : {0x1p-30f, 0x1p30f}) {
        for (size_t i = 0; i < luminance.size(); ++i)
            setting.lit.luminance[i] = scale * luminance[i];
        const Volume scaled = run(setting, {96, 2});
        for (size_t i = 0; i < setting.grid.size(); ++i)
            ASSERT_EQ(scaled.sh[0][i] / scale, one.sh[0][i]);
    }
}

TEST_F(Sn, GivesTheSameBitsRunAfterRunAndWindowByWindow) {
    Scene scene = scenes::cornell_box_with_point();
    turn(scene);
    const Setting setting(scene, 14);
    for (const solver::sn::SnSettings settings : {solver::sn::SnSettings{144, 2}, {144, 1}}) {
        const Volume whole = run(setting, settings);
        EXPECT_TRUE(run(setting, settings).sh == whole.sh);
        // The device's kernels; where that is the host's CPU, it has not used them yet.
        EXPECT_TRUE(run(setting, settings, all_that_binds).sh == whole.sh);
        // Windows of a few layers and a few planes stand for buffers beyond what binds.
        for (const uint64_t window : {260'000, 80'000})
            EXPECT_TRUE(run(setting, settings, window).sh == whole.sh) << window;
    }
    EXPECT_THROW(run(setting, {}, 20'000), Error);
}

TEST_F(Sn, CellsThatFeedNoValidOneChangeNone) {
    Setting setting(scenes::cornell_box_with_point(), 14);
    const std::vector<float> traced = std::exchange(setting.validity, {});
    const Volume of_all = sweep(setting, {96, 2});
    // Those of closed walls, and some here and there, which all that is open feeds.
    std::vector<float> few(traced.size(), 0.0f);
    for (size_t i = 0; i < few.size(); i += 97)
        few[i] = traced[i];
    for (const std::vector<float>& validity : {traced, few}) {
        setting.validity = validity;
        const Volume volume = sweep(setting, {96, 2});
        size_t valid = 0, others = 0;
        for (size_t i = 0; i < validity.size(); ++i) {
            const bool same = volume.sh[0][i] == of_all.sh[0][i];
            valid += validity[i] > 0.0f ? 1 : 0;
            others += same ? 0 : 1;
            ASSERT_TRUE(same || validity[i] == 0.0f) << i;
        }
        EXPECT_GT(valid, 10);
        EXPECT_GT(others, 10); // no rays for them
    }
}

/// Sides of a square split the unit square into so many points each.
constexpr int points_a_side = 24;

/// What arrives at a point from a rectangle of luminance 1, without anything between.
double solid_angle(glm::dvec3 p, glm::dvec3 corner, glm::dvec3 u, glm::dvec3 v) {
    const glm::dvec3 across = glm::cross(u, v);
    double sum = 0.0;
    for (int i = 0; i < points_a_side; ++i)
        for (int k = 0; k < points_a_side; ++k) {
            const glm::dvec3 to =
                corner + (u * (i + 0.5) + v * (k + 0.5)) / double(points_a_side) - p;
            const double square = glm::dot(to, to);
            sum += std::abs(glm::dot(to, across)) / (square * std::sqrt(square));
        }
    return sum / (points_a_side * points_a_side);
}

TEST_F(Sn, APatchInTheOpenCountsByItsAreaWhereverItLies) {
    const Grid grid{glm::dvec3(0.0), 1.0, {14, 12, 14}};
    for (const double side : {0.1, 4.5})
        for (const double offset : {0.0, 0.25, 0.5}) {
            Scene scene;
            const int bright = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(3.0f), true);
            const glm::dvec3 corner(4.5 + offset, 3.2, 5.0 + 0.5 * offset);
            const glm::dvec3 u(0, 0, side), v(side, 0, 0);
            scenes::add_quad(scene, bright, glm::vec3(corner), glm::vec3(u), glm::vec3(v));
            const Setting setting(scene, grid, emission_only());
            const Volume volume = run(setting, {144, 2});
            double off = 0.0, is = 0.0, ought = 0.0;
            for (size_t i = 0; i < grid.size(); ++i) {
                const glm::dvec3 p = grid.center(setting.cell(i));
                const double truth = 3.0 * solid_angle(p, corner, u, v) / std::sqrt(4.0 * pi);
                off += std::abs(double(volume.sh[0][i].r) - truth);
                is += double(volume.sh[0][i].r);
                ought += truth;
            }
            EXPECT_NEAR(is / ought, 1.0, 0.01) << side << ' ' << offset;
            EXPECT_LT(off / ought, 0.02) << side << ' ' << offset;
        }
}

TEST_F(Sn, WhatIsMuchBrighterThanTheMeanIsGathered) {
    Scene scene = scenes::furnace(4.0f, 0.0f, 1.0f);
    const int lamp = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(50.0f), true);
    scenes::add_quad(scene, lamp, {1.7f, 1.9f, 1.9f}, {0, 0.4f, 0}, {0, 0, 0.4f});
    const Setting setting(scene, 14, emission_only());
    const auto [gathered, limit] = peaks(setting);
    double mean = 0.0;
    size_t inside = 0;
    const Volume all = run(setting, {});
    for (size_t i = 0; i < setting.grid.size(); ++i) {
        const glm::dvec3 p = setting.grid.center(setting.cell(i));
        if (glm::any(glm::lessThan(p, glm::dvec3(0.0)))
            || glm::any(glm::greaterThan(p, glm::dvec3(4.0)))) {
            EXPECT_EQ(gathered.sh[0][i], glm::vec3(0.0f));
            continue;
        }
        const double lamp_angle = solid_angle(p, {1.7, 1.9, 1.9}, {0, 0.4, 0}, {0, 0, 0.4});
        mean += (4.0 * pi + 49.0 * lamp_angle) / (4.0 * pi);
        ++inside;
        if (std::abs(p.x - 1.7) < 0.5)
            continue;
        EXPECT_NEAR(double(gathered.sh[0][i].r),
                    (50.0 - double(limit)) * lamp_angle / std::sqrt(4.0 * pi),
                    0.03 * double(gathered.sh[0][i].r) + 1e-4);
        EXPECT_NEAR(double(all.sh[0][i].r), (4.0 * pi + 49.0 * lamp_angle) / std::sqrt(4.0 * pi),
                    0.1);
    }
    EXPECT_NEAR(double(limit) * double(inside), 1.5 * mean, 0.2 * mean);
}

TEST_F(Sn, SkyThroughAHoleCountsByItsArea) {
    // A black box of 8 cells with a hole of two above.
    Scene scene;
    scene.sky.luminance = glm::vec3(5.0f, 10.0f, 0.0f);
    const int black = scenes::add_material(scene, glm::vec3(0.0f), glm::vec3(0.0f), true);
    scenes::add_box(scene, black, {0, 0, 0}, {8, 8, 8}, scenes::Facing::inward);
    scene.instances.clear();
    scene.meshes.clear();
    for (int axis = 0; axis < 3; ++axis)
        for (const float at : {0.0f, 8.0f}) {
            glm::vec3 corner{0.0f}, u{0.0f}, v{0.0f};
            corner[axis] = at;
            u[(axis + 1) % 3] = v[(axis + 2) % 3] = 8.0f;
            if (axis == 1 && at > 0.0f)
                continue;
            scenes::add_quad(scene, black, corner, u, v);
        }
    for (const auto& [x0, x1, z0, z1] :
         {std::array{0.0f, 8.0f, 0.0f, 3.0f}, std::array{0.0f, 8.0f, 5.0f, 8.0f},
          std::array{0.0f, 3.0f, 3.0f, 5.0f}, std::array{5.0f, 8.0f, 3.0f, 5.0f}})
        scenes::add_quad(scene, black, {x0, 8, z0}, {0, 0, z1 - z0}, {x1 - x0, 0, 0});
    const Setting setting(scene, Grid{glm::dvec3(0.0), 1.0, glm::ivec3(8)}, emission_only());
    const Volume volume = run(setting, {96, 2});
    double off = 0.0, is = 0.0, ought = 0.0;
    for (size_t i = 0; i < setting.grid.size(); ++i) {
        const double truth =
            10.0 / std::sqrt(4.0 * pi)
            * solid_angle(setting.grid.center(setting.cell(i)), {3, 8, 3}, {2, 0, 0}, {0, 0, 2});
        off += std::abs(double(volume.sh[0][i].g) - truth);
        is += double(volume.sh[0][i].g);
        ought += truth;
    }
    EXPECT_NEAR(is / ought, 1.0, 0.03);
    EXPECT_LT(off / ought, 0.15);
}

TEST_F(Sn, WithoutLightAllIsDark) {
    const Setting setting(scenes::cornell_box(), 8);
    const auto [gathered, limit] = peaks(setting);
    EXPECT_EQ(limit, 0.0f);
    const Volume volume = run(setting, {96, 4});
    ASSERT_EQ(volume.sh.size(), 25u);
    for (const std::vector<glm::vec3>& values : volume.sh)
        for (const glm::vec3& value : values)
            ASSERT_EQ(value, glm::vec3(0.0f));
}

TEST_F(Sn, ComesCloseToPathTracedIrradiance) {
    double errors[2];
    for (const bool turned : {false, true}) {
        Scene scene = scenes::cornell_box_with_sun();
        if (turned)
            turn(scene);
        const Setting setting(scene, 24);
        std::vector<glm::vec3> points;
        std::vector<uint64_t> keys;
        std::mt19937 random(1);
        while (points.size() < 60) {
            const size_t cell = random() % setting.grid.size();
            if (setting.validity[cell] > 0.0f) {
                points.push_back(glm::vec3(setting.cell(cell)) + 0.5f);
                keys.push_back(cell);
            }
        }
        reference::ReferenceSettings truth;
        truth.sh_order = 2;
        truth.rays = 2048;
        const reference::ProbeField probes =
            reference::trace_probes(setting.scene, setting.visibility, setting.frame, points, keys,
                                    truth, silent, {volume::neighbour_normals(), {}});
        const Volume volume = run(setting, {144, 2});
        const auto irradiance = [](const auto& sh, size_t i, int channel, glm::dvec3 normal) {
            std::array<float, 9> c;
            for (size_t k = 0; k < 9; ++k)
                c[k] = sh[k][i][channel];
            return std::max(0.0, double(volume::sh_irradiance(c, glm::vec3(normal))));
        };
        double off = 0.0, sum = 0.0, is = 0.0, ought = 0.0;
        for (size_t i = 0; i < points.size(); ++i)
            for (int channel = 0; channel < 3; ++channel) {
                is += double(volume.sh[0][keys[i]][channel]);
                ought += double(probes.sh[0][i][channel]);
                for (const glm::dvec3& n : volume::neighbour_normals()) {
                    const double exact = irradiance(probes.sh, i, channel, n);
                    off += std::abs(irradiance(volume.sh, keys[i], channel, n) - exact);
                    sum += exact;
                }
            }
        errors[turned] = off / sum;
        EXPECT_LT(off / sum, 0.06) << turned;
        EXPECT_NEAR(is / ought, 1.0, 0.02) << turned;
    }
    EXPECT_LT(errors[1], errors[0] + 0.01);
}

} // namespace
} // namespace lpvbake
