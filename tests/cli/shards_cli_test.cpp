// `lpvbake light`, `bake --lit --shard` and `merge` from outside.
#include "cli/run.h"
#include "io/stored.h"
#include "io/vdb.h"

#include <nlohmann/json.hpp>

#include <filesystem>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

namespace fs = std::filesystem;

/// A box of 24 x 24 x 116 cells around the Cornell box, open to the sky beyond it: 8 zones along z.
const std::string long_box = "$ROOM --bounds -1,0,-4.8,1,2,4.8 --margin 0 --cell-size 0.0834 "
                             "--quality fast --sky '#8090ff,20' ";
const std::string gather = long_box + "--solver gather ";
const std::string sn = long_box + "--solver sn --tile 16 ";

class ShardsCli : public ::testing::Test {
protected:
    void SetUp() override { fs::create_directory(folder_ / "merged"); }

    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    void must(const std::string& arguments) {
        const CliResult result = run(arguments);
        ASSERT_EQ(result.status, 0) << arguments << "\n" << result.err;
    }
    /// "other.gltf", the Cornell box with a lamp that is brighter.
    void write_brighter_room() {
        std::string scene = slurp(std::string(LPVBAKE_EXAMPLES) + "/cornell_box.gltf");
        const std::size_t at = scene.find("\"intensity\"");
        ASSERT_NE(at, std::string::npos);
        scene.insert(scene.find_first_of("0123456789", at), 1, '1');
        spill(folder_ / "other.gltf", scene);
    }
    /// Bakes parts "p1" to "pN".
    void bake_parts(const std::string& bake, int count, const std::string& more = "") {
        for (int i = 1; i <= count; ++i)
            must("bake " + bake + "-o p" + std::to_string(i) + " --shard " + std::to_string(i) + "/"
                 + std::to_string(count) + " " + more);
    }
    static std::string parts(int count, const std::string& ending = "") {
        std::string names;
        for (int i = count; i >= 1; --i)
            names.append("p").append(std::to_string(i)).append(ending).append(" ");
        return names;
    }
    /// Whether all files that the bake wrote as "whole*" are the same in merged/.
    void expect_same_files() {
        std::size_t files = 0;
        for (const auto& entry : fs::directory_iterator(folder_.path()))
            if (const std::string name = entry.path().filename(); name.starts_with("whole")) {
                EXPECT_TRUE(slurp(folder_ / name) == slurp(folder_ / ("merged/" + name))) << name;
                ++files;
            }
        EXPECT_GT(files, 10u);
    }

    TemporaryFolder folder_;
};

TEST_F(ShardsCli, MergedPartsOfGatherAreTheBakeToTheByte) {
    must("bake " + gather + "-o whole.vdb -o whole.exr");
    for (const int count : {1, 2, 3, 7}) {
        bake_parts(gather, count, count == 3 ? "--threads 3" : "--threads 1");
        must("merge " + parts(count) + "-o merged/whole.vdb -o merged/whole.exr");
        expect_same_files();
    }
}

TEST_F(ShardsCli, MergedPartsOfSnInTilesAreTheBakeToTheByte) {
    must("bake " + sn + "-o whole.vdb -o whole.exr");
    must("light " + sn + "-o room.lit");
    for (const int count : {1, 2, 3, 7}) {
        bake_parts(sn, count, count % 2 == 1 ? "--lit room.lit" : "");
        must("merge " + parts(count) + "-o merged/whole.vdb -o merged/whole.exr");
        expect_same_files();
    }
}

/// A border of zones goes through the blocks of the room, where cells are interpolated on one side
/// by those of the other: parts have to know 16 layers beyond their own (solver/gather/gather.cpp);
/// 8 give other bytes.
TEST_F(ShardsCli, APartKnowsAllThatItsCellsAreMadeFrom) {
    const std::string room = "$ROOM --bounds -1,0,-1.6,1,2,1.6 --margin 0 --cell-size 0.0667 "
                             "--sky '#8090ff,20' --solver gather --tolerance 0.6 ";
    must("bake " + room + "-o whole.vdb");
    bake_parts(room, 3);
    must("merge " + parts(3) + "-o merged/whole.vdb");
    EXPECT_TRUE(slurp(folder_ / "whole.vdb") == slurp(folder_ / "merged/whole.vdb"));
}

TEST_F(ShardsCli, TheWidthOfTheDriversVectorsChangesNoByte) {
    const auto narrow = [&](const std::string& arguments) {
        const CliResult result = run_lpvbake(folder_, arguments, "LP_NATIVE_VECTOR_WIDTH=128");
        ASSERT_EQ(result.status, 0) << arguments << "\n" << result.err;
    };
    must("bake " + gather + "-o p1 --shard 1/2");
    must("bake " + gather + "-o whole.vdb");
    narrow("bake " + gather + "-o p2 --shard 2/2");
    narrow("bake " + gather + "-o other.vdb");
    EXPECT_TRUE(slurp(folder_ / "whole.vdb") == slurp(folder_ / "other.vdb"));
    must("merge p1 p2 -o other.vdb");
    EXPECT_TRUE(slurp(folder_ / "whole.vdb") == slurp(folder_ / "other.vdb"));
    must("bake " + sn + "-o whole.vdb");
    narrow("bake " + sn + "-o other.vdb");
    EXPECT_TRUE(slurp(folder_ / "whole.vdb") == slurp(folder_ / "other.vdb"));
}

TEST_F(ShardsCli, APlanOfAShardNamesItsFileAndTakesLessMemory) {
    const auto plan = [&](const std::string& more) {
        return json::parse(run("bake " + gather + more + " --dry-run --format json").out);
    };
    const json part = plan("-o part --shard 2/7");
    EXPECT_EQ(part["outputs"][0]["files"][0]["path"], "part");
    EXPECT_EQ(part["shard"], (json{{"index", 2}, {"count", 7}, {"z", {16, 31}}}));
    const json all = plan("-o a.vdb");
    EXPECT_LT(part["host_bytes"].get<double>(), all["host_bytes"].get<double>());
    // Surfaces that are lit already are but read.
    must("light " + gather + "-o room.lit");
    const json lit = plan("-o a.vdb --lit room.lit");
    const auto lighting = [](const json& of) {
        for (const json& stage : of["stages"])
            if (stage["name"] == "lighting")
                return stage["seconds"].get<double>();
        return -1.0;
    };
    EXPECT_GE(lighting(lit), 0);
    EXPECT_LT(lighting(lit), 0.2 * lighting(all));
    EXPECT_LT(lit["host_bytes"].get<double>(), all["host_bytes"].get<double>());
}

TEST_F(ShardsCli, HalfPrecisionIsThatOfTheBake) {
    must("bake " + gather + "-o whole.vdb --precision half");
    bake_parts(gather, 2);
    must("merge p1 p2 -o merged/whole.vdb --precision half");
    const Volume whole = io::read_vdb(folder_ / "whole.vdb");
    const Volume merged = io::read_vdb(folder_ / "merged/whole.vdb");
    EXPECT_EQ(merged.sh, whole.sh);
    EXPECT_FALSE(merged.metadata.contains("bake_hash"));
    EXPECT_EQ(merged.walls, whole.walls);
    EXPECT_EQ(merged.metadata.at("output_settings"), whole.metadata.at("output_settings"));
}

TEST_F(ShardsCli, APartIsAVolumeWhereItLies) {
    must("bake " + gather + "-o whole.vdb");
    bake_parts(gather, 3);
    fs::rename(folder_ / "p2", folder_ / "p2.vdb");
    const Volume whole = io::read_vdb(folder_ / "whole.vdb");
    const Volume part = io::read_vdb(folder_ / "p2.vdb");
    const auto first = std::size_t(std::lround(whole.grid.to_grid(part.grid.origin).z));
    EXPECT_EQ(part.grid.dims.x, whole.grid.dims.x);
    EXPECT_EQ(first % 16, 0u);
    for (std::size_t i = 0; i < part.grid.size(); i += 97)
        ASSERT_EQ(part.sh[0][i], whole.sh[0][whole.grid.index({0, 0, int(first)}) + i]) << i;
    const json info = json::parse(run("info p2.vdb --format json").out);
    EXPECT_EQ(info["metadata"]["shard"], "2/3");
}

TEST_F(ShardsCli, WhatIsNotAllOfOneBakeIsRefusedByName) {
    bake_parts(gather, 4);
    const auto refused = [&](const std::string& names, const std::string& why) {
        const std::string merge = "merge " + names + " -o merged/all.vdb";
        expect_one_error(run(merge), merge, ExitCode::invalid, why);
        EXPECT_FALSE(fs::exists(folder_ / "merged/all.vdb"));
    };
    refused("p1 p2 p4", "shard 3 of 4 (z 64 to 95) is missing: bake it with --shard 3/4");
    refused("p2 p3 p4", "shard 1 of 4 (z 0 to 31) is missing");
    refused("p1 p2 p3", "shard 4 of 4 (z 96 to 115) is missing");
    refused("p4 p1", "shard 2 of 4 (from z 32 on) is missing");
    refused("p1 p2 p3 p4 p2", "p2: is given twice; leave one of them out");
    fs::copy(folder_ / "p2", folder_ / "second");
    refused("p1 p2 p3 p4 second", "second: is shard 2 of 4, and so is p2");
    must("bake " + gather + "-o third --shard 3/7");
    refused("p1 p2 third p4", "third: is shard 3 of 7, and p1 is of 4");
    must("bake " + gather + "--vpls 100 -o third --shard 3/4");
    refused("p1 p2 third p4", "third: is of other settings than p1: vpls = 100, not none such");
    must("bake " + gather + "--isa sse2 -o third --shard 3/4");
    refused("p1 p2 third p4", "third: is of another instruction set or device for rays than p1");
    must("bake " + gather + "-o whole.vdb");
    refused("p1 p2 whole.vdb p4", "whole.vdb: is no part of a bake");
    write_brighter_room();
    must("bake other.gltf" + gather.substr(5) + "-o third --shard 3/4");
    refused("p1 p2 third p4", "third: is of another scene than p1");
    // As another version, device or cut of the grid would have written it.
    const auto changed = [&](const std::string& key, const std::string& to) {
        Volume part = io::read_vdb(folder_ / "p3");
        ASSERT_TRUE(part.metadata.contains(key)) << key;
        part.metadata[key] = to;
        const std::string path = folder_ / "third";
        io::write_vdb(path, io::Stored(part, {}, path), Precision::full);
    };
    changed("tool", "lpvbake 0.0.1");
    refused("p1 p2 third p4", "third: is of another version of the program than p1: ");
    changed("device", "another card");
    refused("p1 p2 third p4", "third: is of another device than p1: ");
    changed("shard_layers", "48,80");
    refused("p1 p2 third p4", "third: has the layers from 48 on, not from 64 on");
    changed("shard_layers", "80,112");
    refused("p1 p2 third p4", "third: has the layers from 80 on, not from 64 on");
    changed("shard_layers", "64,98");
    refused("p1 p2 third p4", "third: is no part of a bake any more");
    std::string bytes = slurp(folder_ / "p3");
    bytes[bytes.size() / 2] ^= 1;
    spill(folder_ / "third", bytes);
    refused("p1 p2 third p4", "third: is damaged");
    spill(folder_ / "third", slurp(folder_ / "p3").substr(0, 5000));
    refused("p1 p2 third p4", "third: is damaged");
    fs::copy(folder_ / "p3", folder_ / "p3.vdb");
    must("convert p3.vdb half.vdb --precision half");
    refused("p1 p2 half.vdb p4", "half.vdb: is no part of a bake any more");
    expect_one_error(run("merge p1 p2 p3 p4 -o a.tres"), "a.tres", ExitCode::usage,
                     "a.tres: holds light as Godot has it; merge to another kind");
    const std::string gone = "merge p1 nothing -o merged/all.vdb";
    expect_one_error(run(gone), gone, ExitCode::file, "nothing");
}

TEST_F(ShardsCli, LitSurfacesOfSomethingElseAreRefusedByName) {
    must("light " + gather + "-o room.lit");
    write_brighter_room();
    const std::string bytes = slurp(folder_ / "room.lit");
    const auto refused = [&](const std::string& bake, const std::string& why) {
        const std::string all = "bake " + bake + "--lit room.lit -o p1 --shard 1/2";
        expect_one_error(run(all), all, ExitCode::invalid, "room.lit: " + why);
        EXPECT_FALSE(fs::exists(folder_ / "p1"));
    };
    refused("other.gltf" + gather.substr(5), "is of another scene");
    refused(gather + "--vpls 100 ", "is of other settings: none such, not vpls = 100");
    refused(gather + "--isa sse2 ", "is of another instruction set or device for rays");
    for (const std::size_t at : {bytes.size() / 3, bytes.size() - 1}) {
        std::string other = bytes;
        other[at] ^= 1;
        spill(folder_ / "room.lit", other);
        refused(gather, "is damaged or cut off");
    }
    for (const std::size_t size : {std::size_t(0), std::size_t(9), bytes.size() / 2}) {
        spill(folder_ / "room.lit", bytes.substr(0, size));
        refused(gather, size == 0 ? "is no file of lit surfaces" : "is damaged or cut off");
    }
    spill(folder_ / "room.lit", "LPVLIT of another kind");
    refused(gather, "is no file of lit surfaces");
}

TEST_F(ShardsCli, PartsOfLitSurfacesAreTheWholeToTheByte) {
    json scene = json::parse(slurp(std::string(LPVBAKE_EXAMPLES) + "/cornell_box.gltf"));
    scene["materials"][1]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = 0.5;
    spill(folder_ / "glass.gltf", scene.dump());
    const std::string glass = "glass.gltf" + gather.substr(5);
    for (const std::string& bake :
         {gather, gather + "--bounces 1 ", gather + "--bounces 0 ", sn, glass + "--bounces 2 "}) {
        must("light " + bake + "-o whole.lit");
        for (const int count : bake == gather ? std::vector{1, 2, 7} : std::vector{3}) {
            for (int i = 1; i <= count; ++i)
                must("light " + bake + "-o p" + std::to_string(i) + ".lit --shard "
                     + std::to_string(i) + "/" + std::to_string(count) + " --threads "
                     + std::to_string(1 + i % 2));
            must("merge " + parts(count, ".lit") + "-o merged.lit");
            EXPECT_TRUE(slurp(folder_ / "merged.lit") == slurp(folder_ / "whole.lit"))
                << bake << count;
        }
    }
}

TEST_F(ShardsCli, LitSurfacesThatAreNotAllOfOneAreRefusedByName) {
    for (const char* part : {"1", "2", "3"})
        must("light " + gather + "-o p" + part + ".lit --shard " + part + "/3");
    const auto refused = [&](const std::string& names, const std::string& why) {
        const std::string merge = "merge " + names + " -o all.lit";
        expect_one_error(run(merge), merge, ExitCode::invalid, why);
        EXPECT_FALSE(fs::exists(folder_ / "all.lit"));
    };
    refused("p1.lit p3.lit", "shard 2 of 3 of the lit surfaces is missing: light it with --shard");
    refused("p2.lit p3.lit", "shard 1 of 3 of the lit surfaces is missing");
    refused("p1.lit p2.lit", "shard 3 of 3 of the lit surfaces is missing");
    refused("p1.lit p2.lit p3.lit p2.lit", "p2.lit: is given twice; leave one of them out");
    fs::copy(folder_ / "p2.lit", folder_ / "second.lit");
    refused("p1.lit p2.lit p3.lit second.lit", "second.lit: is shard 2 of 3, and so is p2.lit");
    must("light " + gather + "-o other.lit --shard 2/2");
    refused("p1.lit other.lit p3.lit", "other.lit: is shard 2 of 2, and p1.lit is of 3");
    must("light " + gather + "--vpls 100 -o other.lit --shard 2/3");
    refused("p1.lit other.lit p3.lit", "other.lit: is of other settings than p1.lit: vpls = 100");
    must("light " + gather + "--isa sse2 -o other.lit --shard 2/3");
    refused("p1.lit other.lit p3.lit",
            "other.lit: is of another instruction set or device for rays");
    write_brighter_room();
    must("light other.gltf" + gather.substr(5) + "-o other.lit --shard 2/3");
    refused("p1.lit other.lit p3.lit", "other.lit: is of another scene than p1.lit");
    must("light " + gather + "-o whole.lit");
    refused("p1.lit whole.lit p3.lit", "whole.lit: is no part of lit surfaces, but all of them");
    std::string bytes = slurp(folder_ / "p2.lit");
    spill(folder_ / "other.lit", bytes.substr(0, bytes.size() - 7));
    refused("p1.lit other.lit p3.lit", "other.lit: is damaged or cut off");
    bytes[bytes.size() / 2] ^= 1;
    spill(folder_ / "other.lit", bytes);
    refused("p1.lit other.lit p3.lit", "other.lit: is damaged or cut off");
    must("bake " + gather + "-o p --shard 1/1");
    refused("p1.lit p p3.lit", "p: is no file of lit surfaces");
    const std::string bake = "bake " + gather + "--lit p1.lit -o all.vdb";
    expect_one_error(run(bake), bake, ExitCode::invalid, "p1.lit: is shard 1 of 3");
    const auto misused = [&](const std::string& all, const std::string& why) {
        expect_one_error(run(all), all, ExitCode::usage, why);
    };
    misused("merge p1.lit p2.lit p3.lit -o all.vdb", "parts of lit surfaces make one output");
    misused("merge p -o all.lit", ".lit is of parts of lit surfaces");
    misused("light " + gather + "--rsm-samples 9 -o all.lit --shard 1/2", "--rsm-samples");
    misused("light " + gather + "--layers lights,sky -o all.lit --shard 1/2", "--layers");
}

TEST_F(ShardsCli, APartThatIsThereIsLeftAndADamagedOneIsBakedAgain) {
    const std::string bake = "bake " + gather + "-o p2 --shard 2/3 --if-missing";
    must(bake);
    const std::string bytes = slurp(folder_ / "p2");
    EXPECT_TRUE(run(bake).out.starts_with("unchanged"));
    EXPECT_FALSE(run("bake " + gather + "-o p2 --shard 2/2 --if-missing").out.starts_with("unch"));
    must(bake);
    std::string damaged = bytes;
    damaged[damaged.size() / 2] ^= 1;
    spill(folder_ / "p2", damaged);
    must(bake);
    EXPECT_TRUE(slurp(folder_ / "p2") == bytes);
}

TEST_F(ShardsCli, KilledBakesLeaveNoHalfPart) {
    must("bake " + gather + "-o whole.vdb -o whole.exr");
    must("bake " + gather + "-o p1 --shard 1/2");
    for (int i = 1; i <= 12; ++i) {
        std::system(("cd '" + folder_.path().string() + "' && timeout -s KILL "
                     + std::to_string(0.05 * i) + " '" LPVBAKE_BINARY "' bake "
                     + "'" LPVBAKE_EXAMPLES "/cornell_box.gltf'" + gather.substr(5)
                     + "-o p2 --shard 2/2 > killed 2>&1")
                        .c_str());
        if (fs::exists(folder_ / "p2")) {
            EXPECT_EQ(run("merge p1 p2 -o merged/whole.vdb").status, 0) << i;
        }
    }
    must("bake " + gather + "-o p2 --shard 2/2");
    must("merge p1 p2 -o merged/whole.vdb -o merged/whole.exr");
    expect_same_files();
}

TEST_F(ShardsCli, HelpOfLightHasWhatItTakes) {
    const std::string help = run("light --help").out;
    for (const char* taken : {"--shard", "--sky", "--solver", "--layers"})
        EXPECT_NE(help.find(std::string("\n  ") + taken + " "), std::string::npos) << taken;
    for (const char* refused : {"at", "adaptive", "lit", "dry-run", "if-changed", "if-missing",
                                "depfile", "bytes", "verify"}) {
        EXPECT_EQ(help.find(std::string("\n  --") + refused + " "), std::string::npos) << refused;
        EXPECT_NE(run("bake --help").out.find(std::string("\n  --") + refused + " "),
                  std::string::npos)
            << refused;
    }
    expect_one_error(run("light $ROOM -o a.lit --verify 8"), "--verify", ExitCode::usage,
                     "--verify is of bake, not of light");
}

TEST_F(ShardsCli, WhatIsNoShardIsRefused) {
    const auto refused = [&](const std::string& bake, const std::string& why) {
        const std::string all = "bake " + bake + " -o p";
        expect_one_error(run(all), all, ExitCode::usage, why);
    };
    for (const char* wrong : {"0/2", "3/2", "1.5/2", "2", "1/0", "-1/2", "a/b"})
        refused(gather + "--shard " + wrong, "is not i/N");
    refused(gather + "--shard 3/9", "116 layers of cells along z are 8 shards at most, of 16");
    refused(long_box + "--solver sn --shard 1/2", "sn is parted into tiles; set --tile to 64");
    refused("$ROOM --solver lpv --shard 1/2", "--shard is of gather without --rsm-samples");
    refused(gather + "--shard 1/2 --dilate 1", "--dilate fills cells");
    refused(gather + "--shard 1/2 --time-budget 2s", "--time-budget");
    refused(gather + "--shard 1/2 --depfile $ROOM", "cornell_box.gltf");
    refused(gather + "--shard 1/2 --depfile p", "p: given twice as an output");
    const std::string exr = "bake " + gather + "--shard 1/2 -o p.exr";
    expect_one_error(run(exr), exr, ExitCode::usage, "a part is an OpenVDB file");
}

TEST_F(ShardsCli, ATileAsLargeAsTheGridIsTheSweepAsAWhole) {
    must("bake $ROOM --resolution 16 --solver sn -o a.vdb");
    must("bake $ROOM --resolution 16 --solver sn --tile 16 -o b.vdb");
    const Volume one = io::read_vdb(folder_ / "a.vdb");
    const Volume other = io::read_vdb(folder_ / "b.vdb");
    EXPECT_EQ(one.sh, other.sh);
    EXPECT_EQ(other.metadata.at("tile"), "16");
    // Tiles look up what enters them, and are as right as the sweep.
    must("bake $ROOM --resolution 40 --solver sn -o a.vdb");
    must("bake $ROOM --resolution 40 --solver sn --tile 16 -o b.vdb");
    must("bake $ROOM --resolution 40 --solver gather --quality accurate -o truth.vdb");
    const auto l1 = [&](const std::string& file) {
        return json::parse(run("diff " + file + " truth.vdb --format json")
                               .out)["irradiance"]["relative_l1"]
            .get<double>();
    };
    EXPECT_LT(l1("b.vdb"), l1("a.vdb") + 0.005);
}

} // namespace
} // namespace lpvbake
