// lpvbake reference from outside: command, status, standard output, standard error, files.
//
// LPVBAKE_BINARY is the program's path, LPVBAKE_EXAMPLES the folder of examples/. No device needed.

#include "cli/run.h"
#include "exit_code.h"
#include "io/io.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace lpvbake {
namespace {

using nlohmann::json;

class ReferenceCli : public ::testing::Test {
protected:
    /// Runs `lpvbake reference ARGUMENTS` in the folder; the arguments are words of a shell, in
    /// which $ROOM is the Cornell box.
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "reference " + arguments);
    }

    json run_json(const std::string& arguments) {
        const CliResult result = run(arguments + " --format json");
        EXPECT_EQ(result.status, 0) << arguments << "\n" << result.err;
        return json::parse(result.out);
    }

    /// Expects a status and one line on standard error that contains `text`, and no result.
    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    }

    TemporaryFolder folder_;
};

TEST_F(ReferenceCli, WritesTheVolumeAndItsErrors) {
    const json document =
        run_json("\"$ROOM\" -o a.vdb -e e.vdb -o b.exr --resolution 8 --rays 200");
    EXPECT_EQ(document["command"], "reference");
    EXPECT_EQ(document["grid"]["dims"], json({8, 8, 8}));
    EXPECT_EQ(document["probes"], 512);
    EXPECT_EQ(document["rays"], 256); // whole batches
    EXPECT_EQ(document["bounces"], 1);
    EXPECT_EQ(document["outputs"].size(), 3u);
    EXPECT_GT(document["noise"], 0.0);
    EXPECT_EQ(document["warnings"], json::array());
    const Volume volume = read_volume(folder_ / "a.vdb"), error = read_volume(folder_ / "e.vdb");
    EXPECT_EQ(volume.metadata.at("solver"), "reference");
    EXPECT_EQ(volume.metadata.at("bounces"), "1");
    EXPECT_NE(volume.metadata.at("settings").find("rays = 200"), std::string::npos);
    EXPECT_EQ(error.metadata.at("quantity"), "standard error");
    double squares = 0; // of the constant band's errors: what the document says of it
    for (const glm::vec3& e : error.sh[0])
        squares += double(glm::dot(e, e)) / 3 / 512;
    EXPECT_NEAR(std::sqrt(squares) / double(document["standard_error"][0]), 1.0, 1e-5);
    EXPECT_EQ(read_volume(folder_ / "b.exr").sh.size(), 4u);
}

TEST_F(ReferenceCli, SameBytesForAnyNumberOfThreads) {
    const std::string common = "\"$ROOM\" --resolution 6 --rays 128 --bounces inf --sh-order 2";
    ASSERT_EQ(run(common + " --threads 1 -o a.vdb").status, 0);
    ASSERT_EQ(run(common + " --threads 3 -o b.vdb").status, 0);
    EXPECT_EQ(slurp(folder_ / "a.vdb"), slurp(folder_ / "b.vdb"));
    EXPECT_EQ(read_volume(folder_ / "a.vdb").sh.size(), 9u);
}

TEST_F(ReferenceCli, FourthOrderHasItsGrids) {
    const json document =
        run_json("\"$ROOM\" --resolution 5 --rays 64 --sh-order 4 -o a.vdb -o b.exr");
    EXPECT_EQ(document["sh_order"], 4);
    EXPECT_EQ(document["standard_error"].size(), 25u);
    EXPECT_EQ(read_volume(folder_ / "a.vdb").sh, read_volume(folder_ / "b.exr").sh);
    EXPECT_TRUE(std::filesystem::exists(folder_ / "b_sh_l4_n3.exr"));
}

TEST_F(ReferenceCli, StopsAtTheNoise) {
    const json percent =
        run_json("\"$ROOM\" -o a.vdb --resolution 6 --probes 20 --noise 8% --max-albedo 0.5");
    EXPECT_LE(percent["noise"], 0.08);
    EXPECT_EQ(percent["probes"], 20);
    const Volume volume = read_volume(folder_ / "a.vdb");
    EXPECT_EQ(std::ranges::count(volume.validity, 1.0f), 20);
    EXPECT_EQ(volume.metadata.at("probes"), "20");
    const CliResult cut = run("\"$ROOM\" -o a.vdb --resolution 6 --rays 64 --noise 0.0001");
    EXPECT_EQ(cut.status, 0);
    EXPECT_NE(cut.err.find("cornell_box.gltf: the noise is still"), std::string::npos) << cut.err;
}

TEST_F(ReferenceCli, StopsAtTheTime) {
    const std::string common = "\"$ROOM\" -o a.vdb --resolution 8 --seed 3 ";
    // The first pass is made however little time there is, and no second one.
    const json least = run_json(common + "--time-budget 0.1ms");
    EXPECT_EQ(least["rays"], 256);
    EXPECT_EQ(read_volume(folder_ / "a.vdb").metadata.at("rays"), "256");
    const auto sh = read_volume(folder_ / "a.vdb").sh;
    EXPECT_EQ(run_json(common + "--rays 256 --noise 100%")["rays"], 256);
    EXPECT_EQ(read_volume(folder_ / "a.vdb").sh, sh);
    // Where there is time enough the rest decides.
    EXPECT_EQ(run_json(common + "--time-budget 10min --rays 512")["rays"], 512);
    EXPECT_LE(run_json(common + "--time-budget 10min --noise 30%")["noise"], 0.3);
    // What is left of the noise then is told.
    const CliResult cut = run(common + "--time-budget 0.1ms --noise 0.01%");
    EXPECT_EQ(cut.status, 0);
    EXPECT_NE(cut.err.find("the noise is still"), std::string::npos) << cut.err;
    for (const char* bad : {"0", "-1s", "x", "1d", "h"})
        expect_error(common + "--time-budget=" + bad, cmd::ExitCode::usage, "--time-budget");
}

TEST_F(ReferenceCli, ConfigFileRoundTrips) {
    const std::string given = "\"$ROOM\" -o a.vdb -e e.vdb --cell-size 0.3 --margin 2 --sun 1,2,3"
                              " --no-emitters --sh-order 2 --bounces inf --rays 100 --noise 2%"
                              " --probes 7 --seed 9 --threads 2 --format json";
    const CliResult first = run(given + " --print-config > a.toml; cat a.toml");
    ASSERT_EQ(first.status, 0) << first.err;
    const CliResult second = run("--config a.toml --print-config");
    EXPECT_EQ(second.err, "");
    EXPECT_EQ(second.out, slurp(folder_ / "a.toml"));
    for (const char* line :
         {"noise = 0.02\n", "bounces = \"inf\"\n", "cell-size = 0.3\n", "seed = 9\n"})
        EXPECT_NE(second.out.find(line), std::string::npos) << line << second.out;
}

TEST_F(ReferenceCli, WrongCommandLinesAreRefused) {
    expect_error("", cmd::ExitCode::usage, "no scene");
    expect_error("\"$ROOM\"", cmd::ExitCode::usage, "-o FILE.vdb");
    expect_error("\"$ROOM\" -o a.vdb -e a.vdb", cmd::ExitCode::usage, "given twice");
    expect_error("\"$ROOM\" -o a.vdb -e a.txt", cmd::ExitCode::usage, "a.txt");
    expect_error("\"$ROOM\" -o none/a.vdb", cmd::ExitCode::file, "none/a.vdb");
    expect_error("none.gltf -o a.vdb", cmd::ExitCode::file, "none.gltf");
    for (const char* bad :
         {"--sh-order=3", "--bounces=-1", "--bounces=x", "--bounces=1.5", "--bounces=10001",
          "--rays=-1", "--rays=1e3", "--rays=9999999999", "--noise=0", "--noise=x", "--noise=200%",
          "--noise=%", "--noise=nan", "--probes=-1", "--seed=-1", "--seed=4294967296"})
        expect_error(std::string("\"$ROOM\" -o a.vdb ") + bad, cmd::ExitCode::usage, "");
    expect_error("\"$ROOM\" -o a.vdb --no-scene-lights --no-emitters", cmd::ExitCode::invalid,
                 "--sun");
    expect_error("\"$ROOM\" -o a.vdb --no-emitters --bounces 0", cmd::ExitCode::invalid,
                 "--bounces");
}

TEST_F(ReferenceCli, TakesGridLightAndOrderOfAVolume) {
    run_json("\"$ROOM\" -o a.vdb --resolution 6 --bounds=-1,0,-1,0,2,1 --sky 1:1:1,9"
             " --sh-order 2 --bounces 2 --rays 64");
    const json like = run_json("\"$ROOM\" -o b.vdb --like a.vdb --rays 64");
    EXPECT_EQ(like["bounces"], 2);
    EXPECT_EQ(like["sh_order"], 2);
    EXPECT_EQ(read_volume(folder_ / "b.vdb").sh, read_volume(folder_ / "a.vdb").sh);
    EXPECT_EQ(run_json("\"$ROOM\" -o b.vdb --like a.vdb --rays 64 --bounces 1")["bounces"], 1);
    expect_error("\"$ROOM\" -o b.vdb --like a.vdb --resolution 5", cmd::ExitCode::usage,
                 "exclude each other");
}

} // namespace
} // namespace lpvbake
