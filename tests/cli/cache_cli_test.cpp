// `lpvbake bake --cache` from outside.
#include "cli/run.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <fstream>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

namespace fs = std::filesystem;

class CacheCli : public ::testing::Test {
protected:
    void SetUp() override {
        spill(folder_ / "scene.gltf", slurp(std::string(LPVBAKE_EXAMPLES) + "/cornell_box.gltf"));
    }
    CliResult bake(const std::string& arguments) {
        return run_lpvbake(folder_, "bake scene.gltf --quality fast --resolution 8 --solver gather "
                                        + arguments);
    }
    std::string bytes(const std::string& name) { return slurp(folder_ / name); }

    TemporaryFolder folder_;
};

TEST_F(CacheCli, OtherLightGivesTheBytesOfABakeWithoutIt) {
    const std::string other = "--point 0,1,0.5,40,#ff8040 ";
    ASSERT_EQ(bake("-o a.vdb --cache kept").status, 0);
    ASSERT_EQ(bake("-o plain.vdb " + other).status, 0);
    const CliResult warm = bake("-o b.vdb --cache kept --format json " + other);
    ASSERT_EQ(warm.status, 0) << warm.err;
    EXPECT_TRUE(bytes("plain.vdb") == bytes("b.vdb"));
    EXPECT_FALSE(bytes("a.vdb") == bytes("b.vdb"));
    uint64_t reused = 0;
    const json document = json::parse(warm.out);
    for (const json& stage : document.at("stages")) {
        const bool keeps = stage.contains("cache");
        const std::string name = stage.at("name");
        EXPECT_EQ(keeps, name == "lighting" || name == "validity" || name == "walls") << name;
        if (keeps)
            reused += stage.at("cache").at("reused").get<uint64_t>();
    }
    EXPECT_GE(reused, 5u);
    const CliResult table = bake("-o b.vdb --cache kept " + other);
    EXPECT_NE(table.out.find("; cache: 1 of 1 reused"), std::string::npos) << table.out;
    EXPECT_EQ(bake("-o b.vdb " + other).out.find("cache"), std::string::npos);
}

TEST_F(CacheCli, DamagedFilesAreToldAndMadeAnew) {
    ASSERT_EQ(bake("-o a.vdb --cache kept").status, 0);
    int files = 0;
    for (const auto& entry : fs::directory_iterator(folder_ / "kept")) {
        std::string text = slurp(entry.path());
        text[text.size() / 2] = char(text[text.size() / 2] ^ 4);
        spill(entry.path(), text);
        ++files;
    }
    ASSERT_GE(files, 4);
    const CliResult result = bake("-o b.vdb --cache kept");
    EXPECT_EQ(result.status, 0);
    EXPECT_EQ(std::ranges::count(result.err, '\n'), files) << result.err;
    EXPECT_NE(result.err.find("is damaged"), std::string::npos) << result.err;
    EXPECT_TRUE(bytes("a.vdb") == bytes("b.vdb"));
    EXPECT_EQ(bake("-o b.vdb --cache kept").err, "");
}

TEST_F(CacheCli, AFolderThatCannotBeIsAnError) {
    const CliResult result = bake("-o a.vdb --cache scene.gltf/kept");
    EXPECT_EQ(result.status, int(ExitCode::file));
    EXPECT_NE(result.err.find("scene.gltf/kept: "), std::string::npos) << result.err;
    EXPECT_FALSE(fs::exists(folder_ / "a.vdb"));
    EXPECT_NE(bake("-o a.vdb --cache-size 1G").status, 0); // of what?
}

} // namespace
} // namespace lpvbake
