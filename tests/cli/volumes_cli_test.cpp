// `lpvbake bake --volume` from outside, and what the commands make of the files.
#include "cli/run.h"
#include "io/levels.h"

#include <nlohmann/json.hpp>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

const std::string low = " --volume low=-1,0,-1,1,1,1:0.25",
                  high = " --volume high=-1,1,-1,1,2,1:0.5";

class VolumesCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    CliResult bake(const std::string& arguments) {
        return run("bake \"$ROOM\" --quality fast -q " + arguments);
    }
    void expect_refused(const std::string& arguments, const std::string& text) {
        expect_one_error(bake(arguments), arguments, ExitCode::usage, text);
    }
    bool exists(const std::string& name) const { return std::filesystem::exists(folder_ / name); }

    TemporaryFolder folder_;
};

TEST_F(VolumesCli, EachIsAFileAndTheManifestListsThem) {
    ASSERT_EQ(bake(low + high + " -o a.vdb -o e.exr").status, 0);
    const json manifest = json::parse(slurp(folder_ / "a.volumes.json"));
    ASSERT_EQ(manifest["volumes"].size(), 2u);
    EXPECT_EQ(manifest["volumes"][0]["file"], "a_low.vdb");
    EXPECT_EQ(manifest["volumes"][1]["file"], "a_high.vdb");
    EXPECT_EQ(manifest["volumes"][1]["falloff"], 0.5);
    const Volume volume = read_volume(folder_ / "a_high.vdb");
    EXPECT_EQ(volume.metadata.at("volume"), "high");
    EXPECT_EQ(volume.metadata.at("volume_set"), "a.volumes.json");
    EXPECT_EQ(volume.grid.dims, glm::ivec3(4, 2, 4));
    EXPECT_EQ(run("diff e.volumes.json a.volumes.json").status, 0);
    EXPECT_EQ(json::parse(run("info a.volumes.json --format json").out)["volumes"][0]["name"],
              "low");
    EXPECT_NE(run("info a.volumes.json").out.find("volume high"), std::string::npos);
    ASSERT_EQ(run("render \"$ROOM\" a.volumes.json -o a.png --size 32x32 --samples 1 -q").status,
              0);
    ASSERT_EQ(run("convert a.volumes.json b.ktx2").status, 0);
    EXPECT_TRUE(exists("b_high_sh_l0.ktx2"));
    EXPECT_EQ(run("diff b.volumes.json a.volumes.json --fail 0.001%").status, 0);

    expect_one_error(run("convert a.volumes.json f.vdb --flatten 0.1"), "convert",
                     ExitCode::unsupported, "nested levels");
    expect_one_error(run("convert a.volumes.json a.vdb"), "convert", ExitCode::usage, "replace");
    const CliResult verified = run("verify a.volumes.json \"$ROOM\" --points 32 -q --format json");
    ASSERT_EQ(verified.status, 0) << verified.err;
    EXPECT_EQ(json::parse(verified.out)["levels"].size(), 2u);
    EXPECT_LT(json::parse(verified.out)["verified"]["cells"]["error"], 0.5);
    expect_one_error(run("diff a.volumes.json a_low.vdb"), "diff", ExitCode::usage,
                     "set of volumes");
    std::filesystem::remove(folder_ / "a_high.vdb");
    expect_one_error(run("info a.volumes.json"), "info", ExitCode::file, "a_high.vdb");
}

TEST_F(VolumesCli, WhatAFormerBakeLeftGoes) {
    ASSERT_EQ(bake(low + high + " -o a.exr").status, 0);
    ASSERT_TRUE(exists("a_high.json"));
    spill(folder_ / "a_mine.exr", "not ours");
    ASSERT_EQ(bake(low + " --volume other=-1,1,-1,1,2,1:0.5 -o a.exr").status, 0);
    EXPECT_FALSE(exists("a_high.json"));
    EXPECT_FALSE(exists("a_high_sh_l0.exr"));
    EXPECT_TRUE(exists("a_other.json"));
    EXPECT_TRUE(exists("a_mine.exr"));
}

TEST_F(VolumesCli, TurnedBoxesAreBakedAndRead) {
    spill(folder_ / "turned.json", R"({"volumes": [
        {"name": "all", "box": [-1, 0, -1, 1, 2, 1], "cell": 0.25},
        {"name": "turned", "box": [-0.5, 0.5, -0.5, 0.5, 1.5, 0.5], "cell": 0.2, "priority": 1,
         "rotation": [0, 0.25881905, 0, 0.96592583]}]})");
    ASSERT_EQ(bake("--volumes turned.json -o a.vdb -o e.exr").status, 0);
    const json manifest = json::parse(slurp(folder_ / "a.volumes.json"));
    EXPECT_EQ(manifest["volumes"][0]["name"], "turned");
    EXPECT_NEAR(double(manifest["volumes"][0]["turn"][1]), 0.25881905, 1e-7);
    EXPECT_EQ(manifest["volumes"][1]["turn"], json({0.0, 0.0, 0.0, 1.0}));
    EXPECT_EQ(run("diff a.volumes.json e.volumes.json").status, 0);
    EXPECT_NE(run("info a_turned.vdb").out.find("0.965926), 30 degrees"), std::string::npos)
        << run("info a_turned.vdb").out;
    ASSERT_EQ(run("render \"$ROOM\" a.volumes.json -o a.png --size 32x32 --samples 1 -q").status,
              0);
    const CliResult verified = run("verify a.volumes.json \"$ROOM\" --points 32 -q --format json");
    ASSERT_EQ(verified.status, 0) << verified.err;
    EXPECT_LT(json::parse(verified.out)["verified"]["cells"]["error"], 0.5);
    EXPECT_EQ(run("info a_turned.vdb --slice y=2 -o slice.png").status, 0);
    ASSERT_EQ(run("convert a_turned.vdb u.exr --axes unreal").status, 0);
    ASSERT_EQ(run("convert u.exr b.vdb").status, 0);
    EXPECT_EQ(run("diff b.vdb a_turned.vdb --fail 0.01%").status, 0);
    expect_refused("--volumes turned.json -o b.exr --target threejs", "is turned");
}

TEST_F(VolumesCli, RoomsAreFoundAndNodesTaken) {
    const CliResult planned = bake("--volumes auto --cell-size 0.25 -o p.vdb --dry-run");
    ASSERT_EQ(planned.status, 0) << planned.err;
    EXPECT_NE(planned.out.find("volume        room1,"), std::string::npos) << planned.out;
    EXPECT_NE(planned.out.find("p_room1.vdb"), std::string::npos) << planned.out;
    ASSERT_EQ(bake("--volumes auto --volume more=-1,0,-1,1,1,1 --cell-size 0.25 -o a.vdb").status,
              0);
    EXPECT_TRUE(exists("a_room1.vdb"));
    EXPECT_TRUE(exists("a_more.vdb"));
    expect_refused("--volumes nodes:nobody -o a.vdb", "no node fits");
}

TEST_F(VolumesCli, AFileHasPriorities) {
    spill(folder_ / "rooms.json", R"({"volumes": [
        {"name": "all", "box": [-1, 0, -1, 1, 2, 1]},
        {"name": "low", "box": [-1, 0, -1, 1, 1, 1], "priority": 2, "falloff": 0.1, "cell": 0.25}]})");
    ASSERT_EQ(bake("--volumes rooms.json --resolution 6 -o a.exr --target threejs").status, 0);
    const json manifest = json::parse(slurp(folder_ / "a.volumes.json"));
    EXPECT_EQ(manifest["volumes"][0]["name"], "low");
    EXPECT_EQ(manifest["volumes"][0]["priority"], 2);
    EXPECT_EQ(manifest["volumes"][0]["falloff"], 0.1);
    EXPECT_NEAR(double(manifest["volumes"][1]["cell"]), 2.0 / 6, 1e-9);
    EXPECT_TRUE(exists("a_low.json"));
    EXPECT_TRUE(exists("a_all_atlas.exr"));
    // The dry run tells of all of them.
    const CliResult planned =
        bake("--volumes rooms.json --resolution 6 -o p.exr --target threejs --dry-run");
    for (const char* text :
         {"volume        low, 8 x 4 x 8 cells", "p_all_atlas.exr", "p.volumes.json"})
        EXPECT_NE(planned.out.find(text), std::string::npos) << text << "\n" << planned.out;
    expect_refused("--volumes rooms.json -o b.ktx2 --target bevy", "\"all\" overlaps \"low\"");
    expect_one_error(bake("--volumes gone.json -o a.vdb"), "bake", ExitCode::file, "gone.json");
}

TEST_F(VolumesCli, WhatCannotBeIsRefused) {
    expect_refused("--volume low -o a.vdb", "is not NAME=");
    expect_refused("--volume low=0,0,0,1,1 -o a.vdb", "0,0,0,1,1");
    expect_refused("--volume low=0,0,0,1,1,1:x -o a.vdb", "size of cells");
    expect_refused("--volume a/b=0,0,0,1,1,1 -o a.vdb", "a/b");
    expect_refused(low + low + " -o a.vdb", "twice");
    expect_refused(low + " -o a.glb", "one light volume");
    expect_refused(low + " --bounds 0,0,0,1,1,1 -o a.vdb", "--bounds");
    expect_refused(low + " --solver lpv -o a.vdb", "--volume");
    std::string many;
    for (int i = 0; i < 33; ++i)
        many.append(" --volume v").append(std::to_string(i)).append("=0,0,0,1,1,1:0.5");
    expect_refused(many + " -o a.exr --target vrc", "32 volumes");
    std::string boxes = R"({"volumes": [)";
    for (int i = 0; i < 100000; ++i)
        boxes.append(i ? "," : "")
            .append(R"({"name":"v)")
            .append(std::to_string(i))
            .append(R"(","box":[0,0,0,1,1,1]})");
    spill(folder_ / "many.json", boxes + "]}");
    const CliResult too_many = bake("--volumes many.json -o a.vdb");
    EXPECT_NE(too_many.status, 0);
    EXPECT_NE(too_many.err.find("100000 volumes are more than 256"), std::string::npos)
        << too_many.err;
    const CliResult apart =
        run("bake \"$ROOM\" --quality fast --volume far=9,9,9,10,10,10:0.5" + low + " -o a.vdb");
    EXPECT_EQ(apart.status, 0);
    EXPECT_NE(apart.err.find("far does not meet"), std::string::npos) << apart.err;
}

} // namespace
} // namespace lpvbake
