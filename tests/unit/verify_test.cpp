// Whether what a volume is said to err by holds what it errs by.
#include "report/verify.h"

#include "reference/reference.h"
#include "scenes.h"
#include "volume/sh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace lpvbake {
namespace {

/// In a closed room of one luminance L the field is L everywhere: a volume that has it times
/// 1 + `wrong` in every other cell and 1 - `wrong` in the rest.
Volume furnace_field(double luminance, double wrong) {
    Volume volume;
    volume.grid = {glm::dvec3(0.0), 0.25, glm::ivec3(8)};
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    volume.validity.assign(volume.grid.size(), 1.0f);
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        const glm::ivec3 at = volume.grid.cell_at(i);
        const double sign = (at.x + at.y + at.z) % 2 == 0 ? 1.0 : -1.0;
        volume.sh[0][i] =
            glm::vec3(float(luminance * std::sqrt(4.0 * std::numbers::pi) * (1.0 + sign * wrong)));
    }
    return volume;
}

report::Verified verify(double wrong, double noise, uint64_t seed, uint64_t points = 128) {
    const Scene scene = scenes::furnace(2.0f, 0.5f, 100.0f);
    report::VerifySettings settings;
    settings.points = points;
    settings.noise = noise;
    settings.most_paths = 1 << 12;
    settings.seed = seed;
    reference::PathRules rules;
    rules.bounces.reset();
    Progress silent;
    return report::verify(scene, furnace_field(200.0, wrong), rules,
                          *readers::reader_named("lpvbake"), settings, silent);
}

TEST(Verify, FindsTheErrorOfCells) {
    for (const double wrong : {0.02, 0.1})
        for (const double noise : {0.01, 0.04}) {
            const report::MeasuredError cells = verify(wrong, noise, 3).cells;
            EXPECT_EQ(cells.points, 64u);
            EXPECT_LE(cells.low, wrong) << wrong << " " << noise;
            EXPECT_GE(cells.high, wrong) << wrong << " " << noise;
            EXPECT_NEAR(cells.error, wrong, 0.1 * wrong + 0.25 * noise) << wrong << " " << noise;
        }
}

TEST(Verify, ReadsSurfacesAsTheyAreShown) {
    // Cells that are too bright and too dark are blended there.
    const report::MeasuredError surfaces = verify(0.5, 0.01, 5).surfaces;
    EXPECT_EQ(surfaces.points, 64u);
    EXPECT_LT(surfaces.high, 0.5);
    EXPECT_GT(surfaces.low, 0.02);
    EXPECT_LT(verify(0.0, 0.01, 5).surfaces.low, 0.005);
}

TEST(Verify, SaysWhere) {
    Scene scene = scenes::furnace(2.0f, 0.5f, 100.0f);
    Volume volume = furnace_field(200.0, 0.0);
    const std::size_t worst = volume.grid.index({5, 2, 6});
    volume.sh[0][worst] *= 4.0f;
    report::VerifySettings settings;
    settings.points = 1024;
    settings.most_paths = 256;
    reference::PathRules rules;
    rules.bounces.reset();
    Progress silent;
    const report::Verified verified =
        report::verify(scene, volume, rules, *readers::reader_named("lpvbake"), settings, silent);
    ASSERT_FALSE(verified.worst.empty());
    const glm::dvec3 there = volume.grid.center({5, 2, 6});
    EXPECT_LT(glm::distance(verified.worst[0].position, there), 0.5);
    EXPECT_GT(verified.worst[0].shown, 1.5 * verified.worst[0].true_);
}

TEST(Verify, IsTheSameAgain) {
    const report::Verified a = verify(0.05, 0.03, 9), b = verify(0.05, 0.03, 9);
    EXPECT_EQ(a.cells.error, b.cells.error);
    EXPECT_EQ(a.cells.low, b.cells.low);
    EXPECT_EQ(a.surfaces.high, b.surfaces.high);
    EXPECT_NE(a.cells.error, verify(0.05, 0.03, 10).cells.error);
}

TEST(Verify, IntervalsHoldTheTruth) {
    // A few bright places have most of the error, drawn in proportion to their light or not; the
    // truth is known up to a noise. 95 of 100 are promised; an interval of errors as uneven as
    // these holds somewhat less.
    std::mt19937 random(4);
    std::lognormal_distribution<double> light(0.0, 1.5);
    std::normal_distribution<double> normal;
    int holds = 0;
    constexpr int rounds = 200;
    for (int round = 0; round < rounds; ++round) {
        std::vector<report::VerifiedPoint> points;
        for (int i = 0; i < 128; ++i) {
            report::VerifiedPoint point;
            point.true_ = light(random);
            point.stands_for = 1.0 / (0.5 + 0.5 * point.true_ / 3.08); // as if drawn by it
            point.noise = 0.03 * point.true_;
            const double wrong = 0.05 * point.true_ * normal(random);
            double off[4], all = 0; // of groups of paths
            for (double& each : off)
                all += each = wrong + 2 * point.noise * normal(random);
            point.wrong = std::abs(all / 4);
            for (const double each : off)
                point.agreed += each * std::copysign(0.25, all - each);
            points.push_back(point);
        }
        const report::MeasuredError error = report::measured_error(points, 7);
        const double truth = 0.05 * std::sqrt(2.0 / std::numbers::pi);
        holds += error.low <= truth && truth <= error.high;
    }
    EXPECT_GE(holds, 180);
}

TEST(Verify, IntervalsHoldWhatLongPathsFind) {
    const Scene scene = scenes::cornell_box_with_point();
    Progress silent;
    reference::ReferenceSettings exact;
    exact.rays = 2048;
    exact.seed = 77;
    const Volume volume =
        reference::make_reference(scene, {glm::dvec3(-1.1, -0.1, -1.1), 0.275, glm::ivec3(8)},
                                  exact, silent)
            .volume;
    const auto cells = [&](const report::VerifySettings& settings) {
        return report::verify(scene, volume, exact.paths, *readers::reader_named("lpvbake"),
                              settings, silent)
            .cells;
    };
    report::VerifySettings all;
    all.points = 2 * volume.grid.size();
    all.noise = 0.05;
    all.seed = 99;
    const double truth = cells(all).error;
    EXPECT_GT(truth, 0.05);
    int holds = 0;
    for (uint64_t seed = 1; seed <= 20; ++seed) {
        report::VerifySettings few;
        few.points = 128;
        few.seed = seed;
        const report::MeasuredError error = cells(few);
        holds += error.low <= truth && truth <= error.high;
    }
    EXPECT_GE(holds, 17);
}

TEST(Verify, WhereNoLightArrivesNothingIsKnown) {
    EXPECT_EQ(report::measured_error({}, 1).points, 0u);
    const std::vector<report::VerifiedPoint> dark(5);
    EXPECT_EQ(report::measured_error(dark, 1).points, 0u);
}

} // namespace
} // namespace lpvbake
