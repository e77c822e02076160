// The table of options: a toy option is a row of a toy command, and nothing else.

#include "lpvbake/error.h"
#include "options/file.h"
#include "options/help_text.h"
#include "options/reference.h"
#include "options/toml.h"
#include "unit/volumes.h"

#include <gtest/gtest.h>

#include <memory>
#include <sstream>

namespace lpvbake {
namespace {

struct Toy {
    double glow = 0.5;
    std::string from;
    std::vector<std::string> extra;
    std::optional<int> depth;
    bool loud = false;
    std::vector<std::string> configs;
    bool print_config = false;
};

Toy last; ///< what the toy command ran with
std::string last_recorded;

cmd::options::Action declare_toy(cmd::options::Options& options) {
    const auto fields = std::make_shared<Toy>();
    Toy& o = *fields;
    options.text("from", o.from, "FILE", "Where from");
    options.group("Toy");
    options.number("--glow", o.glow, 0, 10, "How much it glows").record(); // the toy option
    options.texts("--extra", o.extra, "TEXT", "More of it");
    options.number("--depth", o.depth, 1, 9, "How deep")
        .implies("3")
        .record(cmd::options::Recorded::if_changed);
    options.flag("--loud", o.loud, "Say it").exclude({"depth"});
    options.texts("--config", o.configs, "FILE", "Option file").keep_out_of_files();
    options.flag("--print-config", o.print_config, "Print them").keep_out_of_files();
    return [fields, &options] {
        last = *fields;
        last_recorded = options.recorded();
    };
}

/// Another command, to share option files with.
cmd::options::Action declare_bell(cmd::options::Options& options) {
    const auto pitch = std::make_shared<double>(440);
    options.number("--pitch", *pitch, 0, 1e5, "Of its tone, Hz");
    return [pitch] {};
}

const cmd::options::Commands toys{{"toy", "Glows.", "Examples:\n  lpvbake toy", declare_toy},
                                  {"bell", "Rings.", "Examples:\n  lpvbake bell", declare_bell}};

/// The complaint, empty if there is none.
std::string complaint(const std::vector<std::string>& words) {
    try {
        cmd::options::run_command_line(toys, words);
        return "";
    } catch (const Error& error) {
        EXPECT_EQ(error.kind, ErrorKind::argument);
        return error.what();
    }
}

std::string printed(const std::vector<std::string>& words) {
    testing::internal::CaptureStdout();
    cmd::options::run_command_line(toys, words);
    std::fflush(stdout);
    return testing::internal::GetCapturedStdout();
}

TEST(Options, ARowIsOnTheCommandLine) {
    cmd::options::run_command_line(toys, {"toy", "a.gltf", "--glow", "2.50"});
    EXPECT_EQ(last.glow, 2.5);
    EXPECT_EQ(last.from, "a.gltf");
    cmd::options::run_command_line(toys, {"toy"});
    EXPECT_EQ(last.glow, 0.5);
    EXPECT_EQ(complaint({"toy", "--glow=11"}),
              "toy: --glow: '11' is not a number from 0 to 10 (see lpvbake toy --help)");
    EXPECT_NE(complaint({"toy", "--glov=1"}).find("did you mean --glow?"), std::string::npos);
    EXPECT_NE(complaint({"toy", "--glow"}).find("--glow needs a value: X"), std::string::npos);
    EXPECT_NE(complaint({"toy", "--glow=1", "--glow=2"}).find("more than once"), std::string::npos);
    EXPECT_EQ(complaint({"toy", "--loud", "--depth=2"}), "--loud and --depth exclude each other");
}

TEST(Options, ARowIsInOptionFilesAndPrintsIntoThem) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.toml";
    spill(path, "glow = 4\nextra = [\"a\", 'b']\n[toy]\ndepth = 7 # deep\n");
    cmd::options::run_command_line(toys, {"toy", "--config", path});
    EXPECT_EQ(last.glow, 4);
    EXPECT_EQ(last.extra, (std::vector<std::string>{"a", "b"}));
    EXPECT_EQ(last.depth, 7);
    cmd::options::run_command_line(toys, {"toy", "--config", path, "--glow", "5", "--loud"});
    EXPECT_EQ(last.glow, 5) << "the command line comes first";
    EXPECT_EQ(last.depth, std::nullopt) << "and what it excludes is left out";
    EXPECT_TRUE(last.loud);

    const std::string text = printed(
        {"toy", "a.gltf", "--glow=6", "--extra=\"\t\x1b", "--extra=1,2.5,#ff", "--print-config"});
    EXPECT_EQ(text, "[toy]\n\n# Toy\n\n# How much it glows\nglow = 6\n\n# More of it\n"
                    "extra = [\"\\\"\\t\\u001B\", [1, 2.5, \"#ff\"]]\n\n# How deep\n#depth = 3\n\n"
                    "# Say it\nloud = false\n")
        << "all but what it works on";
    spill(path, text);
    EXPECT_EQ(printed({"toy", "--config", path, "--print-config"}), text);

    const auto refused = [&](const std::string& file, const std::string& why) {
        spill(path, file);
        EXPECT_NE(complaint({"toy", "--config", path}).find(path + why), std::string::npos)
            << complaint({"toy", "--config", path});
    };
    refused("\nglow = 11\n", ":2: --glow: '11' is not");
    refused("glov = 1\n", ":1: 'glov' is not an option of toy; did you mean glow?");
    refused("glow = 1\n\nglow = 2\n", ":3: glow is set twice");
    refused("pitch = 1\n[toy]\npitch = 2\n", ":3: 'pitch' is not an option of toy");
    refused("[bell]\nglow = 2\n", ":2: 'glow' is not an option of bell");
    refused("depth = 2.0\n", ":1: --depth: '2.0' is not a whole number");
    refused("glow = [1, 2]\n", ":1: --glow: '1,2' is not a number");
    refused("glow = 1979-05-27\n", ":1: expected a string, a number");
    refused("from = \"a\\u0000b\"\n", ":1: a string holds a NUL character");
    refused("[cook]\n", ":1: [cook] is no command");
    refused("config = \"b.toml\"\n", ":1: 'config' belongs on the command line");
}

TEST(Options, FilesServeSeveralCommandsAndTheLaterOnesWin) {
    const TemporaryFolder folder;
    const std::string first = folder / "a.toml", second = folder / "b.toml";
    spill(first,
          "pitch = 880\nglow = 1\nextra = [\"a\", \"b\"]\n[bell]\npitch = 220\n[toy]\nglow = 2\n");
    spill(second, "depth = 5\n[toy]\nextra = []\n");
    cmd::options::run_command_line(toys, {"toy", "--config", first});
    EXPECT_EQ(last.glow, 2) << "the command's own table comes before the shared one";
    EXPECT_EQ(last.extra.size(), 2u);
    cmd::options::run_command_line(toys, {"toy", "--config", first, "--config", second});
    EXPECT_EQ(last.glow, 2);
    EXPECT_EQ(last.depth, 5);
    EXPECT_EQ(last.extra.size(), 0u) << "an empty array is a value";
    spill(second, "glow = 3\nloud = true\n");
    spill(first, "depth = 4\n[toy]\nglow = 2\n");
    cmd::options::run_command_line(toys, {"toy", "--config", first, "--config", second});
    EXPECT_EQ(last.glow, 3) << "a later file wins, whatever the table";
    EXPECT_EQ(last.depth, std::nullopt) << "and what it excludes is left out";
}

TEST(Options, ArraysAreAsTomlHasThem) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.toml";
    const auto extra = [&](const std::string& text) {
        spill(path, "extra = " + text + "\n");
        cmd::options::run_command_line(toys, {"toy", "--config", path});
        return last.extra;
    };
    using Texts = std::vector<std::string>;
    EXPECT_EQ(extra("\"1,2\""), Texts{"1,2"});
    EXPECT_EQ(extra("[30, 5.0, 1e5, \"#ff\"]"), Texts{"30,5.0,1e+05,#ff"});
    EXPECT_EQ(extra("[[1, 2, [0.5, 1, 1]], \"3,4\"]"), (Texts{"1,2,0.5:1:1", "3,4"}));
    spill(path, "from = [1, [2, 3]]\n");
    cmd::options::run_command_line(toys, {"toy", "--config", path});
    EXPECT_EQ(last.from, "1,2:3");
}

TEST(Options, ARowIsAmongTheSettingsThatAreRecorded) {
    cmd::options::run_command_line(toys, {"toy", "--extra=a"});
    EXPECT_EQ(last_recorded, "glow = 0.5");
    cmd::options::run_command_line(toys, {"toy", "--glow=1", "--depth=4"});
    EXPECT_EQ(last_recorded, "glow = 1; depth = 4");
}

TEST(Options, ARowIsInTheHelpAndTheWrittenReference) {
    const std::string help = printed({"toy", "--help"});
    EXPECT_NE(help.find("--glow X=0.5"), std::string::npos) << help;
    EXPECT_NE(help.find("How much it glows"), std::string::npos) << help;
    EXPECT_LT(help.find("Examples:"), help.find("--glow"));
    cmd::options::Options wide;
    bool field = false;
    wide.flag("--wide", field,
              std::string(20, 'a') + " " + std::string(20, 'b') + " " + std::string(20, 'c'));
    const cmd::options::Command command{"toy", "Glows.",
                                        "Examples:\n  lpvbake toy\n\nA text of two\nlines.\n\n"
                                        "JSON: {\"command\"}",
                                        declare_toy};
    for (const auto& [width, last_line] : {std::pair(60, "\nA text of two lines.\n"), {100, ""}}) {
        const std::string text = cmd::options::help_text(command, wide, std::size_t(width));
        EXPECT_NE(text.find(last_line), std::string::npos) << text;
        std::istringstream lines(text);
        for (std::string line; std::getline(lines, line);)
            EXPECT_LE(line.size(), std::size_t(width)) << line;
    }
    EXPECT_EQ(cmd::options::documents_of(command), "JSON: {\"command\"}\n");
    EXPECT_NE(cmd::options::reference_markdown(toys[0]).find(
                  "| `--glow X` | `0.5` | How much it glows |\n"),
              std::string::npos)
        << cmd::options::reference_markdown(toys[0]);
    const auto rows = cmd::options::reference_json(toys[0])["options"];
    ASSERT_EQ(rows.size(), 7u);
    EXPECT_EQ(rows[1]["name"], "glow");
    EXPECT_EQ(rows[1]["type"], "X");
    EXPECT_EQ(rows[1]["default"], "0.5");
    EXPECT_EQ(rows[1]["recorded"], "always");
    EXPECT_EQ(rows[4]["excludes"][0], "depth");
}

TEST(Options, SweepTablesKeepTheirOrder) {
    const TemporaryFolder folder;
    const std::string path = folder / "s.toml";
    spill(path, "z = 1\na = [2, \"3\"]\n[[sweep]]\nb = true\n[[sweep]]\n[[sweep]]\nc = 0.5\n");
    const auto tables = cmd::options::read_config_tables(path, "sweep");
    ASSERT_EQ(tables.size(), 3u);
    ASSERT_EQ(tables[0].size(), 2u);
    EXPECT_EQ(tables[0][0].key, "z");
    EXPECT_EQ(tables[0][1].values, (std::vector<std::string>{"2", "3"}));
    EXPECT_EQ(tables[0][1].line, 2);
    EXPECT_EQ(tables[1][0].values[0], "true");
    EXPECT_EQ(tables[2][0].values[0], "0.5");
}

} // namespace
} // namespace lpvbake
