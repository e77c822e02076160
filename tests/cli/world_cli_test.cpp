// `lpvbake world`, and the bakes of boxes that its rows are.
#include "base64.h"
#include "cli/run.h"
#include "lpvbake/file.h"
#include "report/seams.h"
#include "text.h"
#include "volume/compare.h"

#include <nlohmann/json.hpp>

#include <set>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;
namespace fs = std::filesystem;

/// A yard of blocks that stand 12 m apart along x, on a floor in parts, one mesh each.
json street(int blocks) {
    json scene{
        {"asset", {{"version", "2.0"}}},
        {"scene", 0},
        {"materials", {{{"pbrMetallicRoughness", {{"baseColorFactor", {0.7, 0.6, 0.5, 1.0}}}}}}}};
    // A cube of two units around 0, of 12 triangles that face out.
    std::vector<float> positions;
    std::vector<uint16_t> indices;
    for (int corner = 0; corner < 8; ++corner)
        for (const int bit : {1, 2, 4})
            positions.push_back(corner & bit ? 1.0f : -1.0f);
    for (const uint16_t i : {0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4,
                             2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6})
        indices.push_back(i);
    std::string bytes(reinterpret_cast<const char*>(positions.data()), positions.size() * 4);
    bytes.append(reinterpret_cast<const char*>(indices.data()), indices.size() * 2);
    scene["buffers"] = {{{"byteLength", bytes.size()},
                         {"uri", "data:application/octet-stream;base64," + base64(bytes)}}};
    scene["bufferViews"] = {{{"buffer", 0}, {"byteLength", 96}},
                            {{"buffer", 0}, {"byteOffset", 96}, {"byteLength", 72}}};
    scene["accessors"] = {
        {{"bufferView", 0},
         {"componentType", 5126},
         {"count", 8},
         {"type", "VEC3"},
         {"min", {-1, -1, -1}},
         {"max", {1, 1, 1}}},
        {{"bufferView", 1}, {"componentType", 5123}, {"count", 36}, {"type", "SCALAR"}}};
    scene["meshes"] = {
        {{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}, {"material", 0}}}}}};
    for (int i = 0; i < blocks; ++i) {
        scene["nodes"].push_back({{"name", "floor" + std::to_string(i)},
                                  {"mesh", 0},
                                  {"translation", {12.0 * i + 6, -0.5, 6}},
                                  {"scale", {6, 0.5, 6}}});
        scene["nodes"].push_back({{"name", "block" + std::to_string(i)},
                                  {"mesh", 0},
                                  {"translation", {12.0 * i + 6, 2, 6}},
                                  {"scale", {1.5, 2, 2.5}}});
    }
    for (std::size_t i = 0; i < scene["nodes"].size(); ++i)
        scene["scenes"][0]["nodes"].push_back(i);
    return scene;
}

class WorldCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    void write(const json& scene) { spill(folder_ / "street.gltf", scene.dump()); }
    json plan() {
        const CliResult planned =
            run("world street.gltf -o w.world.json --cell-size 0.75 --tile 16 --surroundings 8 "
                "--scenario \"noon:--sun '20,70,9000' --solver gather --quality fast\" "
                "--scenario \"dull:--sky '#aaccff,900' --solver gather --quality fast\" "
                "--format json");
        EXPECT_EQ(planned.status, 0) << planned.err;
        return json::parse(slurp(folder_ / "w.world.json"));
    }
    json rows(const std::string& list) {
        const CliResult made = run("world w.world.json --rows " + list + " --format json");
        EXPECT_EQ(made.status, 0) << made.err;
        return json::parse(made.out)["rows"];
    }

    TemporaryFolder folder_;
};

TEST_F(WorldCli, RowsAreBakesOfTheirBoxes) {
    write(street(4));
    const json world = plan();
    ASSERT_EQ(world["rows"].size(), 8u); // four tiles of 12 m
    EXPECT_EQ(world["rows"][0]["file"], "w_noon_x0_y0_z0.vdb");
    EXPECT_EQ(world["rows"][5]["file"], "w_dull_x1_y0_z0.vdb");
    for (const json& row : world["rows"]) {
        EXPECT_GT(row["seconds"], 0.0);
        EXPECT_GT(row["bytes"], 16 * 16 * 16 * 100);
    }
    const json made = rows("1-2,5");
    ASSERT_EQ(made.size(), 3u);
    EXPECT_EQ(made[2]["row"], 5);
    for (const json& row : made)
        EXPECT_EQ(row["made"], true);
    // By hand it is the same, byte for byte.
    const json& bounds = world["rows"][1]["bounds"];
    std::string box;
    for (const json& number : bounds)
        box.append(box.empty() ? "" : ",").append(std::to_string(int(number.get<double>())));
    fs::create_directory(folder_ / "by_hand");
    ASSERT_EQ(
        run("bake street.gltf --cell-size 0.75 --bounds=" + box
            + " --margin 1 --surroundings 8 --sun '20,70,9000' --solver gather --quality fast "
              "-o by_hand/w_noon_x1_y0_z0.vdb -q")
            .status,
        0);
    EXPECT_TRUE(slurp(folder_ / "by_hand/w_noon_x1_y0_z0.vdb")
                == slurp(folder_ / "w_noon_x1_y0_z0.vdb"));
    EXPECT_EQ(run("render street.gltf w_noon_x1_y0_z0.vdb -o a.png --size 16x16 --samples 1 --sun "
                  "'20,70,9000'")
                  .err.find("another scene"),
              std::string::npos);

    // What is there is left, what is damaged or lost is made again.
    EXPECT_EQ(rows("1-2,5")[0]["made"], false);
    const std::string whole = slurp(folder_ / "w_noon_x1_y0_z0.vdb");
    spill(folder_ / "w_noon_x1_y0_z0.vdb", whole.substr(0, whole.size() / 2));
    fs::copy_file(folder_ / "w_dull_x1_y0_z0.vdb", folder_ / "w_noon_x2_y0_z0.vdb",
                  fs::copy_options::overwrite_existing);
    const CliResult checked = run("world w.world.json --check --format json");
    EXPECT_EQ(checked.status, int(ExitCode::invalid));
    const json faults = json::parse(checked.out)["faults"];
    ASSERT_EQ(faults.size(), 7u);
    EXPECT_EQ(faults[0]["why"], "is missing");
    EXPECT_EQ(faults[1]["why"], "is damaged, or was not written by lpvbake: its UUID does not fit "
                                "its content");
    EXPECT_NE(faults[2]["why"].get<std::string>().find("another scene"), std::string::npos);
    EXPECT_EQ(checked.err,
              "lpvbake: error: row 0 (noon, x0_y0_z0): w_noon_x0_y0_z0.vdb is missing, "
              "and 6 more; bake it with --rows 0\n");
    for (const json& row : rows("0-7"))
        EXPECT_EQ(row["made"], row["row"] != 5) << row;
    EXPECT_TRUE(slurp(folder_ / "w_noon_x1_y0_z0.vdb") == whole);

    // Neighbours agree in what they share.
    const json seams = json::parse(run("world w.world.json --check --format json").out)["seams"];
    EXPECT_GT(seams["cells"], 1000);
    EXPECT_LT(seams["mean"], 0.05);
    EXPECT_GT(seams["mean"], 0.0);
    EXPECT_GE(seams["worst"]["share"], seams["mean"]);
    report::Seam all;
    for (const char* scenario : {"noon", "dull"})
        for (int tile = 0; tile < 3; ++tile) {
            const auto file = [&](int x) {
                return lpvbake::read_volume(folder_ / format("w_%s_x%d_y0_z0.vdb", scenario, x));
            };
            all += report::seam_between(file(tile), file(tile + 1));
        }
    EXPECT_EQ(seams["cells"], all.cells);
    EXPECT_EQ(seams["mean"], all.share());
}

TEST_F(WorldCli, AnEditIsBakedWhereItCounts) {
    json scene = street(6);
    write(scene);
    const json before = plan();
    rows("0-11");
    std::vector<std::string> bytes;
    for (const json& row : before["rows"])
        bytes.push_back(slurp(folder_ / row["file"].get<std::string>()));

    scene["nodes"][1]["scale"] = {1.5, 1.0, 2.5}; // the first block; the second tile is 7.5 m away
    write(scene);
    const json after = plan();
    ASSERT_EQ(after["rows"].size(), 12u);
    std::vector<int> changed;
    for (int i = 0; i < 12; ++i)
        if (after["rows"][i]["hash"] != before["rows"][i]["hash"])
            changed.push_back(i);
    EXPECT_EQ(changed, (std::vector<int>{0, 1, 6, 7}));
    for (const json& row : rows("0-11")) {
        const int i = row["row"];
        EXPECT_EQ(row["made"], std::ranges::count(changed, i) > 0) << i;
        EXPECT_EQ(slurp(folder_ / row["file"].get<std::string>()) == bytes[std::size_t(i)],
                  std::ranges::count(changed, i) == 0)
            << i;
    }
    // The scene of another plan.
    write(street(5));
    fs::remove(folder_ / after["rows"][0]["file"].get<std::string>());
    expect_one_error(run("world w.world.json --rows 0"), "--rows 0", ExitCode::invalid,
                     "plan the world again");
}

TEST_F(WorldCli, RowsTogetherAreRowsOneByOne) {
    write(street(7)); // of which a row decodes what is around it
    const json world = plan();
    ASSERT_EQ(world["rows"].size(), 14u);
    for (const json& row : rows("0-3,7,12-13"))
        EXPECT_EQ(row["made"], true);
    fs::create_directory(folder_ / "alone");
    fs::copy(folder_ / "w.world.json", folder_ / "alone/w.world.json");
    for (const int i : {3, 0, 1, 2, 7, 12, 13}) {
        const CliResult made = run("world alone/w.world.json -q --rows " + std::to_string(i));
        ASSERT_EQ(made.status, 0) << made.err;
        const std::string file = world["rows"][i]["file"];
        EXPECT_TRUE(slurp(folder_ / file) == slurp(folder_ / ("alone/" + file))) << file;
    }
}

TEST_F(WorldCli, ThePlanIsOneVolume) {
    write(street(4));
    plan();
    const auto told = [&](const std::string& arguments, ExitCode code = ExitCode::ok) {
        const CliResult result = run(arguments + " --format json");
        EXPECT_EQ(result.status, int(code)) << arguments << "\n" << result.err;
        return json::parse(result.out);
    };
    EXPECT_EQ(told("info w.world.json")["lightings"][1]["there"], 0);
    rows("0-7");
    const json info = told("info w.world.json --scenario noon");
    ASSERT_EQ(info["lightings"].size(), 1u);
    EXPECT_EQ(info["lightings"][0]["there"], 4);
    EXPECT_EQ(info["lightings"][0]["grid"]["dims"], (json{66, 18, 18}));
    EXPECT_EQ(info["lightings"][0]["metadata"]["tracer"].get<std::string>().substr(0, 6), "Embree");

    // The export is the volume that all commands read.
    const json made = told("convert w.world.json noon.vdb --scenario noon");
    EXPECT_EQ(made["grid"]["dims"], (json{66, 18, 18}));
    EXPECT_EQ(made["sh_order"], 2);
    EXPECT_EQ(run("convert w.world.json noon.exr --scenario noon").status, 0);
    EXPECT_EQ(run("convert noon.exr dense.vdb").status, 0);
    EXPECT_TRUE(slurp(folder_ / "noon.vdb") == slurp(folder_ / "dense.vdb"));
    const auto same = [&](const std::string& arguments) {
        return told("diff " + arguments)["result"];
    };
    EXPECT_EQ(same("w.world.json noon.vdb --scenario noon"), "identical");
    EXPECT_EQ(same("w.world.json w_noon_x0_y0_z0.vdb --scenario noon --fail 100%"), "pass");
    EXPECT_EQ(same("w.world.json w.world.json --scenario dull"), "identical");
    EXPECT_EQ(run("diff w.world.json w.world.json --scenario dull,noon -q").status,
              int(ExitCode::difference));
    EXPECT_EQ(run("diff noon.exr w.world.json --scenario dull -q").status,
              int(ExitCode::difference));

    // A picture of one end needs no tile of the other, and looks as the whole does.
    const std::string view = " --size 48x32 --samples 1 --camera 6,6,20:6,1,6:30 --sun "
                             "'20,70,9000' --show irradiance -o ";
    const json whole = told("render street.gltf noon.vdb" + view + "whole.exr");
    fs::remove(folder_ / "w_noon_x3_y0_z0.vdb");
    const json part = told("render street.gltf w.world.json --scenario noon" + view + "part.exr");
    EXPECT_EQ(part["tiles"], json({{"read", 3}, {"of", 4}}));
    EXPECT_NEAR(part["mean_luminance"].get<double>(), whole["mean_luminance"].get<double>(),
                1e-6 * whole["mean_luminance"].get<double>());
    EXPECT_GT(whole["mean_luminance"], 100.0);

    const auto refused = [&](const std::string& arguments, const std::string& text,
                             ExitCode code = ExitCode::usage) {
        expect_one_error(run(arguments), arguments, code, text);
    };
    refused("render street.gltf w.world.json --scenario noon --size 8x8 -o a.png --camera "
            "40,6,20:40,1,6:30",
            "row 3 (noon, w_noon_x3_y0_z0.vdb) is missing; bake it with lpvbake world --rows 3",
            ExitCode::file);
    refused("render street.gltf w.world.json --scenario noon --size 8x8 -o a.png --camera "
            "40,60,20:40,100,6:30",
            "shows no tile", ExitCode::invalid);
    refused("convert w.world.json b.vdb --scenario noon", "row 3 (noon", ExitCode::file);
    refused("convert w.world.json b.vdb", "name one by --scenario: noon, dull");
    refused("convert w.world.json b.vdb --scenario night", "night, but noon, dull");
    refused("convert noon.vdb b.vdb --scenario noon", "is no plan of a world");
    refused("convert w.world.json b.exr --scenario dull --max-memory 1M",
            "between the tiles, more than 1.0 MiB; allow more with --max-memory", ExitCode::memory);
    refused("convert w.world.json w_dull_x0_y0_z0.vdb --scenario dull", "would replace");
    refused("info w.world.json --scenario night", "night, but noon, dull");
    refused("info w.world.json --slice z=1 -o a.png", "give the file of one");
    run("bake street.gltf --cell-size 0.75 --bounds=0.1,-6,0,6,6,12 --sun '20,70,9000' -o odd.vdb");
    refused("diff odd.vdb w.world.json --scenario dull", "is no part of w.world.json",
            ExitCode::invalid);
}

TEST_F(WorldCli, TilesOfTexturesAreReadToo) {
    write(street(2));
    const std::string to = "world street.gltf --cell-size 1 --tile 16 --surroundings 8 "
                           "--scenario 'a:--sky #ffffff,100 --solver gather --quality fast "
                           "--precision float' -o ";
    ASSERT_EQ(run(to + "v.world.json").status, 0);
    ASSERT_EQ(run("world v.world.json --rows 0-99").status, 0);
    for (const std::string kind : {"exr", "dds"}) {
        const std::string plan = kind + ".world.json";
        ASSERT_EQ(run(to + plan + " --kind " + kind).status, 0);
        expect_one_error(run("convert " + plan + " b.vdb"), kind, ExitCode::file,
                         "is missing; bake it with");
        ASSERT_EQ(run("world " + plan + " --rows 0-99").status, 0);
        const json info = json::parse(run("info " + plan + " --format json").out)["lightings"][0];
        EXPECT_EQ(info["there"], info["tiles"]);
        EXPECT_GT(info["bytes"], 100'000);
        const CliResult same = run("diff " + plan + " v.world.json --format json");
        EXPECT_EQ(same.status, 0) << same.err;
        EXPECT_EQ(json::parse(same.out)["result"], "identical");
        EXPECT_EQ(run("convert " + plan + " b.vdb").status, 0);
    }
}

// EvaluateOnExit of AWS Batch has up to 5 entries; what none of them says is tried again.
TEST_F(WorldCli, TheFarmsFileEndsWhatAnotherTryDoesNotMend) {
    const json job = json::parse(slurp(LPVBAKE_EXAMPLES "/farms/aws_batch.json"));
    const json& entries = job["retryStrategy"]["evaluateOnExit"];
    EXPECT_LE(entries.size(), 5u);
    std::set<std::string> codes;
    for (const json& entry : entries) {
        EXPECT_EQ(entry["action"], "EXIT");
        codes.insert(entry["onExitCode"]);
    }
    std::set<std::string> lasting;
    for (const ExitCode code : {ExitCode::usage, ExitCode::invalid, ExitCode::failure,
                                ExitCode::unsupported, ExitCode::memory})
        lasting.insert(std::to_string(int(code)));
    EXPECT_EQ(codes, lasting);
}

TEST_F(WorldCli, WhatCannotBeIsRefusedByName) {
    write(street(2));
    const auto refused = [&](const std::string& arguments, const std::string& text,
                             ExitCode code = ExitCode::usage) {
        expect_one_error(run("world " + arguments), arguments, code, text);
    };
    const std::string to = "street.gltf -o w.world.json --cell-size 1 --surroundings 8 ";
    refused("street.gltf", "-o NAME.world.json");
    refused("street.gltf -o w.json --cell-size 1 --surroundings 8", "-o NAME.world.json");
    refused("street.gltf -o w.world.json --cell-size 1", "--surroundings R");
    refused("- -o w.world.json --cell-size 1 --surroundings 8", "give a file");
    refused("street.gltf --rows 1", "NAME.world.json");
    refused(to + "--scenario 'a/b:'", "is not NAME:OPTIONS");
    refused(to + "--scenario 'a:--sun \"'", "quote");
    refused(to + "--scenario a:--nothing", "scenario a: bake: unknown option --nothing");
    refused(to + "--scenario 'a:-o b.vdb'", "scenario a: a row has one output");
    for (const std::string option : {"--layers lights", "--depfile a.d", "--format json",
                                     "--verify", "--progress plain", "--dry-run", "--print-config"})
        refused(to + "--scenario 'a:" + option + "'",
                "scenario a: " + option.substr(0, option.find(' ')) + " is not for rows");
    refused(to + "--scenario 'a:--cell-size 2'", "--cell-size");
    refused(to + "--scenario 'a:--sky #ffffff,1' --scenario a:", "a is there twice");
    refused(to + "--scenario a:", "no light", ExitCode::invalid);
    refused("gone.gltf -o w.world.json --cell-size 1 --surroundings 8", "gone.gltf",
            ExitCode::file);
    refused(to + "--kind tres --scenario 'a:--sky #ffffff,1'", "scenario a: --kind tres is for");
    refused(to + "--scenario 'a:--sky #ffffff,1 --sh-order 1 --bytes 9K'",
            "scenario a: --bytes 9216: in bytes, of which a volume takes");
    for (const char* order : {"", " --sh-order 1"})
        EXPECT_EQ(run("world " + to + "--scenario 'a:--sky #ffffff,1 --error 5%" + order + "'")
                          .err.find("warning: scenario a: each row chooses its order")
                      != std::string::npos,
                  *order == '\0');
    ASSERT_EQ(run("world " + to + "--tile 16 --scenario 'a:--sky #ffffff,1'").status, 0);
    refused("w.world.json", "--rows 0-9 or --check");
    refused("w.world.json --rows 9", "there is no row 9");
    refused("w.world.json --rows 9-12", "there is no row 9");
    expect_one_error(run("merge w.world.json -o b.vdb"), "merge", ExitCode::usage,
                     "lpvbake convert makes one volume of it");
    refused("w.world.json --rows 3-1", "ends before it begins");
    for (const char* list : {"a", "0x0", "0e0", "0-", "0,"})
        refused("w.world.json --rows '" + std::string(list) + "'", "is no list of rows");
    refused("w.world.json --cell-size 1", "is planned");
    refused("gone.world.json --check", "gone.world.json", ExitCode::file);
    const std::string plan = slurp(folder_ / "w.world.json");
    for (const auto& [of, to_what] : std::vector<std::pair<std::string, std::string>>{
             {"lpvbake world", "lpvbake"},
             {"\"version\": 1", "\"version\": 2"},
             {"\"file\": \"w_", "\"file\": \"../w_"},
             {"\"cell\"", "\"cells\""},
             {"\"scenario\": \"a\"", "\"scenario\": \"b\""},
             {"\"program\": \"", "\"program\": \"9"},
             {"\"bounds\": [", "\"bounds\": [1,"}}) {
        std::string other = plan;
        ASSERT_NE(other.find(of), std::string::npos) << of;
        spill(folder_ / "x.world.json", other.replace(other.find(of), of.size(), to_what));
        refused("x.world.json --check", "x.world.json", ExitCode::invalid);
    }
    spill(folder_ / "x.world.json", plan.substr(0, plan.size() / 2));
    refused("x.world.json --rows 0", "damaged", ExitCode::invalid);
}

} // namespace
} // namespace lpvbake
