// The suite of hard cases: what is read, how it is judged, and that its cheap part holds.

#include "report/suite.h"

#include "gpu/device.h"
#include "hard_cases/gltf_writer.h"
#include "hard_cases/hard_cases.h"
#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "scenes.h"
#include "unit/volumes.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake {
namespace {

using nlohmann::json;

constexpr double pi = glm::pi<double>();

// ---------------------------------------------------------------- truth

/// Lambert's formula: the integral of the direction over a polygon's solid angle, which is the
/// irradiance on a plane that sees all of it, as a vector.
glm::dvec3 lambert(const std::vector<glm::dvec3>& corners, glm::dvec3 point) {
    glm::dvec3 sum(0.0);
    for (size_t i = 0; i < corners.size(); ++i) {
        const glm::dvec3 a = glm::normalize(corners[i] - point);
        const glm::dvec3 b = glm::normalize(corners[(i + 1) % corners.size()] - point);
        const glm::dvec3 cross = glm::cross(a, b);
        sum -= 0.5 * std::acos(glm::clamp(glm::dot(a, b), -1.0, 1.0)) * glm::normalize(cross);
    }
    return sum;
}

const std::vector<glm::dvec3> square{{-1, 0, 1}, {1, 0, 1}, {1, 0, -1}, {-1, 0, -1}}; // faces up

TEST(SuiteTruth, PolygonSendsWhatLambertsFormulaSays) {
    const double y0 = std::sqrt(0.25 / pi), y1 = std::sqrt(0.75 / pi);
    for (const glm::dvec3 point :
         {glm::dvec3(0, 1, 0), glm::dvec3(0.3, 0.1, -0.8), glm::dvec3(4, 2, 1)}) {
        const auto light = report::polygon_light(square, point);
        const glm::dvec3 expected = lambert(square, point);
        const double size = glm::length(expected);
        EXPECT_NEAR(light[1] / y1, expected.y, 6e-3 * size);
        EXPECT_NEAR(light[2] / y1, expected.z, 6e-3 * size);
        EXPECT_NEAR(light[3] / y1, expected.x, 6e-3 * size);
        EXPECT_EQ(report::polygon_light(square, glm::dvec3(point.x, -point.y, point.z))[0], 0.0);
    }
    // The face of a cube takes a sixth of the sphere around its centre.
    EXPECT_NEAR(report::polygon_light(square, {0, 1, 0})[0] / y0, 4.0 * pi / 6.0, 1e-6);
}

TEST(SuiteTruth, FurnaceIsTheSeriesOfItsBounces) {
    const report::FurnaceTruth furnace{2.0, 0.5};
    EXPECT_DOUBLE_EQ(report::furnace_luminance(furnace, 0), 2.0);
    EXPECT_DOUBLE_EQ(report::furnace_luminance(furnace, 1), 3.0);
    EXPECT_DOUBLE_EQ(report::furnace_luminance(furnace, 2), 3.5);
    EXPECT_DOUBLE_EQ(report::furnace_luminance(furnace, std::nullopt), 4.0);
}

/// Mean of the constant coefficient as a luminance.
double traced(const Scene& scene, std::optional<int> bounces) {
    const Grid grid{{0, 0, 0}, 0.25, {4, 4, 4}};
    const visibility::Visibility visibility(scene, {grid.origin, grid.cell, glm::dvec3(grid.dims)});
    const std::vector<size_t> cells{grid.index({1, 1, 1}), grid.index({2, 2, 1})};
    Progress silent;
    const Volume field = report::find_truth(report::TracedTruth{}, scene, visibility, grid, cells,
                                            {bounces, 4096, 0.01}, silent)
                             .volume;
    EXPECT_EQ(std::ranges::count(field.validity, 1.0f), 2);
    return double(field.sh[0][cells[0]].x + field.sh[0][cells[1]].x) / 2 / std::sqrt(4.0 * pi);
}

TEST(SuiteTruth, IsTracedWithTheBouncesOfTheCase) {
    const Scene room = scenes::furnace(1.0f, 0.5f, 1.0f);
    EXPECT_NEAR(traced(room, 0), 1.0, 0.02);
    EXPECT_NEAR(traced(room, 1), 1.5, 0.03);
    EXPECT_NEAR(traced(room, std::nullopt), 2.0, 0.04);
}

// ---------------------------------------------------------------- judging

/// A field of one luminance in 4 x 4 x 4 cells of 1 m.
Volume uniform(double luminance) {
    Volume volume;
    volume.grid = {{0, 0, 0}, 1.0, {4, 4, 4}};
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(64, glm::vec3(0.0f)));
    volume.sh[0].assign(64, glm::vec3(float(luminance * std::sqrt(4.0 * pi))));
    volume.validity.assign(64, 1.0f);
    return volume;
}

struct Judged {
    report::SuiteCase suite_case;
    report::SuiteLimits limits;
    report::TruthField truth{uniform(1.0), 0.0};
    report::SuiteCells cells;

    Judged() {
        for (size_t i = 0; i < 64; i += 3)
            cells.probes.push_back(i);
    }
    report::SuiteRow operator()(const Volume& baked, const Volume* other = nullptr) const {
        return report::judge(suite_case, limits, baked, truth, cells, other);
    }
};

/// Expects one failure that contains `text`.
void expect_failure(const report::SuiteRow& row, const std::string& text) {
    ASSERT_EQ(row.failures.size(), 1u) << text;
    EXPECT_NE(row.failures[0].find(text), std::string::npos) << row.failures[0];
}

TEST(SuiteJudge, EveryLimitCanFail) {
    Judged judged;
    judged.limits.error = 0.2;
    EXPECT_TRUE(judged(uniform(1.1)).failures.empty());
    EXPECT_NEAR(*judged(uniform(1.1)).error, 0.1, 1e-5);
    expect_failure(judged(uniform(1.3)), "error is 0.3, at most 0.2");
    judged.limits = {};
    judged.limits.energy = report::SuiteRange{0.9, 1.1};
    EXPECT_TRUE(judged(uniform(1.0)).failures.empty());
    expect_failure(judged(uniform(1.2)), "energy is 1.2, at most 1.1");
    expect_failure(judged(uniform(0.8)), "energy is 0.8, at least 0.9");
    judged.limits = {};
    judged.limits.negative = 0.1;
    Volume lobes = uniform(1.0);
    lobes.sh[1].assign(64, glm::vec3(10.0f));
    EXPECT_TRUE(judged(uniform(1.0)).failures.empty());
    expect_failure(judged(lobes), "negative is");
}

TEST(SuiteJudge, NanAndInfinityFailWithoutAnyLimit) {
    const Judged judged;
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
        Volume volume = uniform(1.0);
        volume.sh[2][1].y = bad; // no probe
        const report::SuiteRow row = judged(volume);
        EXPECT_EQ(row.not_finite, 1u);
        expect_failure(row, "NaN or infinite: 1 number");
        volume = uniform(1.0);
        volume.occlusion.assign(4, std::vector<float>(64, bad));
        EXPECT_EQ(judged(volume).not_finite, 256u);
    }
}

TEST(SuiteJudge, AFieldMayNotCallItsCellsInvalid) {
    Volume volume = uniform(1.0);
    volume.validity.assign(64, 0.0f);
    expect_failure(Judged()(volume), "22 of 22 cells outside geometry are called invalid");
}

TEST(SuiteJudge, LeaksAreMeasuredInTheRegion) {
    Judged judged;
    judged.suite_case.region = report::SuiteRegion{};
    judged.cells.region = {1, 2};
    judged.limits.leak = report::SuiteRange{0.95, 1.05};
    EXPECT_TRUE(judged(uniform(1.0)).failures.empty());
    Volume volume = uniform(1.0);
    volume.sh[0][2] *= 1.5f;
    EXPECT_NEAR(*judged(volume).leak, 1.25, 1e-5);
    expect_failure(judged(volume), "leak is 1.25, at most 1.05");

    judged.suite_case.region->dark = true;
    judged.limits.leak = report::SuiteRange{0, 0};
    volume.sh[0][1] = volume.sh[0][2] = glm::vec3(0.0f);
    EXPECT_TRUE(judged(volume).failures.empty());
    volume.sh[0][1].y = 1e-20f;
    expect_failure(judged(volume), "leak is");
}

TEST(SuiteJudge, ComparesWithTheOtherCase) {
    Judged judged;
    judged.suite_case.truth = report::NoTruth{};
    judged.suite_case.same_as = report::SuiteSame{"other", 4.0};
    judged.limits.same = 0.01;
    Volume other = uniform(0.25);
    other.grid = {{1e6, 0, 0}, 3.0, {4, 4, 4}}; // elsewhere, and of another scale
    EXPECT_TRUE(judged(uniform(1.0), &other).failures.empty());
    EXPECT_FALSE(judged(uniform(1.0), &other).error);
    expect_failure(judged(uniform(1.1), &other), "same is 0.1, at most 0.01");
    other.validity[5] = 0.0f;
    expect_failure(judged(uniform(1.0), &other), "same is 0.01562"); // one cell of 64
    other.grid.dims = {2, 2, 16};
    EXPECT_THROW(judged(uniform(1.0), &other), Error);
}

// ---------------------------------------------------------------- files

/// A suite of one case, with a scene.
class SuiteFile : public ::testing::Test {
protected:
    SuiteFile() {
        scenes::write_gltf(scenes::furnace(1.0f, 0.5f, 1.0f), folder_ / "room.gltf");
        document_ = {{"cases",
                      {{{"name", "room"},
                        {"reason", "why not"},
                        {"scene", "room.gltf"},
                        {"options", {{"resolution", 6}, {"margin", 0}, {"bounces", "inf"}}},
                        {"truth", {{"furnace", {{"emission", 1}, {"albedo", 0.5}}}}},
                        {"limits", {{"lpv", {{"error", 0.01}, {"energy", {0.99, 1.01}}}}}}}}}};
    }
    json& first() { return document_["cases"][0]; }
    std::string path() const { return folder_ / "suite.json"; }
    report::Suite load() const {
        spill(path(), document_.dump());
        return report::load_suite(path());
    }
    void expect_refused(const char* pointer, const json& value, const std::string& text) {
        const json before = document_;
        document_[json::json_pointer(pointer)] = value;
        const Error error = error_of("suite.json: cases", [&] { load(); });
        EXPECT_EQ(error.kind, ErrorKind::invalid) << pointer;
        EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
        document_ = before;
    }

    TemporaryFolder folder_;
    json document_;
};

TEST_F(SuiteFile, IsReadAsItStands) {
    first()["options"] = {{"resolution", 8}, {"margin", 2},     {"bounds", {0, 1, 2, 3, 4, 5}},
                          {"bounces", 2},    {"max-albedo", 1}, {"iterations", 7},
                          {"probes", 9},     {"rays", 128},     {"noise", 0.5}};
    first()["truth"] = "reference";
    first()["region"] = {{"lo", {0, 0, 0}}, {"hi", {1, 1, 1}}, {"dark", true}};
    first()["limits"]["lpv"]["leak"] = {0, 0.5};
    first()["cheap"] = true;
    const report::Suite suite = load();
    ASSERT_EQ(suite.cases.size(), 1u);
    const report::SuiteCase& c = suite.cases[0];
    EXPECT_EQ(c.name, "room");
    EXPECT_EQ(c.options.resolution, 8);
    EXPECT_EQ(c.options.margin, 2);
    EXPECT_EQ(c.options.bounds->hi, glm::dvec3(3, 4, 5));
    EXPECT_EQ(c.options.bounces, 2);
    EXPECT_EQ(c.options.max_albedo, 1.0);
    EXPECT_EQ(c.options.iterations, 7);
    EXPECT_EQ(c.options.probes, 9u);
    EXPECT_EQ(c.options.rays, 128u);
    EXPECT_EQ(c.options.noise, 0.5);
    EXPECT_TRUE(std::holds_alternative<report::TracedTruth>(c.truth));
    EXPECT_TRUE(c.region->dark && c.cheap);
    EXPECT_EQ(c.limits.at("lpv").leak->hi, 0.5);
    EXPECT_EQ(c.limits.at("lpv").error, 0.01);
    EXPECT_FALSE(c.limits.at("lpv").same);
}

TEST_F(SuiteFile, WhatIsWrongIsNamedInOneLine) {
    const json refused[] = {
        {"/cases", json::array(), "cases: must be an array of 1 to 10000 cases"},
        {"/cases/0", 1, "cases[0]: must be an object"},
        {"/cases/0/x", 1, "cases[0]: has an unknown property \"x\""},
        {"/cases/0/name", "a\nb", "cases[0].name: must be a text of one line"},
        {"/cases/0/reason", "", "cases[0].reason: must be a text of one line"},
        {"/cases/0/scene", "/etc/passwd", "is an absolute path"},
        {"/cases/0/scene", "../room.gltf", "leads out"},
        {"/cases/0/scene", "http://a/b", "is not a relative path"},
        {"/cases/0/options/resolution", 2, "options.resolution: must be a whole number from 3"},
        {"/cases/0/options/resolution", 8.5, "options.resolution: must be a whole number from 3"},
        {"/cases/0/options/bounces", "all", "options.bounces: must be a whole number"},
        {"/cases/0/options/bounces", -1, "options.bounces: must be a whole number"},
        {"/cases/0/options/bounds", {1, 2}, "options.bounds: must be an array of 6 numbers"},
        {"/cases/0/options/bounds", {1, 0, 0, 0, 1, 1}, "inside out"},
        {"/cases/0/options/max-albedo", 2, "options.max-albedo: must be a number from 0"},
        {"/cases/0/options/probes", 0, "options.probes: must be a whole number from 1"},
        {"/cases/0/options/probes", -5, "options.probes: must be a whole number from 1"},
        {"/cases/0/options/noise", 0, "options.noise: must be a number from"},
        {"/cases/0/options/size", 0, "options: has an unknown property \"size\""},
        {"/cases/0/truth", "guess", "truth: must be \"reference\""},
        {"/cases/0/truth/furnace/albedo", 1, "truth.furnace.albedo: must be a number from 0"},
        {"/cases/0/truth",
         {{"polygon", {{"corners", {{1, 2, 3}}}, {"luminance", 1}}}},
         "polygon.corners: must be an array of 3 to 1000 corners"},
        {"/cases/0/limits", json::object(), "limits: must be an object with an entry"},
        {"/cases/0/limits/lpv", json::object(), "limits.lpv: is empty: nothing could fail"},
        {"/cases/0/limits/sorcery",
         {{"error", 1}},
         "there is no such solver; known: sn, gather, lpv"},
        {"/cases/0/limits/lpv/error", "1", "limits.lpv.error: must be a number from 0 up"},
        {"/cases/0/limits/lpv/energy", {2, 1}, "limits.lpv.energy: the least is above the most"},
        {"/cases/0/limits/lpv/leak", {0, 1}, "limits a leak, but the case has no \"region\""},
        {"/cases/0/limits/lpv/same", 1, "limits \"same\", but the case has no \"same_as\""},
        {"/cases/0/same_as", {{"case", "nobody"}}, "\"nobody\" is no other case"},
        {"/cases/0/same_as", {{"case", "room"}}, "\"room\" is no other case"},
        {"/cases/0/truth", "none", "limits what needs a truth"},
        {"/cases/0/cheap", 1, "cheap: must be true or false"},
    };
    for (const json& each : refused)
        expect_refused(each[0].get<std::string>().c_str(), each[1], each[2]);
    json twice = first();
    expect_refused("/cases/1", twice, "cases[1].name: \"room\" is the name of another case");
    first().erase("limits");
    expect_refused("/cases/0/cheap", true, "cases[0]: lacks \"limits\"");

    spill(path(), "{\"cases\": [");
    EXPECT_EQ(error_of("suite.json: not JSON", [&] { report::load_suite(path()); }).kind,
              ErrorKind::invalid);
    EXPECT_EQ(error_of("none.json", [&] { report::load_suite(folder_ / "none.json"); }).kind,
              ErrorKind::file);
}

TEST_F(SuiteFile, ScenesMayNotLeaveTheFolderThroughALink) {
    TemporaryFolder other;
    scenes::write_gltf(scenes::furnace(1.0f, 0.5f, 1.0f), other / "away.gltf");
    std::filesystem::create_symlink(other / "away.gltf", folder_ / "link.gltf");
    expect_refused("/cases/0/scene", "link.gltf", "is a link that leads out");
}

// ---------------------------------------------------------------- running

/// The truth of the furnace, as a solver that is right would have it, times `factor`.
report::SuiteSolver exact(const char* name, float factor, std::optional<int> bounces) {
    return {name, [=](const Scene& scene, const report::SuiteOptions& o, Progress&) {
                const Bounds box = bounds_of(scene);
                Volume volume;
                volume.grid = volume::fit_grid(box.lo, box.hi, {o.resolution, 0.0, o.margin});
                double luminance = 2.0; // all bounces
                if (bounces)
                    luminance = 2.0 - std::pow(0.5, *bounces);
                volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
                volume.sh[0].assign(volume.grid.size(),
                                    glm::vec3(factor * float(luminance * std::sqrt(4.0 * pi))));
                return volume;
            }};
}

std::vector<report::SuiteRow> run(const report::Suite& suite,
                                  const std::vector<report::SuiteSolver>& solvers,
                                  const report::SuiteSelection& selection = {}) {
    Progress silent;
    std::vector<std::string> told;
    std::vector<report::SuiteRow> rows =
        report::run_suite(suite, selection, solvers, silent,
                          [&](const report::SuiteRow& row) { told.push_back(row.name); });
    EXPECT_EQ(told.size(), rows.size());
    return rows;
}

TEST_F(SuiteFile, ASolverIsHeldToTheBouncesOfTheCase) {
    EXPECT_TRUE(run(load(), {exact("lpv", 1.0f, {})})[0].failures.empty());
    const report::SuiteSolver lazy = exact("lpv", 1.0f, 1);
    EXPECT_NEAR(*run(load(), {lazy})[0].energy, 0.75, 1e-5);
    EXPECT_EQ(run(load(), {lazy})[0].failures.size(), 2u); // error and energy
}

TEST_F(SuiteFile, WhatGoesWrongInOneRowIsThatRowsFailure) {
    json broken = first(), later = first();
    broken["name"] = "broken";
    broken["scene"] = "broken.gltf";
    later["name"] = "later";
    later["cheap"] = true;
    document_["cases"] = {first(), broken, later};
    spill(folder_ / "broken.gltf", "not a scene");
    const report::Suite suite = load();
    const std::vector<report::SuiteRow> rows = run(suite, {exact("lpv", 1.0f, {})});
    ASSERT_EQ(rows.size(), 3u);
    EXPECT_TRUE(rows[0].measured && rows[0].failures.empty());
    EXPECT_FALSE(rows[1].measured);
    expect_failure(rows[1], "broken.gltf");
    EXPECT_TRUE(rows[2].measured && rows[2].failures.empty());

    report::SuiteSolver failing = exact("lpv", 1.0f, {});
    failing.bake = [](const Scene&, const report::SuiteOptions&, Progress&) -> Volume {
        throw Error(ErrorKind::memory, "too large");
    };
    expect_failure(run(suite, {failing}, {{"later"}, {}, false})[0], "too large");
    failing.bake = [](const Scene&, const report::SuiteOptions&, Progress&) -> Volume {
        throw Error(ErrorKind::interrupted, "stop");
    };
    EXPECT_THROW(run(suite, {failing}), Error);
}

TEST_F(SuiteFile, TruthIsTracedOnceACase) {
    struct Counter : Progress {
        void begin(std::string_view stage, uint64_t) override {
            traced += stage.starts_with("trace");
        }
        int traced = 0;
    };
    first()["truth"] = "reference";
    first()["limits"]["sn"] = first()["limits"]["lpv"];
    json later = first();
    later["name"] = "later";
    document_["cases"] = {first(), later};
    const auto traced = [&](const std::vector<report::SuiteSolver>& solvers) {
        Counter counter;
        const std::vector<report::SuiteRow> rows =
            report::run_suite(load(), {}, solvers, counter, [](auto&) {});
        EXPECT_EQ(rows.size(), 2 * solvers.size());
        for (const report::SuiteRow& row : rows)
            EXPECT_EQ(row.error, rows[0].error);
        return counter.traced;
    };
    const int once = traced({exact("lpv", 1.0f, {})});
    EXPECT_GE(once, 2);
    EXPECT_EQ(traced({exact("lpv", 1.0f, {}), exact("sn", 1.0f, {})}), once);
}

TEST_F(SuiteFile, RowsCanBeSelected) {
    json later = first();
    later["name"] = "later";
    later["cheap"] = true;
    document_["cases"] = {first(), later};
    const report::Suite suite = load();
    const std::vector<report::SuiteSolver> solvers{exact("lpv", 1.0f, {}),
                                                   exact("other", 1.0f, {})};
    EXPECT_EQ(run(suite, solvers).size(), 2u); // nobody limits the other solver
    EXPECT_EQ(run(suite, solvers, {{"later"}, {}, false}).at(0).name, "later");
    EXPECT_EQ(run(suite, solvers, {{}, {}, true}).size(), 1u);
    EXPECT_EQ(run(suite, solvers, {{}, {"lpv"}, false}).size(), 2u);
    for (const report::SuiteSelection& wrong :
         {report::SuiteSelection{{"nobody"}, {}, false},
          report::SuiteSelection{{}, {"nobody"}, false},
          report::SuiteSelection{{}, {"other"}, false}, report::SuiteSelection{{"room"}, {}, true}})
        EXPECT_EQ(error_of("", [&] { run(suite, solvers, wrong); }).kind, ErrorKind::argument);
}

TEST(HardCases, ScenesAreWhatTheyWereBuiltAs) {
    TemporaryFolder folder;
    Scene built = scenes::cornell_box_with_sun();
    built.lights.push_back(scenes::spot_light({1, 2, 3}, {0, 0, 1}, 5.0, 0.1, 0.2));
    built.materials[0].emission = {0.5f, 40.0f, 3.0f};
    scenes::write_gltf(built, folder / "a.gltf");
    const Scene read = load_gltf(folder / "a.gltf", {});
    EXPECT_TRUE(read.warnings.empty());
    EXPECT_EQ(scene::triangle_count(read), scene::triangle_count(built));
    EXPECT_EQ(bounds_of(read).lo, bounds_of(built).lo);
    EXPECT_EQ(bounds_of(read).hi, bounds_of(built).hi);
    ASSERT_EQ(read.lights.size(), 2u);
    for (size_t i = 0; i < 2; ++i) {
        EXPECT_LT(glm::distance(read.lights[i].direction, built.lights[i].direction), 1e-12);
        EXPECT_EQ(read.lights[i].intensity, built.lights[i].intensity);
    }
    EXPECT_EQ(read.lights[1].position, built.lights[1].position);
    ASSERT_GE(read.materials.size(), 3u);
    EXPECT_EQ(read.materials[1].base_color, built.materials[1].base_color);
    EXPECT_LT(glm::distance(read.materials[0].emission, built.materials[0].emission), 1e-5f);
}

class HardCasesOnDevice : public testing::DeviceTest {};

TEST_F(HardCasesOnDevice, TheCheapPartHolds) {
    TemporaryFolder folder;
    scenes::write_hard_cases(folder.path().string());
    const report::Suite suite = report::load_suite(folder / "suite.json");
    const std::vector<report::SuiteRow> rows =
        run(suite, report::suite_solvers(device()), {{}, {}, true});
    EXPECT_GE(rows.size(), 60u);
    for (const report::SuiteRow& row : rows)
        for (const std::string& failure : row.failures)
            ADD_FAILURE() << row.name << " by " << row.solver << ": " << failure;
}

} // namespace
} // namespace lpvbake
