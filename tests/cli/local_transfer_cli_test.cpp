// `lpvbake bake --local-transfer` and `lpvbake render --relight lrt` from outside.
#include "cli/run.h"
#include "lpvbake/file.h"
#include "volume/grids.h"

#include <nlohmann/json.hpp>

#include <cmath>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

class LocalTransferCli : public ::testing::Test {
protected:
    void SetUp() override {
        if (run("devices").status == int(ExitCode::device))
            GTEST_SKIP() << "no Vulkan device";
    }
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    CliResult bake(const std::string& arguments) {
        return run("bake --resolution 12 --quality fast --solver gather -q " + arguments);
    }
    json relit(const std::string& arguments) {
        const CliResult result = run("render \"$ROOM\" a.vdb --relight lrt --size 16x12 --samples "
                                     "1 --format json "
                                     + arguments);
        EXPECT_EQ(result.status, 0) << result.err;
        return result.status == 0 ? json::parse(result.out) : json();
    }

    TemporaryFolder folder_;
};

TEST_F(LocalTransferCli, OperatorsAreGridsOfTheVolume) {
    ASSERT_EQ(bake("\"$ROOM\" -o a.vdb -o a.exr --local-transfer cells --radius 0.6").status, 0);
    const Volume volume = read_volume(folder_ / "a.vdb");
    EXPECT_EQ(volume.metadata.at("local_radius"), "0.6");
    const json info = json::parse(run("info a.vdb --format json").out);
    std::vector<std::string> names;
    for (const json& grid : info["grids"])
        names.push_back(grid["name"]);
    for (const char* name :
         {"local_transfer_l0_l0", "local_transfer_l1_y_l0", "local_transfer_l1_x_l1_x",
          "local_visibility_l0", "local_visibility_l2_x2y2"})
        EXPECT_EQ(std::ranges::count(names, name), 1) << name;
    EXPECT_EQ(run("diff a.vdb a.exr").status, 0);
    // A dry run knows of them.
    const CliResult dry = bake("\"$ROOM\" --local-transfer cells --radius 0.6 --dry-run --format "
                               "json -o a.vdb");
    EXPECT_NE(dry.out.find("\"local transfer\""), std::string::npos) << dry.err;
}

TEST_F(LocalTransferCli, LightsChangeWithoutABake) {
    ASSERT_EQ(bake("\"$ROOM\" -o a.vdb --local-transfer cells --radius 0.6").status, 0);
    const json once = relit("-o a.exr --show indirect");
    EXPECT_GT(once["relight"]["iterations"], 3);
    EXPECT_LT(once["relight"]["missing"], 1e-3);
    EXPECT_EQ(once["warnings"], json::array());
    const std::string bytes = slurp(folder_ / "a.exr");
    relit("-o a.exr --show indirect --threads 1");
    EXPECT_EQ(slurp(folder_ / "a.exr"), bytes);
    // Light is linear, and twice the lamps are no other scene.
    const json twice = relit("-o a.exr --show indirect --no-emitters --light-scale '*=2'");
    const json lamps = relit("-o a.exr --show indirect --no-emitters");
    EXPECT_EQ(twice["warnings"], json::array());
    EXPECT_NEAR(double(twice["mean_luminance"]) / double(lamps["mean_luminance"]), 2.0, 1e-3);
    EXPECT_LT(lamps["mean_luminance"], once["mean_luminance"]);
    EXPECT_EQ(relit("-o a.exr --iterations 2")["relight"]["iterations"], 2);
}

TEST_F(LocalTransferCli, ObjectsLieOnOneLattice) {
    ASSERT_EQ(run("bake \"$ROOM\" --bounds -0.4,0,-0.4,0.4,0.4,0.4 -q -o a.vdb --cell-size 0.25 "
                  "--solver gather --quality fast --local-transfer object --radius 0.5")
                  .status,
              0);
    const Grid grid = read_volume(folder_ / "a.vdb").grid;
    EXPECT_EQ(grid.origin, glm::dvec3(-1, -0.5, -1));
    EXPECT_EQ(grid.dims, glm::ivec3(8, 6, 8));
}

TEST_F(LocalTransferCli, TellsWhatItDoesNotServe) {
    expect_one_error(run("render \"$ROOM\" a.vdb -o a.png --relight lrt --indirect rsm:4"), "both",
                     ExitCode::usage, "exclude each other");
    const auto expect_error = [&](const std::string& arguments, ExitCode code,
                                  const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    };
    const std::string bake_room = "bake \"$ROOM\" -o b.vdb --local-transfer ";
    expect_error("bake \"$ROOM\" -o b.vdb --radius 1", ExitCode::usage, "--local-transfer");
    expect_error(bake_room + "object --radius 1", ExitCode::usage, "--cell-size");
    expect_error(bake_room + "cells --radius 1 --adaptive 0.25..0.5", ExitCode::usage,
                 "--adaptive");
    ASSERT_EQ(bake("\"$ROOM\" -o plain.vdb").status, 0);
    expect_error("render \"$ROOM\" plain.vdb -o p.png --relight lrt", ExitCode::invalid,
                 "plain.vdb: the volume has no operators of light; bake it with --local-transfer");
    expect_error("render \"$ROOM\" plain.vdb -o p.png --iterations 3", ExitCode::usage,
                 "--relight");
    ASSERT_EQ(run("bake \"$ROOM\" -o set.vdb --cell-size 0.4 --levels 2 --focus "
                  "-0.4,0,-0.4,0.4,0.4,0.4 -q --solver gather --quality fast --local-transfer "
                  "cells --radius 0.8")
                  .status,
              0);
    expect_error("render \"$ROOM\" set.levels.json -o p.png --relight lrt", ExitCode::unsupported,
                 "set.levels.json: --relight lrt is of one volume");
    EXPECT_EQ(run("render \"$ROOM\" set_level1.vdb -o p.png --relight lrt --size 16x12").status, 0);
}

} // namespace
} // namespace lpvbake
