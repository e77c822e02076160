// Air that is not the same everywhere, and light on its way through it.
#include "medium/beams.h"
#include "medium/fog.h"

#include "lpvbake/error.h"
#include "scenes.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cmath>
#include <random>

namespace lpvbake {
namespace {

using medium::Medium;

constexpr double pi = glm::pi<double>(), y0 = 0.28209479177387814;

/// Far from where anything is asked.
Scene nothing() {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {1e4f, 1e4f, 1e4f},
                     {1e-3f, 0, 0}, {0, 1e-3f, 0});
    return scene;
}

/// Random voxels, turned, of edges 0.7, 0.4 and 1.1 m.
std::shared_ptr<volume::Density> smoke() {
    auto density = std::make_shared<volume::Density>();
    density->dims = {7, 9, 5};
    glm::dmat4 map = glm::translate(glm::dmat4(1.0), glm::dvec3(-2, -1, -2));
    map = glm::rotate(map, 0.6, glm::normalize(glm::dvec3(1, 2, -1)));
    map = glm::scale(map, glm::dvec3(0.7, 0.4, 1.1));
    density->to_voxels = glm::inverse(map);
    std::mt19937 random(2);
    for (int i = 0; i < 7 * 9 * 5; ++i) {
        density->values.push_back(random() % 3 ? float(random() % 1000) / 500.0f : 0.0f);
        density->most = std::max(density->most, density->values.back());
    }
    return density;
}

Medium air(glm::dvec3 scatter, glm::dvec3 absorb, double g = 0) {
    return {scatter, absorb, g, {glm::dvec3(-2), glm::dvec3(4)}};
}

TEST(Media, ColumnsAreSumsOfDensity) {
    std::vector<Medium> all(4, air(glm::dvec3(1), glm::dvec3(0)));
    all[1].height = medium::Falloff{-1, 1.5};
    all[2].density = all[3].density = smoke();
    all[3].height = medium::Falloff{0, -3}; // denser above
    std::mt19937 random(1);
    std::uniform_real_distribution<double> any(-5, 6);
    for (const Medium& medium : all) {
        double whole = 0;
        for (int i = 0; i < 60; ++i) {
            const glm::dvec3 a(any(random), any(random), any(random));
            glm::dvec3 b(any(random), any(random), any(random));
            if (i % 4 == 0)
                b = {a.x, b.y, a.z};
            constexpr int n = 40000;
            double sum = 0;
            for (int k = 0; k < n; ++k)
                sum += medium.density_at(glm::mix(a, b, (k + 0.5) / n)) * glm::length(b - a) / n;
            EXPECT_NEAR(medium.column(a, b), sum, 2e-3);
            EXPECT_NEAR(medium.column(b, a), medium.column(a, b), 1e-12);
            EXPECT_LE(sum, medium.peak() * glm::length(b - a) * (1 + 1e-9));
            whole += sum;
        }
        EXPECT_GT(whole, 20);
        EXPECT_EQ(medium.column({1, 1, 1}, {1, 1, 1}), 0);
        // Of a box: the mean over points.
        double mean = 0;
        for (int i = 0; i < 100000; ++i)
            mean += medium.density_at(glm::dvec3(-3, -1, 0)
                                      + glm::dvec3(2, 3, 1.5)
                                            * glm::dvec3(random() * 0x1p-32, random() * 0x1p-32,
                                                         random() * 0x1p-32))
                    / 100000;
        EXPECT_NEAR(medium.mean_density({-3, -1, 0}, {-1, 2, 1.5}), mean, 0.02 * mean);
        EXPECT_EQ(medium.mean_density({4, -1, 0}, {5, 2, 1}), 0);
    }
    EXPECT_NEAR(all[2].grain(), 0.4, 1e-12);
    EXPECT_EQ(all[0].grain(), 0);
}

TEST(Media, ThinLayersUnderHighAirHaveColumns) {
    Medium medium = air(glm::dvec3(1), glm::dvec3(0));
    medium.box = {{-2, 0, -2}, {2, 1000, 2}};
    for (const double scale : {1.0, 0.01, 1e-6}) { // e^-1000 and less at the upper end
        medium.height = medium::Falloff{0, scale};
        EXPECT_NEAR(medium.column({0, 1100, 0}, {0, -1, 0}), scale, 1e-12 * scale);
        EXPECT_NEAR(medium.column({0, -1, 0}, {0, 1100, 0}), scale, 1e-12 * scale);
        EXPECT_EQ(medium.column({0, 1000, 0}, {0, 999, 0}), 0);
        medium.height = medium::Falloff{1000, -scale}; // under a ceiling
        EXPECT_NEAR(medium.column({0, 1100, 0}, {0, -1, 0}), scale, 1e-9 * scale);
        EXPECT_NEAR(medium.column({0, -1, 0}, {0, 1100, 0}), scale, 1e-9 * scale);
    }
}

TEST(Media, TooDenseIsRefused) {
    Medium medium = air(glm::dvec3(1), glm::dvec3(0));
    medium::check_medium(medium, "air");
    medium.height = medium::Falloff{1000, 1};
    EXPECT_THROW(medium::check_medium(medium, "air"), Error);
    medium.height.reset();
    medium.box = {glm::dvec3(1), glm::dvec3(1, 2, 2)};
    EXPECT_THROW(medium::check_medium(medium, "air"), Error);
}

medium::DirectLight lit(const Light& light, const Medium& medium, int cells, double unit,
                        int per_cell = 4, int order = 0) {
    const Scene scene = nothing();
    const scene::Frame frame{glm::dvec3(0), unit, glm::dvec3(cells)};
    return medium::direct_light(light, visibility::Visibility(scene, frame), frame, {},
                                {per_cell, 0.0, order, &medium});
}

TEST(BeamsInAir, TheSunFallsOffAsBeerAndLambertHaveIt) {
    // From the top of the medium, 4 m up, and half of that at 60 degrees of depth.
    const Medium medium = air({0.2, 0.5, 1}, {0.1, 0, 2});
    constexpr double h = 0.25;
    for (const glm::dvec3 way : {glm::dvec3(0, -1, 0), glm::dvec3(1, 0, 0), glm::dvec3(0, 0, -1)})
        for (const int k : {1, 3}) {
            const medium::DirectLight light = lit(scenes::sun(way, 800), medium, 8, h, k);
            for (int i = 0; i < 512; ++i) {
                const glm::dvec3 cell(i % 8, i / 8 % 8, i / 64);
                // The box is [-2, 4], the grid [0, 2].
                const double along = glm::dot(way, cell * h);
                const double depth = way.x > 0 ? along + 2 : 4 + along - h;
                for (int c = 0; c < 3; ++c) {
                    const double s = medium.extinction()[c];
                    const double expected =
                        800 * std::exp(-s * depth) * (1 - std::exp(-s * h)) / (s * h);
                    EXPECT_NEAR(double(light.sh[0][std::size_t(i)][c]) / y0, expected,
                                2e-6 * expected);
                }
            }
        }
}

TEST(BeamsInAir, InThinAirEachCellHasAllOfTheSun) {
    const Medium thin = air(glm::dvec3(1e-9), glm::dvec3(0));
    for (const int k : {1, 2, 4}) {
        const medium::DirectLight light =
            lit(scenes::sun({0.37, -0.81, 0.22}, 500), thin, 9, 0.3, k);
        for (std::size_t cell = 0; cell < 729; ++cell)
            EXPECT_NEAR(double(light.sh[0][cell].g) / y0, 500, 5e-4);
    }
    // And a lamp's own cell its mean: 7.67412 I / h^2.
    const medium::DirectLight lamp =
        lit(scenes::point_light({0.75, 0.75, 0.75}, 3), thin, 5, 0.3, 8);
    EXPECT_NEAR(double(lamp.sh[0][2 + 5 * (2 + 5 * 2)].g) / y0, 7.67412 * 3 / 0.09, 2.5);
}

TEST(BeamsInAir, ALampsLightIsTakenOrLeaves) {
    // What cells take of it, and what is left at the grid's sides: 4 pi I.
    for (const bool even : {true, false}) {
        Medium medium = air(glm::dvec3(0.6), glm::dvec3(0.3));
        if (!even)
            medium.density = smoke();
        const glm::dvec3 at(0.9, 1.1, 0.7);
        const medium::DirectLight light = lit(scenes::point_light(at, 10), medium, 12, 0.2, 6);
        double taken = 0;
        for (const glm::vec3& cell : light.sh[0])
            taken += double(cell.g) / y0 * medium.peak() * 0.9 * 0.008;
        double left = 0;
        constexpr int n = 300;
        for (int i = 0; i < n * 2 * n; ++i) {
            const double y = 2 * (i / (2 * n) + 0.5) / n - 1, turn = pi * (i % (2 * n) + 0.5) / n;
            const glm::dvec3 way(std::sqrt(1 - y * y) * std::cos(turn), y,
                                 std::sqrt(1 - y * y) * std::sin(turn));
            const auto in = medium::within(at, way, glm::dvec3(0), glm::dvec3(2.4), 0, HUGE_VAL);
            left += std::exp(-0.9 * medium.column(at, at + in->y * way)) / (2 * n * n);
        }
        EXPECT_NEAR(taken, 4 * pi * 10 * (1 - left), 0.01 * taken) << even;
        EXPECT_GT(left, 0.05);
    }
}

TEST(BeamsInAir, TheSameBytesForAnyNumberOfThreads) {
    Medium medium = air(glm::dvec3(0.6), glm::dvec3(0.3), 0.5);
    medium.density = smoke();
    medium::DirectLight one, many;
    tbb::task_arena(1).execute([&] {
        one = lit(scenes::point_light({0.9, 1.1, 0.7}, 10), medium, 8, 0.3, 3, 2);
    });
    tbb::task_arena(4).execute([&] {
        many = lit(scenes::point_light({0.9, 1.1, 0.7}, 10), medium, 8, 0.3, 3, 2);
    });
    EXPECT_EQ(one.sh, many.sh);
}

TEST(FogOfOtherDensity, IsThatOfEvenAirWhereItIsEven) {
    Scene scene = nothing();
    Medium even = air({0.05, 0.2, 0.1}, {0, 0.3, 0.01}, 0.6), voxel = even;
    auto density = std::make_shared<volume::Density>();
    density->dims = glm::ivec3(1);
    density->values = {0.5f};
    density->most = 0.5f;
    density->to_voxels =
        glm::inverse(glm::scale(glm::translate(glm::dmat4(1.0), glm::dvec3(-2)), glm::dvec3(6)));
    voxel.density = density;
    voxel.scatter *= 2.0;
    voxel.absorb *= 2.0;
    const scene::Frame frame{glm::dvec3(0), 0.1, glm::dvec3(20)};
    for (const Light& light :
         {scenes::sun({0.3, -1, 0.2}, 1000), scenes::point_light({0.5, 1.1, 0.4}, 99),
          scenes::spot_light({1.5, 2.5, 1.4}, {0.1, -1, 0.2}, 99, 0.3, 0.6)}) {
        scene.lights = {light};
        const visibility::Visibility visibility(scene, frame);
        const medium::Fog a(scene, visibility, frame, nullptr, even, {});
        const medium::Fog b(scene, visibility, frame, nullptr, voxel, {});
        for (int i = 0; i < 20; ++i) {
            const glm::dvec3 origin(-30 + i, 3 * i, -25);
            const glm::dvec3 way = glm::normalize(glm::dvec3(7, 9, 8) - origin);
            const glm::dvec3 exact = a.direct(origin, way, 200), steps = b.direct(origin, way, 200);
            for (int c = 0; c < 3; ++c) {
                EXPECT_NEAR(steps[c], exact[c], 0.006 * exact[c] + 1e-9);
                EXPECT_NEAR(b.transmittance(origin, way, 60)[c],
                            a.transmittance(origin, way, 60)[c], 1e-9);
            }
        }
    }
}

TEST(FogOfOtherDensity, StepsComeToWhatManyDo) {
    Scene scene = nothing();
    Medium medium = air(glm::dvec3(0.4), glm::dvec3(0.1), 0.4);
    medium.density = smoke();
    medium.height = medium::Falloff{0, 2};
    const scene::Frame frame{glm::dvec3(0), 0.2, glm::dvec3(20)};
    for (const Light& light :
         {scenes::sun({0.3, -1, 0.2}, 1000), scenes::point_light({0.5, 1.1, 0.4}, 99)}) {
        scene.lights = {light};
        const visibility::Visibility visibility(scene, frame);
        const medium::Fog steps(scene, visibility, frame, nullptr, medium, {});
        const medium::Fog many(scene, visibility, frame, nullptr, medium, {4000});
        double difference = 0, sum = 0;
        for (int i = 0; i < 25; ++i) {
            const glm::dvec3 origin(-15 + i, 2 * i, -15);
            const glm::dvec3 way = glm::normalize(glm::dvec3(3, 4, 3) - origin);
            const double a = steps.direct(origin, way, 100).x, b = many.direct(origin, way, 100).x;
            difference += std::abs(a - b);
            sum += b;
        }
        EXPECT_GT(sum, 0);
        EXPECT_LT(difference, 0.02 * sum) << int(light.type);
    }
}

TEST(FogOfOtherDensity, OfAThinLayerIsSeenAllThatItScatters) {
    Scene scene = nothing();
    scene.lights = {scenes::sun({0.3, -1, 0.2}, 1000)};
    const scene::Frame frame{glm::dvec3(0), 0.2, glm::dvec3(20)};
    const visibility::Visibility visibility(scene, frame);
    for (const double height : {1e-2, 1e-4, 1e-6, 1e-8}) {
        Medium medium = air(glm::dvec3(1e-3 / height), glm::dvec3(0), 0);
        medium.height = medium::Falloff{medium.box.lo.y, height};
        const medium::Fog fog(scene, visibility, frame, nullptr, medium, {});
        // Thin, and the sun comes through it: depth over the cosine, evenly to all sides.
        const glm::dvec3 along = glm::normalize(glm::dvec3(0.5, -1, 0.3));
        const double seen = fog.direct({0, 15, 0}, along, 200).x;
        const double expected = 1000 * 1e-3 / -along.y / (4 * glm::pi<double>());
        EXPECT_NEAR(seen, expected, 0.004 * expected) << height;
    }
}

} // namespace
} // namespace lpvbake
