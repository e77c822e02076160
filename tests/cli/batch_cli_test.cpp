// What build systems and farms ask of `lpvbake bake`: depfiles, progress, signals, hints.
#include "cli/run.h"

#include <nlohmann/json.hpp>

#include <sstream>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;
namespace fs = std::filesystem;

class BatchCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    CliResult bake(const std::string& arguments) {
        return run("bake \"$ROOM\" --resolution 8 --quality fast --solver gather " + arguments);
    }
    bool shell(const std::string& script) {
        spill(folder_ / "script", script);
        return std::system(("cd '" + folder_.path().string() + "' && bash script").c_str()) == 0;
    }

    TemporaryFolder folder_;
};

TEST_F(BatchCli, ADepfileHasAllThatIsRead) {
    // A scene of a buffer and a picture beside it, of a name that Make reads otherwise.
    fs::create_directory(folder_ / "my $cene");
    json scene = json::parse(slurp(LPVBAKE_EXAMPLES "/cornell_box.gltf"));
    json& uri = scene["buffers"][0]["uri"];
    const std::string embedded = uri;
    spill(folder_ / "base64", embedded.substr(embedded.find(',') + 1));
    ASSERT_TRUE(shell("base64 -d base64 > 'my $cene/a#b:c.bin'"));
    uri = "a%23b%3Ac.bin";
    spill(folder_ / "my $cene/room.gltf", scene.dump());
    std::string picture = "PF\n1 1\n-1.0\n" + std::string(12, '\0');
    spill(folder_ / "sky.pfm", picture.replace(picture.size() - 12, 12, std::string(12, '\x40')));
    spill(folder_ / "a.toml", "resolution = 6\n");
    const std::string from = "bake 'my $cene/room.gltf' --quality fast --solver gather "
                             "--config a.toml --sky sky.pfm -o a.vdb -o b:c.exr --depfile a.d -q";
    ASSERT_EQ(run(from).status, 0);
    const std::string rule = slurp(folder_ / "a.d");
    EXPECT_EQ(rule.substr(0, 16), "a.vdb b\\:c.exr: ") << rule;
    for (const std::string file :
         {"my\\ $$cene/room.gltf", "/my\\ $$cene/a\\#b\\:c.bin", "sky.pfm", "a.toml"})
        EXPECT_NE(rule.find(file), std::string::npos) << rule;
    // Make does nothing until what is read changes, and knows every word of the rule.
    spill(folder_ / "Makefile", "a.vdb:\n\ttouch a.vdb\n\techo made >> log\n-include a.d\n");
    ASSERT_TRUE(shell("touch a.vdb && make -s a.vdb && test ! -e log && sleep 0.1 && touch sky.pfm "
                      "&& make -s a.vdb && test \"$(cat log)\" = made"));
    ASSERT_EQ(run(from + " --if-changed").status, 0);
    EXPECT_EQ(slurp(folder_ / "a.d"), rule);
}

TEST_F(BatchCli, WhatIsThereIsLeftAsItIs) {
    const std::string missing = "-o a.vdb --if-missing --layers lights,emitters";
    ASSERT_EQ(bake(missing).status, 0);
    const std::string bytes = slurp(folder_ / "a.vdb");
    // Of whatever options, and of a scene that is gone.
    const CliResult again = run("bake gone.gltf --resolution 4 --layers lights " + missing);
    EXPECT_EQ(again.status, int(ExitCode::file)); // options are checked as ever
    const CliResult left = run("bake \"$ROOM\" --resolution 4 " + missing);
    EXPECT_EQ(left.status, 0);
    EXPECT_EQ(left.out.substr(0, 9), "unchanged") << left.out;
    EXPECT_EQ(json::parse(bake(missing + " --format json").out)["unchanged"], true);
    EXPECT_EQ(slurp(folder_ / "a.vdb"), bytes);
    // What is cut off, or is no bake's, is missing.
    spill(folder_ / "a.vdb", bytes.substr(0, bytes.size() / 2));
    EXPECT_NE(bake(missing).out.substr(0, 9), "unchanged");
    EXPECT_EQ(slurp(folder_ / "a.vdb"), bytes);
    fs::remove(folder_ / "a_layer_bulb.vdb");
    EXPECT_NE(bake(missing).out.substr(0, 9), "unchanged");
    EXPECT_TRUE(fs::exists(folder_ / "a_layer_bulb.vdb"));
    EXPECT_EQ(bake("-o a.vdb --if-missing --if-changed").status, int(ExitCode::usage));
}

/// Whole numbers of lines that begin so; the lines may be of nothing else.
std::vector<int> numbers_in(const std::string& text, const std::string& begin) {
    std::vector<int> numbers;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with(begin))
            numbers.push_back(std::stoi(line.substr(begin.size())));
        else
            EXPECT_TRUE(line.starts_with("openjd_")) << line;
    }
    return numbers;
}

TEST_F(BatchCli, ProgressIsOfTheWhole) {
    for (const auto& [style, begin] :
         {std::pair("percent", ""), std::pair("openjd", "openjd_progress: ")}) {
        const CliResult baked = run("bake \"$ROOM\" --resolution 40 --solver sn --progress "
                                    + std::string(style) + " -o a.vdb");
        ASSERT_EQ(baked.status, 0);
        const std::vector<int> numbers = numbers_in(baked.err, begin);
        EXPECT_TRUE(std::ranges::is_sorted(numbers)) << baked.err;
        ASSERT_GE(numbers.size(), 2u);
        EXPECT_GE(numbers.front(), 0);
        EXPECT_EQ(numbers.back(), 100);
        EXPECT_LT(numbers.end()[-2], 100);
    }
    const CliResult failed = run("bake gone.gltf -o a.vdb --progress openjd");
    EXPECT_EQ(failed.status, int(ExitCode::file));
    EXPECT_EQ(failed.err.find("openjd_fail: "), failed.err.find('\n') + 1) << failed.err;
}

TEST_F(BatchCli, TerminationIsAnsweredWhateverGoesOn) {
    // Standard input that never ends: nothing asks whether a signal came.
    ASSERT_TRUE(shell("mkfifo pipe\n"
                      "'" LPVBAKE_BINARY "' bake - -o a.vdb < pipe 2> err &\n"
                      "exec 3> pipe\n"
                      "echo '{' >&3\n"
                      "sleep 1\n"
                      "kill -TERM $!\n"
                      "for i in $(seq 300); do kill -0 $! 2>> log || break; sleep 0.1; done\n"
                      "kill -KILL $! 2>> log && exit 1\n"
                      "wait $!\n"
                      "test $? = 143"));
    EXPECT_EQ(slurp(folder_ / "err"), "lpvbake: error: terminated\n");
}

TEST_F(BatchCli, ADryRunSaysWhatToAskFor) {
    const json plan = json::parse(bake("-o a.vdb --dry-run --format json --threads 1").out);
    const json& hints = plan["hints"];
    EXPECT_EQ(hints["threads"], 1);
    EXPECT_GE(hints["minutes"].get<int>(), 1);
    EXPECT_GT(hints["memory_mib"].get<double>() * 0x1p20,
              plan["host_bytes"].get<double>() + plan["device_bytes"].get<double>());
    const json made = json::parse(bake("-o a.vdb --format json --threads 1").out);
    EXPECT_LT(made["peak_memory"].get<double>(), hints["memory_mib"].get<double>() * 0x1p20);
    EXPECT_NE(bake("-o a.vdb --dry-run").out.find("--mem="), std::string::npos);
}

} // namespace
} // namespace lpvbake
