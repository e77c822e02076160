// `lpvbake bake --level` from outside, and what the commands make of the files.
#include "cli/run.h"
#include "io/levels.h"

#include <nlohmann/json.hpp>

#include <array>

#include <unistd.h>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

const std::string fine = " --level -0.4,0,-0.4,0.4,0.4,0.4:0.1",
                  around = " --level -1,0,-1,1,2,1:0.2";

class LevelsCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    CliResult bake(const std::string& arguments) {
        return run("bake \"$ROOM\" --quality fast --solver gather -q " + arguments);
    }
    bool exists(const std::string& name) const { return std::filesystem::exists(folder_ / name); }

    TemporaryFolder folder_;
};

TEST_F(LevelsCli, MemoryThatIsNotThereIsToldInTheWordsThatWereGiven) {
    const auto refused = [&](const std::string& levels, const std::string& remedy) {
        expect_one_error(run("bake \"$ROOM\" -o a.vdb --dry-run --solver gather " + levels), levels,
                         ExitCode::memory, remedy);
    };
    refused("--levels 2 --cell-size 0.0018 --focus -1,0,-1,1,2,1",
            "use a larger --cell-size, a smaller --focus or more --levels");
    refused("--level -1,0,-1,1,2,1:0.0018 --level -2,0,-2,2,2,2:0.0036",
            "give a --level larger cells or a smaller box");
    refused("--volume one=-1,0,-1,1,2,1:0.0018",
            "give that --volume larger cells or a smaller box");
}

TEST_F(LevelsCli, BoxesAreThoseOfNodesToo) {
    const auto grids = [&](const std::string& levels) {
        const CliResult result = run("bake \"$ROOM\" -o a.vdb --dry-run --format json " + levels);
        EXPECT_EQ(result.status, 0) << result.err;
        return json::parse(result.out)["levels"];
    };
    const std::string box = "0.05,0,0.05,0.65,0.6,0.65";
    EXPECT_EQ(grids("--levels 2 --cell-size 0.1 --focus 'short*'"),
              grids("--levels 2 --cell-size 0.1 --focus " + box));
    EXPECT_EQ(grids("--level 'short box:0.1' --level room:0.2"),
              grids("--level " + box + ":0.1 --level -1,0,-1,1,2,1:0.2"));
}

TEST_F(LevelsCli, ASetIsAFileALevelAndAManifestInAnyOrder) {
    ASSERT_EQ(bake(fine + around + " -o a.vdb -o e.exr").status, 0);
    ASSERT_EQ(bake(around + fine + " -o b.vdb").status, 0);
    const json manifest = json::parse(slurp(folder_ / "a.levels.json"));
    ASSERT_EQ(manifest["levels"].size(), 2u);
    EXPECT_EQ(manifest["levels"][0]["file"], "a.vdb");
    EXPECT_EQ(manifest["levels"][1]["file"], "a_level1.vdb");
    EXPECT_EQ(manifest["levels"][1]["dims"], json({11, 11, 11}));
    const std::vector<double> box = manifest["levels"][0]["box"];
    for (std::size_t i = 0; i < 6; ++i)
        EXPECT_NEAR(box[i], (std::array{-0.4, 0.0, -0.4, 0.4, 0.4, 0.4}[i]), 1e-9);
    for (const char* level : {".vdb", "_level1.vdb"}) {
        Volume a = read_volume(folder_ / std::string("a").append(level));
        Volume b = read_volume(folder_ / std::string("b").append(level));
        EXPECT_EQ(a.metadata["level_set"], "a.levels.json");
        EXPECT_EQ(a.metadata["level"], level[0] == '.' ? "0" : "1");
        a.metadata.erase("level_set");
        b.metadata.erase("level_set");
        expect_equal(a, b);
    }
    EXPECT_EQ(run("diff a.levels.json b.levels.json").status, 0);
    EXPECT_EQ(run("diff e.levels.json a.levels.json").status, 0);
    EXPECT_EQ(json::parse(run("info a.levels.json --format json").out)["levels"].size(), 2u);
}

TEST_F(LevelsCli, TheCommandsTakeTheManifest) {
    ASSERT_EQ(bake(fine + around + " -o a.vdb").status, 0);
    ASSERT_EQ(run("render \"$ROOM\" a.levels.json -o a.png --size 32x32 --samples 1 -q").status, 0);
    ASSERT_EQ(run("convert a.levels.json b.ktx2").status, 0);
    EXPECT_TRUE(exists("b_level1_sh_l0.ktx2"));
    EXPECT_EQ(run("diff a.levels.json b.levels.json --fail 0.001%").status, 0);
    ASSERT_EQ(run("convert a.levels.json flat.vdb --flatten 0.1").status, 0);
    EXPECT_FALSE(exists("flat.levels.json"));
    const Volume flat = read_volume(folder_ / "flat.vdb"), own = read_volume(folder_ / "a.vdb");
    EXPECT_EQ(flat.grid.dims, glm::ivec3(21));
    // In the middle of the fine box it is the fine level, cell by cell.
    const glm::dvec3 at(0, 0.2, 0.2);
    const auto l0 = [&](const Volume& volume) {
        return volume.sh[0][volume.grid.index(glm::ivec3(volume.grid.to_grid(at)))].x;
    };
    EXPECT_NEAR(l0(flat), l0(own), 1e-5f * l0(own));
    expect_one_error(run("diff flat.vdb a.levels.json"), "diff", ExitCode::usage, "--flatten");
    const CliResult verified = run("verify a.levels.json \"$ROOM\" --points 64 --format json -q");
    ASSERT_EQ(verified.status, 0) << verified.err;
    const json document = json::parse(verified.out);
    EXPECT_EQ(document["levels"].size(), 2u);
    EXPECT_LT(document["verified"]["cells"]["error"].get<double>(), 0.3);
    EXPECT_LT(document["verified"]["surfaces"]["error"].get<double>(), 0.3);
    expect_one_error(run("convert a.levels.json a.vdb"), "convert", ExitCode::usage, "replace");
}

TEST_F(LevelsCli, ClassicPropagationHasCascades) {
    const CliResult result = run("bake \"$ROOM\" --rsm-size 64 --bounces 2 -o a.vdb --fit "
                                 "surfaces"
                                 + fine + around);
    ASSERT_EQ(result.status, 0) << result.err;
    for (const char* text :
         {"choice        lpv", "level 1: 6 maps of 64 x 64", "of them from levels around"})
        EXPECT_NE(result.out.find(text), std::string::npos) << text << '\n' << result.out;
    EXPECT_EQ(read_volume(folder_ / "a.vdb").metadata["solver"], "lpv");
    EXPECT_EQ(run("info a.levels.json").status, 0);
}

TEST_F(LevelsCli, ABakeMeasuresItsLevels) {
    const CliResult result =
        run("bake \"$ROOM\" --quality fast --solver gather --verify 32 -o a.vdb" + fine + around);
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_NE(result.out.find("verified      cells "), std::string::npos) << result.out;
    for (const char* file : {"a.vdb", "a_level1.vdb"})
        EXPECT_TRUE(read_volume(folder_ / file).metadata.contains("verified_surfaces")) << file;
}

TEST_F(LevelsCli, TheOldLevelsStayUntilAllNewOnesAreThere) {
    ASSERT_EQ(bake(fine + around + " -o a.exr").status, 0);
    const std::string old = slurp(folder_ / "a_sh_l0.exr"), set = slurp(folder_ / "a.levels.json");
    // The second level cannot be written.
    std::filesystem::remove(folder_ / "a_level1_sh_l0.exr");
    std::filesystem::create_directory(folder_ / "a_level1_sh_l0.exr");
    EXPECT_NE(bake(fine + around + " --point 0,1,0,5 -o a.exr").status, 0);
    EXPECT_EQ(slurp(folder_ / "a_sh_l0.exr"), old);
    EXPECT_EQ(slurp(folder_ / "a.levels.json"), set);
    std::filesystem::remove(folder_ / "a_level1_sh_l0.exr");
    ASSERT_EQ(bake(fine + around + " --point 0,1,0,5 -o a.exr").status, 0);
    EXPECT_NE(slurp(folder_ / "a_sh_l0.exr"), old);
}

TEST_F(LevelsCli, LevelsOfAFormerBakeAreRemoved) {
    const std::string outermost = " --level -2,-1,-2,2,3,2:0.4";
    for (const char* name : {"a.vdb", "e.exr"})
        ASSERT_EQ(bake(fine + around + outermost + " -o " + name).status, 0);
    spill(folder_ / "a_level3.vdb", "not of the set");
    EXPECT_TRUE(exists("a_level2.vdb") && exists("e_level2.json") && exists("e_level2_sh_l0.exr"));
    for (const char* name : {"a.vdb", "e.exr"})
        ASSERT_EQ(bake(fine + around + " -o " + name).status, 0);
    EXPECT_FALSE(exists("a_level2.vdb") || exists("e_level2.json") || exists("e_level2_sh_l0.exr"));
    EXPECT_TRUE(exists("a_level3.vdb"));
    EXPECT_EQ(run("info e.levels.json").status, 0);
}

TEST_F(LevelsCli, APictureTakesThePlaceOfNoLevel) {
    ASSERT_EQ(bake(fine + around + " -o a.exr").status, 0);
    for (const char* name : {"a_sh_l0.exr", "a_level1_sh_l0.exr"})
        expect_one_error(run(std::string("render \"$ROOM\" a.levels.json -o ") + name), name,
                         ExitCode::usage, "would replace the input");
    EXPECT_EQ(run("info a.levels.json").status, 0);
}

TEST_F(LevelsCli, WhatIsMissingOrForeignIsToldApart) {
    ASSERT_EQ(bake(fine + around + " -o a.vdb").status, 0);
    ASSERT_EQ(bake(fine + around + " --sky '#ffffff,10' -o b.vdb").status, 0);
    std::filesystem::copy_file(folder_ / "b_level1.vdb", folder_ / "a_level1.vdb",
                               std::filesystem::copy_options::overwrite_existing);
    expect_one_error(run("info a.levels.json"), "info", ExitCode::invalid,
                     "a_level1.vdb is of another bake");
    std::filesystem::remove(folder_ / "a_level1.vdb");
    const CliResult missing = run("info a.levels.json");
    expect_one_error(missing, "info", ExitCode::file, "a.levels.json: a_level1.vdb");
    EXPECT_NE(missing.err.find("bake them again"), std::string::npos);
}

TEST_F(LevelsCli, WhatCannotBeNestedIsRefusedBeforeAnyWork) {
    const auto refused = [&](const std::string& arguments, const std::string& why) {
        expect_one_error(run("bake \"$ROOM\" -o a.vdb " + arguments), arguments, ExitCode::usage,
                         why);
        EXPECT_EQ(folder_.count(), 2) << arguments; // stdout and stderr
    };
    refused(fine + " --level -1,0,-1,1,2,1:0.3", "use 0.2 or 0.4");
    refused(fine + " --level 0,0,0,1,2,1:0.2", "levels are nested");
    refused(" --level 1,0,0,-1,2,1:0.2", "x0 above x1");
    refused(" --level 1,0,0,2,2,1", "is not X0,Y0,Z0,X1,Y1,Z1:CELL");
    refused(" --level 'tree*:0.1'", "--level: no node with surfaces");
    refused(" --levels 2 --cell-size 0.1 --focus tree", "--focus: no node with surfaces");
    refused(" --level 0,0,0,1,1,1:0.00001 --level -1,0,-1,1,2,1:0.16384", "cannot be told apart");
    refused(fine + around + " --resolution 32", "--resolution");
    refused(fine + around + " --rsm-samples 4", "--rsm-samples");
    refused(" --level -1e300,0,0,1e300,1,1:1e300 --level 0,0,0,1,1,1:0.5", "above 1e+18 m");
    refused(" --level 0,0,0,1,1,1:1e300", "above 1e+18 m");
    refused(" --level 0,0,0,1,1,1e300:1e299", "above 1e+18 m");
    refused(" --levels 2 --cell-size 0.00001 --focus 0,0,0,1,1,1",
            "--levels: that of 1e-05 m cells, 0,0,0 to 1,1,1, has cells that cannot be told apart");
    refused(fine + around + " -o a.exr", "share the manifest");
    refused(" --levels 2 --focus 0,0,0,1,1,1", "--cell-size");
    refused(" --levels 2 --cell-size 0.1", "--focus");
    expect_one_error(run("bake \"$ROOM\" -o a.glb " + fine + around), "", ExitCode::usage, ".glb");
}

TEST_F(LevelsCli, NoFileOfALevelTakesThePlaceOfAnother) {
    const auto refused = [&](const std::string& arguments, const std::string& why) {
        expect_one_error(bake(fine + around + arguments), arguments, ExitCode::usage, why);
    };
    const std::string lights =
        R"({"lights": [{"type": "point", "intensity": 100, "position": [0, 1, 0]}]})";
    for (const char* name : {"a.levels.json", "a_level1.json"}) {
        spill(folder_ / name, lights);
        refused(std::string(" -o a.exr --lights ") + name, "would replace the input");
        EXPECT_EQ(slurp(folder_ / name), lights);
    }
    refused(" -o a.vdb -o a_level1.vdb", "share files of levels");
    refused(" -o a_level1.vdb -o a.vdb", "share files of levels");
    refused(" -o a.levels.exr -o a.vdb", "share files of levels");
    EXPECT_FALSE(exists("a.vdb"));
    EXPECT_EQ(bake(fine + around + " -o a.nvdb -o a_b.nvdb").status, 0);
}

TEST_F(LevelsCli, MoreCellsThanCanBeCountedNameTheirOption) {
    expect_one_error(bake(" --level -1,0,-1,1,2,1:0.001 -o a.vdb"), "", ExitCode::usage,
                     "--level -1,0,-1,1,2,1:0.001 has more than 2^31 - 1 cells");
    ASSERT_EQ(bake(fine + around + " -o a.nvdb").status, 0);
    expect_one_error(run("convert a.levels.json b.vdb --flatten 1e-5"), "convert", ExitCode::usage,
                     "--flatten 1e-05");
    // 2^31 - 2^25 cells of 148 bytes.
    if (double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGESIZE)) < 256 * 0x1p30)
        expect_one_error(run("convert a.levels.json b.vdb --flatten 0.00156"), "convert",
                         ExitCode::memory, "--flatten 0.00156: the cells take");
}

TEST_F(LevelsCli, ADryRunListsLevelsAroundAFocus) {
    const CliResult result = run("bake \"$ROOM\" --cell-size 0.05 --levels 3 --focus "
                                 "-0.2,0,-0.2,0.2,0.2,0.2 -o a.vdb --dry-run");
    ASSERT_EQ(result.status, 0) << result.err;
    for (const char* text : {"level 0       9 x 5 x 9 samples every 0.05 m", "level 1 ", "level 2 ",
                             "every 0.2 m", "of numbers in a_level2.vdb",
                             "writes        a_level1.vdb", "writes        a.levels.json"})
        EXPECT_NE(result.out.find(text), std::string::npos) << text << '\n' << result.out;
    EXPECT_FALSE(exists("a.vdb"));
}

} // namespace
} // namespace lpvbake
