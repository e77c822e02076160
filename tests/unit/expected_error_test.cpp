// Errors as they are stated, beside those that were measured (tests/bench/expected_error.py).

#include "bake/choose.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <vector>

namespace lpvbake::bake {
namespace {

using Json = nlohmann::json;

Json kept() {
    std::ifstream file(LPVBAKE_EXPECTED_ERROR);
    return Json::parse(file);
}

solver::Pilot pilot_of(const Json& scene) {
    solver::Pilot pilot;
    scene["pilot"]["bands"].get_to(pilot.bands);
    scene["pilot"]["clusters"].get_to(pilot.clusters);
    return pilot;
}

BakeSettings settings_of(const Json& row) {
    BakeSettings settings(*find_solver(row["solver"].get<std::string>()));
    settings.bounces = std::nullopt;
    for (const auto& [name, value] : row.items())
        if (name == "sh-order")
            settings.solver.set_order(value);
        else if (name != "solver")
            settings.solver.set(name, value);
    return settings;
}

/// Without what the reference's noise adds, which is normal: mean of |x| over its deviation.
double measured(double error, double noise) {
    const double l1 = std::sqrt(2.0 / std::acos(-1.0)) * noise;
    return std::sqrt(std::max(error * error - l1 * l1, 0.0));
}

TEST(ExpectedError, IsNoLessThanWhatIsMeasuredInNineOfTenBakes) {
    const Json document = kept();
    std::vector<double> ratios;
    for (const Json& scene : document["scenes"]) {
        const solver::Pilot pilot = pilot_of(scene);
        if (!is_foretold(pilot))
            continue;
        for (std::size_t i = 0; i < document["rows"].size(); ++i)
            if (!scene["errors"][i].is_null())
                ratios.push_back(expected_error(settings_of(document["rows"][i]), pilot)
                                 / measured(scene["errors"][i], scene["noise"]));
    }
    ASSERT_GT(ratios.size(), 250u);
    const auto held = std::ranges::count_if(ratios, [](double ratio) { return ratio >= 1.0; });
    EXPECT_GE(double(held), 0.9 * double(ratios.size()));
    std::ranges::nth_element(ratios, ratios.begin() + std::ptrdiff_t(ratios.size() / 2));
    EXPECT_LE(ratios[ratios.size() / 2], 1.5);
}

TEST(ExpectedError, IsNotForetoldForScenesBeyondThePilot) {
    for (const Json& scene : kept()["scenes"])
        EXPECT_EQ(is_foretold(pilot_of(scene)), scene["scene"] != "lights.glb") << scene["scene"];
}

TEST(ExpectedError, FallsWithClustersDirectionsAndBands) {
    const Json document = kept();
    for (const Json& scene : document["scenes"]) {
        const solver::Pilot pilot = pilot_of(scene);
        double before = 1e30;
        for (const int clusters : {16, 48, 100, 192, 768}) {
            EXPECT_LE(solver::lost_clusters(pilot, clusters), before);
            before = solver::lost_clusters(pilot, clusters);
        }
        EXPECT_DOUBLE_EQ(solver::lost_clusters(pilot, solver::more_clusters), pilot.clusters[1]);
        EXPECT_GT(solver::lost_bands(pilot, 0), solver::lost_bands(pilot, 1));
        EXPECT_GT(solver::lost_bands(pilot, 1), solver::lost_bands(pilot, 2));
        EXPECT_EQ(solver::lost_bands(pilot, 2), solver::lost_bands(pilot, 3));
        EXPECT_GT(solver::lost_bands(pilot, 3), solver::lost_bands(pilot, 4));
    }
}

TEST(ExpectedError, CountsNoBandsThatFilesDoNotKeep) {
    const solver::Pilot pilot{{0.2, 0.04}, {0.02, 0.01}};
    BakeSettings settings(*find_solver("gather"));
    settings.solver.set_order(4);
    BakeSettings lower = settings;
    lower.solver.set_order(2);
    EXPECT_LT(expected_error(settings, pilot), expected_error(lower, pilot));
    EXPECT_EQ(expected_error(settings, pilot, 2), expected_error(lower, pilot));
}

} // namespace
} // namespace lpvbake::bake
