// `lpvbake verify` from outside. Volumes are references: no device needed.
#include "cli/run.h"
#include "io/io.h"

#include <nlohmann/json.hpp>

#include <fstream>

namespace lpvbake {
namespace {

using nlohmann::json;

class VerifyCli : public ::testing::Test {
protected:
    void SetUp() override {
        std::ofstream(folder_ / "l.json")
            << R"({"lights": [{"type": "point", "name": "a;\"b", "intensity": 3}]})";
        const CliResult made =
            run_lpvbake(folder_, "reference" + room_ + light_
                                     + " -o v.vdb --resolution 8 --rays 512 --sh-order 2");
        ASSERT_EQ(made.status, 0) << made.err;
    }
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "verify " + arguments);
    }
    json run_json(const std::string& arguments, int status = 0) {
        const CliResult result = run(arguments + " --points 128 --format json");
        EXPECT_EQ(result.status, status) << result.err;
        return json::parse(result.out);
    }
    /// Writes v.vdb with another fact in its metadata as changed.vdb.
    void change(const std::string& name, const std::string& value) {
        Volume volume = read_volume(folder_ / "v.vdb");
        volume.metadata[name] = value;
        io::write_volume(folder_ / "changed.vdb", volume, Precision::full);
    }

    TemporaryFolder folder_;
    const std::string room_ = " \"$ROOM\"";
    const std::string light_ = " --lights l.json --light-scale 'a;\"b=0.5' --sky '#ffffff,10'"
                               " --max-albedo 0.5 --bounces 2";
};

TEST_F(VerifyCli, TakesTheLightOfTheVolume) {
    const json own = run_json("v.vdb" + room_);
    EXPECT_EQ(own["warnings"], json::array());
    EXPECT_EQ(own["bounces"], 2);
    EXPECT_EQ(own["verified"]["cells"]["points"], 64);
    EXPECT_EQ(own["verified"]["reader"], "lpvbake");
    EXPECT_EQ(own["fail"], nullptr);
    EXPECT_LT(own["verified"]["cells"]["low"], 0.1);
    EXPECT_EQ(run_json("v.vdb" + room_ + light_)["verified"]["cells"], own["verified"]["cells"]);

    const json other = run_json("v.vdb" + room_ + " --max-albedo 0.9 --bounces inf");
    ASSERT_EQ(other["warnings"].size(), 1u);
    EXPECT_NE(std::string(other["warnings"][0]).find("is of another scene or other lights"),
              std::string::npos);
    EXPECT_EQ(other["bounces"], nullptr);
    EXPECT_GT(other["verified"]["cells"]["low"], own["verified"]["cells"]["high"]);
}

TEST_F(VerifyCli, FailsAboveALimit) {
    const json cells = run_json("v.vdb" + room_)["verified"]["cells"];
    const double high = cells["high"], low = cells["low"];
    const auto with_limit = [&](double limit) {
        return "v.vdb" + room_ + " --fail " + std::to_string(limit);
    };
    const json below = run_json(with_limit(1.01 * high));
    EXPECT_EQ(below["result"], "pass");
    EXPECT_EQ(below["judged"], "cells");
    EXPECT_EQ(below["verified"]["cells"], cells);
    const int differs = int(cmd::ExitCode::difference);
    const CliResult above = run(with_limit(0.5 * low) + " --points 128");
    EXPECT_EQ(above.status, differs);
    EXPECT_NE(above.err.find("v.vdb: the error is above the limit: cells "), std::string::npos)
        << above.err;
    EXPECT_NE(above.out.find("result        fail (cells "), std::string::npos) << above.out;
    EXPECT_NE(above.out.find("; surfaces not judged)"), std::string::npos) << above.out;
}

TEST_F(VerifyCli, GoesOnUntilItIsDecided) {
    const auto verified = [&](uint64_t points) {
        return json::parse(
            run("v.vdb" + room_ + " --format json --points " + std::to_string(points))
                .out)["verified"]["surfaces"];
    };
    const json few = verified(16), more = verified(64);
    const std::string judge =
        "v.vdb" + room_ + " --points 16 --format json --fail-on surfaces --fail ";
    // Inside the first interval; the second, or a later one, leaves it.
    const double limit = 0.98 * double(few["high"]);
    ASSERT_LT(double(more["high"]), limit) << few << more;
    const json passed = json::parse(run(judge + std::to_string(limit)).out);
    EXPECT_EQ(passed["result"], "pass");
    EXPECT_EQ(passed["judged"], "surfaces");
    EXPECT_EQ(passed["verified"]["surfaces"], more);

    const double truth = verified(256)["error"];
    const CliResult never = run(judge + std::to_string(truth));
    EXPECT_EQ(never.status, int(cmd::ExitCode::difference));
    const json document = json::parse(never.out);
    EXPECT_EQ(document["result"], "undecided");
    EXPECT_EQ(document["verified"]["surfaces"]["points"], 128);
    EXPECT_NE(never.err.find("take more --points than 16"), std::string::npos) << never.err;
}

TEST_F(VerifyCli, ReadsSurfacesAsTheyAreFitted) {
    change("fit", "unity");
    EXPECT_EQ(run_json("changed.vdb" + room_)["verified"]["reader"], "unity");
    EXPECT_EQ(run_json("changed.vdb" + room_ + " --sampler godot")["verified"]["reader"], "godot");
    for (const std::string target : {"threejs", "generic"}) {
        const CliResult made =
            run_lpvbake(folder_, "convert v.vdb raw.exr --fit none --target " + target);
        ASSERT_EQ(made.status, 0) << made.err;
        const json raw = run_json("raw.exr" + room_ + " --fail 1000%");
        EXPECT_EQ(raw["verified"]["reader"], target == "generic" ? "lpvbake" : target);
        EXPECT_EQ(raw["judged"], target == "generic" ? "cells" : "surfaces");
    }
}

TEST_F(VerifyCli, RefusesWhatCannotBeMeasured) {
    const auto expect_error = [&](const std::string& arguments, cmd::ExitCode code,
                                  const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    };
    expect_error(
        "v.vdb" + room_ + " --fail 8", cmd::ExitCode::usage,
        "--fail: '8' is no share up to 1, such as 0.01; say 8%, or for as much as that 800%");
    expect_error("v.vdb" + room_ + " --fail-on cells", cmd::ExitCode::usage,
                 "--fail-on needs --fail");
    expect_error("v.vdb", cmd::ExitCode::usage, "no scene: lpvbake verify VOLUME SCENE");
    expect_error("none.vdb" + room_, cmd::ExitCode::file, "none.vdb: cannot be read");
    expect_error("v.vdb none.glb", cmd::ExitCode::file, "none.glb: ");
    expect_error("v.vdb" + room_ + " --sky 0:0:0,0 --no-emitters --no-scene-lights -q"
                     + " --no-light 'a*'",
                 cmd::ExitCode::invalid, "v.vdb: no light arrives where it was measured in ");
    for (const char* settings : {"sun = [[1]]", "sun = [", "max-albedo = 7"}) {
        change("settings", settings);
        expect_error("changed.vdb" + room_, cmd::ExitCode::invalid, "changed.vdb: its settings:");
    }
    change("quantity", "standard error");
    expect_error("changed.vdb" + room_, cmd::ExitCode::invalid, "holds errors, not light");
}

} // namespace
} // namespace lpvbake
