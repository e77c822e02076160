// `lpvbake render` from outside.
#include "cli/run.h"
#include "hard_cases/gltf_writer.h"
#include "image/image.h"
#include "io/io.h"
#include "scenes.h"
#include "volume/light_content.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <iomanip>
#include <numeric>
#include <sstream>

namespace lpvbake {
namespace {

using nlohmann::json;

class RenderCli : public ::testing::Test {
protected:
    void SetUp() override {
        if (run_lpvbake(folder_, "devices").status == int(cmd::ExitCode::device))
            GTEST_SKIP() << "no Vulkan device";
        // A field of 10 nits from everywhere, as wide as the shipped room and its margin.
        volume_.grid = {{-1.25, -0.25, -1.25}, 0.25, {10, 10, 10}};
        volume_.sh.assign(4, std::vector<glm::vec3>(1000, glm::vec3(0)));
        volume_.sh[0].assign(1000, glm::vec3(10 / 0.28209479f));
        volume_.validity.assign(1000, 1);
        volume_.metadata = {{"bounces", "1"}};
        volume::set_content(volume::content_of(true, true, false, 1), volume_.metadata);
        io::write_volume(folder_ / "v.vdb", volume_, Precision::full);
    }
    CliResult run(const std::string& arguments) {
        return run_lpvbake(folder_, "render " + arguments);
    }
    json run_json(const std::string& arguments) {
        const CliResult result = run(arguments + " --format json");
        EXPECT_EQ(result.status, 0) << result.err;
        return json::parse(result.out);
    }
    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run(arguments), arguments, code, text);
    }
    image::Pixels exr(const std::string& name) {
        const std::string bytes = slurp(folder_ / name);
        return image::decode_exr(std::as_bytes(std::span(bytes)), name, 1 << 20);
    }

    TemporaryFolder folder_;
    Volume volume_;
};

TEST_F(RenderCli, DrawsTheFilesCamera) {
    const json document = run_json("\"$ROOM\" v.vdb -o a.png -o a.exr --size 40x30 --samples 4"
                                   " --exposure 3.5");
    EXPECT_EQ(document["size"], json({40, 30}));
    EXPECT_EQ(document["camera"]["name"], "front");
    EXPECT_NEAR(document["camera"]["eye"][2], 3.9, 1e-9);
    EXPECT_EQ(document["exposure"], 3.5);
    EXPECT_EQ(document["reference"], nullptr);
    EXPECT_EQ(document["warnings"], json::array());
    EXPECT_GT(document["rays"], 1000);
    EXPECT_EQ(document["outputs"].size(), 2u);
    EXPECT_EQ(slurp(folder_ / "a.png").substr(1, 3), "PNG");
    const image::Pixels picture = exr("a.exr");
    ASSERT_EQ(picture.samples.size(), 3600u);
    double luminance = 0;
    for (std::size_t i = 0; i < 3600; i += 3)
        luminance += (0.2126 * picture.samples[i] + 0.7152 * picture.samples[i + 1]
                      + 0.0722 * picture.samples[i + 2])
                     / 1200;
    EXPECT_NEAR(double(document["mean_luminance"]) / luminance, 1, 1e-5);
    // As high as asked for nothing, and square: the camera's aspect.
    EXPECT_EQ(run_json("\"$ROOM\" v.vdb -o a.png --camera front --dry-run")["size"],
              json({540, 540}));
}

TEST_F(RenderCli, WallsReflectTheField) {
    const json document = run_json("\"$ROOM\" v.vdb -o a.exr --size 9x9 --samples 1 --show indirect"
                                   " --camera 0,1,0.9:0,1,-1:20");
    for (const float sample : exr("a.exr").samples) // the white back wall, 0.73 of 10 nits
        EXPECT_NEAR(sample, 7.3, 1e-3);
    EXPECT_NEAR(double(document["mean_luminance"]), 7.3, 1e-3);
}

TEST_F(RenderCli, SameBytesForAnyNumberOfThreads) {
    const std::string common = "\"$ROOM\" v.vdb --size 32x24 --samples 2 --reference 3";
    ASSERT_EQ(run(common + " --threads 1 -o a.png -o a.exr --reference-output ar.exr").status, 0);
    ASSERT_EQ(run(common + " --threads 2 -o b.png -o b.exr --reference-output br.exr").status, 0);
    for (const char* name : {".png", ".exr", "r.exr"})
        EXPECT_TRUE(slurp(folder_ / ("a" + std::string(name)))
                    == slurp(folder_ / ("b" + std::string(name))))
            << name;
}

TEST_F(RenderCli, TellsHowFarItIsFromPaths) {
    const json document = run_json("\"$ROOM\" v.vdb -o a.exr --size 16x16 --samples 4 --reference 8"
                                   " --reference-output r.exr --show direct");
    const image::Pixels a = exr("a.exr"), b = exr("r.exr");
    double squares = 0;
    for (std::size_t i = 0; i < a.samples.size(); ++i)
        squares += std::pow(double(a.samples[i]) - double(b.samples[i]), 2);
    EXPECT_NEAR(double(document["reference"]["rmse"]),
                std::sqrt(squares / double(a.samples.size())), 1e-4);
    EXPECT_EQ(document["reference"]["paths"], 8);
    EXPECT_GT(document["reference"]["flip"], 0.0);
    EXPECT_LT(document["reference"]["flip"], 0.5);
    EXPECT_NEAR(double(document["reference"]["ratio"]), 1, 0.1);
}

TEST_F(RenderCli, EnginesReadWhatPathsSeeOfAFloorWithCellsOnIt) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.7f)), {-2, 0, -2}, {2, 3, 2},
                    scenes::Facing::inward);
    scene.lights.push_back(scenes::point_light({0, 2.5, 0}, 100.0));
    scenes::write_gltf(scene, folder_ / "room.gltf");
    const auto mean = [&](const char* name) {
        const image::Pixels picture = exr(name);
        return std::accumulate(picture.samples.begin(), picture.samples.end(), 0.0)
               / double(picture.samples.size());
    };
    // From below the lamp.
    const std::string view = " --camera 0,2.4,0.01:0,0,0:60 --size 24x24 --show irradiance";
    double by_paths = 0;
    for (const int cells : {8, 16})
        for (const double snap : {0.0, 1e-6, -1e-6, 1e-4, -1e-4, 1e-2, -1e-2})
            for (const char* how : {" --solver sn", " --solver gather --dilate 2"}) {
                if (cells > 8 && snap != 0.0)
                    continue; // a matter of seconds
                const double cell = 4.0 / cells, off = (snap - 0.5) * cell;
                std::ostringstream bake;
                bake << std::setprecision(12) << "bake room.gltf -o f.vdb --margin 0 --cell-size "
                     << cell << " --bounds " << off - 2 << "," << off << "," << off - 2 << ","
                     << off + 2 + cell << "," << off + 3 + cell << "," << off + 2 + cell << how;
                const CliResult baked = run_lpvbake(folder_, bake.str());
                ASSERT_EQ(baked.status, 0) << baked.err;
                if (by_paths == 0) {
                    ASSERT_EQ(run("room.gltf f.vdb -o a.exr" + view
                                  + " --samples 1 --reference 400 --reference-output r.exr")
                                  .status,
                              0);
                    by_paths = mean("r.exr");
                    ASSERT_GT(by_paths, 30.0);
                }
                ASSERT_EQ(
                    run("room.gltf f.vdb -o a.exr --samples 4 --sampler trilinear" + view).status,
                    0);
                EXPECT_NEAR(mean("a.exr") / by_paths, 1.0, 0.02) << bake.str();
            }
}

TEST_F(RenderCli, DryRunDrawsNothing) {
    EXPECT_EQ(run("\"$ROOM\" v.vdb --dry-run").status, 0); // with no output to name
    const json document = run_json("\"$ROOM\" v.vdb -o a.png --camera orbit:90,0,7 --dry-run");
    EXPECT_EQ(document["outputs"],
              json::parse(R"([{"path": "a.png", "files": [{"path": "a.png"}]}])"));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "a.png"));
    const auto eye = document["camera"]["eye"];
    EXPECT_NEAR(eye[0], 7, 0.01); // of a room around x = z = 0: 90 degrees is +X
    EXPECT_NEAR(eye[2], 0, 0.01);
}

TEST_F(RenderCli, WarnsOfAVolumeThatDoesNotBelong) {
    volume_.grid.origin.x = -0.5;
    volume::set_content(volume::content_of(true, false, false, 1), volume_.metadata);
    volume_.metadata["scene_hash"] = "0123456789abcdef";
    volume_.metadata["settings"] = "sun = [\"1,2,3\"]";
    io::write_volume(folder_ / "w.vdb", volume_, Precision::full);
    const CliResult result = run("\"$ROOM\" w.vdb -o a.png --size 8x8 --samples 1");
    EXPECT_EQ(result.status, 0);
    for (const char* text :
         {"ends inside the scene", "another scene or other lights", "holds no light of emitters"})
        EXPECT_NE(result.err.find(text), std::string::npos) << text << "\n" << result.err;
    EXPECT_EQ(run("\"$ROOM\" w.vdb -o a.png --size 8x8 --samples 1 --show albedo").err, "");
    volume_.metadata.erase("emitter_reflections"); // as files were once written
    io::write_volume(folder_ / "old.vdb", volume_, Precision::full);
    const CliResult old = run("\"$ROOM\" old.vdb -o a.png --size 8x8 --samples 1");
    EXPECT_EQ(old.status, 0);
    EXPECT_EQ(old.err.find("holds no light"), std::string::npos) << old.err;
    volume_.metadata["minuend"] = "x.vdb";
    io::write_volume(folder_ / "d.vdb", volume_, Precision::full);
    expect_error("\"$ROOM\" d.vdb -o a.png", cmd::ExitCode::invalid, "difference of two volumes");
    volume_.metadata.erase("minuend");
    volume_.metadata["quantity"] = "standard error";
    io::write_volume(folder_ / "e.vdb", volume_, Precision::full);
    expect_error("\"$ROOM\" e.vdb -o a.png", cmd::ExitCode::invalid, "e.vdb");
}

TEST_F(RenderCli, ConfigFileRoundTrips) {
    const std::string given =
        "\"$ROOM\" v.vdb -o a.png --camera 1,2,3:0,0,0:50 --size 20x10 --samples 3 --show direct"
        " --sampler trilinear --exposure 4 --tone-map none --reference 2 --reference-output b.exr"
        " --sun 1,2,3 --threads 2 --format json";
    const CliResult first = run(given + " --print-config > a.toml; cat a.toml");
    ASSERT_EQ(first.status, 0) << first.err;
    const CliResult second = run("--config a.toml --print-config");
    EXPECT_EQ(second.err, "");
    EXPECT_EQ(second.out, slurp(folder_ / "a.toml"));
    for (const char* line :
         {"samples = 3\n", "sampler = \"trilinear\"\n", "camera = \"1,2,3:0,0,0:50\"\n"})
        EXPECT_NE(second.out.find(line), std::string::npos) << line << second.out;
    for (const char* name : {"v.vdb", "a.png", "b.exr"})
        EXPECT_EQ(second.out.find(name), std::string::npos) << "what one run reads and writes";
}

TEST_F(RenderCli, TakesEveryReaderThatItNames) {
    for (const char* name : {"auto", "facing", "trilinear", "blender", "houdini", "unity", "unreal",
                             "godot", "threejs", "vrc", "bevy", "geomerics", "zh3"}) {
        const CliResult result =
            run("\"$ROOM\" v.vdb -o a.png --dry-run --sampler " + std::string(name));
        EXPECT_EQ(result.status, 0) << name << result.err;
    }
}

TEST_F(RenderCli, AFittedVolumeIsShownAsItsReaderDoes) {
    const std::string dry = "\"$ROOM\" f.vdb -o a.png --dry-run";
    for (const auto& [fit, sampler] :
         {std::pair{"godot", "godot"}, {"lpvbake", "facing"}, {"quake", "facing"}}) {
        volume_.metadata["fit"] = fit;
        io::write_volume(folder_ / "f.vdb", volume_, Precision::full);
        EXPECT_EQ(run_json(dry)["sampler"], sampler) << fit;
        EXPECT_EQ(run_json(dry + " --sampler vrc")["sampler"], "vrc") << fit;
    }
    EXPECT_EQ(run_json("\"$ROOM\" v.vdb -o a.png --dry-run")["sampler"], "facing");
}

TEST_F(RenderCli, WrongCommandLinesAreRefused) {
    expect_error("", cmd::ExitCode::usage, "no scene");
    expect_error("\"$ROOM\"", cmd::ExitCode::usage, "no volume");
    expect_error("\"$ROOM\" v.vdb", cmd::ExitCode::usage, "-o FILE.png");
    expect_error("\"$ROOM\" v.vdb -o a.jpg", cmd::ExitCode::usage, "a.jpg");
    expect_error("\"$ROOM\" v.vdb -o a.png -o a.png", cmd::ExitCode::usage, "given twice");
    expect_error("\"$ROOM\" v.vdb -o a.png --reference-output b.png", cmd::ExitCode::usage,
                 "--reference N");
    expect_error("\"$ROOM\" v.vdb -o none/a.png", cmd::ExitCode::file, "none/a.png");
    expect_error("\"$ROOM\" none.vdb -o a.png", cmd::ExitCode::file, "none.vdb");
    expect_error("none.gltf v.vdb -o a.png", cmd::ExitCode::file, "none.gltf");
    expect_error("\"$ROOM\" v.vdb -o a.png --show occlusion", cmd::ExitCode::invalid, "occlusion");
    expect_error("\"$ROOM\" v.vdb -o a.png --show cells --reference 1", cmd::ExitCode::usage,
                 "cells");
    for (const char* bad : {"--size=0x9",
                            "--size=9",
                            "--size=9x9x9",
                            "--size=16385x9",
                            "--size=1.5x2",
                            "--camera=7",
                            "--camera=none",
                            "--camera=1,2,3",
                            "--camera=1,2,3:1,2,3",
                            "--camera=1,2,3:0,0,0:0",
                            "--camera=1,2,3:0,0,0:200",
                            "--camera=1,2,nan:0,0,0",
                            "--camera=orbit:1",
                            "--camera=orbit:1,95",
                            "--camera=orbit:1,2,-3",
                            "--camera=orbit:x,2",
                            "--samples=0",
                            "--samples=x",
                            "--show=all",
                            "--sampler=best",
                            "--exposure=x",
                            "--exposure=99",
                            "--tone-map=aces",
                            "--reference=-1"})
        expect_error(std::string("\"$ROOM\" v.vdb -o a.png ") + bad, cmd::ExitCode::usage, "");
    EXPECT_FALSE(std::filesystem::exists(folder_ / "a.png"));
}

TEST_F(RenderCli, AirAttenuatesAndScatters) {
    const std::string picture = "\"$ROOM\" v.vdb --size 16x12 --samples 5 ",
                      indirect = picture + "--show indirect ";
    EXPECT_TRUE(run_json(indirect + "-o clear.exr")["medium"].is_null());
    run_json(indirect + "-o thin.exr --medium absorb=1e-7");
    // Seen from outside, a thick box of it is black, or where it absorbs nothing shows the field.
    const std::string box = "--medium-bounds -9,-9,-9,9,9,3 ";
    run_json(indirect + box + "-o black.exr --medium absorb=90");
    const json thick = run_json(indirect + box + "-o thick.exr --medium scatter=200/200/100,g=0.3");
    EXPECT_EQ(thick["medium"]["scatter"], json({200, 200, 100}));
    EXPECT_EQ(thick["medium"]["method"], "exact");
    const image::Pixels clear = exr("clear.exr"), thin = exr("thin.exr"), black = exr("black.exr"),
                        full = exr("thick.exr");
    for (std::size_t i = 0; i < clear.samples.size(); ++i) {
        EXPECT_NEAR(thin.samples[i], clear.samples[i], 1e-5f * clear.samples[i]);
        EXPECT_LT(black.samples[i], 1e-12f);
        EXPECT_NEAR(full.samples[i], 10.0f, 1e-3f);
    }
    // What programs do comes near it with many steps.
    run_json(picture + "-o exact.exr --medium scatter=0.1,absorb=0.05,g=0.2");
    run_json(picture
             + "-o march.exr --medium scatter=0.1,absorb=0.05,g=0.2 "
               "--fog-method march:200");
    const image::Pixels exact = exr("exact.exr"), march = exr("march.exr");
    double difference = 0, sum = 0;
    for (std::size_t i = 0; i < exact.samples.size(); ++i) {
        difference += std::abs(double(exact.samples[i]) - double(march.samples[i]));
        sum += double(march.samples[i]);
    }
    EXPECT_LT(difference, 0.01 * sum);
    expect_error(picture + "-o a.png --medium scatter=-1", cmd::ExitCode::usage, "share a metre");
    expect_error(picture + "-o a.png --medium g=1,scatter=1", cmd::ExitCode::usage, "'g=1'");
    expect_error(picture + "-o a.png --medium fog=1", cmd::ExitCode::usage, "'fog=1'");
    expect_error(picture + "-o a.png --medium g=0.5", cmd::ExitCode::usage, "neither scatters");
    EXPECT_GT(run_json(picture + "-o a.exr --medium scatter=1 --reference 2")["reference"]["rays"],
              16 * 12 * 2);
    // Of all air of a density grid there is none outside of it, as above a height.
    EXPECT_EQ(run_json(picture + "-o a.exr --medium scatter=0.1,height=1:0.5")["medium"]["height"],
              json({1, 0.5}));
    run_lpvbake(folder_, "convert v.vdb smoke.vdb --sh-order 0");
    const json smoke =
        run_json(picture + "-o a.exr --medium scatter=0.1 --medium-density smoke.vdb:validity");
    EXPECT_EQ(smoke["medium"]["density"], "smoke.vdb:validity");
    expect_error(picture + "-o a.exr --medium scatter=1 --medium-density smoke.vdb:sh_l0",
                 cmd::ExitCode::unsupported, "grid \"sh_l0\" holds vec3s, not float");
    expect_error(picture + "-o a.exr --medium scatter=1,height=1", cmd::ExitCode::usage,
                 "no height H0:H");
    expect_error(picture + "-o a.exr --medium scatter=1,height=9999:1", cmd::ExitCode::invalid,
                 "of light a metre");
    expect_error(picture + "-o a.png --fog-method march:4", cmd::ExitCode::usage, "--medium");
}

TEST_F(RenderCli, AFieldInAirIsShownInIt) {
    const CliResult baked =
        run_lpvbake(folder_, "bake \"$ROOM\" -o air.vdb --resolution 8 --medium scatter=0.05,"
                             "absorb=0.1 --scattering 2 --bounces 1");
    ASSERT_EQ(baked.status, 0) << baked.err;
    EXPECT_NE(baked.out.find("\nscattering"), std::string::npos) << baked.out;
    const std::string picture = "\"$ROOM\" air.vdb --size 16x12 --samples 2 --point 0,1,1,50 ";
    const CliResult clear = run(picture + "-o clear.exr");
    EXPECT_NE(clear.err.find("--medium"), std::string::npos) << clear.err;
    const CliResult dim = run(picture + "-o dim.exr --show direct --medium absorb=1");
    EXPECT_EQ(dim.status, 0) << dim.err;
    EXPECT_NE(dim.err.find("another medium, --medium scatter=0.05/"), std::string::npos) << dim.err;
    const CliResult same = run(picture + "-o a.exr --medium scatter=0.05,absorb=0.1");
    EXPECT_EQ(same.err.find("another medium"), std::string::npos) << same.err;
    EXPECT_NE(run(picture + "-o a.exr --medium scatter=1 --medium-bounds 50,0,0,51,1,1")
                  .err.find("beside the scene"),
              std::string::npos);
    run(picture + "-o bright.exr --show direct --medium absorb=1e-7");
    const image::Pixels less = exr("dim.exr"), more = exr("bright.exr");
    double left = 0, sum = 0;
    for (std::size_t i = 0; i < less.samples.size(); ++i) {
        left += double(less.samples[i]);
        sum += double(more.samples[i]);
    }
    EXPECT_GT(left, 0);
    EXPECT_LT(left, 0.5 * sum);
    expect_error(picture + "-o a.exr --reference 2", cmd::ExitCode::unsupported, "--scattering");
}

TEST_F(RenderCli, VolumeLightTellsHowFarItIsFromExact) {
    const std::string picture = "\"$ROOM\" v.vdb -o a.exr --size 48x36 --samples 1 --sun 30,50,1e5 "
                                "--medium scatter=0.2,g=0.2 ";
    const CliResult plain = run(picture);
    EXPECT_EQ(plain.err.find("light in air"), std::string::npos) << plain.err;
    EXPECT_TRUE(run_json(picture)["medium"]["beside_exact"].is_null());
    const image::Pixels exact = exr("a.exr");
    const json told = run_json(picture + "--fog-method nvidia");
    EXPECT_EQ(told["medium"]["method"], "nvidia");
    const json beside = told["medium"]["beside_exact"];
    const image::Pixels drawn = exr("a.exr");
    double difference = 0, sum = 0, all = 0;
    for (std::size_t i = 0; i < exact.samples.size(); ++i) {
        difference += std::abs(double(exact.samples[i]) - double(drawn.samples[i]));
        sum += double(exact.samples[i]);
        all += double(drawn.samples[i]);
    }
    EXPECT_GT(difference, 0);
    EXPECT_NEAR(beside["l1"], difference / sum, 1e-9);
    EXPECT_NEAR(beside["energy"], all / sum, 0.05); // that is of luminance
    EXPECT_GT(beside["flip"], 0);
    EXPECT_GT(beside["steps"], 12 * 9);
    EXPECT_GT(beside["long_steps"], 0);
    EXPECT_LT(beside["long_steps"], beside["steps"]);
    // No physics: light behind holes that are filled.
    const json boosted = run_json(picture + "--fog-method nvidia:40");
    EXPECT_EQ(boosted["medium"]["method"], "nvidia:40");
    EXPECT_GE(boosted["mean_luminance"], told["mean_luminance"]);
    // The room's lamp is shown all the same, and that is told.
    const CliResult text = run(picture + "--fog-method nvidia");
    EXPECT_NE(text.out.find("beside exact  energy "), std::string::npos) << text.out;
    EXPECT_NE(text.err.find("1 point or spot light in air shown as by exact"), std::string::npos)
        << text.err;
    expect_error(picture + "--fog-method nvidia:-1", cmd::ExitCode::usage, "-1");
    expect_error(picture + "--fog-method amd", cmd::ExitCode::usage,
                 "none of exact, march:N, nvidia and nvidia:BOOST");
}

TEST_F(RenderCli, TexelsOfMapsLightInsteadOfTheVolume) {
    const std::string picture =
        "\"$ROOM\" v.vdb -o a.exr --size 16x12 --samples 1 --point 0,1,0,50 ";
    EXPECT_TRUE(run_json(picture)["indirect"].is_null());
    const json told = run_json(
        picture + "--indirect rsm:8 --vpl-visibility ssdo:4,1,0.1 --compare rays")["indirect"];
    EXPECT_EQ(told["texels"], 8);
    EXPECT_EQ(told["visibility"], "ssdo:4,1,0.1");
    EXPECT_GT(told["compared"]["pairs"], 0);
    EXPECT_LE(told["compared"]["falsely_lit"], told["compared"]["hidden"]);
    EXPECT_TRUE(run_json(picture + "--indirect rsm:8 --vpl-visibility none")["indirect"]["compared"]
                    .is_null());
    const json rays = run_json(picture + "--indirect rsm:8 --compare rays")["indirect"]["compared"];
    EXPECT_EQ(rays["falsely_lit"], 0);
    EXPECT_EQ(rays["energy"], 1);
    EXPECT_EQ(rays["flip"], 0);
    expect_error(picture + "--indirect rsm", cmd::ExitCode::usage, "neither volume nor rsm:N");
    expect_error(picture + "--indirect rsm:8 --vpl-visibility ssdo:4,1", cmd::ExitCode::usage,
                 "ssdo:SAMPLES,RADIUS,THICKNESS");
    expect_error(picture + "--vpl-visibility none", cmd::ExitCode::usage, "--indirect");
    expect_error(picture + "--indirect volume --compare rays", cmd::ExitCode::usage,
                 "--compare needs --indirect");
}

} // namespace
} // namespace lpvbake
