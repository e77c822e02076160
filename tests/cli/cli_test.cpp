// The program from outside: command, status, standard output, standard error, files.
//
// LPVBAKE_BINARY is the program's path. Scenes are written as text by the tests themselves.

#include "cli/run.h"
#include "image/image.h"
#include "io/io.h"
#include "options/wording.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Environment = std::map<std::string, std::string>;

using Result = CliResult;

/// A temporary folder in which the program runs, with a scene or two.
class Cli : public ::testing::Test {
protected:
    Cli() {
        spill(folder_ / "room.gltf", room(true).dump());
        spill(folder_ / "dark.gltf", room(false).dump());
    }

    /// Starts the program; `output` and `error` are files in the folder or absolute paths.
    pid_t start(const std::vector<std::string>& arguments, const Environment& environment = {},
                const std::string& output = "stdout", const std::string& error = "stderr") {
        const pid_t child = fork();
        if (child == 0) {
            const auto redirect = [](const std::string& to, int descriptor) {
                const int file = open(to.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
                if (file < 0 || dup2(file, descriptor) < 0)
                    _exit(125);
            };
            if (chdir(folder_.c_str()) != 0)
                _exit(125);
            redirect(output, STDOUT_FILENO);
            redirect(error, STDERR_FILENO);
            for (const auto& [name, value] : environment)
                setenv(name.c_str(), value.c_str(), 1);
            std::signal(SIGINT, SIG_DFL); // whoever runs the tests may ignore it
            std::vector<char*> argv{const_cast<char*>("lpvbake")};
            for (const std::string& argument : arguments)
                argv.push_back(const_cast<char*>(argument.c_str()));
            argv.push_back(nullptr);
            execv(LPVBAKE_BINARY, argv.data());
            _exit(125);
        }
        return child;
    }

    Result wait_for(pid_t child) {
        int status = 0;
        waitpid(child, &status, 0);
        return {WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status),
                slurp(folder_ / "stdout"), slurp(folder_ / "stderr")};
    }

    Result run(const std::vector<std::string>& arguments, const Environment& environment = {}) {
        return wait_for(start(arguments, environment));
    }

    /// Expects a status and one line on standard error that contains `text`, and no result.
    void expect_error(const std::vector<std::string>& arguments, cmd::ExitCode code,
                      const std::string& text, const Environment& environment = {}) {
        const Result result = run(arguments, environment);
        std::string command;
        for (const std::string& argument : arguments)
            command += argument + " ";
        expect_one_error(result, command, code, text);
    }

    void need_device() {
        if (run({"devices"}).status == int(cmd::ExitCode::device))
            GTEST_SKIP() << "no Vulkan device";
    }

    /// The room with a picture that glows on its walls, in so long a file that the picture does not
    /// fit into 1 MiB beside it.
    void spill_glowing_room(const char* name) {
        constexpr std::size_t side = 256;
        const std::vector<unsigned char> picture = image::encode_png(
            {int(side), int(side), 3, std::vector<float>(3 * side * side, 0.5f)}, name);
        json scene = room(true);
        scene["accessors"].push_back(
            {{"bufferView", 0}, {"componentType", 5126}, {"count", 8}, {"type", "VEC2"}});
        scene["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 2;
        scene["materials"][0]["emissiveFactor"] = {1, 1, 1};
        scene["materials"][0]["emissiveTexture"]["index"] = 0;
        scene["textures"] = {{{"source", 0}}};
        scene["images"] = {{{"uri", "data:image/png;base64,"
                                        + base64(std::string(picture.begin(), picture.end()))}}};
        spill(folder_ / name, scene.dump() + std::string(550000, ' '));
    }

    std::vector<std::string> entries() {
        std::vector<std::string> names;
        for (const auto& entry : fs::directory_iterator(folder_))
            names.push_back(entry.path().filename().string());
        std::sort(names.begin(), names.end());
        return names;
    }

    const TemporaryFolder temporary_;
    const fs::path folder_ = temporary_.path();

private:
    static std::string base64(const std::string& bytes) {
        const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        std::string text;
        for (std::size_t i = 0; i < bytes.size(); i += 3) {
            uint32_t word = 0;
            for (std::size_t k = 0; k < 3; ++k)
                word = word << 8
                       | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
            for (std::size_t k = 0; k < 4; ++k)
                text += i + k <= bytes.size() ? digits[word >> (18 - 6 * k) & 63] : '=';
        }
        return text;
    }

    /// A room of 2 m, open towards +Z: five double-sided walls, with or without a point light of
    /// 100 cd below its ceiling.
    static json room(bool light) {
        const float corners[8][3] = {{-1, 0, -1}, {1, 0, -1}, {-1, 2, -1}, {1, 2, -1},
                                     {-1, 0, 1},  {1, 0, 1},  {-1, 2, 1},  {1, 2, 1}};
        const uint16_t indices[30] = {0, 1, 3, 0, 3, 2, 0, 4, 5, 0, 5, 1, 2, 3, 7,
                                      2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3};
        std::string bytes(reinterpret_cast<const char*>(corners), sizeof corners);
        bytes.append(reinterpret_cast<const char*>(indices), sizeof indices);
        json scene{
            {"asset", {{"version", "2.0"}}},
            {"scene", 0},
            {"scenes", {{{"nodes", {0}}}}},
            {"nodes", {{{"mesh", 0}}}},
            {"meshes",
             {{{"primitives",
                {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}, {"material", 0}}}}}}},
            {"materials",
             {{{"doubleSided", true},
               {"pbrMetallicRoughness",
                {{"baseColorFactor", {0.8, 0.6, 0.4, 1.0}}, {"metallicFactor", 0.0}}}}}},
            {"buffers",
             {{{"byteLength", bytes.size()},
               {"uri", "data:application/octet-stream;base64," + base64(bytes)}}}},
            {"bufferViews",
             {{{"buffer", 0}, {"byteLength", sizeof corners}},
              {{"buffer", 0}, {"byteOffset", sizeof corners}, {"byteLength", sizeof indices}}}},
            {"accessors",
             {{{"bufferView", 0},
               {"componentType", 5126},
               {"count", 8},
               {"type", "VEC3"},
               {"min", {-1, 0, -1}},
               {"max", {1, 2, 1}}},
              {{"bufferView", 1}, {"componentType", 5123}, {"count", 30}, {"type", "SCALAR"}}}}};
        if (light) {
            scene["extensionsUsed"] = {"KHR_lights_punctual"};
            scene["extensions"]["KHR_lights_punctual"]["lights"] = {
                {{"type", "point"}, {"intensity", 100.0}}};
            scene["nodes"].push_back({{"translation", {0.0, 1.7, 0.0}},
                                      {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
            scene["scenes"][0]["nodes"] = {0, 1};
        }
        return scene;
    }
};

const std::vector<std::string> quick{"bake", "room.gltf", "--resolution", "8"};

std::vector<std::string> operator+(std::vector<std::string> list,
                                   const std::vector<std::string>& more) {
    list.insert(list.end(), more.begin(), more.end());
    return list;
}

// ---------------------------------------------------------------- help, usage

TEST_F(Cli, HelpNamesEveryExitCodeAndCommand) {
    const Result result = run({"--help"});
    EXPECT_EQ(result.status, 0);
    EXPECT_EQ(result.err, "");
    for (const cmd::ExitCodeMeaning& row : cmd::exit_codes)
        EXPECT_TRUE(std::regex_search(
            result.out, std::regex("\n +" + std::to_string(int(row.code)) + " +"
                                   + (row.error ? cmd::retry_names[std::size_t(row.retry)] : "")
                                   + " +" + std::string(row.meaning).substr(0, 10))))
            << int(row.code);
    for (const char* command : {"bake", "reference", "info", "render", "verify", "diff", "convert",
                                "report", "devices", "help"}) {
        EXPECT_NE(result.out.find(std::string("\n  ") + command), std::string::npos) << command;
        const Result own = run({command, "--help"});
        EXPECT_EQ(own.status, 0);
        EXPECT_EQ(run({"help", command}).out, own.out);
        EXPECT_LT(own.out.find("Examples:\n  lpvbake "), own.out.find("  --format text"))
            << command;
        EXPECT_EQ(own.out.find("{\"command\""), std::string::npos) << command;
        std::istringstream lines(own.out);
        for (std::string line; std::getline(lines, line);)
            EXPECT_LE(line.size(), 100u) << line;
    }
    EXPECT_EQ(run({"--version"}).out, "lpvbake " LPVBAKE_VERSION "\n");
    EXPECT_EQ(run({"-V"}).out, run({"--version"}).out);
    const Result documents = run({"help", "json"});
    EXPECT_EQ(documents.status, 0);
    for (const char* command : {"bake", "reference", "info", "render", "verify", "diff", "convert",
                                "report", "devices", "help"})
        EXPECT_NE(documents.out.find("{\"command\": \"" + std::string(command) + "\""),
                  std::string::npos)
            << command;
    EXPECT_NE(documents.out.find("\"exit_code\", \"message\", \"file\" or null, \"retry\""),
              std::string::npos);
}

TEST_F(Cli, WrittenReferenceIsThatOfTheProgram) {
    EXPECT_TRUE(slurp(LPVBAKE_EXAMPLES "/../cmd/README.md")
                == run({"help", "--format", "markdown"}).out)
        << "run lpvbake help --format markdown > cmd/README.md";
    const json reference = json::parse(run({"help", "render", "--format", "json"}).out);
    ASSERT_EQ(reference["commands"].size(), 1u);
    EXPECT_EQ(reference["commands"][0]["options"][1]["name"], "volume");
    EXPECT_EQ(run({"help", "bake"}).out, run({"bake", "--help"}).out);
    expect_error({"help", "bak"}, cmd::ExitCode::usage, "no command 'bak'; did you mean bake?");
}

TEST_F(Cli, TextsOfTheLibraryNameOptions) {
    EXPECT_EQ(cmd::options::in_options("`a`: `resolution`, `max_albedo`; `resolution"),
              "`a`: --resolution, --max-albedo; `resolution");
    std::string help;
    for (const char* command : {"bake", "reference", "render", "report", "world"})
        help += run({command, "--help"}).out;
    std::ranges::replace(help, ',', ' '); // between names of one option
    for (const auto& [setting, option] : cmd::options::wordings())
        for (std::istringstream words(option); words;) {
            std::string word;
            words >> word;
            EXPECT_TRUE(!word.starts_with("--") || help.find(" " + word + " ") != std::string::npos)
                << setting << ": " << word;
        }

    need_device();
    expect_error({"bake", "room.gltf", "-o", "a.vdb", "--point", "1e19,2,3,1"},
                 cmd::ExitCode::invalid, "farther than 1e18 cells");
    expect_error(
        {"bake", "dark.gltf", "-o", "a.vdb"}, cmd::ExitCode::invalid,
        "dark.gltf: no light and no emissive surface; add --default-light or light with --sun "
        "AZIMUTH,ELEVATION,LUX, --point X,Y,Z,CD, --sky COLOUR,NITS or --lights FILE\n");
    spill_glowing_room("glows.gltf");
    const std::vector<std::string> small{"glows.gltf", "--max-memory", "1M"};
    const std::string warning = "glows.gltf: images: halved, once or more, to fit into memory: 1 "
                                "of 1; allow more with --max-memory or use smaller ones";
    expect_error({"info", "glows.gltf", "--max-memory", "1M", "--strict"}, cmd::ExitCode::invalid,
                 warning + " (--strict)\n");
    const Result info = run(std::vector<std::string>{"info", "--format", "json"} + small);
    EXPECT_EQ(info.err, "lpvbake: warning: " + warning + "\n");
    EXPECT_EQ(json::parse(info.out)["warnings"], json{warning});
    const Result bake = run(std::vector<std::string>{"bake", "--dry-run", "--format", "json",
                                                     "--solver", "lpv", "--occlusion", "none"}
                            + small);
    EXPECT_EQ(bake.err, "lpvbake: warning: " + warning + "\n");
    const json plan = json::parse(bake.out);
    EXPECT_EQ(plan["warnings"], json{warning});
    EXPECT_TRUE(std::ranges::any_of(plan["skipped"], [](const json& stage) {
        return stage["why"] == "--occlusion none";
    })) << plan["skipped"];
    const Result report =
        run(std::vector<std::string>{"report", "--solver", "lpv", "--resolution", "4", "--rays",
                                     "64", "--no-peer", "--format", "json"}
            + small);
    EXPECT_EQ(report.err.find('`'), std::string::npos) << report.err;
    const json scene = json::parse(report.out)["scenes"][0];
    EXPECT_EQ(scene["warnings"][0], warning);
    EXPECT_EQ(report.out.find('`'), std::string::npos) << report.out;
}

TEST_F(Cli, WrongCommandLinesAreRefusedBeforeAnyWork) {
    const std::vector<std::string> bake{"bake", "room.gltf", "-o", "a.vdb"};
    const auto refused = [&](const std::vector<std::string>& arguments, const std::string& text) {
        expect_error(arguments, cmd::ExitCode::usage, text);
    };
    refused({}, "no command");
    refused({"--flavour"}, "unknown option --flavour");
    refused({"cook"}, "there is no command 'cook' (see");
    refused({"bakes"}, "there is no command 'bakes'; did you mean bake?");
    refused({"bake"}, "no scene");
    refused({"bake", "room.gltf"}, "-o FILE.vdb");
    refused({"bake", "room.gltf", "-o"}, "bake: --output needs a value: FILE (see");
    refused({"bake", "room.gltf", "--resolution", "8", "--resolution", "9"}, "more than once");
    refused({"bake", "room.gltf", "--strict=so"}, "bake: --strict: 'so' is neither true nor false");
    for (const char* near : {"--resoluton", "--resolution9=8", "-resolution", "--resol"})
        refused({"bake", near, "8", "room.gltf"}, "; did you mean --resolution? (see lpvbake bake");
    refused({"bake", "room.gltf", "-o", "a.txt"}, "a.txt: the name of an output ends in .vdb");
    refused({"bake", "room.gltf", "-o", "a.vdb", "-o", "./a.vdb"}, "./a.vdb: given twice");
    refused({"bake", "room.gltf", "-o", "l.exr", "--lights", "l.json"}, "would replace");
    refused({"bake", "room.gltf", "-o", "t.exr", "--sky", "t_sh_l0.exr"}, "would replace");
    refused({"convert", "v.exr", "v_sh_l0.exr"}, "would replace the input v.exr");
    refused({"convert", "v.vdb", "a.vdb", "./a.vdb"}, "given twice");
    refused({"render", "room.gltf", "v.exr", "-o", "v_sh_l0.exr"}, "would replace the input v.exr");
    refused({"render", "room.gltf", "v.vdb", "-o", "s.exr", "--sky", "s.exr"}, "would replace");
    refused({"report", "room.gltf", "-o", "b.json", "--baseline", "b.json"}, "would replace");
    refused({"bake", "room.gltf", "--device", ""}, "--device: '' is empty");
    refused({"bake", "room.gltf", "--strict", "--strict=false"}, "more than once");
    refused({"info", "a.vdb", "--white", "3"}, "--white needs --slice");
    refused({"info", "a.vdb", "--scene", "3"}, "--scene-name: a.vdb is a volume");
    refused(bake + std::vector<std::string>{"more"},
            "bake: 'more' is one argument too many: lpvbake bake scene");
    refused(bake + std::vector<std::string>{"--flavour", "sweet"}, "unknown option --flavour (see");
    const std::map<std::string, std::vector<std::string>> values{
        {"--resolution", {"2", "0", "-4", "8.5", "x", "", "nan", "1e2", "99999999999999"}},
        {"--cell-size", {"0", "-1", "nan", "inf", "1e-300", "1m"}},
        {"--margin", {"-1", "1.5"}},
        {"--bounds", {"1", "0,0,0,1,1", "0,0,0,1,1,nan", "0,0,0,1,1,1,1", "0,0,0,1,-1,1", "1,2"}},
        {"--sun", {"1", "1,2", "1,2,3,red", "nan,2,3", "1,2,-3"}},
        {"--point", {"1,2,3", "1,2,3,x", "1,2,3,-4", "inf,0,0,1"}},
        {"--rsm-size", {"-1", "1000000"}},
        {"--rsm-kernel", {"0", "65"}},
        {"--rsm-samples", {"-1", "65537"}},
        {"--iterations", {"-1", "1.5"}},
        {"--tolerance", {"-1", "2", "nan"}},
        {"--error", {"0", "-1%", "101%", "few"}},
        {"--time-budget", {"0", "-1s", "soon", "2d", ""}},
        {"--dilate", {"-1", "1.5"}},
        {"--occlusion", {"some", "", "FACE"}},
        {"--max-albedo", {"-0.1", "1.1", "nan"}},
        {"--metallic", {"gold"}},
        {"--backfaces", {"no"}},
        {"--precision", {"double"}},
        {"--bytes", {"0", "-1M", "much"}},
        {"--isa", {"avx3", "AVX2", ""}},
        {"--rays", {"gpu", "Embree", ""}},
        {"--packing", {"tile"}},
        {"--threads", {"-1", "many"}},
        {"--format", {"yaml"}},
        {"--progress", {"loud"}},
    };
    for (const auto& [option, bad] : values)
        for (const std::string& value : bad)
            refused(bake + std::vector<std::string>{option + "=" + value}, "");
    refused(bake + std::vector<std::string>{"--resolution", "8", "--cell-size", "0.1"}, "exclude");
    refused(bake + std::vector<std::string>{"--solver", "lpv", "--tolerance", "0"}, "1e-07");
    // What another solver has is not left unsaid.
    using Words = std::vector<std::string>;
    for (const auto& [words, text] : std::vector<std::pair<Words, const char*>>{
             {{"--solver", "gather", "--directions", "96"}, "--directions is an option of sn"},
             {{"--solver", "gather", "--occlusion", "face"}, "--occlusion is an option of lpv"},
             {{"--solver", "lpv", "--vpls", "64"}, "--vpls is an option of gather, not of lpv"},
             {{"--solver", "lpv", "--quality", "fast"}, "--quality is an option of sn or gather"},
             {{"--solver", "sn", "--iterations", "4"}, "--iterations"},
             {{"--solver", "gather", "--rsm-size", "64"}, "--rsm-size"},
             {{"--solver", "lpv", "--sh-order", "2"}, "--sh-order 2"},
             {{"--vpls", "64", "--directions", "96"},
              "--vpls is an option of gather, not of sn (--directions)"},
             {{"--bytes", "100"},
              "--bytes 100: in bytes, of which a volume takes 1188 here at least; give more, such "
              "as 8M"},
             {{"--quality", "fast", "--error", "4%"}, "exclude"}})
        refused(bake + words, text);
    refused(bake + std::vector<std::string>{"--time-budget", "1d"},
            "'1d' is no time above 0, such as 500ms, 2s, 1.5min or 1h");
    refused({"info"}, "info: file is missing: lpvbake info file");
    refused({"info", "room.gltf", "--white", "-1"}, "--white: '-1' is not a number from");
    refused({"diff", "a.vdb"}, "diff: B is missing: lpvbake diff A B");
    refused({"devices", "--format", "xml"}, "'xml' is none of text|json");
    spill(folder_ / "room.txt", "neither");
    refused({"info", "room.txt"}, "room.txt: neither a scene");
    expect_error({"info", "room.tx"}, cmd::ExitCode::file, "room.tx: No such file");
    refused({"info", "room.gltf", "--slice", "z=1"}, "belong together");
    refused({"info", "room.gltf", "--slice", "z=1", "-o", "a.png"}, "is a scene");
    EXPECT_FALSE(fs::exists(folder_ / "a.vdb"));
}

TEST_F(Cli, PrintsNumbersAsShortAsTheyReadBack) {
    const Result result = run({"bake", "room.gltf", "--print-config"});
    EXPECT_NE(result.out.find("\n#tolerance = 0.3\n"), std::string::npos) << result.out;
    EXPECT_NE(result.out.find("\nmax-albedo = 0.95\n"), std::string::npos) << result.out;
}

TEST_F(Cli, CountsOneOfAThingAsOne) {
    need_device();
    const Result result = run(quick + std::vector<std::string>{"-o", "a.vdb"});
    for (const char* text : {"triangles, 1 light\n", "  1 output\n"})
        EXPECT_NE(result.out.find(text), std::string::npos) << text << result.out;
}

TEST_F(Cli, ConfigFileRoundTrips) {
    const std::vector<std::string> arguments{"bake",
                                             "room.gltf",
                                             "-o",
                                             "a \"b\" \\c.vdb",
                                             "-o",
                                             "d.exr",
                                             "--cell-size",
                                             "0.1",
                                             "--bounds=-1,0,-1,1,2,1",
                                             "--margin",
                                             "2",
                                             "--scene",
                                             "1",
                                             "--animation",
                                             "walk",
                                             "--time",
                                             "0.5",
                                             "--max-memory",
                                             "1G",
                                             "--strict",
                                             "--sun",
                                             "10,20,3e4,#ffeedd",
                                             "--sun",
                                             "1,2,3",
                                             "--point",
                                             "0,1,0,5",
                                             "--lights",
                                             "l # [x].json",
                                             "--no-scene-lights",
                                             "--no-emitters",
                                             "--bounces",
                                             "3",
                                             "--directions",
                                             "96",
                                             "--vpls",
                                             "99",
                                             "--rsm-size",
                                             "128",
                                             "--rsm-kernel",
                                             "2",
                                             "--rsm-samples",
                                             "5",
                                             "--iterations",
                                             "7",
                                             "--tolerance",
                                             "0.01",
                                             "--occlusion",
                                             "sh",
                                             "--max-albedo",
                                             "0.9",
                                             "--metallic",
                                             "black",
                                             "--backfaces",
                                             "cull",
                                             "--precision",
                                             "half",
                                             "--packing",
                                             "channel",
                                             "--device",
                                             "llvmpipe",
                                             "--threads",
                                             "2",
                                             "--validation",
                                             "--format",
                                             "json",
                                             "--progress",
                                             "none"};
    const Result first = run(arguments + std::vector<std::string>{"--print-config"});
    ASSERT_EQ(first.status, 0) << first.err;
    spill(folder_ / "a.toml", first.out);
    const Result second = run({"bake", "--config", "a.toml", "--print-config"});
    EXPECT_EQ(second.status, 0) << second.err;
    EXPECT_EQ(second.out, first.out);
    EXPECT_NE(first.out.find("\nbounds = [-1, 0, -1, 1, 2, 1]\n"), std::string::npos) << first.out;
    // One file serves several commands.
    spill(folder_ / "b.toml", "seed = 5\n" + first.out + "\n[reference]\nrays = 128\n");
    EXPECT_EQ(run({"bake", "--config", "b.toml", "--print-config"}).out, first.out);
    const std::string other = run({"reference", "--config", "b.toml", "--print-config"}).out;
    for (const char* line : {"\nrays = 128\n", "\nseed = 5\n", "\nresolution = 32\n"})
        EXPECT_NE(other.find(line), std::string::npos) << other;

    // Every option of the help that is not about the file itself is in it.
    std::istringstream help(run({"bake", "--help"}).out);
    for (std::string line; std::getline(help, line);) {
        const std::size_t at = line.find("--");
        if (at == std::string::npos || line.substr(0, 2) != "  " || at > 5)
            continue;
        const std::string name = line.substr(at + 2, line.find_first_of(" =,", at) - at - 2);
        if (name == "help" || name == "config" || name == "print-config" || name == "dry-run"
            || name == "output" || name == "scene" || name == "at" || name == "depfile"
            || name == "lit" || name == "shard")
            // --scene-name; the others are of one run
            continue;
        EXPECT_TRUE(first.out.find("\n" + name + " = ") != std::string::npos
                    || first.out.find("\n#" + name + " = ") != std::string::npos)
            << name;
    }

    // The command line comes first; of two ways to say the same it takes the other's place.
    const Result changed =
        run({"bake", "--config", "a.toml", "--resolution", "9", "--margin", "3", "--print-config"});
    EXPECT_NE(changed.out.find("resolution = 9\n"), std::string::npos) << changed.out;
    EXPECT_NE(changed.out.find("margin = 3\n"), std::string::npos);
    EXPECT_NE(changed.out.find("\n#cell-size = X\n"), std::string::npos);
    EXPECT_NE(changed.out.find("rsm-size = 128\n"), std::string::npos);
}

TEST_F(Cli, BrokenConfigFilesNameTheLine) {
    const auto refused = [&](const std::string& text, const std::string& message) {
        spill(folder_ / "c.toml", text);
        expect_error({"bake", "--config", "c.toml", "--print-config"}, cmd::ExitCode::usage,
                     message);
    };
    refused("resolution = 8\nflavour = 1\n", "c.toml:2: 'flavour' is not an option");
    refused("config = \"c.toml\"\n", "c.toml:1:");
    refused("\nresolution = 2\n", "c.toml:2:");
    refused("resolution = [8, 9]\n", "c.toml:1:");
    refused("resolution 8\n", "c.toml:1:");
    refused("resolution =\n", "c.toml:1:");
    refused("resolution = 8 9\n", "c.toml:1:");
    refused("resolution = 8\nresolution = 9\n", "c.toml:2: resolution is set twice");
    refused("device = \"llvm\n", "c.toml:1:");
    refused("device = \"\\q\"\n", "c.toml:1:");
    refused("sun = [\"1,2,3\"\n", "c.toml:");
    refused("[bakes]\n", "c.toml:1: [bakes] is no command; did you mean bake?");
    refused("[info]\nrays = 1\n", "c.toml:2: 'rays' is not an option of info");
    refused("no-emitters = perhaps\n", "c.toml:1:");
    refused(std::string("\0\1\2", 3), "c.toml:1:");
}

// ---------------------------------------------------------------- sky

TEST_F(Cli, SkyFromAPicture) {
    const auto picture = [&](const char* name, int width, float first) {
        image::Pixels pixels{width, 4, 3, std::vector<float>(std::size_t(width) * 12, 2.0f)};
        pixels.samples[0] = first;
        const auto bytes = image::encode_exr(pixels, false, {}, name);
        spill(folder_ / name, std::string(bytes.begin(), bytes.end()));
    };
    picture("even.exr", 8, 2.0f);
    picture("bad.exr", 8, std::nanf(""));
    picture("negative.exr", 9, -1.0f);
    spill(folder_ / "text.hdr", "no picture");
    const std::vector<std::string> sky{"reference", "dark.gltf", "--resolution", "4",
                                       "--rays",    "64",        "-o",           "a.vdb"};
    expect_error(sky + std::vector<std::string>{"--sky", "none.exr"}, cmd::ExitCode::file,
                 "none.exr: ");
    expect_error(sky + std::vector<std::string>{"--sky", "text.hdr,2"}, cmd::ExitCode::invalid,
                 "text.hdr: the image cannot be decoded");
    expect_error(sky + std::vector<std::string>{"--sky", "even.exr,-2"}, cmd::ExitCode::usage,
                 "SCALE");
    expect_error(sky + std::vector<std::string>{"--sky", "red,2"}, cmd::ExitCode::usage,
                 "COLOUR,NITS or FILE[,SCALE]");
    expect_error(sky + std::vector<std::string>{"--sky", "1:1:1,2", "--sky-rotation", "9"},
                 cmd::ExitCode::usage, "--sky-rotation");

    const auto total = [&](const std::vector<std::string>& more) {
        const Result result = run(sky + more);
        EXPECT_EQ(result.status, 0) << result.err;
        return volume::total_energy(read_volume((folder_ / "a.vdb").string()));
    };
    const double even = total({"--sky", "1:1:1,6"});
    EXPECT_GT(even, 0.0);
    EXPECT_NEAR(total({"--sky", "even.exr,3", "--sky-rotation", "40"}) / even, 1.0, 0.05);
    const Volume volume = read_volume((folder_ / "a.vdb").string());
    EXPECT_NE(volume.metadata.at("settings").find("even.exr,3"), std::string::npos);
    EXPECT_NE(volume.metadata.at("settings").find("sky-rotation"), std::string::npos);
    const std::string hash = volume.metadata.at("scene_hash");
    const Result bad = run(sky + std::vector<std::string>{"--sky", "bad.exr,3"});
    EXPECT_EQ(bad.status, 0);
    EXPECT_NE(bad.err.find("bad.exr: 1 of 32 texels"), std::string::npos) << bad.err;
    EXPECT_NE(read_volume((folder_ / "a.vdb").string()).metadata.at("scene_hash"), hash);
    const Result negative = run(sky + std::vector<std::string>{"--sky", "negative.exr"});
    EXPECT_NE(negative.err.find("negative.exr: 1 of 36 texels"), std::string::npos);
    EXPECT_NE(negative.err.find("twice as wide as high"), std::string::npos) << negative.err;
}

// ---------------------------------------------------------------- failures, one a code

TEST_F(Cli, FilesThatCannotBeReadOrWritten) {
    expect_error({"bake", "none.gltf", "-o", "a.vdb"}, cmd::ExitCode::file, "none.gltf");
    expect_error({"info", "none.gltf"}, cmd::ExitCode::file, "none.gltf");
    expect_error({"info", "none.vdb"}, cmd::ExitCode::file, "none.vdb");
    expect_error({"info", "none.exr"}, cmd::ExitCode::file, "none");
    expect_error(quick + std::vector<std::string>{"-o", "none/a.vdb"}, cmd::ExitCode::file,
                 "none/a.vdb: its folder does not exist");
    expect_error(quick + std::vector<std::string>{"-o", "/proc/a.vdb"}, cmd::ExitCode::file,
                 "/proc/a.vdb: cannot be written");
    fs::create_directory(folder_ / "b.vdb");
    expect_error(quick + std::vector<std::string>{"-o", "b.vdb"}, cmd::ExitCode::file,
                 "b.vdb: is a folder");
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb", "--lights", "none.json"},
                 cmd::ExitCode::file, "none.json");
    expect_error({"bake", "--config", "none.toml"}, cmd::ExitCode::file, "none.toml");
    const Result full = wait_for(start({"--help"}, {}, "/dev/full"));
    EXPECT_EQ(full.status, int(cmd::ExitCode::io));
    EXPECT_FALSE(fs::exists(folder_ / "a.vdb"));
}

TEST_F(Cli, InvalidInput) {
    spill(folder_ / "broken.gltf", "{\"asset\": ");
    expect_error({"bake", "broken.gltf", "-o", "a.vdb"}, cmd::ExitCode::invalid, "broken.gltf");
    expect_error({"info", "broken.gltf"}, cmd::ExitCode::invalid, "broken.gltf");
    spill(folder_ / "broken.glb", "glTF");
    expect_error({"info", "broken.glb"}, cmd::ExitCode::invalid, "broken.glb");
    spill(folder_ / "broken.vdb", "no volume");
    expect_error({"info", "broken.vdb"}, cmd::ExitCode::invalid, "broken.vdb");
    spill(folder_ / "broken.json", "[]");
    expect_error({"info", "broken.json"}, cmd::ExitCode::invalid, "broken.json");
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb", "--lights", "broken.json"},
                 cmd::ExitCode::invalid, "broken.json");
}

TEST_F(Cli, PipesAreNoFiles) {
    for (const char* name : {"pipe.gltf", "pipe.glb", "pipe.vdb", "pipe.exr", "pipe.json"})
        ASSERT_EQ(mkfifo((folder_ / name).c_str(), 0600), 0);
    // A reader of a pipe would wait for whoever writes: these tests end by their time limit then.
    for (const char* scene : {"pipe.gltf", "pipe.glb"}) {
        const std::string text = std::string(scene) + ": is not a file\n";
        expect_error({"info", scene}, cmd::ExitCode::file, text);
        expect_error({"bake", scene, "-o", "a.vdb"}, cmd::ExitCode::file, text);
        expect_error({"reference", scene, "-o", "a.vdb"}, cmd::ExitCode::file, text);
        expect_error({"render", scene, "pipe.vdb", "-o", "a.png"}, cmd::ExitCode::file, text);
        expect_error({"report", scene}, cmd::ExitCode::file, text);
    }
    expect_error({"info", "pipe.vdb"}, cmd::ExitCode::file, "pipe.vdb: is not a file\n");
    expect_error({"info", "pipe.json"}, cmd::ExitCode::file, "pipe.json: is not a file\n");
    expect_error({"info", "pipe.exr"}, cmd::ExitCode::file, "pipe.json: is not a file\n");
    expect_error({"diff", "pipe.vdb", "pipe.vdb"}, cmd::ExitCode::file,
                 "pipe.vdb: is not a file\n");
    expect_error({"convert", "pipe.vdb", "a.vdb"}, cmd::ExitCode::file,
                 "pipe.vdb: is not a file\n");
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb", "--lights", "pipe.json"},
                 cmd::ExitCode::file, "pipe.json: is not a file\n");
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb", "--sky", "./pipe.exr"},
                 cmd::ExitCode::file, "pipe.exr: is not a file\n");
}

TEST_F(Cli, WhatIsNoSidecarIsToldPlainly) {
    const std::string start = "a.json: does not describe a volume of lpvbake: ";
    for (const auto& [text, part] :
         {std::pair<std::string, std::string>(slurp(folder_ / "room.gltf"), "it does not say"),
          {"[1, 2]", "it does not say"},
          {"3", "it does not say"},
          {"{\"format\": 3}", "format is 3, expected"},
          {"{\"format\": \"lpvbake flipbook\"}", "key 'version' not found"},
          {"{\"format\": ", "parse error"},
          {"{\"format\": \"" + std::string(1 << 20, 'x') + "\"}", "format is \"xxx"}}) {
        spill(folder_ / "a.json", text);
        const Result result = run({"info", "a.json"});
        expect_one_error(result, part, cmd::ExitCode::invalid, part);
        EXPECT_EQ(result.err.find("json.exception"), std::string::npos) << result.err;
        EXPECT_NE(result.err.find("a.json: "), std::string::npos) << result.err;
        EXPECT_LT(result.err.size(), 500u);
    }
}

TEST_F(Cli, ScenesFromStandardInput) {
    const auto piped = [&](const std::string& arguments) {
        return run_lpvbake(temporary_, arguments);
    };
    const Result file = piped("info room.gltf --format json");
    const Result input = piped("info - --format json < room.gltf");
    EXPECT_EQ(input.status, 0) << input.err;
    json expected = json::parse(file.out), document = json::parse(input.out);
    EXPECT_EQ(document["file"], "-");
    document["file"] = expected["file"];
    EXPECT_EQ(document, expected);
    const Result nothing = piped("info - < /dev/null");
    expect_one_error(nothing, "info -", cmd::ExitCode::invalid, "standard input: is not JSON");
    need_device();
    ASSERT_EQ(piped("bake room.gltf --resolution 8 -o file.vdb").status, 0);
    const Result baked = piped("bake --resolution 8 -o input.vdb - < room.gltf");
    ASSERT_EQ(baked.status, 0) << baked.err;
    const Volume a = read_volume((folder_ / "file.vdb").string());
    const Volume b = read_volume((folder_ / "input.vdb").string());
    EXPECT_EQ(a.sh, b.sh);
    EXPECT_EQ(a.metadata.at("scene_hash"), b.metadata.at("scene_hash"));
    const Result rendered =
        piped("render - file.vdb --size 16x16 --samples 1 -o a.png < room.gltf");
    EXPECT_EQ(rendered.status, 0) << rendered.err;
    const Result traced = piped("reference - --resolution 4 --rays 64 -o r.vdb < room.gltf");
    EXPECT_EQ(traced.status, 0) << traced.err;
    // A pipe, in which nobody can go back.
    const std::string command = "cat '" + (folder_ / "room.gltf").string()
                                + "' | '" LPVBAKE_BINARY "' bake - --dry-run > '"
                                + (folder_ / "stdout").string() + "'";
    EXPECT_EQ(std::system(command.c_str()), 0);
    const std::string config =
        "echo 'resolution = 8' | '" LPVBAKE_BINARY "' bake '" + (folder_ / "room.gltf").string()
        + "' --dry-run --config /dev/stdin > '" + (folder_ / "stdout").string() + "'";
    EXPECT_EQ(std::system(config.c_str()), 0);
    EXPECT_NE(slurp(folder_ / "stdout").find("8 x 8 x 8 cells"), std::string::npos);
}

TEST_F(Cli, VolumesWithoutLightSayWhy) {
    need_device();
    json black = json::parse(slurp(folder_ / "room.gltf"));
    black["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = {0, 0, 0, 1};
    spill(folder_ / "black.gltf", black.dump());
    json far = json::parse(slurp(folder_ / "room.gltf"));
    far["extensions"]["KHR_lights_punctual"]["lights"][0]["range"] = 0.01;
    spill(folder_ / "far.gltf", far.dump());
    struct Case {
        const char* scene;
        std::vector<std::string> options;
        const char* text;
    };
    for (const auto& [scene, options, text] :
         {Case{"black.gltf",
               {},
               "warning: black.gltf: the volume holds no light: all surfaces are black"},
          Case{"room.gltf", {"--max-albedo", "0"}, "nothing reflects any with --max-albedo 0"},
          Case{"far.gltf",
               {},
               "warning: far.gltf: the volume holds no light: none reaches a surface"}}) {
        for (const char* solver : {"gather", "sn", "lpv"}) {
            const Result result = run(std::vector<std::string>{"bake", scene, "--resolution", "6",
                                                               "--solver", solver, "-o", "a.vdb"}
                                      + options);
            EXPECT_EQ(result.status, 0) << result.err;
            EXPECT_NE(result.err.find(text), std::string::npos)
                << scene << " " << solver << ": " << result.err;
        }
        const Result traced = run(std::vector<std::string>{"reference", scene, "--resolution", "4",
                                                           "--rays", "64", "-o", "r.vdb"}
                                  + options);
        EXPECT_NE(traced.err.find(text), std::string::npos) << scene << ": " << traced.err;
    }
    const Result lit = run(quick + std::vector<std::string>{"-o", "a.vdb"});
    EXPECT_EQ(lit.err.find("no light"), std::string::npos) << lit.err;
}

TEST_F(Cli, WarningsOfLightFilesAreTold) {
    need_device();
    spill(folder_ / "spot.json",
          R"({"lights": [{"type": "spot", "intensity": 100, "position": [0, 1.5, 0],
                          "direction": [0, -1, 0],
                          "spot": {"innerConeAngle": 0.5, "outerConeAngle": 0.5}}]})");
    const std::vector<std::string> bake{"bake",  "dark.gltf", "--resolution", "6",        "-o",
                                        "a.vdb", "--lights",  "spot.json",    "--format", "json"};
    const Result result = run(bake);
    EXPECT_EQ(result.status, 0) << result.err;
    const json warnings = json::parse(result.out)["warnings"];
    ASSERT_EQ(warnings.size(), 1u) << warnings;
    EXPECT_NE(warnings[0].get<std::string>().find("hard edge"), std::string::npos);
    const std::vector<std::string> as_text(bake.begin(), bake.end() - 2);
    expect_error(as_text + std::vector<std::string>{"--strict"}, cmd::ExitCode::invalid,
                 "spot.json: lights[0].spot.innerConeAngle");
}

TEST_F(Cli, UnsupportedFeatureIsNamed) {
    json scene = json::parse(slurp(folder_ / "room.gltf"));
    scene["extensionsUsed"].push_back("EXT_from_the_future");
    scene["extensionsRequired"] = {"EXT_from_the_future"};
    spill(folder_ / "future.gltf", scene.dump());
    expect_error({"bake", "future.gltf", "-o", "a.vdb"}, cmd::ExitCode::unsupported,
                 "EXT_from_the_future");
}

TEST_F(Cli, NoDevice) {
    const Environment none{{"VK_DRIVER_FILES", "/nonexistent.json"},
                           {"VK_ICD_FILENAMES", "/nonexistent.json"}};
    expect_error({"devices"}, cmd::ExitCode::device, "mesa-vulkan-drivers", none);
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb"}, cmd::ExitCode::device, "", none);
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb", "--device", "abacus"},
                 cmd::ExitCode::device, "abacus");
}

TEST_F(Cli, SceneWithoutLightNamesTheOptions) {
    need_device();
    const std::vector<std::string> bake{"bake", "dark.gltf", "-o", "a.vdb"};
    for (const char* option : {"--sun", "--point", "--lights"})
        expect_error(bake, cmd::ExitCode::invalid, option);
    expect_error(quick + std::vector<std::string>{"-o", "a.vdb", "--no-scene-lights"},
                 cmd::ExitCode::invalid, "--sun");
}

TEST_F(Cli, AProgramWithoutItsImageModuleFailsWhileRunning) {
    need_device();
    ASSERT_EQ(run({"bake", "room.gltf", "--resolution", "8", "-o", "a.vdb"}).status, 0);
    fs::copy_file(LPVBAKE_BINARY, folder_ / "alone");
    const std::string command =
        "cd '" + folder_.string() + "' && ./alone info a.vdb --slice z=2 -o s.png > out 2> err";
    const int status = std::system(command.c_str());
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), int(cmd::ExitCode::failure));
    EXPECT_NE(slurp(folder_ / "err").find("image module"), std::string::npos);
    EXPECT_FALSE(fs::exists(folder_ / "s.png"));
}

TEST_F(Cli, GridTooLargeForMemory) {
    need_device();
    const auto begin = std::chrono::steady_clock::now();
    expect_error({"bake", "room.gltf", "-o", "a.vdb", "--resolution", "1280"},
                 cmd::ExitCode::memory, "--resolution");
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
}

// ---------------------------------------------------------------- baking

TEST_F(Cli, BakeWritesWhatItSaysAndIsSilentInAPipe) {
    need_device();
    const Result result = run(quick + std::vector<std::string>{"-o", "a.vdb", "-o", "b.exr"});
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(result.err, "");
    EXPECT_NE(result.out.find("8 x 8 x 8 cells"), std::string::npos) << result.out;
    EXPECT_NE(result.out.find("peak memory"), std::string::npos);
    EXPECT_NE(result.out.find("wrote         a.vdb ("), std::string::npos);
    for (const char* file : {"b_sh_l0.exr", "b_validity.exr", "b.json"})
        EXPECT_NE(result.out.find(std::string("wrote         ") + file + " ("), std::string::npos);
    for (const char* name : {"a.vdb", "b.json"})
        EXPECT_GT(fs::file_size(folder_ / name), 100u) << name;
    for (const std::string& name : entries()) // no temporary names left
        EXPECT_NE(name[0], '.') << name;
}

TEST_F(Cli, BakeInJson) {
    need_device();
    const Result result = run(quick + std::vector<std::string>{"-o", "a.vdb", "--format", "json"});
    ASSERT_EQ(result.status, 0) << result.err;
    const json document = json::parse(result.out);
    EXPECT_EQ(document["command"], "bake");
    EXPECT_EQ(document["dry_run"], false);
    EXPECT_EQ(document["grid"]["dims"], json({8, 8, 8}));
    EXPECT_EQ(document["grid"]["cells"], 512);
    EXPECT_EQ(document["outputs"][0]["path"], "a.vdb");
    EXPECT_EQ(document["outputs"][0]["bytes"], fs::file_size(folder_ / "a.vdb"));
    EXPECT_EQ(document["outputs"][0]["files"][0]["path"], "a.vdb");
    double sum = 0;
    for (const json& stage : document["stages"]) {
        EXPECT_GE(stage["seconds"].get<double>(), 0.0) << stage;
        sum += stage["seconds"].get<double>();
    }
    EXPECT_GE(document["stages"].size(), 4u);
    EXPECT_GT(document["seconds"].get<double>(), 0.5 * sum);
    EXPECT_GT(document["peak_memory"].get<uint64_t>(), 1'000'000u);
    EXPECT_FALSE(document["device"]["name"].get<std::string>().empty());
    EXPECT_TRUE(document["warnings"].is_array());
}

TEST_F(Cli, DryRunTellsTheGridAndWritesNothing) {
    need_device();
    std::vector<std::string> before = entries();
    std::erase(before, "stdout");
    std::erase(before, "stderr");
    const Result result = run({"bake", "room.gltf", "--resolution", "20", "-o", "a.vdb", "--solver",
                               "lpv", "--dry-run", "--format", "json"});
    ASSERT_EQ(result.status, 0) << result.err;
    const json document = json::parse(result.out);
    EXPECT_EQ(document["grid"]["dims"], json({20, 20, 20}));
    EXPECT_GT(document["choice"]["error"].get<double>(), 0.995);
    EXPECT_EQ(document["triangles"], 10);
    EXPECT_EQ(document["rsm"]["maps"], 6);
    EXPECT_EQ(document["outputs"][0]["path"], "a.vdb");
    EXPECT_GT(document["device_bytes"].get<uint64_t>(), 20u * 20 * 20 * 12 * 4);
    EXPECT_GT(document["seconds"].get<double>(), 0.0);
    std::vector<std::string> after = entries();
    std::erase(after, "stdout");
    std::erase(after, "stderr");
    EXPECT_EQ(after, before);
    EXPECT_NE(run({"bake", "room.gltf", "--dry-run"}).out.find("cells"), std::string::npos);
    const std::string lpv = run({"bake", "room.gltf", "--solver", "lpv", "--dry-run"}).out;
    EXPECT_NE(lpv.find(" % error"), std::string::npos) << lpv;
    EXPECT_EQ(lpv.find("e+0"), std::string::npos) << lpv; // 100 %
    EXPECT_EQ(run({"bake", "room.gltf", "-o", "none/a.vdb", "--dry-run"}).status, 2);
}

TEST_F(Cli, AutoSaysWhatItChose) {
    need_device();
    const auto choice = [&](const std::vector<std::string>& more) {
        const Result result =
            run(quick + std::vector<std::string>{"--dry-run", "--format", "json"} + more);
        EXPECT_EQ(result.status, 0) << result.err;
        const json document = json::parse(result.out);
        json chosen = document["choice"];
        chosen["warnings"] = document["warnings"].size();
        return chosen;
    };
    const json usual = choice({});
    EXPECT_EQ(usual["solver"], "sn");
    EXPECT_EQ(usual["sh_order"], 2);
    EXPECT_EQ(usual["directions"], 240);
    EXPECT_EQ(choice({"--vpls", "99"})["solver"], "gather");
    EXPECT_EQ(choice({"--vpls", "99"})["vpls"], 99);
    EXPECT_EQ(choice({"--directions", "96"})["solver"], "sn");
    EXPECT_EQ(choice({"--directions", "96"})["directions"], 96);
    EXPECT_EQ(choice({"--occlusion", "sh"})["solver"], "lpv");
    EXPECT_EQ(choice({"--sh-order", "3"})["solver"], "sn");
    EXPECT_EQ(choice({"--quality", "fast"})["directions"], 144);
    const json rough = choice({"--error", "4%"});
    EXPECT_LE(rough["error"].get<double>(), 0.04);
    EXPECT_LT(rough["seconds"].get<double>(), usual["seconds"].get<double>());
    EXPECT_EQ(rough["warnings"], 0);
    EXPECT_EQ(choice({"--error", "0.04"}), rough);
    const json least = choice({"--error", "0.1%", "--sh-order", "2"});
    const std::string below = std::to_string(0.9 * least["error"].get<double>());
    EXPECT_EQ(choice({"--error", below})["sh_order"], 4);
    EXPECT_EQ(rough["pilot"]["bands"].size(), 2u);
    EXPECT_FALSE(usual.contains("pilot"));
    const json unity = choice({"--error", below, "--target", "unity"});
    EXPECT_EQ(unity["sh_order"], 2) << "its files keep no more";
    EXPECT_EQ(unity["warnings"], 1);
    const json beyond = choice({"--error", "0.1%"});
    EXPECT_EQ(beyond["warnings"], 1);
    EXPECT_GT(beyond["error"].get<double>(), 0.001);
    EXPECT_EQ(choice({"--time-budget", "1ms"})["warnings"], 1);
    EXPECT_EQ(choice({"--time-budget", "1min"})["warnings"], 0);

    const std::vector<std::string> wish = quick + std::vector<std::string>{"--error", "5%"};
    const Result first = run(wish + std::vector<std::string>{"-o", "a.vdb"});
    EXPECT_NE(first.out.find("choice        gather, order 2, "), std::string::npos) << first.out;
    ASSERT_EQ(run(wish + std::vector<std::string>{"-o", "b.vdb"}).status, 0);
    EXPECT_EQ(slurp(folder_ / "a.vdb"), slurp(folder_ / "b.vdb"));
    const Volume volume = read_volume((folder_ / "a.vdb").string());
    EXPECT_EQ(volume.metadata.at("solver"), "gather");
    EXPECT_EQ(volume.metadata.at("choice").find("gather, order 2, "), 0u);
}

TEST_F(Cli, VerifyMeasuresAndBakesOn) {
    need_device();
    const auto bake = [&](const std::vector<std::string>& more) {
        const std::vector<std::string> small{"bake", "--resolution", "8",    "--format",
                                             "json", "-o",           "a.vdb"};
        const Result result = run(small + more);
        EXPECT_EQ(result.status, 0) << result.err;
        return json::parse(result.out);
    };
    // What follows is the scene, not how many points.
    const json usual = bake({"--verify", "room.gltf"});
    const json cells = usual["verified"]["cells"], surfaces = usual["verified"]["surfaces"];
    EXPECT_EQ(cells["points"], 128);
    EXPECT_GT(surfaces["points"].get<int>(), 100);
    EXPECT_LE(cells["low"].get<double>(), cells["error"].get<double>());
    EXPECT_LE(cells["error"].get<double>(), cells["high"].get<double>());
    EXPECT_FALSE(usual["verified"]["worst"].empty());
    const std::string kept =
        read_volume((folder_ / "a.vdb").string()).metadata.at("verified_cells");
    EXPECT_NEAR(std::stod(kept), cells["error"].get<double>(), 1e-5);
    EXPECT_EQ(bake({"room.gltf", "--verify", "20"})["verified"]["cells"]["points"], 10);
    EXPECT_FALSE(bake({"room.gltf"}).contains("verified"));

    // The rough choice is measured to err more than it promises, or bakes on until it does not.
    const auto stages = [](const json& document) {
        return std::ranges::count(document["stages"], "verify",
                                  [](const json& stage) { return stage["name"]; });
    };
    const json never = bake({"room.gltf", "--verify", "--error", "0.1%"});
    EXPECT_EQ(never["warnings"].size(), 2u) << never["warnings"];
    EXPECT_GT(never["verified"]["cells"]["high"].get<double>(), 0.001);
    const double reachable = 1.2 * never["verified"]["cells"]["high"].get<double>();
    const json reached = bake({"room.gltf", "--verify", "--error", std::to_string(reachable)});
    EXPECT_GE(stages(reached), 1);
    EXPECT_LE(reached["verified"]["cells"]["high"].get<double>(), reachable);
}

TEST_F(Cli, DilateFillsWhatIsNotValid) {
    need_device();
    const std::vector<std::string> bake{"bake", "room.gltf", "--resolution", "10", "-o", "a.vdb"};
    ASSERT_EQ(run(bake).status, 0);
    const Volume plain = read_volume((folder_ / "a.vdb").string());
    ASSERT_EQ(run(bake + std::vector<std::string>{"--dilate", "2"}).status, 0);
    const Volume filled = read_volume((folder_ / "a.vdb").string());
    EXPECT_EQ(filled.metadata.at("dilate"), "2");
    EXPECT_EQ(plain.metadata.count("dilate"), 0u);
    EXPECT_EQ(filled.validity, plain.validity);
    for (std::size_t cell = 0; cell < plain.grid.size(); ++cell)
        if (plain.validity[cell] > 0.0f) {
            EXPECT_EQ(filled.sh[0][cell], plain.sh[0][cell]);
        }
}

TEST_F(Cli, FitIsForTheTargetsProgramAndIsTold) {
    need_device();
    const std::vector<std::string> bare{"bake", "room.gltf", "--resolution", "10"};
    const auto bake = bare + std::vector<std::string>{"--fit", "surfaces"};
    const Result result = run(
        bake + std::vector<std::string>{"-o", "u.vdb", "--target", "unity", "--format", "json"});
    ASSERT_EQ(result.status, 0) << result.err;
    const json fit = json::parse(result.out).at("fit");
    EXPECT_EQ(fit.at("reader"), "unity");
    EXPECT_LT(fit.at("error").get<double>(), 0.1);
    EXPECT_NEAR(fit.at("energy").get<double>(), 1, 0.05);
    const Volume volume = read_volume((folder_ / "u.vdb").string());
    EXPECT_EQ(volume.metadata.at("fit"), "unity");
    EXPECT_NE(volume.metadata.at("settings").find("fit = \"surfaces\""), std::string::npos);

    ASSERT_EQ(run(bake + std::vector<std::string>{"-o", "g.vdb"}).status, 0);
    EXPECT_EQ(read_volume((folder_ / "g.vdb").string()).metadata.at("fit"), "lpvbake");
    // Cells that are filled already are not filled again, and another program is warned of.
    ASSERT_EQ(run({"convert", "u.vdb", "v.vdb", "--target", "unity"}).err.find("fitted"),
              std::string::npos);
    EXPECT_EQ(read_volume((folder_ / "v.vdb").string()).sh, volume.sh);
    EXPECT_NE(run({"convert", "u.vdb", "t.exr", "--target", "threejs"})
                  .err.find("fitted to what unity reads, not threejs"),
              std::string::npos);
    const Result both = run(bake + std::vector<std::string>{"-o", "b.vdb", "--dilate", "2"});
    EXPECT_EQ(both.status, 1);
    EXPECT_NE(both.err.find("--dilate"), std::string::npos);
    ASSERT_EQ(run({"bake", "room.gltf", "--resolution", "10", "-o", "n.vdb"}).status, 0);
    for (const auto& [key, value] : read_volume((folder_ / "n.vdb").string()).metadata) {
        EXPECT_FALSE(key.starts_with("fit"));
        EXPECT_EQ(value.find("fit = "), std::string::npos);
    }
}

TEST_F(Cli, AFitGoesByWhatShadersMakeOfOrderOne) {
    need_device();
    const std::vector<std::string> bake{"bake", "room.gltf", "--resolution", "8"};
    const auto error = [&](const std::vector<std::string>& given) {
        const Result result = run(bake + given + std::vector<std::string>{"--format", "json"});
        EXPECT_EQ(result.status, 0) << result.err;
        const json document = json::parse(result.out);
        EXPECT_EQ(document["choice"]["sh_order"], 1);
        EXPECT_EQ(result.err.find("left out"), std::string::npos) << result.err;
        return document["fit"]["error"].get<double>();
    };
    for (const char* evaluation : {"geomerics", "zh3"}) {
        const std::string path = std::string(evaluation) + ".exr";
        EXPECT_LT(error({"--target", "unity", "--evaluation", evaluation, "-o", path}), 0.1);
        const Volume volume = read_volume((folder_ / path).string());
        EXPECT_EQ(volume.metadata.at("fit"), "unity");
        EXPECT_EQ(volume.metadata.at("fit_evaluation"), evaluation);
        EXPECT_NE(volume.metadata.at("settings").find("evaluation = "), std::string::npos);
        const json notes = json::parse(slurp(folder_ / (std::string(evaluation) + ".unity.json")));
        EXPECT_EQ(notes["irradiance over pi"].get<std::string>().find("of a colour with"), 0u);
        // Read by a sum the same cells show something else; render reads them as they are meant.
        const auto flip = [&](const std::string& sampler) {
            const Result result = run({"render", "room.gltf", path, "-o", "p.png", "--size",
                                       "48x32", "--samples", "1", "--reference", "32", "--show",
                                       "indirect", "--sampler", sampler, "--format", "json"});
            EXPECT_EQ(result.status, 0) << result.err;
            return json::parse(result.out)["reference"]["flip"].get<double>();
        };
        EXPECT_EQ(flip("auto"), flip(evaluation));
        EXPECT_GT(flip("unity"), 1.05 * flip("auto")) << evaluation;
    }
    ASSERT_EQ(run(bake + std::vector<std::string>{"-o", "a.vdb"}).status, 0);
    EXPECT_EQ(run({"convert", "a.vdb", "v.exr", "--target", "vrc", "--evaluation", "zh3"}).err, "");
    EXPECT_EQ(read_volume((folder_ / "v.exr").string()).metadata.at("fit_evaluation"), "zh3");

    const Result again =
        run({"convert", "zh3.exr", "b.exr", "--target", "vrc", "--evaluation", "geomerics"});
    EXPECT_EQ(again.status, 1);
    EXPECT_NE(again.err.find("is fitted to what unity reads already"), std::string::npos);

    const auto refused = [&](const std::vector<std::string>& given, const std::string& why) {
        const Result result = run(
            bake + std::vector<std::string>{"-o", "b.vdb", "--evaluation", "geomerics"} + given);
        EXPECT_EQ(result.status, 1) << why;
        EXPECT_NE(result.err.find(why), std::string::npos) << result.err;
        EXPECT_EQ(std::ranges::count(result.err, '\n'), 1) << result.err;
    };
    refused({"--target", "threejs"}, "threejs has a formula of its own");
    refused({}, "--fit surfaces");
    refused({"--target", "unity", "--fit", "none"}, "--fit surfaces");
    refused({"--target", "unity", "--sh-order", "2"}, "is of order 1");
}

TEST_F(Cli, TargetsThatShadeSurfacesAreFittedUnlessToldOtherwise) {
    need_device();
    const std::vector<std::string> bake{"bake", "room.gltf", "--resolution", "8", "-o", "a.vdb"};
    const auto fits = [&](const std::vector<std::string>& given) { // as a dry run says
        const Result result =
            run(bake + given + std::vector<std::string>{"--dry-run", "--format", "json"});
        EXPECT_EQ(result.status, 0) << result.err;
        const json stages = json::parse(result.out).at("stages");
        return std::ranges::any_of(stages,
                                   [](const json& stage) { return stage["name"] == "fit"; });
    };
    for (const char* name : {"unity", "unreal", "godot", "threejs", "vrc", "bevy"}) {
        EXPECT_TRUE(fits({"--target", name})) << name;
    }
    EXPECT_FALSE(fits({"--target", "unity", "--fit", "none"}));
    EXPECT_FALSE(fits({"--target", "unity", "--dilate", "1"}));
    for (const char* name : {"generic", "blender", "houdini"}) {
        EXPECT_FALSE(fits({"--target", name})) << name;
    }
    EXPECT_TRUE(fits({"--target", "houdini", "--fit", "surfaces"}));
    EXPECT_NE(run(bake + std::vector<std::string>{"--target", "unity", "--print-config"})
                  .out.find("#fit = \"surfaces\""),
              std::string::npos);

    // By hand or by itself: the same light; and without it what there was before.
    const auto light = [&](const std::vector<std::string>& given) {
        const Result result = run(bake + given);
        EXPECT_EQ(result.status, 0) << result.err;
        return read_volume((folder_ / "a.vdb").string());
    };
    const Volume fitted = light({"--target", "vrc", "--sh-order", "1"});
    EXPECT_EQ(fitted.metadata.at("fit"), "vrc");
    EXPECT_EQ(fitted.sh, light({"--target", "vrc", "--sh-order", "1", "--fit", "surfaces"}).sh);
    const std::vector<std::string> none{"--target", "vrc", "--sh-order", "1", "--fit", "none"};
    const Volume field = light(none);
    EXPECT_NE(fitted.sh, field.sh);
    EXPECT_EQ(field.metadata.count("fit"), 0u);
    EXPECT_NE(field.metadata.at("settings").find("fit = \"none\""), std::string::npos);
    ASSERT_EQ(
        run({"bake", "room.gltf", "--resolution", "8", "-o", "g.vdb", "--sh-order", "1"}).status,
        0);
    ASSERT_EQ(run({"convert", "g.vdb", "c.vdb", "--target", "vrc", "--fit", "none"}).status, 0);
    EXPECT_EQ(field.sh, read_volume((folder_ / "c.vdb").string()).sh);
}

TEST_F(Cli, ProgressGoesToStandardErrorInTheFormAskedFor) {
    need_device();
    const Result plain =
        run(quick + std::vector<std::string>{"-o", "a.vdb", "--progress", "plain"});
    EXPECT_EQ(plain.status, 0);
    std::istringstream lines(plain.err);
    const std::regex form("lpvbake: room.gltf: \\w[^%]* (\\d+) %, \\d+\\.\\d s");
    std::smatch match;
    double last = 0;
    for (std::string line; std::getline(lines, line);) {
        ASSERT_TRUE(std::regex_match(line, match, form)) << plain.err;
        last = std::stod(match[1]);
    }
    EXPECT_EQ(last, 100) << "the last stage ends";
    EXPECT_NE(plain.err.find("lpvbake: room.gltf: load 0 %, 0.0 s\n"), std::string::npos)
        << plain.err;
    EXPECT_NE(plain.err.find("lpvbake: room.gltf: write 100 %"), std::string::npos) << plain.err;
    const Result bar = run(quick + std::vector<std::string>{"-o", "a.vdb", "--progress", "bar"});
    EXPECT_EQ(bar.status, 0);
    EXPECT_NE(bar.err.find("\r\033[K"), std::string::npos);
    EXPECT_EQ(bar.err.substr(bar.err.size() - 4), "\r\033[K") << "the bar is taken away at the end";
    EXPECT_EQ(run(quick + std::vector<std::string>{"-o", "a.vdb", "--progress", "none"}).err, "");
}

TEST_F(Cli, WarningsNameTheirFileAndQuietLeavesThemToTheDocument) {
    need_device();
    const std::vector<std::string> hasty =
        quick + std::vector<std::string>{"-o",  "a.vdb",    "--format", "json", "--time-budget",
                                         "1ms", "--dry-run"};
    const std::string start = "room.gltf: --time-budget 0.001 s: ";
    const Result usual = run(hasty);
    EXPECT_EQ(usual.err.find("lpvbake: warning: " + start), 0u) << usual.err;
    const Result quiet = run(hasty + std::vector<std::string>{"-q", "--progress", "plain"});
    EXPECT_EQ(quiet.status, 0);
    EXPECT_EQ(quiet.err, "");
    const json warnings = json::parse(quiet.out)["warnings"];
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_EQ(warnings[0].get<std::string>().find(start), 0u) << warnings[0];
    EXPECT_EQ(run({"bake", "none.gltf", "-o", "a.vdb", "--quiet"}).err,
              "lpvbake: error: none.gltf: No such file or directory\n");
    expect_error({"devices", "-q", "-v"}, cmd::ExitCode::usage, "exclude each other");
}

TEST_F(Cli, VerboseTellsWhatIsReadAndDone) {
    need_device();
    const Result result = run(quick + std::vector<std::string>{"-o", "a.vdb", "-v"});
    EXPECT_EQ(result.status, 0);
    for (const char* text : {"lpvbake: settings: resolution = 8; ", "lpvbake: reads room.gltf\n",
                             "lpvbake: device: ", "lpvbake: choice: ", "lpvbake: wrote a.vdb\n",
                             "lpvbake: room.gltf: load 100 %"})
        EXPECT_NE(result.err.find(text), std::string::npos) << text << result.err;
}

TEST_F(Cli, ErrorsAreJsonWhereResultsAre) {
    spill(folder_ / "broken.gltf", "{}");
    spill(folder_ / "a.toml", "format = \"json\"\nresolution = 0\n");
    spill(folder_ / "b.toml", "format = \"json\"\n");
    struct Case {
        std::vector<std::string> arguments;
        const char *command, *kind, *file;
    };
    for (const Case& c : std::vector<Case>{
             {{"bake", "none.gltf", "-o", "a.vdb", "--format", "json"},
              "bake",
              "file",
              "none.gltf"},
             {{"bake", "none.gltf", "-o", "a.vdb", "--config", "b.toml"},
              "bake",
              "file",
              "none.gltf"},
             {{"bake", "broken.gltf", "-o", "a.vdb", "--format=json"},
              "bake",
              "invalid",
              "broken.gltf"},
             {{"info", "none.vdb", "--format", "json"}, "info", "file", "none.vdb"},
             {{"bake", "room.gltf", "-o", "none/a.vdb", "--format", "json"},
              "bake",
              "file",
              "none/a.vdb"},
             {{"bake", "--format=json", "--config", "a.toml"}, "bake", "argument", "a.toml"},
             {{"bake", "--format=json", "--resolution=0"}, "bake", "argument", ""},
             {{"devices", "--format=json", "--resolution=0"}, "devices", "argument", ""},
             {{"bakes", "--format=json"}, "", "argument", ""}}) {
        const Result result = run(c.arguments);
        EXPECT_EQ(result.err.find("lpvbake: error: "), 0u) << result.err;
        const json document = json::parse(result.out);
        EXPECT_EQ(document["command"], *c.command ? json(c.command) : json(nullptr));
        const json& error = document["error"];
        EXPECT_EQ(error["kind"], c.kind) << document;
        EXPECT_EQ(error["exit_code"], result.status);
        EXPECT_EQ("lpvbake: error: " + error["message"].get<std::string>() + "\n", result.err);
        EXPECT_EQ(error["file"], *c.file ? json(c.file) : json(nullptr)) << document;
        EXPECT_EQ(error["retry"], false);
        EXPECT_EQ(error["retry_how"], error["kind"] == "file" ? "once" : "never");
    }
    const json lost = json::parse(run({"devices", "--format", "json"},
                                      {{"VK_DRIVER_FILES", "/none"}, {"VK_ICD_FILENAMES", "/none"}})
                                      .out);
    EXPECT_EQ(lost["error"]["kind"], "device");
    EXPECT_EQ(lost["error"]["retry"], true);
    EXPECT_EQ(lost["error"]["retry_how"], "again");
    // A result that is there already is the only document.
    ASSERT_EQ(run({"reference", "room.gltf", "-o", "a.vdb", "--resolution=4", "--rays=64"}).status,
              0);
    ASSERT_EQ(
        run({"reference", "room.gltf", "-o", "b.vdb", "--resolution=4", "--rays=64", "--seed=2"})
            .status,
        0);
    const Result differs = run({"diff", "a.vdb", "b.vdb", "--format", "json"});
    EXPECT_EQ(differs.status, int(cmd::ExitCode::difference));
    EXPECT_EQ(json::parse(differs.out)["command"], "diff");
}

TEST_F(Cli, DryRunNamesTheFilesThatWillExist) {
    need_device();
    for (const char* target : {"generic", "godot", "unity", "unreal", "threejs", "vrc", "bevy"})
        for (const char* solver : {"sn", "lpv"}) {
            const std::vector<std::string> bake{
                "bake",  "room.gltf", "--resolution", "4",        "-o",   "a.vdb",    "-o",
                "b.exr", "--target",  target,         "--solver", solver, "--format", "json"};
            const json planned = json::parse(run(bake + std::vector<std::string>{"--dry-run"}).out);
            json written = json::parse(run(bake).out)["outputs"];
            for (json& output : written) {
                output.erase("bytes");
                for (json& file : output["files"])
                    file.erase("bytes");
            }
            EXPECT_EQ(planned["outputs"], written) << target << " " << solver;
        }
    EXPECT_NE(run({"bake", "room.gltf", "-o", "c.exr", "--dry-run"})
                  .out.find("writes        c_sh_l0.exr\n"),
              std::string::npos);
}

TEST_F(Cli, ValidationLayerIsSilent) {
    need_device();
    const Result result = run(quick + std::vector<std::string>{"-o", "a.vdb", "--validation"});
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(result.err, "");
}

TEST_F(Cli, ConfigFileBakesTheSameBytes) {
    need_device();
    const std::vector<std::string> arguments =
        quick + std::vector<std::string>{"--sun", "30,40,1000,#ff8000", "--occlusion", "sh"};
    ASSERT_EQ(run(arguments + std::vector<std::string>{"-o", "a.vdb"}).status, 0);
    spill(folder_ / "a.toml", run(arguments + std::vector<std::string>{"--print-config"}).out);
    const Result result = run({"bake", "room.gltf", "--config", "a.toml", "-o", "b.vdb"});
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(slurp(folder_ / "a.vdb"), slurp(folder_ / "b.vdb"));
}

/// The most rasteriser threads of Mesa's llvmpipe seen while the process ran.
int llvmpipe_threads(pid_t child) {
    int most = 0;
    for (int status = 0;;) {
        int count = 0;
        std::error_code ended;
        const fs::path tasks = "/proc/" + std::to_string(child) + "/task";
        for (fs::directory_iterator entry(tasks, ended), end; !ended && entry != end;
             entry.increment(ended))
            count += slurp(entry->path() / "comm").starts_with("llvmpipe-");
        most = std::max(most, count);
        siginfo_t state = {};
        status = waitid(P_PID, id_t(child), &state, WEXITED | WNOHANG | WNOWAIT);
        if (status != 0 || state.si_pid == child)
            return most;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
}

TEST_F(Cli, BytesDependNeitherOnTheRunNorOnThreads) {
    need_device();
    const bool llvmpipe = run({"devices"}).out.find("llvmpipe") != std::string::npos;
    const std::vector<std::string> arguments{"bake",         "room.gltf", "--resolution", "20",
                                             "--iterations", "20",        "-o",           "a.vdb",
                                             "-o",           "a.exr"};
    std::map<std::string, std::string> first;
    for (const char* threads : {"1", "2", "1", "2", "0"}) {
        const pid_t child = start(arguments + std::vector<std::string>{"--threads", threads});
        const int seen = llvmpipe_threads(child);
        const Result result = wait_for(child);
        ASSERT_EQ(result.status, 0) << result.err;
        if (llvmpipe && std::string(threads) != "0") {
            EXPECT_EQ(seen, threads == std::string("1") ? 0 : 2); // one: that which asks
        }
        std::map<std::string, std::string> files;
        for (const std::string& name : entries())
            if (name.starts_with("a"))
                files[name] = slurp(folder_ / name);
        EXPECT_GE(files.size(), 6u);
        if (first.empty())
            first = files;
        for (const auto& [name, bytes] : files)
            EXPECT_TRUE(bytes == first[name]) << name << " differs with --threads " << threads;
    }
}

TEST_F(Cli, TheInstructionSetIsTakenAndNamed) {
    need_device();
    const std::vector<std::string> bake{"bake", "room.gltf", "--resolution", "12",
                                        "-o",   "a.vdb",     "--format",     "json"};
    std::map<std::string, std::string> taken;
    for (const char* isa : {"auto", "sse2", "avx2"}) {
        const Result result = run(bake + std::vector<std::string>{"--isa", isa});
        if (result.status == int(cmd::ExitCode::usage) && isa == std::string("avx2")) {
            EXPECT_NE(result.err.find("--isa avx2: this processor"), std::string::npos);
            continue;
        }
        ASSERT_EQ(result.status, 0) << result.err;
        const std::string named = json::parse(result.out)["isa"];
        taken[isa] = named;
        const Volume volume = read_volume((folder_ / "a.vdb").string());
        EXPECT_TRUE(volume.metadata.at("tracer").ends_with(" " + named));
        EXPECT_EQ(volume.metadata.at("settings").find("isa") != std::string::npos,
                  isa != std::string("auto"));
    }
    EXPECT_EQ(taken["sse2"], "sse2");
    if (taken.count("avx2")) { // the processor has it
        EXPECT_EQ(taken["avx2"], "avx2");
        EXPECT_EQ(taken["auto"], "avx2");
    }
}

TEST_F(Cli, SignalsEndABakeAndLeaveTheOldFile) {
    need_device();
    for (const auto& [signal, code] : {std::pair(SIGINT, cmd::ExitCode::interrupted),
                                       std::pair(SIGTERM, cmd::ExitCode::terminated)}) {
        spill(folder_ / "a.vdb", "old");
        fs::remove(folder_ / "stderr");
        const pid_t child = start({"bake", "room.gltf", "--resolution", "48", "--iterations",
                                   "1000000", "-o", "a.vdb", "--progress", "plain"});
        for (int tries = 0; tries < 3000; ++tries) {
            if (slurp(folder_ / "stderr").find("propagat") != std::string::npos)
                break;
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        const auto begin = std::chrono::steady_clock::now();
        kill(child, signal);
        const Result result = wait_for(child);
        EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
        EXPECT_EQ(result.status, int(code)) << result.err;
        EXPECT_EQ(result.out, "");
        EXPECT_NE(result.err.find("propagat"), std::string::npos) << result.err;
        EXPECT_NE(result.err.find("lpvbake: error: "), std::string::npos) << result.err;
        EXPECT_EQ(slurp(folder_ / "a.vdb"), "old");
        for (const std::string& name : entries())
            EXPECT_NE(name[0], '.') << name;
    }
}

// ---------------------------------------------------------------- info, devices

TEST_F(Cli, InfoOfAScene) {
    const Result text = run({"info", "room.gltf"});
    EXPECT_EQ(text.status, 0) << text.err;
    EXPECT_EQ(text.err, "");
    EXPECT_NE(text.out.find("100 cd"), std::string::npos) << text.out;
    const json document = json::parse(run({"info", "room.gltf", "--format", "json"}).out);
    EXPECT_EQ(document["kind"], "scene");
    EXPECT_EQ(document["triangles"], 10);
    EXPECT_EQ(document["bounds"]["lo"], json({-1.0, 0.0, -1.0}));
    EXPECT_EQ(document["bounds"]["hi"], json({1.0, 2.0, 1.0}));
    EXPECT_EQ(document["materials"]["double_sided"], 1);
    EXPECT_EQ(document["emitters"], false);
    EXPECT_EQ(document["lights"][0]["type"], "point");
    EXPECT_EQ(document["lights"][0]["intensity"], 100.0);
    EXPECT_EQ(document["lights"][0]["unit"], "candela");
    EXPECT_DOUBLE_EQ(document["lights"][0]["position"][1].get<double>(), 1.7);
}

TEST_F(Cli, InfoOfAVolumeAgreesBetweenFormatsAndDrawsASlice) {
    need_device();
    const std::vector<std::string> outputs{"-o", "a.vdb", "-o", "b.exr"};
    ASSERT_EQ(run(quick + outputs).status, 0);
    const Result result = run({"info", "a.vdb", "--format", "json"});
    ASSERT_EQ(result.status, 0) << result.err;
    const json vdb = json::parse(result.out);
    EXPECT_EQ(vdb["kind"], "volume");
    EXPECT_EQ(vdb["grid"]["dims"], json({8, 8, 8}));
    EXPECT_EQ(vdb["grid"]["cells"], 512);
    EXPECT_EQ(vdb["sh_order"], 2);
    EXPECT_GT(vdb["energy"].get<double>(), 0.0);
    EXPECT_EQ(vdb["grids"][0]["name"], "sh_l0");
    EXPECT_EQ(vdb["grids"][0]["channels"], 3);
    for (int channel = 0; channel < 3; ++channel) {
        const auto of = [&](const char* what) {
            return vdb["grids"][0][what][std::size_t(channel)].get<double>();
        };
        EXPECT_GE(of("min"), 0.0);
        EXPECT_GT(of("max"), of("mean"));
        EXPECT_GT(of("mean"), of("min"));
    }
    EXPECT_EQ(vdb["metadata"]["scene"], "room.gltf");
    EXPECT_NE(vdb["metadata"]["settings"].get<std::string>().find("resolution = 8"),
              std::string::npos);
    EXPECT_EQ(vdb["metadata"].dump().find(folder_.string()), std::string::npos)
        << "outputs tell nothing of the machine's folders";
    const json exr = json::parse(run({"info", "b.exr", "--format", "json"}).out);
    EXPECT_EQ(exr["grid"], vdb["grid"]);
    EXPECT_NEAR(exr["energy"].get<double>(), vdb["energy"].get<double>(),
                1e-6 * vdb["energy"].get<double>());

    const Result slice = run({"info", "a.vdb", "--slice", "z=4", "-o", "slice.png"});
    EXPECT_EQ(slice.status, 0) << slice.err;
    EXPECT_EQ(slurp(folder_ / "slice.png").substr(1, 3), "PNG");
    EXPECT_NE(slice.out.find("wrote      slice.png, white is "), std::string::npos) << slice.out;
    const json scale = json::parse(run({"info", "a.vdb", "--slice", "z=4", "-o", "slice.png",
                                        "--white", "30", "--format", "json"})
                                       .out)["slice"];
    EXPECT_EQ(scale, json({{"output", "slice.png"}, {"white", 30}, {"exponent", 1}}));
    for (const char* bad : {"z=8", "z=-1", "w=1", "z", "z=", "z=1x"})
        expect_error({"info", "a.vdb", "--slice", bad, "-o", "s.png"}, cmd::ExitCode::usage, bad);
}

TEST_F(Cli, Devices) {
    need_device();
    const Result text = run({"devices"});
    EXPECT_EQ(text.status, 0);
    const json document = json::parse(run({"devices", "--format", "json"}).out);
    ASSERT_FALSE(document["devices"].empty());
    const json device = document["devices"][0];
    EXPECT_EQ(device["index"], 0);
    EXPECT_NE(text.out.find(device["name"].get<std::string>()), std::string::npos);
    // Each of the three ways to name it opens it.
    for (const std::string& name :
         {std::string("0"), device["uuid"].get<std::string>(), device["name"].get<std::string>()})
        EXPECT_EQ(run({"bake", "room.gltf", "--dry-run", "--device", name}).status, 0) << name;
}

} // namespace
} // namespace lpvbake
