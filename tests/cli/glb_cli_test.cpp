// A scene with its volume in one file, from outside.
#include "cli/run.h"

#include <nlohmann/json.hpp>

namespace lpvbake {
namespace {

TEST(GlbCli, EveryCommandTakesItAsSceneAndAsVolume) {
    const TemporaryFolder folder;
    const auto run =
        [&](const std::string& arguments) {
            const CliResult result = run_lpvbake(folder, arguments);
            EXPECT_EQ(result.status, 0) << arguments << "\n" << result.err;
            EXPECT_EQ(result.err, "")
                << arguments; // no warning: neither of the extension nor of a hash
            return result.out;
        };
    const std::string small = " --resolution 8 --threads 2";
    run("bake $ROOM -o lit.glb -o apart.vdb --fit none" + small);
    run("diff lit.glb apart.vdb --fail 0.0001%");
    const auto told = nlohmann::json::parse(run("info lit.glb --format json"));
    EXPECT_EQ(told["kind"], "scene");
    EXPECT_EQ(told["volume"]["kind"], "volume");
    EXPECT_EQ(told["volume"]["grid"]["dims"],
              nlohmann::json::parse(run("info apart.vdb --format json"))["grid"]["dims"]);
    const auto scene = nlohmann::json::parse(run("info $ROOM --format json"));
    EXPECT_TRUE(scene["volume"].is_null());
    EXPECT_EQ(scene["triangles"], told["triangles"]);
    EXPECT_NE(run("info lit.glb").find("sh_l1_y"), std::string::npos);
    run("info lit.glb --slice z=3 -o slice.png");
    // Baked again of the whole, and put into the scene by convert, it is the same light.
    run("bake lit.glb -o again.vdb --fit none" + small);
    run("diff again.vdb apart.vdb --fail 0.0001%");
    run("convert apart.vdb put.glb --fit none --scene $ROOM");
    run("diff put.glb apart.vdb --fail 0.0001%");
    run("render lit.glb -o one.png --size 32x32 --samples 1");
    run("render $ROOM apart.vdb -o two.png --size 32x32 --samples 1");
    EXPECT_EQ(slurp(folder / "one.png"), slurp(folder / "two.png"));
    EXPECT_EQ(nlohmann::json::parse(
                  run("verify lit.glb --points 8 --format json"))["verified"]["surfaces"],
              nlohmann::json::parse(
                  run("verify lit.glb lit.glb --points 8 --format json"))["verified"]["surfaces"]);
    run("reference $ROOM -o truth.glb --rays 64" + small);
    EXPECT_EQ(nlohmann::json::parse(run("info truth.glb --format json"))["volume"]["sh_order"], 1);
    run("convert apart.vdb alone.glb");
    run("diff alone.glb apart.vdb --fail 0.0001%");
}

TEST(GlbCli, SaysBeforeTheWorkWhatCannotBe) {
    const TemporaryFolder folder;
    const auto expect_error = [&](const std::string& arguments, cmd::ExitCode code,
                                  const std::string& text) {
        expect_one_error(run_lpvbake(folder, arguments), arguments, code, text);
    };
    ASSERT_EQ(run_lpvbake(folder, "bake $ROOM -o lit.glb --resolution 4").status, 0);
    expect_error("bake lit.glb -o again.glb", cmd::ExitCode::unsupported,
                 "lit.glb: has a light volume already");
    expect_error("bake - -o again.glb < $ROOM", cmd::ExitCode::usage, "standard input");
    expect_error("bake lit.glb -o lit.glb", cmd::ExitCode::usage, "would replace the input");
    ASSERT_EQ(run_lpvbake(folder, "convert lit.glb alone.glb").status, 0);
    expect_error("bake $ROOM -o again.glb --resolution 4 --target godot",
                 cmd::ExitCode::unsupported, "not godot");
    EXPECT_FALSE(std::filesystem::exists(folder / "again.glb"));
    spill(folder / "plain.glb", slurp(LPVBAKE_EXAMPLES "/cornell_box.gltf"));
    expect_error("info plain.glb --slice z=1 -o slice.png", cmd::ExitCode::usage,
                 "plain.glb is a scene, not a volume");
    expect_error("diff plain.glb lit.glb", cmd::ExitCode::invalid, "plain.glb");
    // A file of several is not taken for one of its parts.
    ASSERT_EQ(run_lpvbake(folder, "bake plain.glb -o plain_lit.glb --resolution 4").status, 0);
}

} // namespace
} // namespace lpvbake
