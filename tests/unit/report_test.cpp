// The yardstick itself: sweeps, samples of points, errors, ratios, and what is written of them.

#include "report/report.h"
#include "report/search.h"

#include "base64.h"
#include "lpvbake/error.h"
#include "report/baseline.h"
#include "report/page.h"
#include "report/plot.h"
#include "report/tables.h"
#include "scenes.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include "unit/volumes.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

namespace lpvbake {
namespace {

using std::numbers::pi;

// ---------------------------------------------------------------- sweeps

TEST(Sweep, RowsAreAllCombinationsOnce) {
    bake::BakeSettings base;
    base.grid.margin = 3;
    const std::vector<report::SweepRow> rows =
        report::sweep_rows({{{"resolution", {"16", "32"}}, {"occlusion", {"none", "sh", "face"}}},
                            {{"resolution", {"32"}}, {"occlusion", {"face"}}},
                            {{"iterations", {"7"}}, {"rsm-size", {"64"}}, {"tolerance", {"0.5"}}}},
                           base);
    ASSERT_EQ(rows.size(), 7u); // the second sweep has nothing new
    EXPECT_EQ(rows[1].settings.grid.resolution, 16);
    EXPECT_EQ(rows[1].settings.solver["occlusion"], 1);
    EXPECT_EQ(rows[3].settings.grid.resolution, 32);
    EXPECT_EQ(rows[3].settings.solver["occlusion"], 0);
    EXPECT_EQ(rows[3].options[0], (std::pair<std::string, std::string>("resolution", "32")));
    EXPECT_EQ(rows[6].settings.solver["iterations"], 7);
    EXPECT_EQ(rows[6].settings.solver["rsm-size"], 64);
    EXPECT_EQ(rows[6].settings.solver["tolerance"], 0.5);
    for (const report::SweepRow& row : rows)
        EXPECT_EQ(row.settings.grid.margin, 3);
    const std::vector<report::SweepRow> usual = report::sweep_rows(report::default_sweeps(), {});
    EXPECT_GE(usual.size(), 12u);
    EXPECT_EQ(report::row_name(usual[0]), "what bake takes");
    const bake::BakeSettings bakes;
    EXPECT_EQ(usual[0].settings.solver.kind().name, bakes.solver.kind().name);
    EXPECT_EQ(usual[0].settings.solver.order(), bakes.solver.order());
    EXPECT_EQ(usual[0].settings.bounces, bakes.bounces);
    EXPECT_EQ(usual[0].settings.grid.resolution, bakes.grid.resolution);
}

TEST(Sweep, UsualRowsHoldTheLightOfABake) {
    const std::vector<report::SweepRow> usual = report::sweep_rows(report::default_sweeps(), {});
    const bake::BakeSettings bakes;
    int as_bakes = 0;
    for (const report::SweepRow& row : usual) {
        EXPECT_EQ(row.settings.bounces, bakes.bounces) << report::row_name(row);
        const auto& solver = row.settings.solver;
        as_bakes += &solver.kind() == &bakes.solver.kind() && row.settings.grid.resolution == 32
                    && solver["directions"] == bakes.solver["directions"];
    }
    EXPECT_EQ(as_bakes, 1); // the first
}

TEST(Search, CandidatesAreWhatBakeChoosesFrom) {
    const auto rows_of = [](const report::Sweep& given, double error) {
        return report::candidate_rows(given, {error, {}}, {});
    };
    const std::vector<report::SweepRow> rows = rows_of({{"resolution", {"20"}}}, 0.05);
    std::size_t wanted = 0;
    for (const solver::SolverKind* kind : bake::solver_kinds())
        for (const solver::Rung& rung : kind->ladder)
            for (const int order : kind->orders.back() == 1 ? std::vector{1} : std::vector{2, 4}) {
                ++wanted;
                solver::SolverSettings settings(*kind);
                settings.set(rung);
                settings.set_order(order);
                EXPECT_EQ(std::ranges::count_if(
                              rows,
                              [&](const report::SweepRow& row) {
                                  const solver::SolverSettings& own = row.settings.solver;
                                  bool same = &own.kind() == kind && own.order() == order
                                              && own.lighting_rays() >= settings.lighting_rays();
                                  for (const solver::Parameter& each : kind->parameters)
                                      same = same && own[each.name] == settings[each.name];
                                  return same && row.settings.grid.resolution == 20
                                         && !row.settings.bounces;
                              }),
                          1)
                    << kind->name << " " << order;
            }
    EXPECT_EQ(rows.size(), wanted);
    for (const report::SweepRow& row :
         rows_of({{"directions", {"96"}}, {"bounces", {"1"}}}, 0.05)) {
        EXPECT_STREQ(row.settings.solver.kind().name, "sn");
        EXPECT_EQ(row.settings.solver["directions"], 96);
        EXPECT_EQ(row.settings.bounces, 1);
    }
    for (const report::SweepRow& row : report::candidate_rows({}, {{}, 2.0}, {}))
        EXPECT_LE(row.settings.solver.order(), 2); // nothing asks for more
    EXPECT_EQ(report::candidate_rows({{"solver", {"lpv"}}}, {{}, 2.0}, {})[0].settings.bounces, 1);
    EXPECT_THROW(rows_of({{"resolution", {"16", "32"}}}, 0.05), Error);
    EXPECT_THROW(rows_of({{"solver", {"none"}}}, 0.05), Error);
}

TEST(Sweep, RefusesWhatBakeWouldRefuse) {
    const auto text = [](const std::string& option, const std::string& value) {
        try {
            report::check_sweep_value(option, value);
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, ErrorKind::argument);
            return std::string(error.what());
        }
        return std::string();
    };
    EXPECT_EQ(text("resolution", "3"), "");
    for (const char* bad : {"2", "65537", "", "1e3", "x", "16 ", "-1", "99999999999999999999"})
        EXPECT_NE(text("resolution", bad).find("resolution: '" + std::string(bad) + "'"),
                  std::string::npos)
            << bad;
    EXPECT_NE(text("tolerance", "nan"), "");
    EXPECT_NE(text("tolerance", "2"), "");
    EXPECT_NE(text("occlusion", "full").find("none, sh, face"), std::string::npos);
    EXPECT_NE(text("solver", "magic"), "");
    EXPECT_NE(text("colour", "1").find("'colour'"), std::string::npos);
    EXPECT_THROW(report::sweep_rows({{{"resolution", {}}}}, {}), Error);
    EXPECT_THROW(report::sweep_rows({{{"resolution", {"4"}}, {"resolution", {"5"}}}}, {}), Error);
    report::SweepAxis many{"iterations", {}};
    for (int i = 0; i < 40; ++i)
        many.values.push_back(std::to_string(i));
    report::SweepAxis more = many;
    more.option = "rsm-size";
    EXPECT_THROW(report::sweep_rows({{many, more}}, {}), Error); // 1600 rows
    EXPECT_EQ(report::sweep_rows({{many}}, {}).size(), 40u);
}

// ---------------------------------------------------------------- speed against error

TEST(Pareto, FrontIsWhatNothingBeats) {
    const std::vector<report::SpeedError> points = {{1, 5}, {2, 3}, {3, 3}, {4, 1},
                                                    {4, 2}, {1, 5}, {9, 9}};
    EXPECT_EQ(report::pareto_front(points),
              (std::vector<bool>{true, true, false, true, false, true, false}));
    EXPECT_TRUE(report::pareto_front({}).empty());
}

TEST(Pareto, RatioAtEqualErrorOfAPowerLaw) {
    std::vector<report::SpeedError> curve; // error = 1 / sqrt(seconds)
    for (const double t : {1.0, 4.0, 16.0, 64.0})
        curve.push_back({t, 1 / std::sqrt(t)});
    const auto crossing = report::at_equal_error({0.5, 0.3}, curve);
    ASSERT_TRUE(crossing);
    EXPECT_EQ(crossing->kind, report::EqualError::Kind::crosses);
    EXPECT_NEAR(crossing->factor, 1 / (0.3 * 0.3) / 0.5, 1e-9);
    const auto already = report::at_equal_error({10, 2}, curve);
    EXPECT_EQ(already->kind, report::EqualError::Kind::already);
    EXPECT_NEAR(already->factor, 0.1, 1e-12);
    const auto beyond = report::at_equal_error({2, 0.01}, curve);
    EXPECT_EQ(beyond->kind, report::EqualError::Kind::beyond);
    EXPECT_NEAR(beyond->factor, 32, 1e-9);
    // A point that is no better than one before it does not bend the curve.
    curve.insert(curve.begin() + 2, {8, 0.7});
    EXPECT_NEAR(report::at_equal_error({0.5, 0.3}, curve)->factor, 1 / (0.3 * 0.3) / 0.5, 1e-9);
    EXPECT_FALSE(report::at_equal_error({1, 1}, {}));
    EXPECT_FALSE(report::at_equal_error({1, 0}, curve));
}

TEST(Report, TimingIsMedianAndRange) {
    EXPECT_EQ(report::timing_of({3, 1, 2}).median, 2);
    EXPECT_EQ(report::timing_of({4, 1, 2, 10}).median, 3);
    EXPECT_EQ(report::timing_of({4, 1, 2, 10}).min, 1);
    EXPECT_EQ(report::timing_of({4, 1, 2, 10}).max, 10);
}

// ---------------------------------------------------------------- errors

TEST(Measure, ErrorsOfKnownDistances) {
    const std::vector<glm::dvec3> truth = {{1, 2, 3}, {2, 2, 2}};
    const std::vector<glm::dvec3> twice = {{2, 4, 6}, {4, 4, 4}};
    EXPECT_NEAR(report::error_of(twice, truth).relative_l1, 1, 1e-12);
    EXPECT_NEAR(report::error_of(twice, truth).energy_ratio, 2, 1e-12);
    EXPECT_NEAR(report::error_of(twice, truth).relative_rms, std::sqrt((1 + 4 + 9 + 12) / 6.0) / 2,
                1e-12);
    EXPECT_EQ(report::error_of(truth, truth).relative_l1, 0);
    const std::vector<glm::dvec3> dark(2, glm::dvec3(0));
    EXPECT_EQ(report::error_of(dark, dark).relative_l1, 0);
    EXPECT_EQ(report::error_of(dark, dark).energy_ratio, 1);
    EXPECT_TRUE(std::isinf(report::error_of(truth, dark).relative_l1));
}

TEST(Measure, AgreesWithDiff) {
    const Volume a = random_volume({5, 4, 3}, 1, false, 1);
    Volume b = random_volume({5, 4, 3}, 2, false, 2);
    b.validity = a.validity;
    const volume::Comparison wanted = volume::compare(a, b, {});
    const auto valid = [&](const Volume& volume) {
        std::vector<std::vector<glm::vec3>> sh(volume.sh.size());
        for (std::size_t k = 0; k < sh.size(); ++k)
            for (std::size_t i = 0; i < a.validity.size(); ++i)
                if (a.validity[i] > 0)
                    sh[k].push_back(volume.sh[k][i]);
        return sh;
    };
    uint64_t negative = 0;
    const report::FieldError error = report::error_of(report::irradiance_of(valid(a), 1, &negative),
                                                      report::irradiance_of(valid(b), 2));
    EXPECT_NEAR(error.relative_l1 / wanted.relative_l1, 1, 1e-6);
    EXPECT_NEAR(error.relative_rms / wanted.relative_rms, 1, 1e-6);
    EXPECT_EQ(negative, wanted.negative_a);
}

// ---------------------------------------------------------------- points

TEST(Points, CellsAreValidDistinctAndSpread) {
    std::vector<float> validity(1000);
    for (std::size_t i = 0; i < validity.size(); ++i)
        validity[i] = i % 2 == 0;
    const auto cells = report::draw_cells(validity, 100, 1);
    EXPECT_EQ(cells.size(), 100u);
    EXPECT_TRUE(std::ranges::is_sorted(cells));
    EXPECT_EQ(std::set(cells.begin(), cells.end()).size(), 100u);
    for (const std::size_t cell : cells)
        EXPECT_EQ(cell % 2, 0u);
    const auto low = std::ranges::count_if(cells, [](std::size_t c) { return c < 500; });
    EXPECT_NEAR(double(low), 50, 4 * std::sqrt(100 * 0.25 * 0.8)); // without replacement
    EXPECT_EQ(report::draw_cells(validity, 100, 1), cells);
    EXPECT_NE(report::draw_cells(validity, 100, 2), cells);
    EXPECT_EQ(report::draw_cells(validity, 5000, 1).size(), 500u);
    EXPECT_TRUE(report::draw_cells(std::vector<float>(9, 0.0f), 5, 1).empty());
}

class Drawn {
public:
    Drawn(const Scene& scene, const Bounds& box, uint64_t count)
        : frame{glm::dvec3(-1), 0.25, glm::dvec3(16)},
          visibility(scene, frame),
          points(report::draw_surface_points(scene, visibility, frame, box, count, 7)) {}
    scene::Frame frame;
    visibility::Visibility visibility;
    std::vector<report::FrontPoint> points;
};

TEST(Points, SurfacesInsideARoomCountByTheirArea) {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f));
    scenes::add_box(scene, grey, {0, 0, 0}, {2, 1, 1}, scenes::Facing::inward);
    // A block on the floor: the floor below it faces into geometry.
    scenes::add_box(scene, grey, {0.25f, 0, 0.25f}, {0.75f, 0.5f, 0.75f}, scenes::Facing::outward);
    const Drawn drawn(scene, bounds_of(scene), 4000);
    ASSERT_EQ(drawn.points.size(), 4000u);
    double floor = 0, block = 0;
    for (const report::FrontPoint& p : drawn.points) {
        EXPECT_NEAR(glm::length(p.normal), 1, 1e-12);
        const bool below = p.position.x > 0.251 && p.position.x < 0.749 && p.position.z > 0.251
                           && p.position.z < 0.749 && p.position.y < 1e-6 && p.normal.y > 0;
        EXPECT_FALSE(below);
        floor += p.position.y < 1e-6 && p.normal.y > 0.5;
        block += p.position.x > 0.2 && p.position.x < 0.8 && p.position.z > 0.2
                 && p.position.z < 0.8 && p.position.y > 1e-6 && p.position.y < 0.6;
    }
    const double area = 10 - 0.25 + 4 * 0.25 + 2 * 0.25; // room, less what is covered; block
    const auto expect_share = [&](double count, double share) {
        EXPECT_NEAR(count, 4000 * share, 4 * std::sqrt(4000 * share * (1 - share)));
    };
    expect_share(floor, 1.75 / area);
    expect_share(block, 1.25 / area);
}

TEST(Points, OnlyThePartInsideTheBoxCounts) {
    Scene scene = scenes::floor_quad(1000.0f, glm::vec3(0.5f));
    const Bounds box{{-1, -1, -0.5}, {0.5, 1, 0.5}};
    const Drawn drawn(scene, box, 500);
    ASSERT_EQ(drawn.points.size(), 500u);
    glm::dvec3 mean(0);
    for (const report::FrontPoint& p : drawn.points) {
        EXPECT_TRUE(glm::all(glm::greaterThanEqual(p.position, box.lo - 1e-9)));
        EXPECT_TRUE(glm::all(glm::lessThanEqual(p.position, box.hi + 1e-9)));
        EXPECT_GT(p.normal.y, 0.99);
        mean += p.position / 500.0;
    }
    EXPECT_NEAR(mean.x, -0.25, 4 * 1.5 / std::sqrt(12.0 * 500));
    EXPECT_NEAR(mean.z, 0, 4 * 1.0 / std::sqrt(12.0 * 500));
    EXPECT_TRUE(Drawn(scene, {{0, 1, 0}, {1, 2, 1}}, 10).points.empty());
}

// ---------------------------------------------------------------- truth

TEST(Truth, AFurnaceIsTheSameFromAllSidesAndOnItsWalls) {
    const Scene scene = scenes::furnace(1.0f, 0.5f, 10.0f); // 20 nits everywhere
    const scene::Frame frame{glm::dvec3(0), 0.125, glm::dvec3(8)};
    const visibility::Visibility visibility(scene, frame);
    const reference::PathRules rules = {std::nullopt, true};
    const report::TruthSettings settings{0.01, 1 << 14, 3};
    Progress silent;
    const std::vector<glm::vec3> points = {{4, 4, 4}, {1.5f, 6, 2}};
    const report::Truth truth =
        report::trace_truth(scene, visibility, frame, points, {}, rules, settings, silent);
    ASSERT_EQ(truth.irradiance.size(), 2u * 26);
    for (const glm::dvec3& e : truth.irradiance)
        EXPECT_NEAR(e.y / (20 * pi), 1, 0.05);
    EXPECT_LE(truth.noise, 0.01);
    EXPECT_TRUE(truth.converged);
    EXPECT_LT(report::error_of(report::irradiance_of(truth.sh, 1), truth.irradiance).relative_l1,
              0.02);

    const std::vector<glm::vec3> on_wall = {{0.001f, 4, 4}};
    const std::vector<glm::dvec3> normal = {{1, 0, 0}};
    const report::Truth wall =
        report::trace_truth(scene, visibility, frame, on_wall, normal, rules, settings, silent);
    ASSERT_EQ(wall.irradiance.size(), 1u);
    EXPECT_NEAR(wall.irradiance[0].x / (20 * pi), 1, 0.05);
}

TEST(Truth, RulesAreThoseOfTheBake) {
    bake::BakeSettings settings;
    EXPECT_EQ(report::field_rules(settings), (reference::PathRules{std::nullopt, true}));
    settings.bounces = 1;
    settings.emitters = false;
    EXPECT_EQ(report::field_rules(settings), (reference::PathRules{1, false}));
}

// ---------------------------------------------------------------- what is written

/// A report of made-up numbers of a scene with this name.
report::Report made_up(const std::string& path) {
    report::Report report;
    report.device = "a <device> & \"more\"";
    report.threads = 2;
    report::SceneReport scene;
    scene.path = path;
    scene.grids.resize(2);
    for (std::size_t g = 0; g < 2; ++g) {
        report::GridResult& grid = scene.grids[g];
        grid.grid.dims = glm::ivec3(16 << g);
        grid.probes = 10;
        grid.floor[0].relative_l1 = 0.2;
        grid.floor[1].relative_l1 = 0.04;
        for (const double t : {0.1, 0.4, 1.6}) {
            report::PeerPoint point;
            point.rays = uint64_t(100 * t);
            point.seconds = {t, t, t};
            point.projected[0].relative_l1 = 0.1 / std::sqrt(t);
            point.error[0].relative_l1 = 0.2 + 0.1 / std::sqrt(t);
            grid.peer.push_back(point);
        }
    }
    for (const char* occlusion : {"none", "face"}) {
        report::RowResult row;
        row.row.settings = bake::BakeSettings(*bake::find_solver("lpv"));
        row.shown = {{"unity", {.relative_l1 = 0.55}}, {"vrc", {.relative_l1 = 0.66}}};
        row.row.options = {{"resolution", "16"}, {"occlusion", occlusion}};
        row.command = "lpvbake bake '" + path + "' --resolution 16 --occlusion " + occlusion;
        row.seconds = {0.5, 0.4, 0.7};
        row.error.relative_l1 = 0.7;
        row.projected.relative_l1 = 0.6;
        row.front = true;
        row.stages = {{"inject", {0.1, 0.1, 0.1}, "detail"}};
        row.peer = report::EqualError{report::EqualError::Kind::already, 0.25};
        scene.rows.push_back(row);
    }
    scene.rows[1].error.relative_l1 = std::numeric_limits<double>::infinity();
    scene.views = report::Views{.row = 1,
                                .camera = path,
                                .paths = 64,
                                .exposure = 3,
                                .traced = {'p', 'a', 't', 'h'},
                                .shown = {{"unity", {.relative_l1 = 0.123}, 0.456, {'u'}}}};
    report.scenes.push_back(scene);
    return report;
}

const char hostile[] = "x';system \"touch pwned\" #`touch pwned`\\\n$(touch pwned)<script>&.gltf";

TEST(Written, NoTextOfASceneBecomesMarkup) {
    const std::string page = report::report_page(made_up(hostile), "<svg/>");
    EXPECT_EQ(page.find("<script"), std::string::npos);
    EXPECT_EQ(page.find("<device>"), std::string::npos);
    EXPECT_NE(page.find("x&#39;;system &quot;touch pwned&quot;"), std::string::npos);
    EXPECT_NE(page.find("&lt;script&gt;&amp;.gltf"), std::string::npos);
    EXPECT_EQ(page.find("http"), std::string::npos); // loads nothing
    EXPECT_NE(page.find("base64,cGF0aA=="), std::string::npos);
    EXPECT_NE(page.find("base64,dQ=="), std::string::npos);
    EXPECT_NE(page.find("unity: 12.3 % wrong on surfaces, energy 1; FLIP 0.456"),
              std::string::npos);
    EXPECT_EQ(report::html_text("<a href='x'>&\""), "&lt;a href=&#39;x&#39;&gt;&amp;&quot;");
}

TEST(Written, NoTextOfASceneBecomesAPlotCommand) {
    EXPECT_EQ(report::plot_string("it's\n`x`\x7f"), "'it''s?`x`?'");
    const TemporaryFolder folder;
    const std::filesystem::path home = std::filesystem::current_path();
    std::filesystem::current_path(folder.path());
    const std::string svg = report::plot_svg(report::plot_script(made_up(hostile)), 1);
    std::filesystem::current_path(home);
    EXPECT_EQ(folder.count(), 0); // nothing was run
    EXPECT_EQ(svg.find("<script"), std::string::npos);
    EXPECT_NE(svg.find("touch pwned"), std::string::npos); // it stands there as text
    EXPECT_NE(svg.find("exact, SH L1"), std::string::npos);
    EXPECT_NE(svg.find("Pareto front"), std::string::npos);
    EXPECT_THROW(report::plot_svg("no command", 1), Error);
}

TEST(Written, CsvQuotesAndHasOneLineEach) {
    const std::string csv = report::report_csv(made_up("a,\"b\".gltf"));
    EXPECT_EQ(std::ranges::count(csv, '\n'), 1 + 2 + 2 * 3 * (3 + 1)); // rows, peers and floors
    EXPECT_NE(csv.find("\n\"a,\"\"b\"\".gltf\",bake,16 none,"), std::string::npos);
    EXPECT_NE(csv.find("stage_inject"), std::string::npos);
    EXPECT_NE(csv.find(",unity_l1,unity_rms,unity_energy_ratio,"), std::string::npos);
    EXPECT_NE(csv.find(",0.55,"), std::string::npos);
    EXPECT_NE(csv.find(",inf,"), std::string::npos);
}

TEST(Written, JsonHasNoInfiniteNumbers) {
    const nlohmann::ordered_json json = report::report_json(made_up("a.gltf"));
    const auto& scene = json["scenes"][0];
    EXPECT_EQ(scene["rows"][0]["error"]["relative_l1"], 0.7);
    EXPECT_TRUE(scene["rows"][1]["error"]["relative_l1"].is_null());
    EXPECT_EQ(scene["rows"][0]["command"],
              "lpvbake bake 'a.gltf' --resolution 16 --occlusion none");
    EXPECT_EQ(scene["rows"][0]["peer"]["relation"], "already");
    EXPECT_EQ(scene["rows"][0]["readers"]["vrc"]["relative_l1"], 0.66);
    EXPECT_EQ(scene["grids"][0]["floors"][2]["sh_order"], 4);
    EXPECT_EQ(nlohmann::json::parse(json.dump())["scenes"].size(), 1u);
}

TEST(Written, TextSaysWhoWins) {
    report::Report report = made_up("a.gltf");
    EXPECT_NE(report::report_text(report).find("lpv: loses everywhere"), std::string::npos);
    EXPECT_NE(report::report_text(report).find("unity  threejs   vrc  bevy"), std::string::npos);
    EXPECT_NE(report::report_text(report).find("55 %        -  66 %     -"), std::string::npos);
    EXPECT_NE(report::report_text(report).find("better at its fewest rays, in 0.25 of the time"),
              std::string::npos);
    for (report::RowResult& row : report.scenes[0].rows)
        row.peer = report::EqualError{report::EqualError::Kind::crosses, 12};
    EXPECT_NE(report::report_text(report).find("lpv: wins everywhere"), std::string::npos);
    EXPECT_NE(report::report_text(report).find("peer needs 12 x as long"), std::string::npos);
    report.scenes[0].rows[0].peer = report::EqualError{report::EqualError::Kind::already, 3};
    const std::string mixed = report::verdicts(report.scenes[0]).at(0);
    EXPECT_NE(mixed.find("need longer in 1 row and less time in 0; in 1 they are more accurate"),
              std::string::npos)
        << mixed;
}

TEST(Written, Base64OfTheStandardsExamples) {
    EXPECT_EQ(base64(""), "");
    EXPECT_EQ(base64("f"), "Zg==");
    EXPECT_EQ(base64("fo"), "Zm8=");
    EXPECT_EQ(base64("foo"), "Zm9v");
    EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
    EXPECT_EQ(base64("\xff\xfe"), "//4=");
}

TEST(Sweep, RowsHaveNoOptionsThatTheirSolverLacks) {
    const auto rows = report::sweep_rows({{{"solver", {"lpv", "sn"}},
                                           {"directions", {"48", "96"}},
                                           {"quality", {"fast"}},
                                           {"rsm-size", {"64"}}}},
                                         {});
    ASSERT_EQ(rows.size(), 3u);
    using Set = std::vector<std::pair<std::string, std::string>>;
    EXPECT_EQ(rows[0].options, (Set{{"solver", "lpv"}, {"rsm-size", "64"}}));
    EXPECT_EQ(rows[1].options, (Set{{"solver", "sn"}, {"directions", "48"}, {"quality", "fast"}}));
    EXPECT_EQ(rows[2].options, (Set{{"solver", "sn"}, {"directions", "96"}, {"quality", "fast"}}));
}

// ---------------------------------------------------------------- baselines

TEST(Baseline, TellsWhatBecameWorseAndNothingElse) {
    const report::Baseline kept{{"a: sn", {{"error", 0.05}, {"energy", 0.98}, {"seconds", 1.0}}},
                                {"b: sn", {{"error", 0.0}}}};
    const auto worse = [&](const std::string& name, double value,
                           const report::BaselineSlack& slack = {}) {
        report::Baseline now = kept;
        now["a: sn"][name] = value;
        now["c: sn"] = {{"error", 9}};
        const report::BaselineComparison result = report::compare_baselines(kept, now, slack);
        EXPECT_EQ(result.compared, 2u);
        EXPECT_EQ(result.added, 1u);
        return result.worse;
    };
    EXPECT_EQ(worse("error", 0.0514), std::vector<std::string>()); // 2 % and 5e-4
    ASSERT_EQ(worse("error", 0.0516).size(), 1u);
    EXPECT_EQ(worse("error", 0.0516)[0], "a: sn: error is 0.0516, was 0.05");
    EXPECT_TRUE(worse("error", 0.0516, {0.05, {}}).empty());
    EXPECT_TRUE(worse("error", 0.01).empty());
    EXPECT_TRUE(worse("energy", 1.02).empty()) << "as far from 1 on the other side";
    EXPECT_EQ(worse("energy", 1.03).size(), 1u);
    EXPECT_EQ(worse("energy", 0.97).size(), 1u);
    EXPECT_TRUE(worse("seconds", 100).empty()) << "nobody asked for times";
    EXPECT_EQ(worse("seconds", 1.6, {0.02, 0.5}).size(), 1u);
    EXPECT_TRUE(worse("seconds", 1.4, {0.02, 0.5}).empty());
    report::Baseline gone = kept;
    gone["a: sn"].erase("error");
    EXPECT_EQ(report::compare_baselines(kept, gone, {}).worse.size(), 1u);
    EXPECT_EQ(report::compare_baselines(kept, {{"c: sn", {}}}, {}).compared, 0u);
}

TEST(Baseline, FilesKeepIt) {
    const TemporaryFolder folder;
    const report::Baseline kept{{"a \"b\": sn 32", {{"error", 0.01234}, {"energy", 1}}},
                                {"c: lpv", {}}};
    report::save_baseline(folder / "a.json", kept);
    EXPECT_EQ(report::load_baseline(folder / "a.json"), kept);
    for (const char* text : {"", "[]", "{}", "{\"rows\": 1}", "{\"rows\": {\"a\": 1}}",
                             "{\"rows\": {\"a\": {\"error\": null}}}"}) {
        spill(folder / "b.json", text);
        EXPECT_THROW(report::load_baseline(folder / "b.json"), Error) << text;
    }
}

} // namespace
} // namespace lpvbake
