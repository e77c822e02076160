// `lpvbake bake --if-changed` from outside.
#include "cli/run.h"

#include <nlohmann/json.hpp>

#include <filesystem>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

namespace fs = std::filesystem;

class UnchangedCli : public ::testing::Test {
protected:
    void SetUp() override {
        std::string scene = slurp(std::string(LPVBAKE_EXAMPLES) + "/cornell_box.gltf");
        spill(folder_ / "scene.gltf", scene);
    }
    CliResult bake(const std::string& arguments) {
        return run_lpvbake(folder_, "bake scene.gltf --quality fast " + grid_ + " " + arguments);
    }
    /// Whether a bake finds nothing to do; then it must have left all files as they are.
    bool is_unchanged(const std::string& arguments) {
        std::map<std::string, fs::file_time_type> before;
        for (const auto& entry : fs::directory_iterator(folder_.path()))
            if (const std::string name = entry.path().filename(); !name.starts_with("std"))
                before[name] = fs::last_write_time(entry);
        const CliResult result = bake(arguments + " --if-changed");
        EXPECT_EQ(result.status, 0) << arguments << "\n" << result.err;
        if (!result.out.starts_with("unchanged "))
            return false;
        EXPECT_EQ(std::ranges::count(result.out, '\n'), 1) << result.out;
        for (const auto& [name, time] : before)
            EXPECT_EQ(fs::last_write_time(folder_ / name), time) << name;
        return true;
    }
    void edit(const std::string& name, const std::string& from, const std::string& to) {
        std::string text = slurp(folder_ / name);
        const std::size_t at = text.find(from);
        ASSERT_NE(at, std::string::npos) << name << " has no " << from;
        spill(folder_ / name, text.replace(at, from.size(), to));
    }
    void cut(const std::string& name) {
        const std::string bytes = slurp(folder_ / name);
        spill(folder_ / name, bytes.substr(0, bytes.size() - bytes.size() / 4));
    }

    std::string grid_ = "--resolution 8";
    TemporaryFolder folder_;
};

TEST_F(UnchangedCli, ASecondBakeHasNothingToDo) {
    EXPECT_FALSE(is_unchanged("-o a.vdb"));
    const std::string bytes = slurp(folder_ / "a.vdb");
    EXPECT_TRUE(is_unchanged("-o a.vdb"));
    EXPECT_TRUE(is_unchanged("-o a.vdb --threads 1"));
    EXPECT_EQ(slurp(folder_ / "a.vdb"), bytes);
    const json document = json::parse(bake("-o a.vdb --if-changed --format json").out);
    EXPECT_EQ(document["unchanged"], true);
    EXPECT_EQ(document["outputs"], json({"a.vdb"}));
    // Made anew it is the same, with and without the option.
    ASSERT_EQ(bake("-o a.vdb").status, 0);
    EXPECT_EQ(slurp(folder_ / "a.vdb"), bytes);
}

TEST_F(UnchangedCli, APartIsNoWholeVolume) {
    grid_ = "--resolution 24"; // two zones along z
    ASSERT_EQ(bake("--solver gather --shard 1/2 -o a.vdb").status, 0);
    EXPECT_TRUE(is_unchanged("--solver gather --shard 1/2 -o a.vdb"));
    const std::string part = slurp(folder_ / "a.vdb");
    const CliResult whole = bake("--solver gather -o a.vdb --if-missing -v");
    EXPECT_EQ(whole.status, 0) << whole.err;
    EXPECT_NE(whole.err.find("bakes: a.vdb: is a part, shard 1 of 2"), std::string::npos)
        << whole.err;
    EXPECT_FALSE(slurp(folder_ / "a.vdb") == part);
    EXPECT_TRUE(bake("--solver gather -o a.vdb --if-missing").out.starts_with("unchanged "));
}

TEST_F(UnchangedCli, OtherOptionsAreBaked) {
    ASSERT_EQ(bake("-o a.exr --target unity").status, 0);
    const std::string unity = "-o a.exr --target unity";
    EXPECT_TRUE(is_unchanged(unity));
    for (const char* other :
         {"--precision float", "--sh-order 1", "--sky '#ffffff,10'", "--no-light bulb",
          "--fit none", "--packing channel --exr-columns 2"}) {
        EXPECT_FALSE(is_unchanged(unity + " " + other)) << other;
        EXPECT_TRUE(is_unchanged(unity + " " + other)) << other;
    }
    EXPECT_FALSE(is_unchanged("-o a.exr"));
}

TEST_F(UnchangedCli, OtherInputsAreBaked) {
    const std::string sky = "--sky sky.pfm --volumes boxes.json -o a.vdb";
    const float grey[3] = {20, 20, 20};
    const auto write_sky = [&](float last) {
        std::string picture = "PF\n2 1\n-1.0\n";
        picture.append(reinterpret_cast<const char*>(grey), sizeof grey);
        picture.append(reinterpret_cast<const char*>(grey), 8);
        picture.append(reinterpret_cast<const char*>(&last), 4);
        spill(folder_ / "sky.pfm", picture);
    };
    write_sky(20);
    spill(folder_ / "boxes.json",
          R"({"volumes": [{"name": "low", "box": [-1, 0, -1, 1, 1, 1], "cell": 0.25}]})");
    // The buffer in a file of its own.
    json scene = json::parse(slurp(folder_ / "scene.gltf"));
    const auto export_buffer = [&](const std::string& bytes) {
        spill(folder_ / "scene.bin", bytes);
    };
    const CliResult packed = run_lpvbake(folder_, "bake scene.gltf --resolution 8 -o packed.glb");
    ASSERT_EQ(packed.status, 0);
    const std::string glb = slurp(folder_ / "packed.glb");
    const auto word = [&](std::size_t at) {
        uint32_t value = 0;
        std::memcpy(&value, glb.data() + at, 4);
        return std::size_t(value);
    };
    const std::size_t chunk = 20 + word(12);
    const std::string buffer =
        glb.substr(chunk + 8, scene["buffers"][0]["byteLength"].get<std::size_t>());
    export_buffer(buffer);
    scene["buffers"][0]["uri"] = "scene.bin";
    spill(folder_ / "scene.gltf", scene.dump());

    EXPECT_FALSE(is_unchanged(sky));
    EXPECT_TRUE(is_unchanged(sky));
    write_sky(21);
    EXPECT_FALSE(is_unchanged(sky));
    EXPECT_TRUE(is_unchanged(sky));
    edit("boxes.json", "0.25", "0.30");
    EXPECT_FALSE(is_unchanged(sky));
    EXPECT_TRUE(is_unchanged(sky));
    edit("scene.gltf", "\"lamp\"", "\"LAMP\"");
    EXPECT_FALSE(is_unchanged(sky));
    EXPECT_TRUE(is_unchanged(sky));
    std::string moved = buffer;
    float x = 0;
    std::memcpy(&x, moved.data(), 4);
    x *= 0.99f;
    std::memcpy(moved.data(), &x, 4);
    export_buffer(moved);
    EXPECT_FALSE(is_unchanged(sky));
    EXPECT_TRUE(is_unchanged(sky));
}

TEST_F(UnchangedCli, MissingForeignAndDamagedOutputsAreBaked) {
    const std::string files = "-o a.vdb -o a.exr -o b.ktx2 --target unity";
    EXPECT_FALSE(is_unchanged(files));
    EXPECT_TRUE(is_unchanged(files));
    const auto expect_baked = [&](const std::string& what, const std::string& name) {
        const std::string told = bake(files + " --if-changed --dry-run -v").err;
        EXPECT_NE(told.find("bakes: "), std::string::npos) << what << "\n" << told;
        EXPECT_NE(told.find(name), std::string::npos) << what << "\n" << told;
        EXPECT_FALSE(is_unchanged(files)) << what;
        EXPECT_TRUE(is_unchanged(files)) << what;
    };
    for (const char* name : {"a.vdb", "a_wall_1.exr", "b.unity.json"}) {
        ASSERT_TRUE(fs::remove(folder_ / name)) << name;
        expect_baked("removed", name);
    }
    for (const char* name : {"a.vdb", "a_wall_1.exr", "b_wall_1.ktx2"}) {
        cut(name);
        expect_baked("cut", name);
    }
    spill(folder_ / "a.vdb", "no volume");
    expect_baked("foreign", "a.vdb");
    ASSERT_EQ(run_lpvbake(folder_, "convert a.exr a.vdb").status, 0);
    expect_baked("converted", "a.vdb");
    ASSERT_EQ(run_lpvbake(folder_, "bake \"$ROOM\" --resolution 9 -o a.vdb").status, 0);
    expect_baked("of another bake", "a.vdb");
}

TEST_F(UnchangedCli, SetsOfVolumesAreOneOutput) {
    const struct {
        const char* options;
        const char* part;
    } sets[] = {
        {"-o a.vdb --layers lights,emitters --fit none --dering off --resolution 8",
         "a_layer_lamp.vdb"},
        {"-o a.exr --level=-0.5,0,-0.5,0.5,1,0.5:0.2 --level=-1,0,-1,1,2,1:0.4",
         "a_level1_sh_l0.exr"},
        {"-o a.vdb --volume low=-1,0,-1,1,1,1:0.25 --volume high=-1,1,-1,1,2,1:0.5", "a_high.vdb"},
        {"-o a.vdb --adaptive 0.125..0.25", "a_level1.vdb"},
        {"-o a.glb --target threejs --resolution 8", "a.glb"},
    };
    grid_ = "";
    for (const auto& [options, part] : sets) {
        EXPECT_FALSE(is_unchanged(options)) << options;
        EXPECT_TRUE(is_unchanged(options)) << options;
        ASSERT_TRUE(fs::remove(folder_ / part)) << options;
        EXPECT_FALSE(is_unchanged(options)) << part;
        EXPECT_TRUE(is_unchanged(options)) << options;
    }
}

TEST_F(UnchangedCli, WhatCannotBeComparedIsToldOrBaked) {
    spill(folder_ / "points.json", R"({"points": [[0, 1, 0]]})");
    expect_one_error(
        run_lpvbake(folder_, "bake scene.gltf --at points.json -o a.json --if-changed"), "--at",
        ExitCode::usage, "--if-changed");
    for (int i = 0; i < 2; ++i) {
        const CliResult piped =
            run_lpvbake(folder_, "bake - --resolution 8 -o a.vdb --if-changed < \"$ROOM\"");
        EXPECT_EQ(piped.status, 0) << piped.err;
        EXPECT_FALSE(piped.out.starts_with("unchanged"));
    }
}

} // namespace
} // namespace lpvbake
