// lpvbake diff from outside: command, status, standard output, standard error, files.
//
// LPVBAKE_BINARY is the program's path. Volumes are written by the library, so no device is needed.

#include "cli/run.h"
#include "image/image.h"
#include "io/io.h"
#include "volume/light_content.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

namespace lpvbake {
namespace {

using nlohmann::json;

class Diff : public ::testing::Test {
protected:
    /// Runs `lpvbake diff ARGUMENTS` in the folder; the arguments are words of a shell.
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "diff " + arguments);
    }

    json run_json(const std::string& arguments, cmd::ExitCode code) {
        const CliResult result = run(arguments + " --format json");
        EXPECT_EQ(result.status, int(code)) << arguments << "\n" << result.err;
        return json::parse(result.out);
    }

    /// Expects a status and one line on standard error that contains `text`, and no result.
    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    }

    void write(const std::string& name, const Volume& volume) {
        io::write_volume(folder_ / name, volume, Precision::full);
    }

    /// A chart of 4 x 4 cells of 64 pixels, y up.
    image::Rgba8 picture(const std::string& name) {
        const std::string bytes = slurp(folder_ / name);
        const image::Rgba8 image =
            image::decode_image(std::as_bytes(std::span(bytes)), name, 1 << 20);
        EXPECT_EQ(glm::ivec2(image.width, image.height), glm::ivec2(48 + 256 + 24, 54 + 256 + 30));
        return image;
    }

    /// From the upper left of the cells.
    static glm::ivec3 pixel_in(const image::Rgba8& image, int x, int y) {
        const uint8_t* p = &image.texels[4 * size_t((54 + y) * image.width + 48 + x)];
        return {p[0], p[1], p[2]};
    }

    static glm::ivec3 cell_in(const image::Rgba8& image, int x, int y) {
        return pixel_in(image, x * 64 + 32, (3 - y) * 64 + 32);
    }

    TemporaryFolder folder_;
};

/// Irradiance pi for all normals, red, green and blue, in 4 x 4 x 4 valid cells.
Volume even_light() {
    Volume volume;
    volume.grid = {{-1, 0, 10}, 0.5, {4, 4, 4}};
    volume.sh.assign(4, std::vector<glm::vec3>(64));
    volume.sh[0].assign(64, glm::vec3(2 * std::sqrt(std::numbers::pi_v<float>)));
    volume.validity.assign(64, 1);
    volume.metadata = {{"solver", "none"}};
    return volume;
}

/// The same, brighter by a tenth in the 8 cells with z = 3 and y < 2.
Volume brighter_corner() {
    Volume volume = even_light();
    for (int y = 0; y < 2; ++y)
        for (int x = 0; x < 4; ++x)
            volume.sh[0][volume.grid.index({x, y, 3})] *= 1.1f;
    return volume;
}

TEST_F(Diff, AVolumeAndItselfAreIdentical) {
    const Volume volume = random_volume({6, 5, 4}, 1, true, 1);
    write("a.vdb", volume);
    write("b.exr", volume);
    for (const char* arguments : {"a.vdb a.vdb", "b.exr b.exr", "a.vdb b.exr", "b.json a.vdb"}) {
        const CliResult result = run(arguments);
        EXPECT_EQ(result.status, 0) << arguments << result.err;
        EXPECT_EQ(result.err, "");
        EXPECT_NE(result.out.find("result     identical\n"), std::string::npos) << result.out;
        const json document = run_json(arguments, cmd::ExitCode::ok);
        EXPECT_EQ(document["result"], "identical");
        EXPECT_GT(document["samples"], 1000);
        EXPECT_GT(document["irradiance"]["mean_b"], 0.0);
        for (const char* key : {"relative_l1", "rms", "relative_rms", "percentile95", "max"})
            EXPECT_EQ(document["irradiance"][key], 0.0) << key;
        EXPECT_EQ(document["energy"]["ratio"], 1.0);
        EXPECT_EQ(document["worst"], json::array());
        EXPECT_EQ(document["grids"].size(), 11u);
        for (const json& grid : document["grids"])
            EXPECT_EQ(grid["worst"], nullptr);
        EXPECT_EQ(document["fail"], nullptr);
    }
}

TEST_F(Diff, OnePerturbedCoefficientIsFoundAndLocated) {
    const Volume b = even_light();
    Volume a = b;
    a.sh[2][a.grid.index({3, 1, 2})].g = 0.25f;
    write("a.vdb", a);
    write("b.vdb", b);
    const json document = run_json("a.vdb b.vdb", cmd::ExitCode::difference);
    EXPECT_EQ(document["result"], "fail");
    ASSERT_EQ(document["worst"].size(), 1u);
    const json worst = document["worst"][0];
    EXPECT_EQ(worst["cell"], json({3, 1, 2}));
    EXPECT_EQ(worst["position"], json({0.75, 0.75, 11.25}));
    EXPECT_EQ(worst["channel"], "g");
    EXPECT_EQ(std::abs(worst["normal"][2].get<double>()), 1.0);
    const double pi = std::numbers::pi;
    EXPECT_NEAR(worst["b"], pi, 1e-6);
    // (2 pi / 3) sqrt(3 / 4 pi) 0.25 more or less
    const double change = 2 * pi / 3 * std::sqrt(3 / (4 * pi)) * 0.25;
    EXPECT_NEAR(std::abs(worst["a"].get<double>() - pi), change, 1e-6);
    EXPECT_NEAR(worst["difference"], change / pi, 1e-6);
    for (const json& grid : document["grids"])
        EXPECT_EQ(grid["cells"], grid["name"] == "sh_l1_z" ? 1 : 0) << grid;
    const json grid = document["grids"][2];
    EXPECT_EQ(grid["name"], "sh_l1_z");
    EXPECT_EQ(grid["max_abs"], 0.25);
    EXPECT_EQ(grid["relative"], nullptr) << "all of B's is zero";
    EXPECT_EQ(grid["worst"]["cell"], json({3, 1, 2}));
    EXPECT_EQ(grid["worst"]["channel"], "g");
    EXPECT_EQ(grid["worst"]["a"], 0.25);
    EXPECT_EQ(grid["worst"]["b"], 0.0);

    const CliResult text = run("a.vdb b.vdb");
    EXPECT_EQ(text.status, int(cmd::ExitCode::difference));
    EXPECT_EQ(text.err, "lpvbake: error: a.vdb differs from b.vdb in sh_l1_z\n");
    EXPECT_NE(text.out.find("(3, 1, 2) at (0.75, 0.75, 11.25) m"), std::string::npos) << text.out;
}

TEST_F(Diff, WhatNoSampleSeesStillCountsWithoutThresholds) {
    Volume b = random_volume({4, 4, 4}, 1, true, 3);
    b.validity[5] = 0;
    write("b.vdb", b);
    const auto expect_found = [&](const std::string& text, const auto& change) {
        Volume a = b;
        change(a);
        write("a.vdb", a);
        const CliResult result = run("a.vdb b.vdb");
        EXPECT_EQ(result.status, int(cmd::ExitCode::difference)) << text;
        EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    };
    expect_found("sh_l1_y", [](Volume& a) { a.sh[1][5].x += 1; });
    expect_found("occlusion_l1_x", [](Volume& a) { a.occlusion[3][7] += 1e-3f; });
    expect_found("occlusion_l0 (only in B)", [](Volume& a) { a.occlusion.clear(); });
    expect_found("validity", [](Volume& a) { a.validity[5] = 1; });
    expect_found("wall_1", [](Volume& a) { a.walls[1][7].z += 1e-3f; });
    Volume inside = b;
    inside.sh[1][5].x += 1;
    write("a.vdb", inside);
    const CliResult judged = run("a.vdb b.vdb --fail 0");
    EXPECT_EQ(judged.status, 0) << "with a threshold the samples alone decide";
    EXPECT_NE(judged.out.find("result     pass\n"), std::string::npos);
}

TEST_F(Diff, ABakeBesidePathsIsMeasured) {
    Volume truth = even_light();
    truth.metadata = {{"solver", "reference"}, {"noise", "0.0125"}};
    truth.validity.assign(64, 0);
    for (int z = 2; z < 4; ++z)
        truth.validity[truth.grid.index({1, 1, z})] = 1;
    write("truth.vdb", truth);
    write("bake.vdb", brighter_corner()); // by a tenth in one of the two cells
    const CliResult result = run("bake.vdb truth.vdb");
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(result.err, "");
    for (const char* text :
         {"truth.vdb: path-traced, 2 cells in both\n", "error      5 % on average",
          "uncertain by 1.25 %", "A holds 5 % too much light", "RMS 7.07 %",
          "bands up to order 1 cannot hold is no part of it", "result     pass\n"})
        EXPECT_NE(result.out.find(text), std::string::npos) << text << "\n" << result.out;
    EXPECT_LE(std::ranges::count(result.out, '\n'), 12) << result.out;
    EXPECT_EQ(result.out.find("sh_l"), std::string::npos) << result.out;
    EXPECT_EQ(run_json("bake.vdb truth.vdb", cmd::ExitCode::ok)["result"], "pass");
    EXPECT_EQ(run("bake.vdb truth.vdb --fail 11%").status, 0);
    run_json("bake.vdb truth.vdb --fail 9%", cmd::ExitCode::difference);
    run_json("bake.vdb truth.vdb --metadata", cmd::ExitCode::difference);
    // Two references may be the same, or not.
    EXPECT_EQ(run_json("truth.vdb truth.vdb", cmd::ExitCode::ok)["result"], "identical");
    truth.sh[0][0] *= 2.0f;
    write("other.vdb", truth);
    run_json("other.vdb truth.vdb", cmd::ExitCode::difference);
}

TEST_F(Diff, ThresholdsMeanWhatTheyMeanToIdiff) {
    write("a.vdb", brighter_corner()); // 12.5 % of the samples differ by 10 %
    write("b.vdb", even_light());
    const struct {
        const char* options;
        int status;
        const char* result;
    } cases[] = {
        {"", 7, "fail"},
        {"--fail 0", 7, "fail"},
        {"--fail 0.09", 7, "fail"},
        {"--fail 9%", 7, "fail"},
        {"--fail 0.11", 0, "pass"},
        {"--fail 11%", 0, "pass"},
        {"--fail 0.09 --fail-percent 12", 7, "fail"},
        {"--fail 0.09 --fail-percent 12.5", 0, "pass"},
        {"--fail-percent 12.5", 0, "pass"},
        {"--fail-percent 100 --hard-fail 0.11", 0, "pass"},
        {"--fail-percent 100 --hard-fail 9%", 7, "fail"},
        {"--hard-fail 0.11", 7, "fail"}, // --fail is 0 still
        {"--fail 0.11 --warn 0.09", 0, "warning"},
        {"--fail 0.11 --warn 0.09 --warn-percent 12.5", 0, "pass"},
        {"--fail 0.11 --warn 0.2 --hard-warn 0.09", 0, "warning"},
        {"--fail 0.11 --warn-percent 20 --hard-warn 0.2", 0, "pass"},
        {"--fail 0.09 --warn 0.05", 7, "fail"},
        {"--warn 0.5", 7, "fail"}, // a threshold for warnings does not let differences pass
    };
    for (const auto& [options, status, verdict] : cases) {
        const CliResult result = run(std::string("a.vdb b.vdb --format json ") + options);
        EXPECT_EQ(result.status, status) << options << "\n" << result.err;
        EXPECT_EQ(json::parse(result.out)["result"], verdict) << options;
        const std::string stderr_starts = status != 0 ? "lpvbake: error: a.vdb"
                                          : verdict == std::string("pass")
                                              ? ""
                                              : "lpvbake: warning: a.vdb";
        EXPECT_EQ(result.err.substr(0, stderr_starts.size()), stderr_starts) << options;
        EXPECT_EQ(std::ranges::count(result.err, '\n'), stderr_starts.empty() ? 0 : 1) << options;
    }
    const json document =
        run_json("a.vdb b.vdb --fail 5% --fail-percent 20 --warn 50%", cmd::ExitCode::ok);
    EXPECT_EQ(document["fail"]["limit"], 0.05);
    EXPECT_EQ(document["fail"]["percent"], 20.0);
    EXPECT_EQ(document["fail"]["hard"], nullptr);
    EXPECT_EQ(document["fail"]["exceeding"], 8 * 78);
    EXPECT_EQ(document["warn"]["exceeding"], 0);
    EXPECT_NEAR(document["irradiance"]["relative_l1"], 0.0125, 1e-6);
    EXPECT_NEAR(document["irradiance"]["percentile95"], 0.1, 1e-6);
    EXPECT_NEAR(document["energy"]["ratio"], 1.0125, 1e-6);
}

TEST_F(Diff, WrongCommandLinesAreRefused) {
    write("a.vdb", even_light());
    write("b.exr", even_light());
    spill(folder_ / "note.txt", "");
    const auto refused = [&](const std::string& arguments, const std::string& text) {
        expect_error(arguments, cmd::ExitCode::usage, text);
    };
    refused("", "diff: A is missing");
    refused("a.vdb", "diff: B is missing");
    refused("a.vdb a.vdb a.vdb", "a.vdb");
    refused("a.vdb note.txt", "note.txt");
    for (const char* option : {"--fail", "--warn", "--hard-fail", "--hard-warn", "--slice-max"})
        for (const char* bad : {"-1", "nan", "inf", "x", "''", "1%%", "1x", "1e99"})
            refused(std::string("a.vdb a.vdb ") + option + "=" + bad, option);
    for (const char* option : {"--fail-percent", "--warn-percent"})
        for (const char* bad : {"-1", "nan", "101", "5%"})
            refused(std::string("a.vdb a.vdb ") + option + "=" + bad, option);
    for (const char* bad : {"-1", "1.5", "x", "99999999999"})
        refused(std::string("a.vdb a.vdb --worst=") + bad, "--worst");
    refused("a.vdb a.vdb --format xml", "text|json");
    refused("a.vdb a.vdb -o out.txt", "out.txt");
    refused("a.vdb a.vdb -o out.png", "--slice");
    refused("a.vdb a.vdb --slice z=1", "--slice");
    refused("a.vdb a.vdb --slice-max 1", "--slice");
    refused("a.vdb a.vdb -o d.vdb --slice z=1", "--slice");
    for (const char* bad : {"z=4", "z=-1", "w=1", "z", "z=", "z=1x", "=1", "zz=1"})
        refused(std::string("a.vdb a.vdb -o out.png --slice ") + bad, bad);
    refused("a.vdb b.exr -o ./a.vdb", "would replace the input a.vdb");
    refused("a.vdb b.json -o b.exr", "would replace the input b.json");
    refused("a.vdb b.exr -o b.exr", "would replace the input b.exr");
    refused("a.vdb a.vdb -o d.vdb -o ./d.vdb", "given twice");
    expect_error("a.vdb none.vdb", cmd::ExitCode::file, "none.vdb");
    spill(folder_ / "broken.vdb", "x");
    expect_error("broken.vdb a.vdb", cmd::ExitCode::invalid, "broken.vdb");
    expect_error("a.vdb a.vdb -o none/d.vdb", cmd::ExitCode::file, "none/d.vdb");
    EXPECT_EQ(slurp(folder_ / "broken.vdb"), "x");
}

TEST_F(Diff, OtherGridsAreRefusedByName) {
    write("a.vdb", even_light());
    const auto refused = [&](const std::string& text, const auto& change) {
        Volume volume = even_light();
        change(volume);
        write("b.vdb", volume);
        expect_error("a.vdb b.vdb", cmd::ExitCode::invalid,
                     "a.vdb and b.vdb are not on one grid: " + text);
    };
    refused("dims: 4 x 4 x 4 and 4 x 2 x 8 cells", [](Volume& v) { v.grid.dims = {4, 2, 8}; });
    refused("cell: 0.5 and 0.4 m", [](Volume& v) { v.grid.cell = 0.4; });
    refused("origin: (-1, 0, 10) and (-1, 0, 9.5) m", [](Volume& v) { v.grid.origin.z = 9.5; });

    Volume inside = even_light();
    inside.validity.assign(64, 0);
    write("b.vdb", inside);
    expect_error("a.vdb b.vdb --fail 1", cmd::ExitCode::invalid, "no cell that is valid in both");
    EXPECT_EQ(run("b.vdb b.vdb").status, 0);
}

TEST_F(Diff, OrdersMayDiffer) {
    const Volume full = random_volume({4, 4, 4}, 2, false, 1);
    Volume cut = full;
    cut.sh_order = 1;
    cut.sh.resize(4);
    write("a.vdb", cut);
    write("b.vdb", full);
    const json document = run_json("a.vdb b.vdb", cmd::ExitCode::difference);
    EXPECT_EQ(document["sh_order"], json({1, 2}));
    EXPECT_GT(document["irradiance"]["relative_l1"], 0.01);
    EXPECT_EQ(document["only_b"].size(), 5u);
    EXPECT_EQ(document["only_b"][0], "sh_l2_xy");
    EXPECT_EQ(document["only_a"], json::array());
    EXPECT_NE(run("a.vdb b.vdb").out.find("SH order   1 in A, 2 in B"), std::string::npos);
}

TEST_F(Diff, MetadataAreToldAndDecideNothingUnlessAsked) {
    Volume a = even_light(), b = even_light();
    a.metadata = {{"solver", "lpv"}, {"settings", "iterations = 3; size = 4"}, {"mine", "1"}};
    b.metadata = {{"solver", "lpv"}, {"settings", "iterations = 5; size = 4"}, {"yours", "2"}};
    write("a.vdb", a);
    write("b.vdb", b);
    const json metadata = run_json("a.vdb b.vdb", cmd::ExitCode::ok)["metadata"];
    EXPECT_EQ(metadata["only_a"], json({{"mine", "1"}}));
    EXPECT_EQ(metadata["only_b"], json({{"yours", "2"}}));
    EXPECT_EQ(metadata["different"],
              json({{"settings", {"iterations = 3; size = 4", "iterations = 5; size = 4"}}}));
    const CliResult text = run("a.vdb b.vdb");
    EXPECT_NE(text.out.find("A  iterations = 3\n    B  iterations = 5\n"), std::string::npos)
        << text.out;
    EXPECT_NE(text.out.find("result     identical"), std::string::npos);
    for (const char* options : {"--metadata", "--metadata --fail 1"}) {
        const CliResult asked = run(std::string("a.vdb b.vdb ") + options);
        EXPECT_EQ(asked.status, int(cmd::ExitCode::difference));
        EXPECT_EQ(asked.err, "lpvbake: error: a.vdb differs from b.vdb in its metadata\n");
    }
    EXPECT_EQ(run("a.vdb a.vdb --metadata").status, 0);
}

TEST_F(Diff, WarnsWhereLightIsKnownToBeOfOtherSources) {
    Volume a = even_light(), b = even_light();
    volume::set_content(volume::content_of(true, true, false, 1), a.metadata);
    volume::set_content(volume::content_of(true, false, false, 1), b.metadata);
    write("a.vdb", a);
    write("b.vdb", b);
    EXPECT_NE(run("a.vdb b.vdb")
                  .err.find("holds other light than b.vdb: punctual lights after one "
                            "reflection; emitters direct and after one reflection "
                            "against punctual lights after one reflection\n"),
              std::string::npos);
    a.metadata.erase("sky_reflections"); // as files were once written: unknown, whatever it says
    write("old.vdb", a);
    EXPECT_EQ(run("old.vdb b.vdb").err, "");
    a = b;
    a.metadata["content"] = "otherwise said";
    write("said.vdb", a);
    EXPECT_EQ(run("said.vdb b.vdb").err, "");
}

TEST_F(Diff, ABlackReferenceIsNoDivisionByZero) {
    Volume black = even_light();
    black.sh.assign(4, std::vector<glm::vec3>(64));
    write("black.vdb", black);
    write("lit.vdb", even_light());
    const json document = run_json("lit.vdb black.vdb --fail 100000%", cmd::ExitCode::difference);
    EXPECT_EQ(document["irradiance"]["relative_l1"], nullptr);
    EXPECT_EQ(document["energy"]["ratio"], nullptr);
    EXPECT_NEAR(document["irradiance"]["rms"], std::numbers::pi, 1e-5);
    const CliResult text = run("lit.vdb black.vdb --slice z=0 -o a.png");
    EXPECT_EQ(text.status, int(cmd::ExitCode::difference));
    EXPECT_EQ(text.out.find("nan"), std::string::npos) << text.out;
    EXPECT_NE(text.out.find("inf %"), std::string::npos) << text.out;
    const json same = run_json("black.vdb black.vdb --fail 0", cmd::ExitCode::ok);
    EXPECT_EQ(same["irradiance"]["relative_l1"], 0.0);
    EXPECT_EQ(same["energy"]["ratio"], 1.0);
}

TEST_F(Diff, WritesTheDifferenceAndAPictureOfIt) {
    const Volume b = even_light();
    Volume a = brighter_corner();
    a.validity[a.grid.index({0, 3, 3})] = 0;
    a.sh[0][a.grid.index({3, 0, 3})] *= 2.0f;
    write("a.vdb", a);
    write("b.vdb", b);
    const CliResult result =
        run("a.vdb b.vdb -o d.vdb -o d2.exr -o e.png --slice z=3 --slice-max 120%");
    EXPECT_EQ(result.status, int(cmd::ExitCode::difference)) << result.err;
    EXPECT_NE(result.out.find("wrote      d.vdb\n"), std::string::npos) << result.out;
    for (const char* name : {"d.vdb", "d2.exr"}) {
        const Volume d = read_volume(folder_ / name);
        EXPECT_EQ(d.grid, b.grid);
        for (size_t k = 0; k < 4; ++k)
            for (size_t i = 0; i < 64; ++i)
                EXPECT_EQ(d.sh[k][i], a.sh[k][i] - b.sh[k][i]);
        EXPECT_EQ(d.validity, a.validity);
        EXPECT_EQ(d.metadata.at("minuend"), "a.vdb");
        EXPECT_EQ(d.metadata.at("subtrahend"), "b.vdb");
    }

    const image::Rgba8 image = picture("e.png");
    const auto pixel = [&](int x, int y) { return cell_in(image, x, y); };
    EXPECT_EQ(pixel(3, 0), glm::ivec3(255, 255, 255)) << "a whole 120 % of the mean";
    // 10 % of 120 % is a quarter of the way to red: sRGB of 0.25
    for (int x = 0; x < 3; ++x)
        EXPECT_EQ(pixel(x, 1), glm::ivec3(137, 0, 0));
    EXPECT_EQ(pixel(1, 2), glm::ivec3(0, 0, 0)) << "no difference";
    bool hatched = false;
    for (int x = 0; x < 64; ++x)
        hatched = hatched || pixel_in(image, x, 32).b != 0;
    EXPECT_TRUE(hatched) << "not valid in both";

    const json scale = run_json("a.vdb b.vdb -o e.png --slice x=3", cmd::ExitCode::difference);
    EXPECT_EQ(scale["slice"]["slice"], "x=3");
    EXPECT_NEAR(scale["slice"]["max"], 0.1, 1e-5) << "the percentile of two errors is the lower";
    EXPECT_EQ(scale["outputs"], json({"e.png"}));
}

TEST_F(Diff, APictureOfProbesSpreadsThemOverTheCellsAround) {
    Volume a = even_light(), b = even_light();
    std::ranges::fill(b.validity, 0.0f);
    b.validity[b.grid.index({0, 1, 3})] = 1;
    a.sh[0][a.grid.index({0, 1, 3})] *= 2.0f;
    write("a.vdb", a);
    write("b.vdb", b);
    EXPECT_EQ(run("a.vdb b.vdb -o e.png --slice z=3 --slice-max 300%").status,
              int(cmd::ExitCode::difference));
    const image::Rgba8 image = picture("e.png");
    const glm::ivec3 colour = cell_in(image, 0, 1);
    EXPECT_EQ(colour.r, 255) << "100 of 300 %";
    EXPECT_EQ(cell_in(image, 3, 1), colour) << "three cells away";
    EXPECT_EQ(cell_in(image, 1, 3), colour);
    EXPECT_NE(cell_in(image, 3, 3), colour) << "farther";
}

TEST_F(Diff, ListsAsManyCellsAsAsked) {
    write("a.vdb", brighter_corner());
    write("b.vdb", even_light());
    EXPECT_EQ(run_json("a.vdb b.vdb", cmd::ExitCode::difference)["worst"].size(), 5u);
    EXPECT_EQ(run_json("a.vdb b.vdb --worst 0", cmd::ExitCode::difference)["worst"].size(), 0u);
    const json all = run_json("a.vdb b.vdb --worst 100", cmd::ExitCode::difference)["worst"];
    EXPECT_EQ(all.size(), 8u);
    EXPECT_EQ(all[0]["cell"], json({0, 0, 3}));
}

TEST_F(Diff, HelpTellsWhatIsCompared) {
    const CliResult help = run("--help");
    EXPECT_EQ(help.status, 0);
    for (const char* word : {"--fail", "--fail-percent", "--hard-fail", "--warn", "--slice",
                             "mean irradiance of B", "Examples:\n  lpvbake diff"})
        EXPECT_NE(help.out.find(word), std::string::npos) << word;
}

} // namespace
} // namespace lpvbake
