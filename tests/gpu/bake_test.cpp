// The whole pipeline on small scenes: what has to hold whatever the numbers are.
#include "bake/bake.h"
#include "bake/contested.h"
#include "bake/pilot.h"

#include "gpu/device.h"
#include "lpvbake/error.h"
#include "readers/readers.h"
#include "reference/reference.h"
#include "scene/sky.h"
#include "scenes.h"
#include "solver/lpv/lpv.h"
#include "surface/lit_surfaces.h"
#include "volume/compare.h"
#include "volume/dilate.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <optional>
#include <random>

namespace lpvbake {
namespace {

class Bake : public testing::DeviceTest {
protected:
    bake::BakePlan plan_of(const Scene& scene, const bake::BakeSettings& settings) {
        return bake::plan_bake(bake::survey(scene), settings, device().info());
    }
    Baked run(const Scene& scene, const bake::BakeSettings& settings) {
        Progress silent;
        return bake::bake(scene, plan_of(scene, settings), device(), silent);
    }
    /// One reflection.
    static bake::BakeSettings coarse(int resolution = 12, const char* solver = "lpv") {
        bake::BakeSettings settings(*bake::find_solver(solver));
        settings.bounces = 1;
        settings.grid.resolution = resolution;
        if (solver::find_parameter(settings.solver.kind(), "rsm-size"))
            settings.solver.set("rsm-size", 128);
        return settings;
    }
};

double injected(const Baked& baked) {
    return std::stod(baked.volume.metadata.at("injected_lm"));
}

void expect_finite(const Volume& volume) {
    for (const auto& grid : volume.sh)
        for (const glm::vec3& c : grid)
            ASSERT_TRUE(std::isfinite(c.x) && std::isfinite(c.y) && std::isfinite(c.z));
    for (const auto& grid : volume.occlusion)
        for (const float c : grid)
            ASSERT_TRUE(std::isfinite(c));
}

TEST_F(Bake, CornellBoxIsLitAndItsWallsBleed) {
    const Baked baked = run(scenes::cornell_box_with_point(), coarse(16));
    const Volume& volume = baked.volume;
    expect_finite(volume);
    // Beside the red wall (-X) the field is redder than beside the green one.
    const auto ratio = [&](glm::dvec3 at) {
        const glm::vec3 c = volume.sh[0][volume.grid.index(glm::ivec3(volume.grid.to_grid(at)))];
        EXPECT_GT(c.x, 0.0f);
        return c.x / c.y;
    };
    EXPECT_GT(ratio({-0.85, 1.0, 0.2}), 1.2f * ratio({0.85, 1.0, 0.2}));
    EXPECT_GT(volume::total_energy(volume), 0.0);
    EXPECT_TRUE(baked.warnings.empty());
}

TEST_F(Bake, ASealedBoxOfAnyOrientationLetsNothingOut) {
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 6; ++i) {
        const glm::dmat4 turn =
            i == 0 ? glm::dmat4(1.0)
                   : glm::rotate(
                       glm::dmat4(1.0), 0.4 + i,
                       glm::normalize(glm::dvec3(normal(random), normal(random), normal(random))));
        Scene scene;
        scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.8f)), glm::vec3(-1.0f),
                        glm::vec3(1.0f), scenes::Facing::inward, turn);
        scene.lights.push_back(scenes::point_light({0.1, 0.2, -0.1}, 100.0));
        bake::BakeSettings settings = coarse(20);
        settings.bounds = Bounds{glm::dvec3(-2.0), glm::dvec3(2.0)};
        settings.solver.set("iterations", 200);
        const Baked baked = run(scene, settings);
        const Volume& volume = baked.volume;
        // All reflected light starts inside: rho * 4 pi I, three channels.
        EXPECT_NEAR(injected(baked) / (3 * 0.8 * 4.0 * glm::pi<double>() * 100.0), 1.0, 2e-3);
        const glm::dmat4 back = glm::inverse(turn);
        double inside = 0.0, outside = 0.0;
        for (int z = 0; z < volume.grid.dims.z; ++z)
            for (int y = 0; y < volume.grid.dims.y; ++y)
                for (int x = 0; x < volume.grid.dims.x; ++x) {
                    const glm::dvec3 p{back * glm::dvec4(volume.grid.center({x, y, z}), 1.0)};
                    const bool in = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}) < 1.0;
                    (in ? inside : outside) += double(volume.sh[0][volume.grid.index({x, y, z})].x);
                }
        EXPECT_GT(inside, 0.0);
        EXPECT_EQ(outside, 0.0) << i;
    }
}

TEST_F(Bake, InstructionSetsAgreeButForRounding) {
    // A street whose walls lie on planes of the lattice, in the sun and under a sky.
    Scene scene = scenes::floor_quad(24.0f, glm::vec3(0.4f));
    scene.sky.luminance = glm::vec3(500.0f);
    scene.lights.push_back(scenes::sun({1, -2, 0.4}, 50000.0));
    const int brick = scenes::add_material(scene, glm::vec3(0.6f, 0.4f, 0.3f));
    for (const float x : {-8.0f, 4.0f})
        for (const float z : {-10.0f, 1.0f})
            scenes::add_box(scene, brick, {x, 0, z}, {x + 4, 6, z + 8}, scenes::Facing::outward);
    bake::BakeSettings settings = coarse(16, "sn");
    std::optional<Volume> first;
    for (const visibility::Isa isa :
         {visibility::Isa::sse2, visibility::Isa::avx2, visibility::Isa::avx512}) {
        if (!visibility::processor_has(isa))
            continue;
        settings.isa = isa;
        const Volume volume = run(scene, settings).volume;
        EXPECT_TRUE(volume.metadata.at("tracer").ends_with(visibility::name_of(isa)));
        if (!first)
            first = volume;
        double off = 0.0, sum = 0.0;
        for (size_t cell = 0; cell < volume.grid.size(); ++cell) {
            off += std::abs(double(volume.sh[0][cell].y) - double(first->sh[0][cell].y));
            sum += double(first->sh[0][cell].y);
        }
        EXPECT_LT(off / sum, 0.005) << visibility::name_of(isa);
        EXPECT_EQ(volume.validity, first->validity) << visibility::name_of(isa);
        EXPECT_EQ(volume.walls, first->walls) << visibility::name_of(isa);
    }
}

TEST_F(Bake, PowerDoesNotDependOnTheSizeOfTheMap) {
    Scene scene = scenes::cornell_box_with_sun();
    bake::BakeSettings settings = coarse();
    settings.solver.set("iterations", 1);
    settings.solver.set("rsm-size", 1024);
    const double reference = injected(run(scene, settings));
    for (const int size : {128, 256, 512}) {
        settings.solver.set("rsm-size", size);
        EXPECT_NEAR(injected(run(scene, settings)) / reference, 1.0, 0.02) << size;
    }
}

TEST_F(Bake, LightOfSurfacesBesideTheGridComesIn) {
    // The lit floor lies half a cell and more below the grid.
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_box(scene, grey, {-2, 0, -2}, {2, 4, 2}, scenes::Facing::inward);
    scene.lights.push_back(scenes::spot_light({0, 2, 0}, {0, -1, 0}, 100.0, 0.2, 0.3));
    const auto bake_from = [&](double low) {
        bake::BakeSettings settings = coarse(16);
        settings.bounds = Bounds{{-2, low, -2}, {2, 4, 2}};
        settings.grid.margin = 0;
        return run(scene, settings);
    };
    const double whole = injected(bake_from(0.0));
    // View factors from the middle of the floor to the grid's lower faces.
    EXPECT_NEAR(injected(bake_from(0.25)) / whole, 0.986, 0.02);
    EXPECT_NEAR(injected(bake_from(1.0)) / whole, 0.83, 0.03);
}

TEST_F(Bake, FieldFallsWithTheSquareOfTheScaleWhereverTheSceneStands) {
    const Baked reference = run(scenes::cornell_box_with_point(), coarse());
    const double energy = volume::total_energy(reference.volume);
    struct Place {
        double scale, offset;
    };
    for (const Place place :
         {Place{1e-4, 0.0}, Place{1e4, 0.0}, Place{5e5, 0.0}, Place{1.0, 1e3}, Place{1.0, 1e6}}) {
        Scene scene = scenes::cornell_box_with_point();
        const glm::dmat4 move = glm::translate(glm::dmat4(1.0), glm::dvec3(place.offset))
                                * glm::scale(glm::dmat4(1.0), glm::dvec3(place.scale));
        for (Instance& instance : scene.instances)
            instance.to_world = move * instance.to_world;
        for (Light& light : scene.lights)
            light.position = glm::dvec3(move * glm::dvec4(light.position, 1.0));
        const Baked baked = run(scene, coarse());
        EXPECT_EQ(baked.volume.grid.dims, reference.volume.grid.dims);
        EXPECT_NEAR(volume::total_energy(baked.volume) * place.scale * place.scale / energy, 1.0,
                    0.02)
            << place.scale << ' ' << place.offset;
        expect_finite(baked.volume);
    }
}

TEST_F(Bake, IsLinearInItsLights) {
    const double energy =
        volume::total_energy(run(scenes::cornell_box_with_point(1.0), coarse()).volume);
    for (const double candela : {1e-9, 1e9})
        EXPECT_NEAR(
            volume::total_energy(run(scenes::cornell_box_with_point(candela), coarse()).volume)
                / (energy * candela),
            1.0, 1e-4);
}

TEST_F(Bake, GivesTheSameBitsRunAfterRun) {
    const Scene scene = scenes::cornell_box_with_point();
    const Baked a = run(scene, coarse()), b = run(scene, coarse());
    EXPECT_EQ(a.volume.sh, b.volume.sh);
    EXPECT_EQ(a.volume.occlusion, b.volume.occlusion);
    EXPECT_EQ(a.volume.validity, b.volume.validity);
}

TEST_F(Bake, OcclusionModesDifferAsTheyShould) {
    const Scene scene = scenes::cornell_box_with_point();
    bake::BakeSettings settings = coarse();
    double energy[3];
    for (const solver::lpv::Occlusion mode :
         {solver::lpv::Occlusion::none, solver::lpv::Occlusion::sh, solver::lpv::Occlusion::face}) {
        settings.solver.set("occlusion", double(mode));
        settings.solver.set("iterations", 40);
        const Baked baked = run(scene, settings);
        energy[int(mode)] = volume::total_energy(baked.volume);
        EXPECT_EQ(baked.volume.occlusion.size(), mode == solver::lpv::Occlusion::none ? 0u : 4u);
    }
    EXPECT_GT(energy[int(solver::lpv::Occlusion::none)], energy[int(solver::lpv::Occlusion::sh)]);
    EXPECT_GT(energy[int(solver::lpv::Occlusion::none)], energy[int(solver::lpv::Occlusion::face)]);
}

TEST_F(Bake, EmittersAloneAreLightEnough) {
    const Scene scene = scenes::furnace(2.0f, 0.5f, 100.0f);
    // pi L A over the six walls, L = Le (1 + rho + rho^2 + ...).
    const double emitted = 3 * glm::pi<double>() * 100.0 * 24.0;
    bake::BakeSettings settings = coarse();
    EXPECT_NEAR(injected(run(scene, settings)) / emitted, 1.5, 2e-3);
    settings.bounces = 0;
    EXPECT_NEAR(injected(run(scene, settings)) / emitted, 1.0, 1e-4);
    settings.bounces = std::nullopt;
    EXPECT_NEAR(injected(run(scene, settings)) / emitted, 2.0, 4e-3);
    bake::BakeSettings without = coarse();
    without.emitters = false;
    EXPECT_THROW(run(scene, without), Error);
}

TEST_F(Bake, ReflectionsAddUpWhereverTheyComeFrom) {
    // The first reflection from maps and the others from patches, or all from patches: the same.
    const Scene scene = scenes::cornell_box_with_point();
    bake::BakeSettings settings = coarse();
    const double once = injected(run(scene, settings));
    settings.bounces = 2;
    const double twice = injected(run(scene, settings));
    settings.bounces = std::nullopt;
    const double all = injected(run(scene, settings));
    EXPECT_GT(twice, 1.2 * once);
    EXPECT_LT(twice, 1.8 * once);
    EXPECT_GT(all, 1.1 * twice);

    Progress silent;
    const bake::BakePlan plan = plan_of(scene, settings);
    const visibility::Visibility visibility(scene, plan.frame);
    surface::LightingSettings lighting;
    lighting.bounces = std::nullopt;
    double power = 0.0;
    const surface::LitSurfaces lit =
        surface::light_surfaces(scene, visibility, plan.frame, lighting, silent);
    for (size_t i = 0; i < lit.luminance.size(); ++i) {
        const glm::vec3 l = lit.luminance[i];
        power += double(l.x + l.y + l.z) * double(lit.patches[i / 2].area);
    }
    EXPECT_NEAR(power * glm::pi<double>() * plan.grid.cell * plan.grid.cell / all, 1.0, 0.02);
}

TEST_F(Bake, ASkyAloneIsLightEnough) {
    Scene scene = scenes::floor_quad(4.0f, glm::vec3(0.5f));
    scene.sky.luminance = glm::vec3(50.0f);
    bake::BakeSettings settings = coarse();
    settings.solver.set("occlusion", double(solver::lpv::Occlusion::none));
    const Baked baked = run(scene, settings);
    EXPECT_GT(volume::total_energy(baked.volume), 0.0);
    expect_finite(baked.volume);
}

/// A bright horizon towards one side, and a sun of one texel, 1.4 degrees, 45 degrees high.
Sky sky_with_sun(float sun) {
    constexpr int width = 256, height = 128;
    std::vector<glm::vec3> texels;
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column)
            texels.push_back(glm::vec3(10.0f, 20.0f, 40.0f)
                             * (1.0f + std::cos(6.2832f * float(column) / width)));
    texels[size_t(32 * width + 100)] += glm::vec3(sun);
    return scene::make_sky(width, height, texels, 0.0);
}

TEST_F(Bake, AnEvenPictureIsAsGoodAsAnEvenSky) {
    Scene even = scenes::floor_quad(4.0f, glm::vec3(0.5f)), picture = even;
    even.sky.luminance = {1.0f, 2.0f, 4.0f};
    picture.sky = scene::make_sky(8, 4, std::vector<glm::vec3>(32, even.sky.luminance), 0.0);
    for (const char* solver : {"lpv", "sn", "gather"}) {
        const bake::BakeSettings settings = coarse(8, solver);
        const Volume a = run(even, settings).volume, b = run(picture, settings).volume;
        for (size_t k = 0; k < a.sh.size(); ++k)
            for (size_t cell = 0; cell < a.grid.size(); ++cell)
                for (int c = 0; c < 3; ++c)
                    ASSERT_NEAR(a.sh[k][cell][c], b.sh[k][cell][c], 1e-4f) << solver;
    }
}

TEST_F(Bake, AnOpenCellHoldsTheProjectedPicture) {
    Scene scene = scenes::floor_quad(1e-3f, glm::vec3(0.0f));
    scene.sky = sky_with_sun(1e5f);
    std::vector<glm::dvec3> expected(9, glm::dvec3(0.0));
    constexpr int width = 1024, height = 512;
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column) {
            const double polar = (row + 0.5) / height * glm::pi<double>();
            const double around = (column + 0.5) / width * 2 * glm::pi<double>();
            const glm::vec3 w(std::sin(polar) * std::cos(around), std::cos(polar),
                              std::sin(polar) * std::sin(around));
            const double weight = 2 * glm::pi<double>() * glm::pi<double>() * std::sin(polar)
                                  / (double(width) * height);
            const volume::ShValues y = volume::sh_basis(2, w);
            for (size_t k = 0; k < 9; ++k)
                expected[k] +=
                    weight * double(y[k]) * glm::dvec3(scene::sky_luminance(scene.sky, w));
        }
    bake::BakeSettings settings = coarse(6);
    settings.bounds = Bounds{glm::dvec3(-1, 0.1, -1), glm::dvec3(1, 2, 1)};
    for (const char* solver : {"sn", "gather"}) {
        settings.solver = solver::SolverSettings(*bake::find_solver(solver));
        const Volume volume = run(scene, settings).volume;
        // A direction of sn stands for 7 degrees around it, a sample of gather's bins for 1.7.
        const double near = solver == std::string("sn") ? 0.08 : 0.015;
        for (size_t k = 0; k < 9; ++k)
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(volume.sh[k][volume.grid.index({2, 3, 3})][c], expected[k][c],
                            (k == 0 ? 0.01 : near) * expected[0][c])
                    << solver << ' ' << k;
    }
}

TEST_F(Bake, ASmallSunOfAPictureLightsAsTheReferenceSays) {
    Scene scene = scenes::floor_quad(4.0f, glm::vec3(0.5f));
    const int wall = scenes::add_material(scene, {0.8f, 0.4f, 0.2f}, glm::vec3(0.0f), true);
    scenes::add_quad(scene, wall, {-1, 0, 1}, {1.5f, 0, -1}, {0, 1.2f, 0});
    scene.sky = sky_with_sun(3e5f);
    bake::BakeSettings settings = coarse(10);
    settings.bounces = 1;
    reference::ReferenceSettings truth;
    truth.sh_order = 2;
    truth.rays = 2048;
    const Grid grid = plan_of(scene, settings).grid;
    Progress silent;
    const reference::Reference reference = reference::make_reference(scene, grid, truth, silent);
    EXPECT_LT(reference.noise, 0.03);
    for (const char* solver : {"sn", "gather"}) {
        settings.solver = solver::SolverSettings(*bake::find_solver(solver));
        const Volume volume = run(scene, settings).volume;
        double error = 0.0, all = 0.0, energy = 0.0;
        for (size_t cell = 0; cell < grid.size(); ++cell) {
            if (volume.validity[cell] == 0.0f)
                continue;
            const glm::dvec3 a(volume.sh[0][cell]), b(reference.volume.sh[0][cell]);
            error += std::abs(a.x - b.x) + std::abs(a.y - b.y) + std::abs(a.z - b.z);
            energy += a.x + a.y + a.z;
            all += b.x + b.y + b.z;
        }
        EXPECT_NEAR(energy / all, 1.0, 0.04) << solver;
        EXPECT_LT(error / all, 0.12) << solver;
        RecordProperty(std::string(solver) + "_error", std::to_string(error / all));
    }
}

TEST_F(Bake, ExactSolversReadAFurnaceOfAllBounces) {
    for (const char* solver : {"sn", "gather"}) {
        bake::BakeSettings settings = coarse(12, solver);
        settings.bounces = settings.solver.kind().default_bounces;
        const Baked baked = run(scenes::furnace(2.0f, 0.5f, 100.0f), settings);
        const Volume& volume = baked.volume;
        ASSERT_EQ(volume.sh_order, 2);
        ASSERT_EQ(volume.sh.size(), 9u);
        EXPECT_EQ(volume.metadata.at("solver"), solver);
        EXPECT_EQ(volume.metadata.at("bounces"), "inf");
        double sum = 0.0, cells = 0.0;
        for (int z = 1; z + 1 < volume.grid.dims.z; ++z) // a cell of margin lies outside
            for (int y = 1; y + 1 < volume.grid.dims.y; ++y)
                for (int x = 1; x + 1 < volume.grid.dims.x; ++x) {
                    sum += double(volume.sh[0][volume.grid.index({x, y, z})].y);
                    ++cells;
                }
        ASSERT_EQ(cells, 1000.0);
        EXPECT_NEAR(sum / cells / (200.0 * std::sqrt(4.0 * glm::pi<double>())), 1.0, 0.01);
    }
}

/// A bake of a furnace of 200 nits whose six walls go through centres of cells, but for a hair.
struct SnappedFurnace {
    Scene scene = scenes::furnace(2.0f, 0.5f, 100.0f);
    bake::BakeSettings settings;

    SnappedFurnace(bake::BakeSettings base, double snap, bool double_sided) : settings(base) {
        const double cell = 0.25;
        settings.bounces = settings.solver.kind().default_bounces;
        settings.grid.cell = cell;
        settings.grid.margin = 0;
        settings.bounds =
            Bounds{glm::dvec3(cell * (snap - 0.5)), glm::dvec3(2.0 + cell * (snap + 0.5))};
        for (Material& material : scene.materials)
            material.double_sided = double_sided;
    }
};

TEST_F(Bake, CellsOnTheWallsOfAFurnaceReadItsLuminance) {
    for (const double snap : {0.0, 1e-6, -1e-6, 1e-4, -1e-4, 1e-2, -1e-2})
        for (const char* solver : {"sn", "gather"})
            for (const bool double_sided : {false, true}) {
                if (double_sided && snap != 0.0)
                    continue;
                SCOPED_TRACE(::testing::Message() << solver << " " << snap << " " << double_sided);
                const SnappedFurnace furnace(coarse(12, solver), snap, double_sided);
                const Volume volume = run(furnace.scene, furnace.settings).volume;
                ASSERT_EQ(volume.grid.dims, glm::ivec3(9));
                ASSERT_NEAR(volume.grid.center({0, 0, 0}).y, 0.25 * snap, 1e-9);
                for (size_t i = 0; i < volume.grid.size(); ++i) {
                    ASSERT_EQ(volume.validity[i], 1.0f) << i;
                    EXPECT_NEAR(double(volume.sh[0][i].y)
                                    / (200.0 * std::sqrt(4.0 * glm::pi<double>())),
                                1.0, 0.03)
                        << i;
                }
                // What engines read, and what readers do that know of walls.
                for (const Reading reading : {Reading::trilinear, Reading::facing})
                    for (const double x : {0.0, 0.1, 0.35, 1.25, 2.0})
                        EXPECT_NEAR(read_irradiance(volume, {x, 0.0, 0.9}, {0, 1, 0}, reading).y
                                        / (200.0 * glm::pi<double>()),
                                    1.0, 0.02)
                            << x;
            }
}

TEST_F(Bake, PropagationLeavesCellsOnWallsOutAndTheyAreFilled) {
    for (const double snap : {0.0, 1e-6, -1e-6, 1e-2, -1e-2}) {
        const SnappedFurnace furnace(coarse(12, "lpv"), snap, false);
        Volume volume = run(furnace.scene, furnace.settings).volume;
        for (size_t i = 0; i < volume.grid.size(); ++i) {
            const glm::ivec3 cell = volume.grid.cell_at(i);
            const bool inside = glm::all(glm::greaterThan(cell, glm::ivec3(0)))
                                && glm::all(glm::lessThan(cell, glm::ivec3(8)));
            ASSERT_EQ(volume.validity[i], inside ? 1.0f : 0.0f) << snap << " " << i;
            if (inside) {
                EXPECT_GT(volume.sh[0][i].y, 0.0f) << snap << " " << i;
            }
        }
        const auto read = [&](Reading reading) {
            return read_irradiance(volume, {0.35, 0.0, 0.9}, {0, 1, 0}, reading).y;
        };
        const double right = read(Reading::facing);
        EXPECT_GT(right, 0.0);
        EXPECT_LT(read(Reading::trilinear), 0.2 * right);
        volume::dilate(volume, 2);
        EXPECT_NEAR(read(Reading::trilinear) / right, 1.0, 0.1) << snap;
    }
}

TEST_F(Bake, ThePlanSaysWhatIsNotNeeded) {
    const auto planned = [&](const Scene& scene, const char* solver, std::optional<int> bounces) {
        bake::BakeSettings settings = coarse(12, solver);
        settings.bounces = bounces;
        return plan_of(scene, settings);
    };
    const auto skips = [](const bake::BakePlan& plan, const std::string& name) {
        return std::ranges::count(plan.skipped, name, &solver::SkippedStage::name) == 1;
    };
    const auto runs = [](const bake::BakePlan& plan, const std::string& name) {
        return std::ranges::count(plan.stages, name, &StageReport::name) == 1;
    };
    Scene scene = scenes::cornell_box_with_point();
    const bake::BakePlan once = planned(scene, "gather", 1);
    for (const char* name : {"sky", "emitters", "rsm", "light between patches"})
        EXPECT_TRUE(skips(once, name)) << name;
    EXPECT_FALSE(skips(planned(scene, "gather", {}), "light between patches"));
    const bake::BakePlan maps = planned(scene, "lpv", 1);
    EXPECT_TRUE(skips(maps, "lighting"));
    EXPECT_FALSE(runs(maps, "lighting"));
    EXPECT_TRUE(runs(maps, "rsm"));
    // Once it is there it is no longer left out.
    scene.sky.luminance = glm::vec3(1.0f);
    const bake::BakePlan sky = planned(scene, "lpv", 1);
    EXPECT_FALSE(skips(sky, "sky"));
    EXPECT_TRUE(runs(sky, "lighting"));
    scene.lights.clear();
    EXPECT_TRUE(skips(planned(scene, "lpv", 1), "rsm"));
    EXPECT_EQ(planned(scene, "lpv", 1).maps.count, 0);
    EXPECT_TRUE(skips(planned(scene, "gather", 1), "punctual lights"));
    const Scene glowing = scenes::furnace(2.0f, 0.5f, 1.0f);
    EXPECT_FALSE(skips(planned(glowing, "sn", {}), "emitters"));
}

TEST_F(Bake, LightsThatAreFarOutsideAreTold) {
    Scene scene = scenes::cornell_box_with_point();
    EXPECT_TRUE(plan_of(scene, coarse()).warnings.empty());
    scene.lights[0].position *= 100.0; // in centimetres
    const bake::BakePlan plan = plan_of(scene, coarse());
    ASSERT_EQ(plan.warnings.size(), 1u);
    EXPECT_NE(plan.warnings[0].find("\"" + scene.lights[0].name + "\" is "), std::string::npos);
}

TEST_F(Bake, TimeIsThatOfTheThreadsAndTheKindOfDevice) {
    const Scene scene = scenes::cornell_box_with_point();
    const bake::SceneFacts facts = bake::survey(scene);
    gpu::DeviceInfo cpu = device().info(), card = cpu;
    cpu.type = "cpu";
    card.type = "discrete";
    for (const char* solver : {"sn", "gather", "lpv"}) {
        bake::BakeSettings settings = coarse(64);
        settings.solver = solver::SolverSettings(*bake::find_solver(solver));
        const bake::BakePlan here = bake::plan_bake(facts, settings, cpu);
        EXPECT_LT(bake::plan_bake(facts, settings, card).seconds, here.seconds) << solver;
        const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
        const bake::BakePlan alone = bake::plan_bake(facts, settings, cpu);
        EXPECT_EQ(alone.threads, 1);
        // Alike for all stages: what is fastest does not depend on the threads.
        const double share = (0.3 + 0.7 * 2) / (0.3 + 0.7 * 2 / here.threads);
        ASSERT_EQ(alone.stages.size(), here.stages.size());
        for (size_t i = 0; i < here.stages.size(); ++i)
            EXPECT_NEAR(alone.stages[i].seconds, share * here.stages[i].seconds, 1e-9) << i;
    }
}

TEST_F(Bake, AWishIsMetByTheFastestOrTheMostAccurate) {
    const Scene scene = scenes::cornell_box_with_point();
    bake::BakeSettings base = coarse(32);
    base.bounces = std::nullopt;
    const auto choose = [&](bake::Wish wish) {
        const bake::Choice choice =
            bake::choose_settings(bake::survey(scene), base, wish, device().info());
        EXPECT_EQ(choice.plan.seconds, plan_of(scene, choice.plan.settings).seconds);
        EXPECT_EQ(choice.error, bake::expected_error(choice.plan.settings));
        return choice;
    };
    double seconds = 0.0;
    for (const double error : {1.0, 0.1, 0.06, 0.04, 0.025}) {
        bake::Wish wish;
        wish.error = error;
        const bake::Choice choice = choose(wish);
        EXPECT_LE(choice.error, error);
        EXPECT_TRUE(choice.warnings.empty());
        EXPECT_GE(choice.plan.seconds, seconds);
        seconds = choice.plan.seconds;
        // With that time, the error is as low.
        bake::Wish budget;
        budget.seconds = choice.plan.seconds;
        if (choice.solver().order() > 1)
            budget.order = choice.solver().order();
        EXPECT_LE(choose(budget).error, choice.error);
        EXPECT_LE(choose(budget).plan.seconds, choice.plan.seconds);
    }
    bake::Wish fixed;
    fixed.error = 0.02;
    fixed.solvers = {bake::find_solver("gather")};
    fixed.order = 4;
    fixed.given = {{"vpls", 500}};
    EXPECT_EQ(choose(fixed).solver()["vpls"], 500);
    EXPECT_EQ(choose(fixed).solver().order(), 4);
    bake::Wish hopeless;
    hopeless.error = 1e-4;
    hopeless.seconds = 1e-4;
    EXPECT_EQ(choose(hopeless).warnings.size(), 2u);
    EXPECT_EQ(choose(bake::Wish{}).solver().kind().name, std::string("sn"));
}

TEST_F(Bake, APilotTellsWhatBandsAndClustersLose) {
    const Scene scene = scenes::cornell_box_with_point();
    bake::BakeSettings settings = coarse(16, "gather");
    settings.bounces = std::nullopt;
    const bake::SceneFacts facts = bake::survey(scene);
    Progress silent;
    const auto pilot = [&](const Scene& of) {
        return bake::run_pilot(of, bake::plan_pilot(facts, settings, device().info()), device(),
                               silent);
    };
    const std::optional<solver::Pilot> told = pilot(scene);
    ASSERT_TRUE(told);
    tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(*pilot(scene), *told);

    // Beside all cells, solved.
    settings.solver.set("tolerance", 0.0);
    const auto solved = [&](int order, int clusters) {
        settings.solver.set_order(order);
        settings.solver.set("vpls", clusters);
        return run(scene, settings).volume;
    };
    const Volume four = solved(4, 1024);
    Volume two = four, first = four;
    two.sh.resize(9);
    first.sh.resize(4);
    two.sh_order = 2;
    first.sh_order = 1;
    const auto lost = [](const Volume& some, const Volume& all) {
        return volume::compare(some, all, {}).relative_l1;
    };
    EXPECT_NEAR(told->bands[0] / lost(first, four), 1.0, 0.15);
    EXPECT_NEAR(told->bands[1] / lost(two, four), 1.0, 0.15);
    EXPECT_NEAR(told->clusters[0] / lost(solved(2, solver::few_clusters), two), 1.0, 0.4);
    EXPECT_NEAR(told->clusters[1] / lost(solved(2, solver::more_clusters), two), 1.0, 0.4);
}

TEST_F(Bake, DirectionsAreThoseThatAreSolved) {
    bake::BakeSettings settings = coarse(6, "sn"), rounded = settings;
    settings.solver.set("directions", 100);
    rounded.solver.set("directions", 144);
    const Scene scene = scenes::cornell_box_with_point();
    EXPECT_EQ(plan_of(scene, settings).seconds, plan_of(scene, rounded).seconds);
    EXPECT_EQ(bake::expected_error(settings), bake::expected_error(rounded));
    EXPECT_EQ(run(scene, settings).volume.metadata.at("directions"), "144");
}

TEST_F(Bake, ExactSolversNeedNoMaps) {
    const Scene scene = scenes::cornell_box_with_point();
    for (const char* solver : {"sn", "gather"}) {
        const bake::BakeSettings settings = coarse(12, solver);
        const bake::BakePlan plan = plan_of(scene, settings);
        EXPECT_EQ(plan.maps.count, 0);
        EXPECT_TRUE(plan.lit);
        for (const StageReport& stage : run(scene, settings).stages)
            EXPECT_TRUE(
                std::any_of(plan.stages.begin(), plan.stages.end(),
                            [&](const StageReport& planned) { return planned.name == stage.name; }))
                << stage.name;
    }
}

TEST_F(Bake, DiscsOfTheMapsBringNoMoreAndNoLessThanClusters) {
    Scene scene = scenes::cornell_box_with_point();
    bake::BakeSettings settings = coarse(12, "gather");
    for (const std::optional<int> bounces : {std::optional(1), std::optional<int>()}) {
        settings.bounces = bounces;
        settings.solver.set("rsm-samples", 0);
        const Volume clusters = run(scene, settings).volume;
        settings.solver.set("rsm-samples", 512);
        EXPECT_EQ(plan_of(scene, settings).lit, bounces != 1);
        const Baked discs = run(scene, settings);
        EXPECT_EQ(discs.stages.end()[-2].name, "discs");
        EXPECT_EQ(discs.volume.metadata.at("content"), clusters.metadata.at("content"));
        EXPECT_NEAR(volume::total_energy(discs.volume) / volume::total_energy(clusters), 1.0,
                    0.015);
    }
}

TEST_F(Bake, HardCasesEndInFiniteNumbers) {
    std::vector<std::pair<const char*, Scene>> cases;
    {
        Scene flat = scenes::floor_quad(4.0f, glm::vec3(0.5f));
        flat.lights.push_back(scenes::sun({0.3, -1, 0.2}, 1e5));
        cases.emplace_back("flat", flat);
        Scene grazing = scenes::floor_quad(4.0f, glm::vec3(0.5f));
        grazing.lights.push_back(scenes::sun({1, -1e-4, 0}, 1e5));
        cases.emplace_back("grazing", grazing);
        Scene edge_on = scenes::floor_quad(4.0f, glm::vec3(0.5f));
        edge_on.lights.push_back(scenes::sun({1, 0, 0}, 1e5));
        cases.emplace_back("edge on", edge_on);
    }
    {
        Scene inside = scenes::cornell_box();
        inside.lights.push_back(scenes::point_light({-1.0, 1.0, 0.0}, 100.0)); // in a wall
        inside.lights.push_back(scenes::point_light({0.0, 1e-9, 0.0}, 100.0)); // on the floor
        cases.emplace_back("light in geometry", inside);
    }
    {
        Scene doubled = scenes::cornell_box_with_point();
        doubled.instances.insert(doubled.instances.end(), doubled.instances.begin(),
                                 doubled.instances.begin() + 1);
        for (Mesh& mesh : doubled.meshes)
            for (int i = 0; i < 8; ++i)
                mesh.triangles.push_back(glm::uvec3(0, 0, 1));
        cases.emplace_back("duplicate and degenerate triangles", doubled);
    }
    {
        Scene white = scenes::floor_quad(4.0f, glm::vec3(1.0f));
        white.rules.max_albedo = 1.0f;
        white.lights.push_back(scenes::spot_light({0, 2, 0}, {0, -1, 0}, 1e9, 0.0, 1.57));
        cases.emplace_back("albedo 1, widest spot", white);
    }
    for (const auto& [name, scene] : cases) {
        SCOPED_TRACE(name);
        bake::BakeSettings settings = coarse();
        settings.solver.set("iterations", 1000);
        expect_finite(run(scene, settings).volume);
    }
}

TEST_F(Bake, SaysWhatIsWrong) {
    const auto fails = [&](const Scene& scene, const bake::BakeSettings& settings, ErrorKind kind,
                           const char* word) {
        try {
            run(scene, settings);
            ADD_FAILURE() << word;
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, kind) << error.what();
            EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
        }
    };
    fails(scenes::cornell_box(), coarse(), ErrorKind::invalid, "`lights`");
    fails(Scene{}, coarse(), ErrorKind::invalid, "no triangles");
    bake::BakeSettings huge = coarse(1200);
    fails(scenes::cornell_box_with_point(), huge, ErrorKind::memory, "`resolution`");
}

TEST_F(Bake, TheResolutionThatItNamesFits) {
    const Scene scene = scenes::cornell_box_with_point();
    const bake::SceneFacts facts = bake::survey(scene);
    gpu::DeviceInfo small = device().info();
    small.memory = 8 << 20;
    try {
        bake::plan_bake(facts, coarse(200), small);
        ADD_FAILURE();
    } catch (const Error& error) {
        const std::string text = error.what();
        const int named = std::stoi(text.substr(text.rfind(' ')));
        EXPECT_GT(named, 10);
        EXPECT_NO_THROW(bake::plan_bake(facts, coarse(named), small));
        EXPECT_THROW(bake::plan_bake(facts, coarse(named + 1), small), Error);
    }
}

TEST_F(Bake, WhatLiesFarFromTheGridCostsAPlanLittle) {
    // A room on a plain of 80 m and of 8 km, and a grid around the room.
    const auto plan = [&](float edge) {
        Scene scene = scenes::floor_quad(edge, glm::vec3(0.5f));
        scenes::add_box(scene, 0, {0, 0.01f, 0}, {4, 3, 4}, scenes::Facing::inward);
        scene.lights.push_back(scenes::point_light({2, 2.5, 2}, 100.0));
        bake::BakeSettings settings(*bake::find_solver("sn"));
        settings.grid.cell = 0.25;
        settings.bounds = Bounds{{-1, 0, -1}, {5, 3.2, 5}};
        settings.fit = readers::reader_named("unity");
        return plan_of(scene, settings);
    };
    const bake::BakePlan near = plan(80.0f), far = plan(8000.0f);
    EXPECT_LT(far.host_bytes, near.host_bytes + near.host_bytes / 4);
    EXPECT_LT(far.seconds, 2.0 * near.seconds);
    EXPECT_GT(far.seconds, near.seconds);
}

TEST_F(Bake, RaysThatKeepWhatTheyMeetAndPassAreInThePlan) {
    const auto kept = [&](bool tinted) {
        Scene scene = scenes::glass_room(true);
        if (!tinted)
            scene.materials.back().transmission = 0.0f;
        bake::BakeSettings settings = coarse(16, "sn");
        settings.bounces = 1;
        const uint64_t none = plan_of(scene, settings).host_bytes;
        settings.bounces = std::nullopt;
        return plan_of(scene, settings).host_bytes - none;
    };
    EXPECT_GT(kept(false), 32u * sizeof(uint32_t));
    EXPECT_EQ(kept(true), 4 * kept(false)); // a colour, too
}

TEST_F(Bake, WarnsOfEmptyBoundsAndOfBacks) {
    Scene town;
    const int material = scenes::add_material(town, glm::vec3(0.5f));
    for (int i = 0; i < 30; ++i)
        scenes::add_box(town, material, glm::vec3(0.0f), glm::vec3(1.0f), scenes::Facing::outward,
                        glm::translate(glm::dmat4(1.0), glm::dvec3(2.0 * i, 0, 0)));
    scenes::add_quad(town, material, {-1000, 0, -1000}, {0, 0, 2000}, {2000, 0, 0});
    town.lights.push_back(scenes::sun({0.2, -1, 0.1}, 1e5));
    const bake::BakePlan plan = plan_of(town, coarse());
    ASSERT_EQ(plan.warnings.size(), 1u);
    EXPECT_NE(plan.warnings[0].find("`bounds`"), std::string::npos);

    Scene inside_out;
    scenes::add_box(inside_out, scenes::add_material(inside_out, glm::vec3(0.5f)), glm::vec3(-1.0f),
                    glm::vec3(1.0f), scenes::Facing::outward);
    inside_out.lights.push_back(scenes::point_light({0, 0, 0}, 100.0));
    const Baked baked = run(inside_out, coarse());
    ASSERT_FALSE(baked.warnings.empty());
    EXPECT_NE(baked.warnings[0].find("`cull_backfaces`"), std::string::npos);
}

TEST_F(Bake, WarnsOfLightThatFallsOnLessThanACell) {
    for (const double outer : {0.004, 0.7}) {
        Scene scene = scenes::cornell_box();
        scene.lights.push_back(scenes::spot_light({0, 1.9, 0}, {0.3, -1, 0.2}, 100.0, 0.0, outer));
        const Baked baked = run(scene, coarse(12, "gather"));
        ASSERT_EQ(baked.warnings.size(), outer < 0.1 ? 1u : 0u);
        if (outer < 0.1) {
            EXPECT_EQ(baked.warnings[0].find("100 % of the light of lamps"), 0u)
                << baked.warnings[0];
        }
    }
}

TEST_F(Bake, AFitShowsSurfacesToItsReaderAndSaysHowWell) {
    const Scene scene = scenes::cornell_box_with_point();
    for (const char* solver : {"sn", "lpv"}) { // all surfaces lit, or maps alone
        bake::BakeSettings settings = coarse(16, solver);
        const Baked plain = run(scene, settings);
        EXPECT_EQ(plain.volume.metadata.count("fit"), 0u);
        settings.fit = readers::reader_named("unity");
        const bake::BakePlan plan = plan_of(scene, settings);
        EXPECT_EQ(plan.stages.back().name, "fit");
        const Baked fitted = run(scene, settings);
        EXPECT_EQ(fitted.stages.back().name, "fit");
        EXPECT_TRUE(fitted.warnings.empty());
        expect_finite(fitted.volume);
        const auto& facts = fitted.volume.metadata;
        EXPECT_EQ(facts.at("fit"), "unity");
        EXPECT_LT(std::stod(facts.at("fit_error")), 0.06) << solver;
        EXPECT_NEAR(std::stod(facts.at("fit_energy")), 1, 0.02) << solver;
        EXPECT_LT(std::abs(std::stod(facts.at("fit_leak"))), 0.02) << solver;
        EXPECT_EQ(fitted.volume.validity, plain.volume.validity);
        EXPECT_EQ(fitted.volume.sh_order, plain.volume.sh_order);
    }
}

TEST_F(Bake, TheResolutionHoldsFromWhichOnItSaysThatAFitWould) {
    // A lit storey below a dark one: their walls stand above each other, and share cells.
    Scene scene;
    const int material = scenes::add_material(scene, glm::vec3(0.7f), glm::vec3(0.0f), true);
    for (const float y : {0.0f, 1.0f, 2.0f})
        scenes::add_quad(scene, material, {0, y, 0}, {0, 0, 3}, {4, 0, 0});
    for (const float x : {0.0f, 4.0f})
        scenes::add_quad(scene, material, {x, 0, 0}, {0, 2, 0}, {0, 0, 3});
    for (const float z : {0.0f, 3.0f})
        scenes::add_quad(scene, material, {0, 0, z}, {4, 0, 0}, {0, 2, 0});
    scene.lights.push_back(scenes::point_light({2, 0.8, 1.5}, 100));
    bake::BakeSettings settings = coarse(8, "sn");
    settings.bounces.reset();
    settings.fit = readers::reader_named("unity");
    const auto warning = [&](const Baked& baked) -> std::string {
        for (const std::string& text : baked.warnings)
            if (text.find("walls part") != std::string::npos)
                return text;
        return {};
    };
    const auto contested = [](const Baked& baked) {
        return std::stod(baked.volume.metadata.at("fit_contested"));
    };
    const Baked first = run(scene, settings);
    EXPECT_GT(contested(first), 2 * bake::contested_most);
    const std::string told = warning(first), setting = "from `resolution` ";
    ASSERT_NE(told.find(setting), std::string::npos) << told;
    const int enough = std::stoi(told.substr(told.find(setting) + setting.size()));
    EXPECT_GT(enough, 15);
    EXPECT_LT(enough, 30);
    EXPECT_NEAR(std::stod(first.volume.metadata.at("fit_cell")),
                8 * first.volume.grid.cell / enough, first.volume.grid.cell * 8 / 15 / 15);

    settings.grid.resolution = enough;
    const Baked holds = run(scene, settings);
    EXPECT_EQ(warning(holds), "");
    EXPECT_LE(contested(holds), bake::contested_most);
    const Baked before = [&] { // where walls lie in cells counts as well: the worst of some
        std::optional<Baked> worst;
        for (int resolution = enough * 4 / 5; resolution < enough; ++resolution) {
            settings.grid.resolution = resolution;
            Baked baked = run(scene, settings);
            if (!worst || contested(baked) > contested(*worst))
                worst = std::move(baked);
        }
        return std::move(*worst);
    }();
    EXPECT_NE(warning(before), "");
    const auto error = [](const Baked& baked) {
        return std::stod(baked.volume.metadata.at("fit_error"));
    };
    EXPECT_LT(error(holds), error(before));
    EXPECT_LT(error(holds), 0.5 * error(first));
}

TEST_F(Bake, NothingIsFittedWhereNoSurfaceIs) {
    bake::BakeSettings settings = coarse(6, "sn");
    settings.bounds = Bounds{{-0.2, 1.4, 0.2}, {0.2, 1.6, 0.5}}; // in the air
    const Baked plain = run(scenes::cornell_box_with_point(), settings);
    settings.fit = readers::reader_named("unity");
    const Baked fitted = run(scenes::cornell_box_with_point(), settings);
    EXPECT_EQ(fitted.volume.sh, plain.volume.sh);
    EXPECT_EQ(fitted.volume.metadata.count("fit"), 0u);
    ASSERT_EQ(fitted.warnings.size(), plain.warnings.size() + 1);
    EXPECT_NE(fitted.warnings.back().find("nothing is fitted"), std::string::npos);
}

} // namespace
} // namespace lpvbake
