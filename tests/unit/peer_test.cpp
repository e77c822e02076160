// The peer against the reference, which shares no estimator with it, and against closed forms.
#include "reference/peer.h"

#include "reference/reference.h"
#include "scene/sky.h"
#include "scenes.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <functional>

namespace lpvbake {
namespace {

constexpr double pi = glm::pi<double>();

/// Points inside the Cornell box and before it, off its boxes.
std::vector<glm::vec3> some_points() {
    std::vector<glm::vec3> points;
    for (int i = 0; i < 60; ++i)
        points.push_back({-0.8f + 0.32f * float(i % 6), 1.3f + 0.12f * float(i / 6 % 5),
                          -0.7f + 0.9f * float(i / 30)});
    return points;
}

/// The box with a lamp, a spot, a sun and a wide glowing quad; one wall's texture varies.
Scene lit_box() {
    Scene scene = scenes::cornell_box_with_point(60);
    const int glow = scenes::add_material(scene, glm::vec3(0.2f), glm::vec3(20.0f, 10.0f, 5.0f));
    scenes::add_quad(scene, glow, {-0.9f, 1.2f, -0.95f}, {0.8f, 0, 0}, {0, 0.6f, 0});
    scene.lights.push_back(scenes::sun({-0.2, -0.6, -1}, 50, {1.0f, 0.8f, 0.5f}));
    scene.lights.push_back(scenes::spot_light({0.5, 1.8, 0.5}, {-0.2, -1, -0.3}, 80, 0.2, 0.6));
    scene.lights.back().range = 3.0;
    Mesh& floor = scene.meshes[0];
    for (size_t i = 0; i < floor.positions.size(); ++i)
        floor.colors.push_back({1.0f, 0.3f + 0.2f * float(i % 4), 0.5f, 1.0f});
    return scene;
}

/// Mean over seeds and its standard error, a number at a time.
struct Estimate {
    std::vector<double> mean, error;
};

std::vector<double> numbers_of(const reference::PeerField& field) {
    std::vector<double> all;
    for (const auto* part : {&field.sh, &field.irradiance})
        for (const auto& row : *part)
            for (const glm::vec3& c : row)
                all.insert(all.end(), {double(c.x), double(c.y), double(c.z)});
    return all;
}

Estimate over_seeds(int seeds, const std::function<reference::PeerField(uint64_t)>& trace) {
    std::vector<double> sum, squares;
    for (int seed = 0; seed < seeds; ++seed) {
        const std::vector<double> numbers = numbers_of(trace(uint64_t(seed)));
        sum.resize(numbers.size());
        squares.resize(numbers.size());
        for (size_t i = 0; i < numbers.size(); ++i) {
            sum[i] += numbers[i];
            squares[i] += numbers[i] * numbers[i];
        }
    }
    Estimate estimate;
    for (size_t i = 0; i < sum.size(); ++i) {
        const double mean = sum[i] / seeds;
        const double variance = std::max(0.0, squares[i] / seeds - mean * mean) / (seeds - 1);
        estimate.mean.push_back(mean);
        estimate.error.push_back(std::sqrt(variance));
    }
    return estimate;
}

TEST(Peer, AgreesWithTheReference) {
    Scene scene = lit_box();
    scene.sky.luminance = {4.0f, 6.0f, 8.0f};
    const scene::Frame frame{{-1.2, 0.1, -1.1}, 0.25, glm::dvec3(8)};
    const visibility::Visibility visibility(scene, frame);
    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    for (const glm::vec3& p : some_points()) {
        keys.push_back(points.size());
        points.push_back(glm::vec3(frame.from_world(p)));
    }
    for (const std::optional<int> bounces :
         {std::optional(0), std::optional(1), std::optional<int>()}) {
        reference::ReferenceSettings truth_settings;
        truth_settings.paths.bounces = bounces;
        truth_settings.sh_order = 4;
        truth_settings.rays = 4096;
        Progress silent;
        const reference::ProbeField truth =
            reference::trace_probes(scene, visibility, frame, points, keys, truth_settings, silent,
                                    {volume::neighbour_normals(), {}});
        reference::PeerSettings settings;
        settings.paths = truth_settings.paths;
        settings.sh_order = 4;
        settings.rays = 200;
        settings.irradiance = true;
        const Estimate peer = over_seeds(96, [&](uint64_t seed) {
            settings.seed = seed;
            return reference::trace_peer(scene, visibility, frame, points, settings);
        });
        size_t n = 0;
        int beyond = 0;
        double whole = 0, whole_truth = 0, squares = 0;
        const auto compare_with = [&](const std::vector<std::vector<glm::vec3>>& mean,
                                      const std::vector<std::vector<glm::vec3>>& error) {
            for (size_t k = 0; k < mean.size(); ++k)
                for (size_t i = 0; i < points.size(); ++i)
                    for (int c = 0; c < 3; ++c, ++n) {
                        const double off = peer.mean[n] - double(mean[k][i][c]);
                        const double sigma = std::hypot(peer.error[n], double(error[k][i][c]));
                        beyond += std::abs(off) > 3 * sigma + 1e-6;
                        if (k == 0) {
                            whole += peer.mean[n];
                            whole_truth += double(mean[k][i][c]);
                            squares += sigma * sigma;
                        }
                    }
        };
        compare_with(truth.sh, truth.error);
        compare_with(truth.irradiance, truth.irradiance_error);
        ASSERT_EQ(n, peer.mean.size());
        EXPECT_LE(beyond, 0.012 * double(n)) << n;
        EXPECT_NEAR(whole, whole_truth, 4 * std::sqrt(squares));
        EXPECT_LT(std::sqrt(squares), 0.005 * whole_truth);
        RecordProperty("beyond" + std::to_string(bounces.value_or(-1)),
                       std::to_string(beyond) + " of " + std::to_string(n));
    }
}

TEST(Peer, SkyOfAPictureAboveAFloor) {
    constexpr int width = 512, height = 256, row = 40;
    std::vector<glm::vec3> texels(size_t(width * height), glm::vec3(1.0f));
    texels[size_t(row * width + 100)] = glm::vec3(1e6f);
    Scene scene = scenes::floor_quad(1e4f, glm::vec3(0.25f));
    scene.sky = scene::make_sky(width, height, texels, 0.0);
    const double top = std::cos(pi * row / height), bottom = std::cos(pi * (row + 1) / height);
    const double sun = 1e6 * 2 * pi / width * (top - bottom);
    const double sun_lux = 1e6 * pi / width * (top * top - bottom * bottom);
    const visibility::Visibility visibility(scene, scene::Frame{});
    reference::PeerSettings settings;
    settings.rays = 256;
    std::vector<glm::vec3> points;
    for (int i = 0; i < 400; ++i)
        points.push_back({0.1f * float(i), 1.0f, 0.0f});
    const reference::PeerField field =
        reference::trace_peer(scene, visibility, scene::Frame{}, points, settings);
    double mean = 0;
    for (const glm::vec3& c : field.sh[0])
        mean += double(c.y) / double(points.size());
    const double expected = 0.5 / std::sqrt(pi) * (sun + 2 * pi + 0.5 * (sun_lux + pi));
    EXPECT_NEAR(mean / expected, 1.0, 0.05);
}

TEST(Peer, BlendedBoxInABlackRoom) {
    // As in the reference's test: L = a e + a r L + (1 - a).
    Scene scene = scenes::furnace(4.0f, 0.0f, 1.0f);
    const int glass = scenes::add_material(scene, glm::vec3(0.8f), glm::vec3(3.0f));
    scene.materials[size_t(glass)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(glass)].base_color.a = 0.25f;
    scenes::add_box(scene, glass, glm::vec3(1.0f), glm::vec3(3.0f), scenes::Facing::inward);
    const visibility::Visibility visibility(scene, scene::Frame{});
    reference::PeerSettings settings;
    settings.paths.bounces = {};
    settings.rays = 1000;
    std::vector<glm::vec3> points;
    for (int i = 0; i < 40; ++i)
        points.push_back(glm::vec3(1.3f + 0.03f * float(i), 1.9f, 2.2f));
    const reference::PeerField field =
        reference::trace_peer(scene, visibility, scene::Frame{}, points, settings);
    double mean = 0;
    for (const glm::vec3& c : field.sh[0])
        mean += double(c.x * volume::sh_y0) / double(points.size());
    EXPECT_NEAR(mean, (0.25 * 3 + 0.75) / (1 - 0.25 * 0.8), 0.01);
}

TEST(Peer, IrradianceOverAnEvenFloorIsHalfTheSphere) {
    // Above a glowing plane without end, whatever the number of rays.
    Scene scene = scenes::floor_quad(1e4f, glm::vec3(0.0f));
    scene.materials[0].emission = glm::vec3(1.0f, 2.0f, 0.0f);
    const visibility::Visibility visibility(scene, scene::Frame{});
    for (const uint32_t rays : {1000u, 2048u, 5000u}) {
        reference::PeerSettings settings;
        settings.rays = rays;
        settings.sh_order = 0;
        settings.irradiance = true;
        const std::vector<glm::vec3> points(5, glm::vec3(0.3f, 0.7f, 0.1f));
        const reference::PeerField field =
            reference::trace_peer(scene, visibility, scene::Frame{}, points, settings);
        for (size_t i = 0; i < points.size(); ++i)
            for (size_t n = 0; n < 26; ++n)
                EXPECT_NEAR(field.irradiance[n][i].y, pi * (1 - volume::neighbour_normals()[n].y),
                            25 / std::pow(rays, 0.75)) // as a lattice should
                    << rays << ' ' << n;
        EXPECT_EQ(field.sh.size(), 1u);
        EXPECT_NE(field.sh[0][0], field.sh[0][1]) << "points of one place turn their rays apart";
    }
}

TEST(Peer, SameBitsForAnyNumberOfThreads) {
    const Scene scene = lit_box();
    const visibility::Visibility visibility(scene, scene::Frame{});
    for (const uint32_t rays : {24u, 5000u}) {
        const auto with_threads = [&](size_t threads) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            reference::PeerSettings settings;
            settings.paths.bounces = {};
            settings.rays = rays;
            settings.irradiance = true;
            std::vector<glm::vec3> points = some_points();
            if (rays > 1000)
                points.resize(7);
            return reference::trace_peer(scene, visibility, scene::Frame{}, points, settings);
        };
        const reference::PeerField one = with_threads(1), four = with_threads(4);
        EXPECT_EQ(one.sh, four.sh);
        EXPECT_EQ(one.irradiance, four.irradiance);
        EXPECT_EQ(one.traced, four.traced);
    }
}

TEST(Peer, LooksUpIndirectLight) {
    // In the furnace every surface gets pi / (1 - albedo), so that one hit tells all.
    const Scene scene = scenes::furnace(2.0f, 0.8f, 1.0f);
    const visibility::Visibility visibility(scene, scene::Frame{});
    reference::PeerSettings settings;
    settings.rays = 64;
    settings.paths.bounces = {};
    settings.indirect = [](std::span<const visibility::Hit> hits, std::span<glm::vec3> irradiance) {
        for (size_t i = 0; i < hits.size(); ++i)
            irradiance[i] = glm::vec3(glm::pi<float>() / (1 - 0.8f))
                            * float(hits[i].facing == visibility::Facing::front);
    };
    const std::vector<glm::vec3> points{glm::vec3(0.7f)};
    const reference::PeerField field =
        reference::trace_peer(scene, visibility, scene::Frame{}, points, settings);
    EXPECT_NEAR(field.sh[0][0].x * volume::sh_y0, 5.0f, 1e-4f);
    EXPECT_EQ(field.traced, 64u);
}

TEST(Peer, ItsRaysCanBeTracedAlone) {
    const Scene scene = lit_box();
    const visibility::Visibility visibility(scene, scene::Frame{});
    reference::PeerSettings settings;
    settings.paths.bounces = {};
    settings.rays = 100;
    const reference::PeerField field =
        reference::trace_peer(scene, visibility, scene::Frame{}, some_points(), settings);
    const visibility::PackedRays rays =
        reference::peer_rays(scene, visibility, scene::Frame{}, some_points(), settings);
    EXPECT_EQ(rays.size(), field.traced);
    EXPECT_GT(rays.size(), 3 * 60 * 100u);
    const uint64_t met = rays.trace(visibility);
    EXPECT_GT(met, rays.size() / 4);
    EXPECT_LT(met, rays.size());
}

} // namespace
} // namespace lpvbake
