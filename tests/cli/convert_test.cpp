// lpvbake convert from outside.
#include "cli/run.h"
#include "io/io.h"
#include "volume/compare.h"
#include "volume/dering.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <fstream>
#include <map>
#include <numbers>
#include <set>
#include <tuple>

namespace lpvbake {
namespace {

class Convert : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "convert " + arguments);
    }
    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    }
    void write(const std::string& name, const Volume& volume) {
        io::write_volume(folder_ / name, volume, Precision::full);
    }

    TemporaryFolder folder_;
};

TEST_F(Convert, ThereAndBackIsTheSame) {
    for (const int order : {1, 2, 4}) {
        const Volume volume = random_volume({6, 5, 4}, order, order == 1, 1);
        write("a.vdb", volume);
        ASSERT_EQ(run("a.vdb b.exr").status, 0);
        ASSERT_EQ(run("b.exr c.vdb").status, 0);
        ASSERT_EQ(run("b.json d.exr --exr-columns 3").status, 0);
        for (const char* name : {"c.vdb", "d.exr"}) {
            const Volume back = read_volume(folder_ / name);
            EXPECT_TRUE(volume::compare(back, volume, {}).identical) << name << order;
            EXPECT_EQ(back.metadata, volume.metadata);
            EXPECT_EQ(back.grid, volume.grid);
        }
        const auto sidecar = nlohmann::json::parse(slurp(folder_ / "d.json"));
        EXPECT_EQ(sidecar["layout"]["columns"], 3);
        EXPECT_EQ(sidecar["layout"]["rows"], 2);
    }
}

TEST_F(Convert, ReplacesAllOfAnotherVolume) {
    write("a.vdb", random_volume({5, 4, 6}, 2, true, 3));
    write("first.vdb", random_volume({5, 4, 6}, 1, true, 3));
    const auto exists = [&](const char* name) { return std::filesystem::exists(folder_ / name); };
    std::ofstream(folder_ / "b_own.dds") << "of the user";
    ASSERT_EQ(run("a.vdb b.dds --precision bc6h").status, 0);
    ASSERT_EQ(run("a.vdb b_c.dds c.exr --precision half").status, 0);
    ASSERT_TRUE(exists("b_base.dds") && exists("b_sh_l2_xy.dds") && exists("c_sh_l2_xy.exr"));
    ASSERT_EQ(run("a.vdb b.dds --precision half").status, 0);
    EXPECT_FALSE(exists("b_base.dds"));
    EXPECT_TRUE(exists("b_sh_l2_xy.dds") && exists("b_own.dds") && exists("b_c_sh_l2_xy.dds"));
    ASSERT_EQ(run("first.vdb c.exr").status, 0);
    EXPECT_FALSE(exists("c_sh_l2_xy.exr"));
    EXPECT_EQ(read_volume(folder_ / "c.exr").sh_order, 1);
    // Not by the word of a sidecar that names others.
    std::string text = slurp(folder_ / "c.json");
    text.replace(text.find("c_sh_l0.exr"), 11, "b_c.dds.json");
    std::ofstream(folder_ / "c.json") << text;
    ASSERT_EQ(run("a.vdb c.exr").status, 0);
    EXPECT_TRUE(exists("b_c.dds.json"));
}

TEST_F(Convert, EveryConventionAndAxesComeBackFromEveryFile) {
    const Volume volume = random_volume({6, 5, 4}, 1, true, 2);
    write("a.vdb", volume);
    const std::pair<const char*, const char*> encodings[] = {
        {"radiance", "blender"}, {"irradiance", "unity"}, {"lpv", "unreal"},
        {"godot", "gltf"},       {"unity", "unity"},      {"unreal", "unreal"}};
    for (const auto& [convention, axes] : encodings)
        for (const char* file : {"b.vdb", "b.exr --packing channel", "b.exr"}) {
            const std::string options =
                " --sh-convention " + std::string(convention) + " --axes " + axes;
            ASSERT_EQ(run("a.vdb " + std::string(file) + options).status, 0) << options;
            const std::string name = std::string(file).substr(0, 5);
            ASSERT_EQ(run(name + " c.vdb").status, 0) << options;
            const Volume back = read_volume(folder_ / "c.vdb");
            EXPECT_LT(volume::compare(back, volume, {}).relative_l1, 1e-6) << options;
        }
}

TEST_F(Convert, StoresWhatTheConventionSays) {
    Volume volume = random_volume({3, 3, 3}, 2, false, 3);
    write("a.vdb", volume);
    ASSERT_EQ(run("a.vdb u.exr --sh-convention unity --packing channel").status, 0);
    const auto sidecar = nlohmann::json::parse(slurp(folder_ / "u.json"));
    EXPECT_EQ(sidecar["convention"], "unity");
    EXPECT_EQ(sidecar["files"][0]["file"], "u_r.exr");
    EXPECT_EQ(sidecar["files"][0]["channels"],
              (nlohmann::json{"sh_l1_x.r", "sh_l1_y.r", "sh_l1_z.r", "sh_l0.r"}));
    EXPECT_EQ(sidecar["files"][3]["file"], "u_r2.exr");
    EXPECT_EQ(sidecar["files"][6]["file"], "u_sh_l2_x2y2.exr");
    ASSERT_EQ(run("a.vdb l.vdb --sh-convention lpv --sh-order 1").status, 0);
    volume.sh_order = 1;
    volume.sh.resize(4);
    EXPECT_LT(volume::compare(read_volume(folder_ / "l.vdb"), volume, {}).relative_l1, 1e-6);
}

TEST_F(Convert, WritesWhatEachTargetReads) {
    Volume volume = random_volume({4, 5, 7}, 2, false, 4);
    volume.validity.assign(volume.grid.size(), 1.0f);
    write("a.vdb", volume);
    const std::map<std::string, std::set<std::string>> notes = {
        {"generic", {}},
        {"houdini", {}},
        {"blender", {}},
        {"threejs", {}},
        {"bevy", {"t.bevy.json"}},
        {"unity", {"t.unity.json"}},
        {"vrc", {"t.unity.json"}},
        {"unreal", {"t.unreal.json"}},
        {"godot",
         {"t_r.exr.import", "t_g.exr.import", "t_b.exr.import", "t_r2.exr.import",
          "t_g2.exr.import", "t_b2.exr.import", "t_sh_l2_x2y2.exr.import", "t_validity.exr.import",
          "t_wall_0.exr.import", "t_wall_1.exr.import", "t.godot.json"}}};
    for (const auto& [target, expected] : notes) {
        const CliResult result = run(
            "a.vdb t.exr u.vdb --format json --precision float --dering off --fit none --target "
            + target);
        ASSERT_EQ(result.status, 0) << target << result.err;
        const auto document = nlohmann::json::parse(result.out);
        const auto outputs = document["outputs"];
        std::string warnings = document["warnings"].dump();
        for (const auto& [unfit, format] : {std::pair{"t.exr", ".vdb"}, std::pair{"u.vdb", ".exr"}})
            EXPECT_EQ(warnings.find(std::string(unfit) + ": " + target + " reads " + format)
                          != std::string::npos,
                      (std::string(format) == ".vdb")
                              == (target == "houdini" || target == "blender")
                          && target != "generic" && target != "unreal" && target != "bevy")
                << target << warnings;
        EXPECT_EQ(warnings.find("bevy reads .ktx2 and .dds") != std::string::npos,
                  target == "bevy");
        EXPECT_EQ(warnings.find("higher bands are left out") != std::string::npos, target == "vrc");
        std::set<std::string> beside;
        for (const auto& file : outputs[0]["files"])
            if (const std::string name = file["path"]; name != "t.json" && !name.ends_with(".exr"))
                beside.insert(name);
        EXPECT_EQ(beside, expected) << target;
        // What comes back is what was given, but for bands that the program has no form for.
        Volume wanted = volume;
        if (target == "vrc") {
            wanted.sh_order = 1;
            wanted.sh.resize(4);
        }
        EXPECT_LT(volume::compare(read_volume(folder_ / "u.vdb"), wanted, {}).relative_l1, 1e-6)
            << target;
        if (target != "bevy") {
            EXPECT_LT(volume::compare(read_volume(folder_ / "t.exr"), wanted, {}).relative_l1, 1e-6)
                << target;
        }
        const auto layout = nlohmann::json::parse(slurp(folder_ / "t.json"))["layout"];
        if (!expected.empty() && target != "bevy") { // these take empty tiles for slices
            EXPECT_EQ(int(layout["columns"]) * int(layout["rows"]), target == "unreal" ? 5 : 7)
                << target;
        }
    }
    const std::string import = slurp(folder_ / "t_r.exr.import");
    EXPECT_NE(import.find("importer=\"3d_texture\""), std::string::npos);
    EXPECT_NE(import.find("slices/vertical="), std::string::npos);
    expect_error("a.vdb t.exr --target maya", cmd::ExitCode::usage, "--target");
}

TEST_F(Convert, ShowsNoNegativeIrradianceToProgramsThatWould) {
    Volume volume = random_volume({5, 5, 7}, 2, false, 4);
    volume.validity.clear();
    for (glm::vec3& l0 : volume.sh[0])
        l0 = glm::vec3(500.0f);
    write("a.vdb", volume);
    const auto least = [&](const std::string& options) { // over its cells, as the file has them
        EXPECT_EQ(run("a.vdb t.exr " + options).status, 0) << options;
        const Volume got = read_volume(folder_ / "t.exr");
        double result = 1e30;
        for (std::size_t cell = 0; cell < got.grid.size(); ++cell)
            for (int c = 0; c < 3; ++c) {
                std::vector<float> colour;
                for (const auto& band : got.sh)
                    colour.push_back(band[cell][c]);
                result = std::min(result, volume::least_irradiance(colour));
                EXPECT_NEAR(colour[0], 500, 0.5) << options;
            }
        return result;
    };
    for (const char* target : {"unity", "unreal", "godot", "threejs", "vrc"}) {
        const std::string option = "--fit none --target " + std::string(target);
        EXPECT_GE(least(option), 0) << target; // half precision
        EXPECT_LT(least(option + " --dering off"), -10) << target;
    }
    EXPECT_LT(least("--target generic"), -10);
    EXPECT_GE(least("--target generic --dering on"), 0);
    // What was fitted to a program holds negative light on purpose, also for one that reads alike.
    volume.metadata["fit"] = "godot";
    write("a.vdb", volume);
    for (const char* target : {"godot", "unity", "unreal"})
        EXPECT_LT(least("--target " + std::string(target)), -10) << target;
}

TEST_F(Convert, ScalesBandOneForVrcAndTellsOfIt) {
    Volume volume = random_volume({4, 5, 6}, 1, false, 4);
    write("a.vdb", volume);
    const std::string vrc = " --target vrc --fit none --dering off --precision float";
    ASSERT_EQ(run("a.vdb p.exr p.vdb" + vrc).status, 0);
    ASSERT_EQ(run("a.vdb s.exr s.vdb --l1-scale 1.65" + vrc).status, 0);
    // What is in the file, its fact left out; read with it the light is what it was.
    const std::string sidecar = slurp(folder_ / "s.json");
    const std::size_t at = sidecar.find("\"l1_scale\"");
    ASSERT_NE(at, std::string::npos);
    const Volume plain = read_volume(folder_ / "p.exr"), seen = read_volume(folder_ / "s.exr");
    spill(folder_ / "s.json", std::string(sidecar).replace(at, 10, "\"l1_told\""));
    const Volume stored = read_volume(folder_ / "s.exr");
    for (std::size_t i = 0; i < plain.grid.size(); ++i) {
        EXPECT_EQ(stored.sh[0][i], plain.sh[0][i]);
        for (std::size_t k = 1; k < 4; ++k) {
            EXPECT_LT(glm::distance(stored.sh[k][i], 1.65f * plain.sh[k][i]), 0.01f);
            EXPECT_LT(glm::distance(seen.sh[k][i], plain.sh[k][i]), 0.01f);
        }
    }
    EXPECT_EQ(seen.metadata.at("l1_scale"), "1.65");
    EXPECT_EQ(read_volume(folder_ / "s.vdb").metadata.at("l1_scale"), "1.65");
    EXPECT_EQ(plain.metadata.count("l1_scale"), 0u);
    // Written on without the option it is gone, with it it is there once.
    for (const auto& [options, times] : {std::pair{"", false}, {" --l1-scale 1.65", true}}) {
        ASSERT_EQ(run("s.vdb t.vdb" + vrc + options).status, 0);
        const Volume back = read_volume(folder_ / "t.vdb");
        EXPECT_EQ(back.metadata.count("l1_scale"), std::size_t(times));
        EXPECT_LT(volume::compare(back, plain, {}).relative_l1, 1e-6);
    }
    spill(folder_ / "s.json", std::string(sidecar).replace(sidecar.find("1.65"), 4, "-1.0"));
    EXPECT_EQ(error_of("s.exr", [&] { read_volume(folder_ / "s.exr"); }).kind, ErrorKind::invalid);
    expect_error("a.vdb t.exr --target unity --l1-scale 1.65", cmd::ExitCode::usage, "--l1-scale");
}

/// A wall without thickness across x = 5.3 m, lit from everywhere before it, dark behind, in cells
/// of a metre.
Volume halves() {
    Volume volume;
    volume.grid = {glm::dvec3(0.0), 1.0, {11, 6, 6}};
    volume.sh_order = 2;
    volume.sh.assign(9, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    volume.validity.assign(volume.grid.size(), 1.0f);
    volume.walls.assign(1, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        const float way = 5.3f - (float(volume.grid.cell_at(i).x) + 0.5f);
        if (std::abs(way) < walls_reach)
            volume.walls[0][i] = {way, 0, 0};
        if (way > 0)
            volume.sh[0][i] = glm::vec3(100, 50, 20);
    }
    return volume;
}

TEST_F(Convert, FitsToTheVolumesOwnWallsUnlessToldOtherwise) {
    write("a.vdb", halves());
    const auto shown = [&](const std::string& options) { // plainly, on both sides of the wall
        const CliResult result = run("a.vdb t.vdb " + options + " --format json");
        EXPECT_EQ(result.status, 0) << result.err;
        const Volume volume = read_volume(folder_ / "t.vdb");
        const glm::dvec3 at(5.3, 3.2, 2.9), lit(-1, 0, 0);
        const double full = double(volume::sh_y0) * 100 * std::numbers::pi;
        return std::tuple(read_irradiance(volume, at, lit, Reading::trilinear).x / full,
                          read_irradiance(volume, at, -lit, Reading::trilinear).x / full,
                          nlohmann::json::parse(result.out));
    };
    for (const std::string target : {"unity", "vrc"}) {
        const auto [lit, dark, document] = shown("--target " + target);
        EXPECT_NEAR(lit, 1, 0.03) << target;
        EXPECT_NEAR(dark, 0, 0.03) << target;
        EXPECT_EQ(document["fit"]["reader"], target);
        EXPECT_LT(document["fit"]["error"].get<double>(), 0.03);
    }
    EXPECT_EQ(read_volume(folder_ / "t.vdb").metadata.at("fit_to"), "walls");
    for (const std::string options :
         {"--target unity --fit none", "--target houdini", "--target unity --dilate 1"}) {
        const auto [lit, dark, document] = shown(options);
        EXPECT_NEAR(lit, 0.2, 1e-3) << options; // what there is to mend
        EXPECT_NEAR(dark, 0.2, 1e-3) << options;
        EXPECT_FALSE(document.contains("fit")) << options;
    }
    EXPECT_TRUE(std::get<2>(shown("--target houdini --fit surfaces")).contains("fit"));
    // Once is enough; and not without walls.
    ASSERT_EQ(run("a.vdb u.vdb --target unity").status, 0);
    expect_error("u.vdb t.vdb --target unity --fit surfaces", cmd::ExitCode::usage, "fitted");
    ASSERT_EQ(run("u.vdb t.vdb --target unity").status, 0);
    EXPECT_EQ(read_volume(folder_ / "t.vdb").sh, read_volume(folder_ / "u.vdb").sh);
    Volume bare = halves();
    bare.walls.clear();
    write("b.vdb", bare);
    expect_error("b.vdb t.vdb --target unity --fit surfaces", cmd::ExitCode::usage, "--scene");
    EXPECT_EQ(run("b.vdb t.vdb --target unity").status, 0);
    expect_error("a.vdb t.vdb --fit surfaces --dilate 1", cmd::ExitCode::usage, "--dilate");
}

TEST_F(Convert, FitsToTheSurfacesOfAScene) {
    // The light of an empty lattice around the shipped room: any light does.
    Volume volume = halves();
    volume.grid = {{-1.2, -0.2, -1.2}, 0.24, {11, 11, 11}};
    for (auto& band : volume.sh)
        band.assign(volume.grid.size(), glm::vec3(0.0f));
    volume.sh[0].assign(volume.grid.size(), glm::vec3(10.0f));
    volume.validity.assign(volume.grid.size(), 1.0f);
    volume.walls.clear();
    write("a.vdb", volume);
    const CliResult result = run("a.vdb t.exr --target godot --scene \"$ROOM\" --format json");
    ASSERT_EQ(result.status, 0) << result.err;
    EXPECT_LT(nlohmann::json::parse(result.out)["fit"]["error"].get<double>(), 0.01);
    EXPECT_EQ(read_volume(folder_ / "t.exr").metadata.at("fit_to"), "surfaces");
    expect_error("a.vdb t.exr --target godot --scene none.gltf", cmd::ExitCode::file, "none.gltf");
}

TEST_F(Convert, OptionsGoBeforeTheTarget) {
    write("a.vdb", random_volume({4, 5, 6}, 2, false, 4));
    ASSERT_EQ(run("a.vdb t.exr --target unity --fit none --axes unreal --packing band").status, 0);
    const auto sidecar = nlohmann::json::parse(slurp(folder_ / "t.json"));
    EXPECT_EQ(sidecar["convention"], "unity");
    EXPECT_EQ(sidecar["axes"], "unreal");
    EXPECT_EQ(sidecar["packing"], "band");
    EXPECT_EQ(sidecar["precision"], "half");
}

TEST_F(Convert, SaysWhatItWrote) {
    write("a.vdb", random_volume({3, 3, 3}, 2, false, 3));
    const CliResult result = run("a.vdb b.vdb c.exr --format json --sh-order 1");
    ASSERT_EQ(result.status, 0) << result.err;
    const auto document = nlohmann::json::parse(result.out);
    EXPECT_EQ(document["sh_order"], 1);
    EXPECT_EQ(document["outputs"][0]["path"], "b.vdb");
    EXPECT_EQ(document["outputs"][1]["files"].size(), 8u);
    const CliResult text = run("a.vdb b.vdb");
    EXPECT_NE(text.out.find("wrote         b.vdb ("), std::string::npos) << text.out;
    ASSERT_EQ(run("a.vdb d.vdb --dilate 2").status, 0);
    EXPECT_EQ(read_volume(folder_ / "d.vdb").metadata.at("dilate"), "2");
}

TEST_F(Convert, WrongCommandsAreRefused) {
    write("a.vdb", random_volume({3, 3, 3}, 2, false, 3));
    expect_error("a.vdb b.png", cmd::ExitCode::usage, "unknown kind of volume file");
    expect_error("a.vdb ./a.vdb", cmd::ExitCode::usage, "would replace the input a.vdb");
    expect_error("a.vdb b.vdb --sh-order 4", cmd::ExitCode::usage, "has order 2, not 4");
    expect_error("a.vdb b.vdb --sh-convention lpv", cmd::ExitCode::unsupported, "set --sh-order");
    expect_error("none.vdb b.vdb", cmd::ExitCode::file, "none.vdb");
    expect_error("a.vdb b.vdb --axes maya", cmd::ExitCode::usage, "--axes");
    expect_error("a.vdb", cmd::ExitCode::usage, "output");
    expect_error("a.vdb u.ktx2 --precision bc6h --packing band", cmd::ExitCode::usage,
                 "u.ktx2: --precision bc6h is packed by block alone, not by band");
    expect_error("a.vdb u.ktx2 --precision unorm8 --packing channel", cmd::ExitCode::usage,
                 "u.ktx2: --precision unorm8 is packed by ratio alone, not by channel");
    expect_error("a.vdb u.ktx2 --precision half --packing block", cmd::ExitCode::usage,
                 "u.ktx2: --packing block is for --precision bc6h alone");
}

TEST_F(Convert, BevyGetsAScene) {
    Volume volume = random_volume({4, 6, 8}, 1, false, 9);
    volume.grid = {{-1, 0, 0.5}, 0.25, {4, 6, 8}};
    write("a.vdb", volume);
    for (const std::string extension : {".ktx2", ".dds"}) {
        const CliResult result =
            run("a.vdb t" + extension + " --target bevy --fit none --format json");
        ASSERT_EQ(result.status, 0) << result.err;
        const auto files = nlohmann::json::parse(result.out)["outputs"][0]["files"];
        EXPECT_EQ(files.back()["path"], "t.scn.ron");
        EXPECT_EQ(slurp(folder_ / "t.scn.ron"), R"((
  resources: {},
  entities: {
    4294967297: (
      components: {
        "bevy_transform::components::transform::Transform": (
          translation: (-0.5, 0.75, 1.5),
          rotation: (0, 0, 0, 1),
          scale: (1, 1.5, 2),
        ),
        "bevy_light::probe::IrradianceVolume": (
          voxels: Path("t_cube)" + extension + R"("),
          intensity: 1,
          affects_lightmapped_meshes: true,
        ),
      },
    ),
  },
)
)");
    }
}

TEST_F(Convert, GodotGetsProbes) {
    const Volume volume = random_volume({4, 3, 5}, 2, false, 10);
    write("a.vdb", volume);
    ASSERT_EQ(run("a.vdb t.tres --target godot --fit none --dering off --precision float").status,
              0);
    ASSERT_EQ(run("t.tres back.vdb").status, 0);
    const Volume back = read_volume(folder_ / "back.vdb");
    EXPECT_EQ(back.grid, volume.grid);
    for (size_t i = 0; i < volume.grid.size(); ++i)
        if (volume.validity[i] > 0) { // others are filled
            EXPECT_LT(glm::length(back.sh[0][i] - volume.sh[0][i]), 1e-3f);
        }
    expect_error("a.vdb u.tres", cmd::ExitCode::unsupported,
                 "holds light as Godot has it; add --target godot");
}

} // namespace
} // namespace lpvbake
