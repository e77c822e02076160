// Gathering from discs of the maps against a closed form, against the gather of clusters, which
// shares neither its surfaces nor its sums, and against what its light may not do.
#include "solver/gather/discs.h"

#include "gpu/device.h"
#include "scenes.h"
#include "solver/gather/gather.h"
#include "visibility/validity.h"
#include "volume/grid.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>

namespace lpvbake {
namespace {

const double pi = glm::pi<double>();

class Discs : public testing::DeviceTest {
protected:
    Volume gather(const Scene& scene, const Grid& grid, int samples, int map_size = 256) {
        const scene::Frame frame{grid.origin, grid.cell, glm::dvec3(grid.dims)};
        const visibility::Visibility visibility(scene, frame);
        Volume volume;
        volume.grid = grid;
        volume.sh_order = 2;
        volume.sh.assign(9, std::vector<glm::vec3>(grid.size(), glm::vec3(0.0f)));
        volume.validity = visibility::trace_validity(visibility, grid.dims);
        Progress silent;
        solver::gather::gather_discs(device(), scene, frame, visibility, {samples, map_size},
                                     volume, silent);
        return volume;
    }
};

Grid fit(const Scene& scene, int resolution) {
    const Bounds box = bounds_of(scene);
    return volume::fit_grid(box.lo, box.hi, {resolution});
}

/// Sums over valid cells of the difference of L0 and of b's, green.
double difference(const Volume& a, const Volume& b, double& mean_ratio) {
    double off = 0.0, sum_a = 0.0, sum_b = 0.0;
    for (size_t cell = 0; cell < a.grid.size(); ++cell) {
        off += std::abs(double(a.sh[0][cell].y) - double(b.sh[0][cell].y));
        sum_a += double(a.sh[0][cell].y);
        sum_b += double(b.sh[0][cell].y);
    }
    mean_ratio = sum_a / sum_b;
    return off / sum_b;
}

TEST_F(Discs, HaveTheSolidAngleOfASunlitSquare) {
    Scene scene = scenes::floor_quad(4.0f, glm::vec3(0.5f));
    scene.lights.push_back(scenes::sun({0.3, -1.0, 0.2}, 1000.0));
    const double cosine = 1.0 / std::sqrt(1.0 + 0.09 + 0.04);
    const double luminance = 0.5 * 1000.0 * cosine / pi;
    const Grid grid{glm::dvec3(-2.25, 0.0, -2.25), 0.5, {9, 12, 9}};
    const Volume volume = gather(scene, grid, 1 << 11);
    for (int y = 0; y < 12; ++y) {
        const double d = 0.5 * (y + 0.5), a = 2.0, s = std::hypot(a, d);
        const double angle = 4.0 * std::asin(a * a / (s * s));
        const double facing = 4.0 * (a / s) * std::atan(a / s);
        const size_t cell = grid.index({4, y, 4});
        EXPECT_NEAR(double(volume.sh[0][cell].x) / (luminance * angle / std::sqrt(4.0 * pi)), 1.0,
                    0.02)
            << y;
        EXPECT_NEAR(double(volume.sh[1][cell].x)
                        / (-luminance * facing * std::sqrt(3.0 / (4.0 * pi))),
                    1.0, 0.02)
            << y;
    }
}

TEST_F(Discs, NoiseFallsWithTheirSamplesAndTheMeanStays) {
    const Scene scene = scenes::cornell_box_with_point();
    const Grid grid = fit(scene, 8);
    const Volume fine = gather(scene, grid, 2048);
    double few_mean = 0.0, many_mean = 0.0;
    const double few = difference(gather(scene, grid, 16), fine, few_mean);
    const double many = difference(gather(scene, grid, 256), fine, many_mean);
    EXPECT_NEAR(few_mean, 1.0, 0.03);
    EXPECT_NEAR(many_mean, 1.0, 0.01);
    EXPECT_GT(few / many, 3.0);
    EXPECT_LT(many, 0.12);
}

TEST_F(Discs, AgreeWithClusters) {
    for (const Scene& scene : {scenes::cornell_box_with_point(), scenes::cornell_box_with_sun()}) {
        const Grid grid = fit(scene, 8);
        const Volume discs = gather(scene, grid, 1024, 512);
        const scene::Frame frame{grid.origin, grid.cell, glm::dvec3(grid.dims)};
        const visibility::Visibility visibility(scene, frame);
        Progress silent;
        const surface::LitSurfaces lit =
            surface::light_surfaces(scene, visibility, frame, {}, silent);
        Volume clusters = discs;
        solver::gather::GatherSettings settings;
        settings.vpls = 2000;
        settings.tolerance = 0.0f;
        solver::gather::GatherProgram(device(), settings)
            .gather(lit, scene.sky, visibility, clusters, silent);
        double ratio = 0.0;
        EXPECT_LT(difference(discs, clusters, ratio), 0.05);
        EXPECT_NEAR(ratio, 1.0, 0.015);
    }
}

TEST_F(Discs, NothingLeaksThroughAClosedWall) {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.7f));
    scenes::add_box(scene, white, {0, 0, 0}, {4.05f, 2, 2}, scenes::Facing::inward);
    scenes::add_box(scene, white, {2, 0, 0}, {2.05f, 2, 2}, scenes::Facing::outward);
    scene.lights.push_back(scenes::point_light({0.8, 1.7, 0.7}, 100.0));
    const Grid grid = fit(scene, 14);
    const Volume volume = gather(scene, grid, 64);
    double lit = 0.0;
    for (int z = 0; z < grid.dims.z; ++z)
        for (int y = 0; y < grid.dims.y; ++y)
            for (int x = 0; x < grid.dims.x; ++x) {
                const glm::vec3 value = volume.sh[0][grid.index({x, y, z})];
                if (grid.center({x, y, z}).x < 2.0)
                    lit += double(value.x);
                else
                    ASSERT_EQ(value, glm::vec3(0.0f)) << x << ' ' << y << ' ' << z;
            }
    EXPECT_GT(lit, 0.0);
}

TEST_F(Discs, SameBitsForAnyNumberOfThreads) {
    const Scene scene = scenes::cornell_box_with_point();
    const Grid grid = fit(scene, 8);
    const Volume all = gather(scene, grid, 32);
    const tbb::global_control alone(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(gather(scene, grid, 32).sh, all.sh);
}

} // namespace
} // namespace lpvbake
