// `lpvbake rebake` from outside.
#include "cli/run.h"

#include <nlohmann/json.hpp>

#include <filesystem>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

class RebakeCli : public ::testing::Test {
protected:
    void SetUp() override {
        spill(folder_ / "scene.gltf", slurp(std::string(LPVBAKE_EXAMPLES) + "/cornell_box.gltf"));
        std::filesystem::create_directory(folder_ / "tmp");
    }
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    void bake(const std::string& arguments) {
        const CliResult result = run("bake scene.gltf -q " + arguments);
        ASSERT_EQ(result.status, 0) << arguments << "\n" << result.err;
    }
    /// Its document; nothing may be left of its files.
    json rebake(const std::string& arguments, ExitCode expected = ExitCode::ok) {
        setenv("TMPDIR", (folder_ / "tmp").c_str(), 1);
        const CliResult result = run("rebake --format json " + arguments);
        unsetenv("TMPDIR");
        EXPECT_EQ(result.status, int(expected)) << arguments << "\n" << result.err;
        EXPECT_TRUE(std::filesystem::is_empty(folder_ / "tmp")) << arguments;
        return json::parse(result.out, nullptr, false);
    }

    TemporaryFolder folder_;
};

TEST_F(RebakeCli, AVolumeIsBakedAgainByItsSettings) {
    const struct {
        const char* options;
        const char* file;
    } bakes[] = {
        {"--resolution 8 -o a.vdb", "a.vdb"},
        {"--cell-size 0.25 --quality fast --sky '#8899aa,10' --no-light bulb --bounces 2 -o b.vdb",
         "b.vdb"},
        {"--resolution 8 --target unity --sh-order 1 -o c.exr", "c.exr"},
        {"--resolution 8 --target threejs --fit none --precision half -o d.ktx2", "d.ktx2"},
        {"--solver gather --precision unorm8 --bytes 20k -o e.dds", "e.dds"},
        {"--resolution 8 --verify 8 --layers lights,emitters -o f.vdb", "f.vdb"},
        {"--level=-0.5,0,-0.5,0.5,1,0.5:0.2 --level=-1,0,-1,1,2,1:0.4 -o g.vdb", "g.levels.json"},
        {"--volume low=-1,0,-1,1,1,1:0.25 --volume high=-1,1,-1,1,2,1:0.5 -o h.exr",
         "h.volumes.json"},
        {"--adaptive 0.125..0.25 -o i.vdb", "i.levels.json"},
        {"--resolution 8 --target threejs -o j.glb", "j.glb"},
        {"--resolution 8 --medium scatter=0.2/0.1/0.1,g=0.3,height=0:1 "
         "--medium-bounds=-1,0,-1,1,1,1"
         " --direct sh,shaft --lamp-radius 0.1 -o k.vdb",
         "k.vdb"},
        {"--resolution 8 --medium scatter=0.2 --scattering 3 -o l.exr", "l.exr"},
        {"--resolution 8 --static bulb --beams 2 -o m.vdb", "m.vdb"},
    };
    for (const auto& [options, file] : bakes) {
        bake(options);
        const json result = rebake(std::string(file) + " scene.gltf --threads 1");
        EXPECT_EQ(result["same"], true) << options << result.dump(1);
        EXPECT_EQ(result["same_inputs"], true) << options << result.dump(1);
        EXPECT_EQ(result["differences"], json::array()) << options;
        EXPECT_EQ(result["metadata"]["different"], json::object()) << options << result.dump(1);
    }
}

TEST_F(RebakeCli, AnotherSceneIsADifference) {
    const std::string options = "--resolution 8 --sh-order 1 --sky '#8899aa,10' --precision half ";
    bake(options + "-o a.exr");
    std::string scene = slurp(folder_ / "scene.gltf");
    const std::size_t red = scene.find("0.63, 0.065, 0.05");
    ASSERT_NE(red, std::string::npos);
    spill(folder_ / "scene.gltf", scene.replace(red, 4, "0.33"));
    const json result = rebake("a.exr scene.gltf -o again.exr", ExitCode::difference);
    EXPECT_EQ(result["same"], false);
    EXPECT_EQ(result["same_inputs"], false);
    ASSERT_EQ(result["differences"].size(), 1u);
    EXPECT_NE(result["differences"][0].get<std::string>().find("sh_l0"), std::string::npos);
    EXPECT_TRUE(result["metadata"]["different"].contains("scene_hash"));
    // What is kept is the bake of that scene by those options.
    bake(options + "-o own.exr");
    const CliResult diff = run("diff again.exr own.exr --metadata");
    EXPECT_EQ(diff.status, 0) << diff.out << diff.err;

    const CliResult text = run("rebake a.exr scene.gltf -q");
    EXPECT_EQ(text.status, int(ExitCode::difference));
    EXPECT_NE(text.out.find("differs       other values: sh_l0"), std::string::npos) << text.out;
    EXPECT_NE(text.err.find("scene.gltf: does not bake a.exr"), std::string::npos) << text.err;
    EXPECT_EQ(run("rebake own.exr scene.gltf -q").out.find("inputs        the same"), 0u);
}

TEST_F(RebakeCli, OnlyBakesAreBakedAgain) {
    bake("--resolution 8 -o a.vdb --layers lights --fit none --dering off");
    bake("--level=-0.5,0,-0.5,0.5,1,0.5:0.2 --level=-1,0,-1,1,2,1:0.4 -o set.vdb");
    ASSERT_EQ(run("mix a.vdb -o mixed.vdb -q").status, 0);
    ASSERT_EQ(run("convert a.vdb half.exr --precision half").status, 0);
    const auto refused = [&](const std::string& arguments, ExitCode code, const std::string& why) {
        expect_one_error(run("rebake " + arguments), arguments, code, why);
    };
    refused("mixed.vdb scene.gltf", ExitCode::invalid, "has no settings of a bake");
    refused("a_layer_bulb.vdb scene.gltf", ExitCode::invalid, "is the layer bulb");
    refused("set.vdb scene.gltf", ExitCode::invalid, "give set.levels.json");
    refused("a.vdb scene.gltf -o b.exr", ExitCode::usage, "has to end in .vdb");
    refused("a.vdb scene.gltf -o a.vdb", ExitCode::usage, "would replace the input");
    refused("a.vdb none.gltf", ExitCode::file, "none.gltf");
    EXPECT_EQ(rebake("half.exr scene.gltf", ExitCode::difference)["same_inputs"], nullptr);
}

} // namespace
} // namespace lpvbake
