// A solver that the program has never heard of: one kind is all it takes to plan, choose, bake and
// sweep with it.
#include "bake/bake.h"

#include "gpu/device.h"
#include "lpvbake/error.h"
#include "report/suite.h"
#include "report/sweep.h"
#include "scenes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

namespace lpvbake {
namespace {

// ---------------------------------------------------------------- what its folder would hold

constexpr int toy_orders[] = {1, 2};

constexpr solver::Parameter toy_parameters[] = {
    {.name = "samples",
     .kind = solver::ValueKind::whole,
     .lo = 1,
     .hi = 64,
     .usual = 16,
     .unit = "samples",
     .help = "more are slower and better",
     .round = [](double value) { return value < 16 ? value : 16 * std::ceil(value / 16); }},
    {.name = "glow",
     .kind = solver::ValueKind::real,
     .hi = 100,
     .usual = 1,
     .help = "nits, everywhere"},
};

constexpr solver::Rung toy_ladder[] = {
    {solver::Quality::fast, 1 << 10, {{{"samples", 4}}}},
    {solver::Quality::balanced, 1 << 10, {{{"samples", 16}}}},
    {solver::Quality::accurate, 1 << 12, {{{"samples", 64}}}},
};

/// The same luminance in every cell.
class ToySolver final : public solver::Solver {
public:
    explicit ToySolver(const solver::SolverSettings& settings) : settings_(settings) {}
    void solve(const solver::Inputs& inputs, solver::Stages& stages, Volume& volume) override {
        stages.begin("glow", 1);
        volume.sh_order = settings_.order();
        const auto bands = std::size_t(volume.sh_order + 1);
        volume.sh.assign(bands * bands, std::vector(inputs.grid.size(), glm::vec3(0.0f)));
        std::ranges::fill(volume.sh[0], glm::vec3(float(settings_["glow"])));
        volume.validity.assign(inputs.grid.size(), 1.0f);
        volume.metadata["samples"] = std::to_string(int(settings_["samples"]));
        if (!inputs.lit)
            stages.warn("no lit surfaces");
        stages.progress().advance(1);
        stages.end("an even glow");
    }

private:
    solver::SolverSettings settings_;
};

constinit const solver::SolverKind toy_kind{
    .name = "toy",
    .help = "an even glow",
    .orders = toy_orders,
    .default_bounces = 3,
    .parameters = toy_parameters,
    .ladder = toy_ladder,
    .map_size = [](const Grid&, const solver::SolverSettings&) { return 0; },
    .expected_error = [](const solver::SolverSettings& settings,
                         const solver::Pilot&) { return 0.4 / settings["samples"]; },
    .device_bytes = [](const Grid& grid, const solver::SolverSettings&,
                       uint64_t) { return uint64_t(grid.size()); },
    .cost =
        [](const solver::Workload& work, const solver::SolverSettings& settings) {
            return solver::Cost{{{"glow", settings["samples"] * 1e-3, "an even glow"}},
                                {{"shadows", "a glow has none"}},
                                work.grid.size()};
        },
    .make = [](const gpu::Device&, const Grid&, const solver::SolverSettings& settings)
        -> std::unique_ptr<solver::Solver> { return std::make_unique<ToySolver>(settings); },
};

// ---------------------------------------------------------------- and its line in the list

constexpr std::array<const solver::SolverKind*, 1> toys{&toy_kind};

std::vector<const solver::SolverKind*> with_toy() {
    std::vector<const solver::SolverKind*> kinds(bake::solver_kinds().begin(),
                                                 bake::solver_kinds().end());
    kinds.push_back(&toy_kind);
    return kinds;
}

class ToySolverTest : public testing::DeviceTest {
protected:
    const Scene scene = scenes::cornell_box_with_point();
    const bake::SceneFacts facts = bake::survey(scene);

    static bake::BakeSettings coarse() {
        bake::BakeSettings settings(toy_kind);
        settings.grid.resolution = 8;
        return settings;
    }
    bake::Choice choose(const bake::Wish& wish) {
        return bake::choose_settings(facts, coarse(), wish, device().info());
    }
};

TEST_F(ToySolverTest, IsFoundByItsName) {
    EXPECT_EQ(bake::find_solver("toy", toys), &toy_kind);
    EXPECT_EQ(bake::find_solver("toy"), nullptr);
    EXPECT_EQ(bake::find_solver("sn", toys), nullptr);
}

TEST_F(ToySolverTest, ItsSettingsAreWhatCanBeSolved) {
    solver::SolverSettings settings(toy_kind);
    EXPECT_EQ(settings["samples"], 16);
    EXPECT_EQ(settings["glow"], 1);
    EXPECT_EQ(settings.order(), 2);
    settings.set_order(4);
    EXPECT_EQ(settings.order(), 2);
    settings.set_order(0);
    EXPECT_EQ(settings.order(), 1);
    settings.set("samples", 17);
    EXPECT_EQ(settings["samples"], 32);
    settings.set(solver::Quality::accurate);
    EXPECT_EQ(settings["samples"], 64);
    EXPECT_EQ(settings.lighting_rays(), 1u << 12);
    EXPECT_THROW(settings.set("samples", 65), Error);
    EXPECT_THROW(settings.set("samples", 2.5), Error);
    EXPECT_THROW(settings.set("directions", 48), Error);
    EXPECT_THROW(settings["directions"], Error);
}

TEST_F(ToySolverTest, IsPlannedAndBaked) {
    bake::BakeSettings settings = coarse();
    EXPECT_EQ(settings.bounces, 3);
    settings.solver.set("glow", 7);
    const bake::BakePlan plan = bake::plan_bake(facts, settings, device().info());
    EXPECT_TRUE(plan.lit);
    EXPECT_EQ(plan.device_bytes, plan.grid.size());
    EXPECT_EQ(plan.stages.end()[-2].name, "glow");
    EXPECT_EQ(plan.skipped.end()[-2].name, "shadows"); // and then the fit
    Progress silent;
    const Baked baked = bake::bake(scene, plan, device(), silent);
    EXPECT_EQ(baked.volume.sh[0].front(), glm::vec3(7.0f));
    EXPECT_EQ(baked.volume.metadata.at("solver"), "toy");
    EXPECT_EQ(baked.volume.metadata.at("samples"), "16");
    EXPECT_EQ(baked.volume.metadata.at("bounces"), "3");
    EXPECT_EQ(baked.stages.end()[-2].detail, "an even glow");
    EXPECT_TRUE(baked.warnings.empty());
}

TEST_F(ToySolverTest, IsChosenByItsModels) {
    bake::Wish wish;
    wish.solvers = with_toy();
    wish.seconds = 1.0;
    wish.error = 0.029;
    wish.pilot = solver::Pilot{{0.2, 0.02}, {0.02, 0.01}};
    wish.given = {{"glow", 3}, {"vpls", 99}}; // the latter is none of it
    // The others need longer on this grid, or err by more.
    const bake::Choice choice = choose(wish);
    EXPECT_EQ(&choice.solver().kind(), &toy_kind);
    EXPECT_EQ(choice.text, "toy, order 2, 64 samples");
    EXPECT_EQ(choice.solver()["glow"], 3);
    EXPECT_TRUE(choice.warnings.empty());
    EXPECT_EQ(choice.plan.settings.bounces, 3);
    EXPECT_EQ(choice.error, bake::expected_error(choice.plan.settings, wish.pilot));
    EXPECT_NEAR(choice.error / std::hypot(0.02, 0.4 / 64), 1.35, 1e-12);

    wish.solvers = {&toy_kind};
    wish.error.reset();
    wish.seconds = bake::plan_bake(facts, coarse(), device().info()).seconds;
    EXPECT_EQ(choose(wish).text, "toy, order 2, 16 samples");
    wish.seconds.reset();
    EXPECT_EQ(choose(wish).text, "toy, order 2, 16 samples");
}

TEST_F(ToySolverTest, IsSweptOver) {
    const std::vector<const solver::SolverKind*> kinds = with_toy();
    const std::vector<std::string> options = report::sweep_options(kinds);
    EXPECT_TRUE(std::ranges::count(options, "glow"));
    EXPECT_FALSE(std::ranges::count(report::sweep_options(), "glow"));
    EXPECT_NO_THROW(report::check_sweep_value("glow", "2.5", kinds));
    EXPECT_THROW(report::check_sweep_value("glow", "2.5"), Error);
    EXPECT_THROW(report::check_sweep_value("glow", "200", kinds), Error);
    const std::vector<report::SweepRow> rows = report::sweep_rows(
        {{{"glow", {"2"}}, {"samples", {"4", "33"}}}, {{"solver", {"sn", "toy"}}, {"glow", {"9"}}}},
        {}, kinds);
    ASSERT_EQ(rows.size(), 4u);
    for (const std::size_t row : {0, 1, 3})
        EXPECT_EQ(&rows[row].settings.solver.kind(), &toy_kind) << row;
    EXPECT_EQ(rows[1].settings.solver["samples"], 48);
    EXPECT_EQ(rows[1].settings.bounces, 3);
    EXPECT_EQ(rows[2].settings.solver.kind().name, std::string("sn"));
    EXPECT_EQ(rows[3].settings.solver["glow"], 9);
}

TEST_F(ToySolverTest, IsOneOfASuitesSolvers) {
    const std::vector<report::SuiteSolver> solvers = report::suite_solvers(device(), toys);
    ASSERT_EQ(solvers.size(), 1u);
    EXPECT_EQ(solvers[0].name, "toy");
    report::SuiteOptions options;
    options.resolution = 8;
    Progress silent;
    EXPECT_EQ(solvers[0].bake(scene, options, silent).metadata.at("solver"), "toy");
}

} // namespace
} // namespace lpvbake
