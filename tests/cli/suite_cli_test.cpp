// lpvbake report --suite from outside: command, status, standard output, standard error.
//
// LPVBAKE_BINARY is the program's path.

#include "cli/run.h"
#include "hard_cases/gltf_writer.h"
#include "hard_cases/hard_cases.h"
#include "scenes.h"

#include <nlohmann/json.hpp>

namespace lpvbake {
namespace {

using nlohmann::json;

class SuiteCli : public ::testing::Test {
protected:
    SuiteCli() {
        scenes::write_gltf(scenes::furnace(1.0f, 0.5f, 1.0f), folder_ / "room.gltf");
        const json room{{"name", "glowing-room"},
                        {"reason", "small"},
                        {"scene", "room.gltf"},
                        {"options", {{"resolution", 8}}},
                        {"truth", {{"furnace", {{"emission", 1}, {"albedo", 0.5}}}}},
                        {"limits", {{"lpv", {{"error", 0.6}, {"energy", {1.0, 1.5}}}}}}};
        json twin = room;
        twin["name"] = "twin";
        twin["truth"] = "none";
        twin["same_as"] = {{"case", "glowing-room"}};
        twin["limits"]["lpv"] = {{"same", 0}};
        document_ = {{"cases", {room, twin}}};
    }
    /// Writes the suite and runs `lpvbake report ARGUMENTS`.
    CliResult run(const std::string& arguments) {
        spill(folder_ / "suite.json", document_.dump());
        return run_lpvbake(folder_, "report " + arguments);
    }
    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    }

    TemporaryFolder folder_;
    json document_;
};

TEST_F(SuiteCli, PrintsATableOfTheCases) {
    const CliResult text = run("--suite suite.json");
    if (text.status == int(cmd::ExitCode::device))
        GTEST_SKIP() << text.err;
    EXPECT_EQ(text.status, 0) << text.err;
    EXPECT_EQ(text.err, "");
    EXPECT_EQ(std::ranges::count(text.out, '\n'), 3) << text.out;
    EXPECT_EQ(text.out.find("case"), 0u) << text.out;
    EXPECT_NE(text.out.find("\nglowing-room  lpv"), std::string::npos) << text.out;
    EXPECT_TRUE(text.out.ends_with(" ok\n")) << text.out;

    const CliResult one = run("--suite suite.json --case twin --solver lpv --format json");
    EXPECT_EQ(one.status, 0) << one.err;
    const json document = json::parse(one.out);
    ASSERT_EQ(document["rows"].size(), 1u);
    const json& row = document["rows"][0];
    EXPECT_EQ(row["case"], "twin");
    EXPECT_EQ(row["solver"], "lpv");
    EXPECT_EQ(row["error"], nullptr);
    EXPECT_EQ(row["same"], 0.0);
    EXPECT_EQ(row["not_finite"], 0);
    EXPECT_EQ(row["failures"], json::array());
    EXPECT_EQ(document["failed"], 0);
}

TEST_F(SuiteCli, AnImpossibleLimitFailsAndIsNamed) {
    document_["cases"][0]["limits"]["lpv"]["error"] = 0;
    const CliResult text = run("--suite suite.json");
    if (text.status == int(cmd::ExitCode::device))
        GTEST_SKIP() << text.err;
    EXPECT_EQ(text.status, int(cmd::ExitCode::difference));
    EXPECT_NE(text.out.find("FAIL: error is 0."), std::string::npos) << text.out;
    EXPECT_EQ(text.err.find("lpvbake: error: suite.json: 1 of 2 rows failed, the first is "
                            "glowing-room by lpv: error is 0."),
              0u)
        << text.err;
    EXPECT_EQ(std::ranges::count(text.err, '\n'), 1) << text.err;
    const CliResult other = run("--suite suite.json --format json");
    EXPECT_EQ(other.status, int(cmd::ExitCode::difference));
    EXPECT_EQ(json::parse(other.out)["failed"], 1);
}

TEST_F(SuiteCli, ABrokenSceneFailsItsRowAlone) {
    document_["cases"][0]["scene"] = "broken.gltf";
    document_["cases"][1].erase("same_as");
    document_["cases"][1]["limits"]["lpv"] = {{"negative", 1}};
    spill(folder_ / "broken.gltf", "{");
    const CliResult text = run("--suite suite.json");
    if (text.status == int(cmd::ExitCode::device))
        GTEST_SKIP() << text.err;
    EXPECT_EQ(text.status, int(cmd::ExitCode::difference));
    EXPECT_NE(text.out.find("broken.gltf"), std::string::npos) << text.out;
    EXPECT_TRUE(text.out.ends_with(" ok\n")) << text.out;
}

TEST_F(SuiteCli, WrongSuitesAndCommandLinesAreRefused) {
    expect_error("--suite none.json", cmd::ExitCode::file, "none.json");
    expect_error("--suite suite.json room.gltf", cmd::ExitCode::usage, "--suite");
    expect_error("--suite suite.json -o a.csv", cmd::ExitCode::usage, "--suite");
    for (const char* option :
         {"--sun=1,2,3", "--bounds=0,0,0,1,1,1", "--no-emitters", "--dry-run", "--resolution=8",
          "--sweep=a.toml", "--sky=1:1:1,2", "--margin=2", "--max-albedo=0.5", "--metallic=black",
          "--backfaces=cull", "--repeats=2", "--probes=9", "--noise=2%", "--rays=64", "--seed=3",
          "--strict", "--scene=0"})
        expect_error(std::string("--suite suite.json ") + option, cmd::ExitCode::usage, "not --");
    expect_error("room.gltf --case twin", cmd::ExitCode::usage, "--suite");
    expect_error("room.gltf --cheap", cmd::ExitCode::usage, "--suite");
    document_["cases"][1]["scene"] = "../room.gltf";
    expect_error("--suite suite.json", cmd::ExitCode::invalid, "cases[1].scene");
    document_["cases"] = 1;
    expect_error("--suite suite.json", cmd::ExitCode::invalid, "suite.json: cases");
}

} // namespace
} // namespace lpvbake
