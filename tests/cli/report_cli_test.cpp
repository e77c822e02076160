// lpvbake report from outside: command, status, standard output, standard error, files.
//
// LPVBAKE_BINARY is the program's path, LPVBAKE_EXAMPLES the folder of examples/.

#include "cli/run.h"
#include "exit_code.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace lpvbake {
namespace {

using nlohmann::json;

/// As coarse as it gets, so that a run takes a second.
const std::string coarse = " --resolution 6 --probes 40 --noise 20% --repeats 2 ";

class ReportCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "report " + arguments);
    }

    json run_json(const std::string& arguments) {
        const CliResult result = run(arguments + " --format json");
        EXPECT_EQ(result.status, 0) << arguments << "\n" << result.err;
        return json::parse(result.out);
    }

    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    }

    TemporaryFolder folder_;
};

TEST_F(ReportCli, MeasuresEveryRowAndWritesEveryForm) {
    const CliResult result =
        run("\"$ROOM\"" + coarse + "--occlusion none,face -o r.html -o r.csv -o r.json -o r.svg");
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_NE(result.out.find("6 x 6 x 6"), std::string::npos) << result.out;
    const json document = json::parse(slurp(folder_ / "r.json"));
    EXPECT_EQ(document["command"], "report");
    const json& scene = document["scenes"][0];
    ASSERT_EQ(scene["rows"].size(), 2u);
    ASSERT_EQ(scene["grids"].size(), 1u);
    EXPECT_EQ(scene["grids"][0]["probes"], 40);
    EXPECT_EQ(scene["grids"][0]["peer"].size(), 5u);
    EXPECT_TRUE(scene["grids"][0]["peer_sharing_bounces"].empty()); // there is one bounce
    EXPECT_LE(scene["grids"][0]["reference"]["noise"], 0.2);
    EXPECT_LE(scene["surfaces"]["points"], 40);
    EXPECT_GE(scene["surfaces"]["points"], 30); // the boxes' undersides are dark
    double last = 1e9;
    for (const json& floor : scene["grids"][0]["floors"]) { // more bands are nearer the truth
        EXPECT_LT(floor["relative_l1"], last);
        last = floor["relative_l1"];
    }
    for (const json& row : scene["rows"]) {
        EXPECT_GT(row["error"]["relative_l1"], 0);
        EXPECT_GT(row["surface"]["relative_l1"], 0);
        for (const char* reader :
             {"blender", "houdini", "unity", "unreal", "godot", "threejs", "vrc", "bevy"})
            EXPECT_GT(row["readers"][reader]["relative_l1"], 0) << reader;
        // The same lookup and formula; an offset, and no fill, make others.
        EXPECT_EQ(row["readers"]["unity"], row["readers"]["godot"]);
        EXPECT_NE(row["readers"]["unity"], row["readers"]["threejs"]);
        EXPECT_NE(row["readers"]["unity"], row["readers"]["blender"]);
        EXPECT_LE(row["seconds"]["min"], row["seconds"]["median"]);
        EXPECT_LE(row["seconds"]["median"], row["seconds"]["max"]);
        EXPECT_FALSE(row["peer"].is_null());
        EXPECT_GE(row["stages"].size(), 5u);
    }
    EXPECT_EQ(scene["rows"][1]["options"]["occlusion"], "face");
    EXPECT_NE(std::string(scene["rows"][1]["command"]).find("--resolution 6 --occlusion face"),
              std::string::npos);

    const std::string page = slurp(folder_ / "r.html");
    EXPECT_NE(page.find("data:image/svg+xml;base64,"), std::string::npos);
    EXPECT_NE(page.find("--occlusion face"), std::string::npos);
    // A slice, its truth and its error; and what is seen: by paths, our own sampler, four programs,
    // and one of them without the fit, which is farther from the paths.
    const std::string png = "data:image/png;base64,";
    int pictures = 0;
    for (std::size_t at = 0; (at = page.find(png, at)) != std::string::npos; at += png.size())
        ++pictures;
    EXPECT_EQ(pictures, 3 + 7);
    const auto flip = [&](const std::string& what) {
        const std::size_t caption = page.find("<figcaption>" + what + ": ");
        const std::size_t at = caption == std::string::npos ? caption : page.find("FLIP ", caption);
        return at == std::string::npos ? -1 : std::stod(page.substr(at + 5));
    };
    for (const char* what : {"our own sampler", "unity", "threejs", "vrc", "bevy"})
        EXPECT_GT(flip(what), 0) << what;
    EXPECT_GT(flip("unity, not fitted"), 1.2 * flip("unity"));
    EXPECT_NE(slurp(folder_ / "r.svg").find("</svg>"), std::string::npos);
    const std::string csv = slurp(folder_ / "r.csv");
    EXPECT_EQ(std::ranges::count(csv, '\n'), 1 + 2 + 3 * (5 + 1));
}

TEST_F(ReportCli, ProbesThatShareBouncesConvergeToTheReference) {
    const CliResult result =
        run("\"$ROOM\"" + coarse + "--solver gather --bounces 4 --no-slices -o r.json");
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_NE(result.out.find("sharing bounces it"), std::string::npos) << result.out;
    const json scene = json::parse(slurp(folder_ / "r.json"))["scenes"][0];
    EXPECT_FALSE(scene["rows"][0]["peer_sharing_bounces"].is_null());
    const json& paths = scene["grids"][0]["peer"];
    const json& sharing = scene["grids"][0]["peer_sharing_bounces"];
    ASSERT_EQ(sharing.size(), 5u);
    const auto error = [](const json& peer) {
        return peer["orders"][2]["projected"]["relative_l1"].get<double>();
    };
    // The reference's own noise is a few per cent here.
    EXPECT_LT(error(sharing[4]), 0.1);
    EXPECT_LT(error(sharing[4]), 0.5 * error(sharing[1]));
    EXPECT_LT(error(sharing[1]), error(paths[1]));
    const json& got = sharing[4]["orders"][2]["error"]["energy_ratio"];
    EXPECT_NEAR(got.get<double>(), 1.0, 0.04);
}

TEST_F(ReportCli, ErrorsDoNotDependOnThreads) {
    const std::string common = "\"$ROOM\"" + coarse + "--no-peer ";
    const json one = run_json(common + "--threads 1"), three = run_json(common + "--threads 3");
    const json &a = one["scenes"][0], &b = three["scenes"][0];
    EXPECT_EQ(a["rows"][0]["error"], b["rows"][0]["error"]);
    EXPECT_EQ(a["rows"][0]["surface"], b["rows"][0]["surface"]);
    EXPECT_EQ(a["grids"][0]["floors"], b["grids"][0]["floors"]);
    EXPECT_TRUE(a["rows"][0]["peer"].is_null());
    const json other = run_json(common + "--seed 2");
    EXPECT_NE(a["rows"][0]["error"], other["scenes"][0]["rows"][0]["error"]);
}

TEST_F(ReportCli, SweepFilesAreBakedAsListed) {
    spill(folder_ / "s.toml", "[[sweep]]\nresolution = [5, 6] # cells\nocclusion = \"face\"\n"
                              "[[sweep]]\nresolution = 5\niterations = [1,\n 2]\n");
    const json listed = run_json("\"$ROOM\" --sweep s.toml --dry-run");
    const json& rows = listed["scenes"][0]["rows"];
    ASSERT_EQ(rows.size(), 4u);
    EXPECT_EQ(rows[1]["dims"], json({6, 6, 6}));
    EXPECT_EQ(rows[3]["name"], "5 iterations=2");
    EXPECT_GT(rows[3]["seconds"], 0.0);
    const CliResult text = run("\"$ROOM\" --dry-run");
    EXPECT_EQ(text.status, 0) << text.err;
    EXPECT_EQ(std::ranges::count(text.out, '\n'), 1 + 29 + 1) << text.out;
    EXPECT_NE(text.out.find("\nrow           what bake takes "), std::string::npos) << text.out;
    spill(folder_ / "plain.toml", "resolution = [5]\n"); // without a header
    EXPECT_EQ(run_json("\"$ROOM\" --sweep plain.toml --dry-run")["scenes"][0]["rows"].size(), 1u);
}

TEST_F(ReportCli, FindsSettingsForAnError) {
    const std::string search = "\"$ROOM\" --point 0,1,0,5 --resolution 8 --probes 100 --noise 4%"
                               " --repeats 1 --time-budget 10min --error ";
    const CliResult found = run(search + "60%");
    ASSERT_EQ(found.status, 0) << found.err;
    const std::size_t last = found.out.rfind("\nlpvbake bake ");
    ASSERT_NE(last, std::string::npos) << found.out;
    EXPECT_EQ(found.out.find('\n', last + 1), found.out.size() - 1) << found.out;
    const std::size_t expected = found.out.find("\nexpected      about ");
    EXPECT_LT(expected, found.out.find("\ntried         "));
    const std::string command = found.out.substr(last + 9);
    const CliResult repeated = run_lpvbake(folder_, command.substr(0, command.size() - 1));
    EXPECT_EQ(repeated.status, 0) << command << repeated.err;
    EXPECT_NE(repeated.out.find("8 x 8 x 8 cells"), std::string::npos) << repeated.out;

    // A better one is another bake, and what no bake reaches is told, with the nearest.
    const json better = run_json(search + "15%");
    const json& best = better["scenes"][0]["tried"][better["scenes"][0]["best"].get<int>()];
    EXPECT_TRUE(better["scenes"][0]["found"]);
    EXPECT_LE(best["error"]["high"], 0.15);
    EXPECT_EQ(best["command"], better["scenes"][0]["command"]);
    const CliResult none = run(search + "0.1%");
    EXPECT_EQ(none.status, int(cmd::ExitCode::difference));
    EXPECT_EQ(std::ranges::count(none.err, '\n'), 1) << none.err;
    EXPECT_NE(
        none.err.find(" tried is known to keep error 0.1 %, time 600 s; nearest comes, with "),
        std::string::npos)
        << none.err;
    EXPECT_EQ(none.out.find("\nlpvbake bake"), std::string::npos) << none.out;
    expect_error(search + "5% --sweep a.toml", cmd::ExitCode::usage, "exclude each other");
    expect_error("\"$ROOM\" --error 5% --resolution 8,9", cmd::ExitCode::usage, "resolution: ");
}

TEST_F(ReportCli, FindsSettingsForATime) {
    const std::string search = "\"$ROOM\" --resolution 8 --probes 50 --noise 9% --repeats 2 ";
    const json most = run_json(search + "--time-budget 10min")["scenes"][0];
    EXPECT_TRUE(most["found"]);
    ASSERT_EQ(most["tried"].size(), 1u); // the most accurate fits
    EXPECT_GE(most["tried"][0]["sh_order"], 2);
    const CliResult none = run(search + "--time-budget 0.1ms --format json");
    EXPECT_EQ(none.status, int(cmd::ExitCode::difference));
    const json scene = json::parse(none.out)["scenes"][0];
    EXPECT_FALSE(scene["found"]);
    for (const json& trial : scene["tried"])
        EXPECT_EQ(trial["missed"], "too slow");
    const CliResult plan = run(search + "--time-budget 2s --dry-run");
    EXPECT_EQ(plan.status, 0) << plan.err;
    EXPECT_NE(plan.out.find("\nexpected      about "), std::string::npos) << plan.out;
    EXPECT_NE(plan.out.find("\ncandidate     sn quality=fast "), std::string::npos) << plan.out;
    EXPECT_EQ(plan.out.find("tried"), std::string::npos) << plan.out;
}

TEST_F(ReportCli, CommandsOfRowsRepeatThem) {
    const json document = run_json("\"$ROOM\" \"$ROOM\" --dry-run --no-emitters --margin 2 --point"
                                   " 0,1,0,5,#ff8000 --resolution 7 --occlusion sh --scene 0"
                                   " --max-memory 1G --strict --allow-external --sky 1:1:1,2"
                                   " --metallic black --threads 1");
    EXPECT_EQ(document["scenes"].size(), 2u);
    const std::string command = document["scenes"][1]["rows"][0]["command"];
    ASSERT_TRUE(command.starts_with("lpvbake bake "));
    const CliResult repeated = run_lpvbake(folder_, command.substr(8) + " --print-config");
    EXPECT_EQ(repeated.status, 0) << repeated.err;
    for (const char* line :
         {"no-emitters = true\n", "margin = 2\n", "resolution = 7\n", "occlusion = \"sh\"\n",
          "point = [[0, 1, 0, 5, \"#ff8000\"]]\n", "scene-name = \"0\"\n", "max-memory = \"1G\"\n",
          "strict = true\n", "allow-external = true\n", "sky = \"1:1:1,2\"\n",
          "metallic = \"black\"\n", "threads = 1\n"})
        EXPECT_NE(repeated.out.find(line), std::string::npos) << line << repeated.out;
}

TEST_F(ReportCli, HostileFileNamesDoNothing) {
    const std::string name = "x';system(\"touch pwned\")#`touch pwned`$(touch pwned)<script>.gltf";
    spill(folder_ / name, slurp(LPVBAKE_EXAMPLES "/cornell_box.gltf"));
    const CliResult result = run("*script*.gltf" + coarse + "-o r.html -o r.svg");
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_FALSE(std::filesystem::exists(folder_ / "pwned"));
    EXPECT_EQ(slurp(folder_ / "r.html").find("<script"), std::string::npos);
    EXPECT_EQ(slurp(folder_ / "r.svg").find("<script"), std::string::npos);
}

TEST_F(ReportCli, MissingGnuplotIsSaidBeforeTheWork) {
    const std::string command = "cd '" + folder_.path().string()
                                + "' && PATH=/none '" LPVBAKE_BINARY "' report '" LPVBAKE_EXAMPLES
                                  "/cornell_box.gltf' -o r.svg > stdout 2> stderr";
    const int status = std::system(command.c_str());
    EXPECT_EQ(WEXITSTATUS(status), int(cmd::ExitCode::failure));
    EXPECT_NE(slurp(folder_ / "stderr").find("gnuplot-nox"), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(folder_ / "r.svg"));
}

TEST_F(ReportCli, ConfigFileRoundTrips) {
    const CliResult first = run("\"$ROOM\" -o r.csv --resolution 5,6 --seed 9 --noise 2% --no-peer"
                                " --bounds 0,0,0,1,1,1 --print-config > a.toml; cat a.toml");
    ASSERT_EQ(first.status, 0) << first.err;
    const CliResult second = run("--config a.toml --print-config");
    EXPECT_EQ(second.err, "");
    EXPECT_EQ(second.out, slurp(folder_ / "a.toml"));
    for (const char* line : {"noise = 0.02\n", "resolution = [5, 6]\n", "no-peer = true\n"})
        EXPECT_NE(second.out.find(line), std::string::npos) << line << second.out;
}

TEST_F(ReportCli, WhatIsWorseThanTheBaselineFails) {
    const std::string rows = "\"$ROOM\"" + coarse
                             + "--no-peer --solver gather"
                               " --bounces 1 --baseline b.json ";
    expect_error(rows, cmd::ExitCode::file, "b.json");
    ASSERT_EQ(run(rows + "--update-baseline").status, 0);
    const CliResult same = run(rows);
    EXPECT_EQ(same.status, 0) << same.err;
    json kept = json::parse(slurp(folder_ / "b.json"));
    ASSERT_EQ(kept["rows"].size(), 1u);
    auto& row = kept["rows"].begin().value();
    EXPECT_GT(row["threejs"], 0);
    row["surface"] = row["surface"].get<double>() * 0.9;
    spill(folder_ / "b.json", kept.dump());
    const CliResult worse = run(rows);
    EXPECT_EQ(worse.status, int(cmd::ExitCode::difference));
    EXPECT_NE(worse.err.find("lpvbake: error: b.json: 1 number of 1 row became worse, the first is "
                             "cornell_box.gltf: "),
              std::string::npos)
        << worse.err;
    EXPECT_NE(worse.err.find(": surface is "), std::string::npos) << worse.err;
    expect_error("\"$ROOM\" --slack 1%", cmd::ExitCode::usage, "--slack needs --baseline");
    spill(folder_ / "b.json", "{\"rows\": {}}");
    const CliResult none = run(rows);
    EXPECT_EQ(none.status, int(cmd::ExitCode::usage));
    EXPECT_NE(none.err.find("--update-baseline"), std::string::npos) << none.err;
}

TEST_F(ReportCli, WrongCommandLinesAreRefused) {
    expect_error("", cmd::ExitCode::usage, "no scene");
    expect_error("\"$ROOM\" -o r.txt", cmd::ExitCode::usage, "r.txt");
    expect_error("\"$ROOM\" -o r.csv -o ./r.csv", cmd::ExitCode::usage, "given twice");
    expect_error("\"$ROOM\" -o none/r.csv", cmd::ExitCode::file, "none/r.csv");
    expect_error("none.gltf", cmd::ExitCode::file, "none.gltf");
    expect_error("\"$ROOM\" --sweep none.toml", cmd::ExitCode::file, "none.toml");
    expect_error("\"$ROOM\" --resolution 2", cmd::ExitCode::usage, "--resolution: '2'");
    expect_error("\"$ROOM\" --resolution 16,,32", cmd::ExitCode::usage, "--resolution: ''");
    expect_error("\"$ROOM\" --occlusion full", cmd::ExitCode::usage, "none, sh, face");
    for (const char* bad : {"--repeats=0", "--probes=0", "--probes=1000000", "--noise=0",
                            "--noise=x", "--rays=1", "--seed=-1", "--margin=-1"})
        expect_error(std::string("\"$ROOM\" ") + bad, cmd::ExitCode::usage, "");
    spill(folder_ / "a.toml", "resolution = [16]\nwidth = 3\n");
    expect_error("\"$ROOM\" --sweep a.toml", cmd::ExitCode::usage,
                 "a.toml:2: a sweep cannot set 'width'");
    spill(folder_ / "b.toml", "[[sweep]]\n\nocclusion = [\"none\", \"half\"]\n");
    expect_error("\"$ROOM\" --sweep b.toml", cmd::ExitCode::usage, "b.toml:3: occlusion: 'half'");
    spill(folder_ / "c.toml", "resolution = []\n");
    expect_error("\"$ROOM\" --sweep c.toml", cmd::ExitCode::usage, "c.toml:1");
    spill(folder_ / "d.toml", "[sweep]\nresolution = 4\n");
    expect_error("\"$ROOM\" --sweep d.toml", cmd::ExitCode::usage, "d.toml:1");
    spill(folder_ / "e.toml", "# nothing\n");
    expect_error("\"$ROOM\" --sweep e.toml", cmd::ExitCode::usage, "e.toml");
    spill(folder_ / "f.toml", "resolution = [4]\n");
    expect_error("\"$ROOM\" --sweep f.toml --resolution 5", cmd::ExitCode::usage,
                 "exclude each other");
    expect_error("\"$ROOM\" --sweep f.toml -o f.toml", cmd::ExitCode::usage, "f.toml");
    expect_error("\"$ROOM\" --no-scene-lights --no-emitters", cmd::ExitCode::invalid, "--sun");
    expect_error("\"$ROOM\" --bounds 5,5,5,5,5,5", cmd::ExitCode::invalid, "");
}

} // namespace
} // namespace lpvbake
