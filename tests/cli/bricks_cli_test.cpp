// `lpvbake bake --adaptive` from outside, and what the commands make of the files.
#include "cli/run.h"
#include "io/levels.h"

#include <nlohmann/json.hpp>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

class BricksCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    CliResult bake(const std::string& arguments) {
        return run("bake \"$ROOM\" --quality fast -q " + arguments);
    }
    bool exists(const std::string& name) const { return std::filesystem::exists(folder_ / name); }

    TemporaryFolder folder_;
};

TEST_F(BricksCli, BricksAreSparseLevelsOrAnAtlasAndAManifest) {
    ASSERT_EQ(bake("--adaptive 0.1..0.2 --max-size 2M -o a.vdb -o e.exr").status, 0);
    const json manifest = json::parse(slurp(folder_ / "a.levels.json"));
    EXPECT_EQ(manifest["format"], "lpvbake bricks");
    ASSERT_EQ(manifest["levels"].size(), 2u);
    EXPECT_EQ(manifest["levels"][1]["file"], "a_level1.vdb");
    for (const char* file : {"a.vdb", "a_level1.vdb", "e_atlas.json", "e_bricks.exr"})
        EXPECT_TRUE(exists(file)) << file;
    // Both are one field.
    EXPECT_EQ(run("diff a.levels.json e.levels.json --fail 0").status, 0);
    const CliResult info = run("info a.levels.json");
    EXPECT_NE(info.out.find("level 0 "), std::string::npos) << info.out;
    EXPECT_NE(info.out.find("bricks_error"), std::string::npos) << info.out;
    ASSERT_EQ(run("convert a.levels.json flat.vdb --flatten 0.1").status, 0);
    ASSERT_EQ(run("convert a.levels.json b.exr").status, 0);
    EXPECT_EQ(run("diff a.levels.json b.levels.json --fail 0").status, 0);
    EXPECT_EQ(run("render \"$ROOM\" e.levels.json -o a.png --size 32x24 --samples 1 -q").status, 0);
    // As files they are no larger than what was asked for.
    for (const char stem : {'a', 'e'}) {
        uintmax_t bytes = 0;
        for (const auto& file : std::filesystem::directory_iterator(folder_.path()))
            if (file.path().filename().string()[0] == stem && file.path().extension() != ".png")
                bytes += file.file_size();
        EXPECT_LT(bytes, 2u << 20) << stem;
        EXPECT_GT(bytes, 1u << 18) << stem;
    }
    expect_one_error(run("convert a.levels.json c.vdb --target unity"), "convert", ExitCode::usage,
                     "--flatten");
    expect_one_error(run("convert a.levels.json c.tres"), "convert", ExitCode::usage,
                     "bricks are written as");
}

TEST_F(BricksCli, BricksAreVerifiedAsTheFieldThatTheyAre) {
    ASSERT_EQ(run("bake \"$ROOM\" -q --adaptive 0.1..0.2 --error 0.5% -o a.vdb").status, 0);
    ASSERT_EQ(run("bake \"$ROOM\" --solver gather --cell-size 0.1 -o dense.vdb -q").status, 0);
    const auto verified = [&](const std::string& arguments) {
        const CliResult result = run("verify " + arguments + " --points 300 --format json");
        EXPECT_EQ(result.status, 0) << result.err;
        return json::parse(result.out);
    };
    const json bricks = verified("a.levels.json \"$ROOM\""), grid = verified("dense.vdb \"$ROOM\"");
    EXPECT_EQ(bricks["levels"].size(), 2u);
    for (const char* where : {"cells", "surfaces"}) {
        EXPECT_LT(bricks["verified"][where]["error"], 0.15) << where;
        EXPECT_LT(std::abs(double(bricks["verified"][where]["error"])
                           - double(grid["verified"][where]["error"])),
                  0.04)
            << where;
    }
    // In a box alone.
    for (const json& worst :
         verified("a.levels.json \"$ROOM\" --bounds 0,0,-1,1,2,1")["verified"]["worst"])
        EXPECT_GE(double(worst["position"][0]), 0.0);
}

TEST_F(BricksCli, OtherBricksAreComparedFlattened) {
    ASSERT_EQ(bake("--adaptive 0.2..0.2 -o a.vdb").status, 0);
    ASSERT_EQ(bake("--adaptive 0.1..0.1 -o b.vdb").status, 0);
    expect_one_error(run("diff a.levels.json b.levels.json"), "diff", ExitCode::invalid,
                     "have not the same bricks");
}

TEST_F(BricksCli, WhatCannotBeIsRefusedBeforeAnyWork) {
    const auto refused = [&](const std::string& arguments, const std::string& why) {
        expect_one_error(run("bake \"$ROOM\" " + arguments), arguments, ExitCode::usage, why);
        EXPECT_EQ(folder_.count(), 2) << arguments; // stdout and stderr
    };
    refused("-o a.vdb --adaptive 0.2..0.1", "--adaptive 0.2..0.1 begins with the larger cells");
    refused("-o a.vdb --adaptive 0.1..0.3", "use 0.1..0.2 or 0.1..0.4");
    refused("-o a.vdb --adaptive 0.001..1.024", "levels, more than 8");
    refused("-o a.vdb --adaptive 0.1..25.6", "levels, more than 8");
    refused("-o a.vdb --adaptive 0.1..1.6", "larger than the box of");
    refused("-o a.vdb --adaptive 0.1", "is not FINE..COARSE");
    refused("-o a.vdb --adaptive 0.1..-1", "is not FINE..COARSE");
    refused("-o a.vdb --adaptive 0.1..0.2 --solver sn", "--adaptive is an option of gather");
    refused("-o a.vdb --adaptive 0.1..0.2 --solver lpv", "--adaptive is an option of gather");
    refused("-o a.glb --adaptive 0.1..0.2", "bricks are written as");
    refused("-o a.vdb --adaptive 0.1..0.2 --max-size 100", "--max-size: the");
    refused("-o a.vdb --max-size 1M", "--adaptive");
    refused("-o a.vdb --adaptive 0.1..0.2 --target unity", "--target");
    refused("-o a.vdb -o a.exr --adaptive 0.1..0.2", "share the manifest");
}

TEST_F(BricksCli, ADryRunStatesAnEstimate) {
    const CliResult result = run("bake \"$ROOM\" --adaptive 0.1..0.2 -o a.vdb -o e.exr --dry-run");
    ASSERT_EQ(result.status, 0) << result.err;
    for (const char* text :
         {"2 levels of 0.1 to 0.2 m", "of numbers in each output", "writes        a_level1.vdb",
          "writes        e_atlas_sh_l0.exr", "writes        e_bricks.exr",
          "writes        e.levels.json", "memory "})
        EXPECT_NE(result.out.find(text), std::string::npos) << text << '\n' << result.out;
    EXPECT_FALSE(exists("a.vdb"));
}

TEST_F(BricksCli, TheSameBytesWhateverTheThreads) {
    ASSERT_EQ(bake("--adaptive 0.1..0.2 --threads 1 -o a.vdb").status, 0);
    ASSERT_EQ(bake("--adaptive 0.1..0.2 -o b.vdb").status, 0);
    EXPECT_EQ(run("diff a.levels.json b.levels.json --fail 0").status, 0);
    EXPECT_NE(run("diff a.levels.json b.levels.json").out.find("identical"), std::string::npos);
}

} // namespace
} // namespace lpvbake
