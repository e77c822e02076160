// --rays from outside: who traces is told, refused where it cannot, and not mixed.
#include "cli/run.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <filesystem>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

/// With the driver for the CPU that .ci/install.sh has put beside the system's, whose device traces
/// rays, or else with the first there is.
class RaysCli : public ::testing::Test {
protected:
    void SetUp() override {
        const bool own = std::filesystem::exists(LPVBAKE_RAYS_DRIVER);
        environment_ = own ? "VK_DRIVER_FILES=" LPVBAKE_RAYS_DRIVER : "";
        const CliResult devices = run("devices --format json");
        if (devices.status == int(ExitCode::device)
            || !json::parse(devices.out)["devices"][0]["rays"].get<bool>())
            GTEST_SKIP() << "no device traces rays; .ci/install.sh unpacks a driver that does";
    }
    CliResult run(const std::string& arguments) const {
        return run_lpvbake(folder_, arguments, environment_);
    }
    void must(const std::string& arguments) const {
        const CliResult result = run(arguments);
        ASSERT_EQ(result.status, 0) << arguments << "\n" << result.err;
    }
    void refused(const std::string& arguments, const std::string& why) const {
        expect_one_error(run(arguments), arguments, ExitCode::invalid, why);
    }

    TemporaryFolder folder_;
    std::string environment_;
    const std::string bake_ = "$ROOM --resolution 40 --margin 0 --solver gather ";
};

TEST_F(RaysCli, WhoTracesIsTold) {
    for (const auto& [given, taken] :
         {std::pair("embree", "embree"), std::pair("device", "device")}) {
        const std::string of = "bake " + bake_ + "-o a.vdb --format json --rays " + given;
        const CliResult result = run(of);
        ASSERT_EQ(result.status, 0) << result.err;
        EXPECT_EQ(json::parse(result.out)["rays"], taken);
        EXPECT_EQ(json::parse(run(of + " --dry-run").out)["rays"], taken);
        const json info = json::parse(run("info a.vdb --format json").out);
        const std::string tracer = info["metadata"]["tracer"];
        EXPECT_EQ(tracer.substr(0, 7), "Embree ");
        EXPECT_EQ(tracer.find(", rays by ") != std::string::npos, taken == std::string("device"))
            << tracer;
    }
}

TEST_F(RaysCli, PartsOfOneAreNotMixedWithThoseOfAnother) {
    const std::string why = "is of another instruction set or device for rays";
    must("bake " + bake_ + "--rays device -o p1 --shard 1/2");
    must("bake " + bake_ + "--rays device -o p2 --shard 2/2");
    must("bake " + bake_ + "--rays device -o whole.vdb");
    must("merge p1 p2 -o merged.vdb");
    EXPECT_TRUE(slurp(folder_ / "whole.vdb") == slurp(folder_ / "merged.vdb"));
    must("bake " + bake_ + "--rays embree -o other --shard 2/2");
    refused("merge p1 other -o all.vdb", "other: " + why + " than p1");
    must("light " + bake_ + "--rays device -o room.lit");
    must("bake " + bake_ + "--rays device --lit room.lit -o lit.vdb");
    EXPECT_TRUE(slurp(folder_ / "whole.vdb") == slurp(folder_ / "lit.vdb"));
    refused("bake " + bake_ + "--rays embree --lit room.lit -o all.vdb", "room.lit: " + why);
    // Nor is what a cache keeps.
    const auto cached = [&](const std::string& rays, const std::string& name) {
        must("bake " + bake_ + "--cache kept --rays " + rays + " -o " + name);
        return slurp(folder_ / name);
    };
    EXPECT_TRUE(cached("embree", "first.vdb") != cached("device", "second.vdb"));
    EXPECT_TRUE(slurp(folder_ / "second.vdb") == slurp(folder_ / "whole.vdb"));
    EXPECT_TRUE(cached("device", "third.vdb") == slurp(folder_ / "whole.vdb"));
}

TEST(RaysOfTheSystem, AreRefusedOrTracedInOneLine) {
    const TemporaryFolder folder;
    const CliResult devices = run_lpvbake(folder, "devices --format json");
    if (devices.status == int(ExitCode::device))
        GTEST_SKIP() << devices.err;
    const std::string bake = "bake $ROOM --resolution 12 -o a.vdb --rays device";
    const CliResult result = run_lpvbake(folder, bake);
    if (json::parse(devices.out)["devices"][0]["rays"].get<bool>())
        EXPECT_EQ(result.status, 0) << result.err;
    else
        expect_one_error(result, bake, ExitCode::device, "--rays device: '");
}

} // namespace
} // namespace lpvbake
