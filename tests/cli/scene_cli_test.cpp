// What options say of a scene's lights and nodes, by their names, from outside.
//
// LPVBAKE_BINARY is the program's path, LPVBAKE_EXAMPLES the folder of examples/.

#include "cli/run.h"
#include "exit_code.h"
#include "io/io.h"
#include "volume/compare.h"

#include <nlohmann/json.hpp>

namespace lpvbake {
namespace {

using nlohmann::json;

class SceneCli : public ::testing::Test {
protected:
    void SetUp() override {
        if (run_lpvbake(folder_, "devices").status == int(cmd::ExitCode::device))
            GTEST_SKIP() << "no Vulkan device";
    }

    CliResult run(const std::string& arguments) {
        CliResult result = run_lpvbake(folder_, arguments);
        EXPECT_EQ(result.status, 0) << arguments << "\n" << result.err;
        return result;
    }

    json run_json(const std::string& arguments) {
        return json::parse(run(arguments + " --format json").out);
    }

    Volume bake(const std::string& arguments) {
        run("bake -o a.vdb --resolution 6 --threads 1 " + arguments);
        return read_volume(folder_ / "a.vdb");
    }

    double energy_of(const std::string& arguments) { return volume::total_energy(bake(arguments)); }

    void expect_error(const std::string& arguments, cmd::ExitCode code, const std::string& text) {
        expect_one_error(run_lpvbake(folder_, arguments), arguments, code, text);
    }

    /// The box as a file of the tests' own.
    void spill_room(const char* name, const auto& change) {
        json room = json::parse(slurp(LPVBAKE_EXAMPLES "/cornell_box.gltf"));
        change(room);
        spill(folder_ / name, room.dump());
    }

    TemporaryFolder folder_;
};

TEST_F(SceneCli, SurfacesHaveRolesByPatterns) {
    // Of a room without its boxes no bake knows whether they are not loaded or not there.
    spill_room("bare.gltf", [](json& room) {
        for (json& node : room["nodes"])
            if (node.value("name", "").ends_with("box"))
                node.erase("mesh");
    });
    const Volume bare = bake("bare.gltf"), excluded = bake("\"$ROOM\" --exclude '*box'");
    EXPECT_EQ(excluded.sh, bare.sh);
    const std::string box = " --bounds -1,0,-1,1,2,1";
    EXPECT_EQ(bake("\"$ROOM\" --receive-only 'tall box' --exclude mesh:box" + box).sh,
              bake("bare.gltf" + box).sh);
    EXPECT_EQ(bake("\"$ROOM\" --receive-only mesh:box" + box).sh, bake("bare.gltf" + box).sh);
    EXPECT_NE(bake("\"$ROOM\" --cast-only mesh:box" + box).sh, bake("bare.gltf" + box).sh);
    EXPECT_NE(bake("\"$ROOM\" --cast-only mesh:box" + box).sh, bake("\"$ROOM\"" + box).sh);

    const json info = run_json("info \"$ROOM\" --receive-only mesh:box --lights-only 'lamp*'");
    EXPECT_EQ(info["roles"], json::parse(R"([
        {"role": "receive-only", "placed": 2, "triangles": 24, "meshes": ["box"]},
        {"role": "lights-only", "placed": 1, "triangles": 2, "meshes": ["lamp"]}])"));
    EXPECT_NE(run("info \"$ROOM\" --cast-only 'short*'").out.find("cast-only: 1 placed mesh, 12"),
              std::string::npos);

    const CliResult told = run("bake \"$ROOM\" -o a.vdb --resolution 6 --exclude Door "
                               "--cast-only extras:gone --no-light bulb");
    EXPECT_NE(told.err.find("--exclude: \"Door\" fits no"), std::string::npos) << told.err;
    EXPECT_NE(told.err.find("--cast-only: \"extras:gone\" fits no"), std::string::npos) << told.err;
    EXPECT_NE(read_volume(folder_ / "a.vdb").metadata.at("settings").find("Door"),
              std::string::npos);
    expect_error("bake \"$ROOM\" -o a.vdb --strict --exclude Door", cmd::ExitCode::invalid, "Door");
    expect_error("bake \"$ROOM\" -o a.vdb --exclude '*'", cmd::ExitCode::invalid, "no triangles");

    // Whoever measures takes them from the volume.
    run("bake \"$ROOM\" -o b.vdb --resolution 12 --lights-only 'lamp*' --exclude 'tall*'");
    EXPECT_LT(run_json("verify b.vdb \"$ROOM\" --points 64")["verified"]["cells"]["error"], 0.12);
    EXPECT_EQ(run("verify b.vdb \"$ROOM\" --points 8").err.find("another scene"),
              std::string::npos);
    run("render \"$ROOM\" b.vdb -o b.png --size 16x16 --samples 1 --reference 1");
    const CliResult report =
        run_lpvbake(folder_, "report \"$ROOM\" -o r.json --resolution 6 --lights-only 'lamp*' -q");
    EXPECT_EQ(report.status, int(cmd::ExitCode::unsupported));
    EXPECT_NE(report.err.find("--no-peer"), std::string::npos) << report.err;
}

TEST_F(SceneCli, BoxesAdjustWhatIsBaked) {
    spill(folder_ / "boxes.json", R"({"boxes": [
        {"box": [-1, 0, -1, 1, 1, 1], "set": "invalid"},
        {"box": [-1, 1, -1, 1, 2, 1], "set": "valid", "intensity": 2}]})");
    spill(folder_ / "valid.json", R"({"boxes": [
        {"box": [-1, 0, -1, 1, 1, 1], "set": "invalid"},
        {"box": [-1, 1, -1, 1, 2, 1], "set": "valid"}]})");
    const std::string box = "\"$ROOM\" --bounds -1,0,-1,1,2,1";
    const Volume plain = bake(box + " --adjust valid.json");
    const Volume adjusted = bake(box + " --adjust boxes.json");
    for (std::size_t i = 0; i < plain.grid.size(); ++i) {
        const bool low = plain.grid.cell_at(i).y < 3;
        EXPECT_EQ(adjusted.validity[i], low ? 0.0f : 1.0f);
        if (!low) {
            EXPECT_EQ(adjusted.sh[0][i], 2.0f * plain.sh[0][i]);
        }
    }
    EXPECT_EQ(adjusted.metadata.at("adjust"),
              "-1,0,-1,1,1,1 invalid; -1,1,-1,1,2,1 valid intensity 2");
    const auto refused = [&](const char* text, const char* part,
                             cmd::ExitCode code = cmd::ExitCode::invalid) {
        spill(folder_ / "bad.json", text);
        expect_error("bake \"$ROOM\" -o a.vdb --resolution 6 --adjust bad.json", code, part);
    };
    refused("[]", "bad.json: is not JSON of the form");
    refused(R"({"boxes": []})", "has no box");
    refused(R"({"boxes": [{"box": [0, 0, 0, 1, 1], "set": "valid"}]})", "boxes[0].box: must be");
    refused(R"({"boxes": [{"box": [2, 0, 0, 1, 1, 1], "set": "valid"}]})",
            "boxes[0].box: is inside");
    refused(R"({"boxes": [{"box": [0, 0, 0, 1, 1, 1]}]})", "boxes[0]: adjusts nothing");
    refused(R"({"boxes": [{"box": [0, 0, 0, 1, 1, 1], "intensity": -1}]})", "boxes[0].intensity");
    refused(R"({"boxes": [{"box": [0, 0, 0, 1, 1, 1], "brighter": 1}]})", "\"brighter\"");
    refused(R"({"boxes": [{"box": [0, 0, 0, 1, 1, 1], "set": "finer"}]})", "\"finer\" is of",
            cmd::ExitCode::unsupported);
    refused(R"({"boxes": [{"box": [0, 0, 0, 1, 1, 1], "set": "fine"}]})", "\"finer\" or");
    expect_error("bake \"$ROOM\" -o a.vdb --adjust gone.json", cmd::ExitCode::file, "gone.json");
    expect_error("bake \"$ROOM\" -o a.vdb --adjust a.vdb", cmd::ExitCode::usage, "replace");
}

TEST_F(SceneCli, LightsThatInfoPrintsAreAFileOfLights) {
    spill_room("room.gltf", [](json& room) {
        json& lights = room["extensions"]["KHR_lights_punctual"]["lights"];
        lights.push_back({{"type", "spot"},
                          {"intensity", 20.1},
                          {"color", {0.3, 0.7, 0.1}},
                          {"range", 3.3},
                          {"spot", {{"innerConeAngle", 0.1}, {"outerConeAngle", 0.7}}}});
        lights.push_back({{"type", "directional"}, {"intensity", 5}});
        for (const int light : {1, 2}) {
            room["scenes"][0]["nodes"].push_back(room["nodes"].size());
            room["nodes"].push_back(
                {{"name", "turned"},
                 {"translation", {0.1, 1.3, 0.2}},
                 {"rotation", {0.2, 0.4, 0.1, 0.8888194417315589}},
                 {"extensions", {{"KHR_lights_punctual", {{"light", light}}}}}});
        }
    });
    const json document = run_json("info room.gltf --hash");
    ASSERT_EQ(document["lights"].size(), 3u);
    EXPECT_EQ(document["lights"][0]["name"], "bulb");
    EXPECT_EQ(document["lights"][1]["name"], "turned"); // its node's
    EXPECT_EQ(document["lights"][2]["unit"], "lux");
    spill(folder_ / "lights.json", document.dump());
    const Volume own = bake("room.gltf");
    EXPECT_EQ(own.metadata.at("scene_hash"), document["scene_hash"]);
    const Volume given = bake("room.gltf --no-scene-lights --lights lights.json");
    EXPECT_EQ(given.sh, own.sh);

    json wrong = document;
    wrong["lights"][0]["unit"] = "lux";
    spill(folder_ / "wrong.json", wrong.dump());
    expect_error("bake room.gltf -o b.vdb --lights wrong.json", cmd::ExitCode::invalid,
                 "wrong.json: lights[0].unit: must be \"candela\"");
}

TEST_F(SceneCli, LightsAreScaledAndLeftOutByName) {
    const std::string room = "\"$ROOM\" --bounces 1 --fit none ";
    const double all = energy_of(room), bulb = energy_of(room + "--no-emitters"),
                 lamp = energy_of(room + "--no-scene-lights");
    EXPECT_GT(bulb, 0.05 * all);
    EXPECT_GT(lamp, 0.05 * all);
    EXPECT_NEAR(energy_of(room + "--no-light 'bu*'"), lamp, 1e-6 * all);
    EXPECT_NEAR(energy_of(room + "--no-light lamp"), bulb, 0.02 * all);
    EXPECT_NEAR(energy_of(room + "--no-emitters --light-scale bulb=3"), 3 * bulb, 1e-3 * all);
    EXPECT_NEAR(energy_of(room + "--light-scale '*=0.5'"), 0.5 * all, 1e-3 * all);
    expect_error("bake \"$ROOM\" -o b.vdb --no-light 'Bulb*'", cmd::ExitCode::usage,
                 "of the name 'Bulb*'; there are 'bulb', 'lamp'");
    expect_error("bake \"$ROOM\" -o b.vdb --light-scale bulb", cmd::ExitCode::usage,
                 "'bulb' is not NAMES=X");
    expect_error("bake \"$ROOM\" -o b.vdb --light-scale bulb=-1", cmd::ExitCode::usage, "-1");
}

TEST_F(SceneCli, BoundsGoByTheNamesOfNodes) {
    spill_room("room.gltf", [](json& room) { // both boxes below a node that has no mesh
        room["scenes"][0]["nodes"] = {0, 3, 4, room["nodes"].size()};
        room["nodes"].push_back({{"name", "boxes"}, {"children", {1, 2}}});
    });
    const json info = run_json("info room.gltf");
    std::map<std::string, json> boxes;
    for (const json& node : info["nodes"])
        boxes[node["name"]] = node["bounds"];
    ASSERT_EQ(boxes.size(), 5u) << info["nodes"];
    EXPECT_NEAR(boxes["short box"]["lo"][0].get<double>(), 0.05, 1e-6);
    EXPECT_NEAR(boxes["short box"]["hi"][1].get<double>(), 0.6, 1e-6);
    EXPECT_EQ(boxes["boxes"]["lo"][0], boxes["tall box"]["lo"][0]);
    EXPECT_EQ(boxes["boxes"]["hi"][0], boxes["short box"]["hi"][0]);
    EXPECT_NE(run("info room.gltf").out.find("  tall box\n"), std::string::npos);

    const auto grid_of = [&](const std::string& bounds) {
        return run_json("bake room.gltf -o a.vdb --dry-run --resolution 8 " + bounds)["grid"];
    };
    std::string numbers;
    for (const char* end : {"lo", "hi"})
        for (const json& number : boxes["boxes"][end])
            numbers.append(numbers.empty() ? "" : ",").append(number.dump());
    EXPECT_EQ(grid_of("--bounds boxes"), grid_of("--bounds=" + numbers));
    EXPECT_EQ(grid_of("--bounds '* box'"), grid_of("--bounds boxes"));
    EXPECT_NE(grid_of("--bounds 'tall*'"), grid_of("--bounds boxes"));
    EXPECT_EQ(run_json("report room.gltf --dry-run --resolution 8 --solver sn --bounds 'tall*'")
                  ["scenes"][0]["rows"][0]["dims"],
              grid_of("--bounds 'tall*'")["dims"]);
    expect_error("bake room.gltf -o a.vdb --bounds 'Tall*'", cmd::ExitCode::usage,
                 "--bounds: no node with surfaces of the name 'Tall*'; there are 'boxes'");
}

TEST_F(SceneCli, BoundsThatAreGivenAreTheGrids) {
    const auto cell_of = [&](const std::string& more) {
        return run_json("bake \"$ROOM\" -o a.vdb --dry-run --resolution 8 " + more)["grid"]["cell"];
    };
    EXPECT_EQ(cell_of("--bounds=-1,0,-1,1,2,1"), 0.25);
    EXPECT_EQ(cell_of("--bounds=-1,0,-1,1,2,1 --margin 1"), cell_of(""));
    EXPECT_NEAR(cell_of("").get<double>(), 1.0 / 3, 1e-9);
    const std::string config = run("bake --bounds=-1,0,-1,1,2,1 --print-config").out;
    EXPECT_NE(config.find("\n#margin = 0\n"), std::string::npos) << config;
}

TEST_F(SceneCli, ASceneWithoutLightHasOneByDefaultWhereItIsAsked) {
    const std::string dark = "\"$ROOM\" --no-scene-lights --no-emitters ";
    expect_error("bake -o a.vdb " + dark, cmd::ExitCode::invalid,
                 "no light and no emissive surface; add --default-light or light with --sun");
    const CliResult lit = run("bake -o a.vdb --resolution 6 --default-light " + dark);
    EXPECT_NE(lit.err.find("warning: "), std::string::npos);
    EXPECT_NE(
        lit.err.find("cornell_box.gltf: gives no light: it is lit by a white sky of 1000 nits"),
        std::string::npos)
        << lit.err;
    const Volume volume = read_volume(folder_ / "a.vdb");
    EXPECT_EQ(volume.metadata.at("default_light"), "a white sky of 1000 nits");
    EXPECT_EQ(bake(dark + "--sky '#ffffff,1000'").sh, volume.sh);
    const Volume own = bake("\"$ROOM\" --default-light");
    EXPECT_EQ(own.metadata.count("default_light"), 0u);
    EXPECT_EQ(own.sh, bake("\"$ROOM\"").sh);
}

TEST_F(SceneCli, SaysWhatWasMixedUp) {
    const auto usage = cmd::ExitCode::usage;
    expect_error("bake out.vdb -o a.vdb", usage,
                 "out.vdb: is a volume; lpvbake bake takes a scene");
    expect_error("verify \"$ROOM\" v.vdb", usage,
                 "v.vdb: scene and volume are the other way round: lpvbake verify VOLUME SCENE");
    expect_error("render v.vdb \"$ROOM\" -o a.png", usage,
                 "v.vdb: scene and volume are the other way round: lpvbake render SCENE VOLUME");
    expect_error("verify", usage, "no volume: lpvbake verify VOLUME SCENE");
    EXPECT_NE(run("verify --print-config").out.find("[verify]"), std::string::npos);
    expect_error("info none", cmd::ExitCode::file, "none: No such file or directory");
    expect_error("inof v.vdb", usage, "did you mean info?");
    expect_error("render \"$ROOM\" v.vdb -o a.png --camera 0,2,-3", usage,
                 "it would be 0,2,-3:TX,TY,TZ");
    expect_error("bake \"$ROOM\" -o a.vdb --cell-size 10cm", usage,
                 "'10cm' is no number of metres, such as 0.25");
    spill(folder_ / "p.csv", "\xEF\xBB\xBFx,y,z\n0,1,0\n");
    run("bake \"$ROOM\" --at p.csv -o p.json --dry-run");
    spill(folder_ / "p.csv", "0;1;0\n");
    expect_error("bake \"$ROOM\" --at p.csv -o p.json", cmd::ExitCode::invalid,
                 "separated by commas");
}

TEST_F(SceneCli, DirectLightIsKeptBesideTheField) {
    const std::string box = LPVBAKE_EXAMPLES "/cornell_box.gltf --no-scene-lights "
                                             "--sun 20,40,1000 --point 0,1,0,5 ";
    run("bake " + box
        + "-o a.vdb -o a.exr -o a.nvdb -o a.ktx2 --precision float --resolution 6 "
          "--direct visibility,sh --beams 2 --sun-angle 0.53");
    const json info = run_json("info a.vdb");
    std::vector<std::string> names;
    for (const json& grid : info["grids"])
        names.push_back(grid["name"]);
    for (const char* name : {"visibility_0", "visibility_1", "direct_l0", "direct_l2_x2y2"})
        EXPECT_TRUE(std::ranges::count(names, name)) << name;
    for (const char* other : {"a.exr", "a.nvdb", "a.ktx2"})
        run(std::string("diff a.vdb ") + other);
    // Axes turn it, conventions do not touch it.
    run("convert a.vdb other.vdb --axes blender --sh-convention irradiance");
    const Volume a = read_volume(folder_ / "a.vdb"), b = read_volume(folder_ / "other.vdb");
    ASSERT_EQ(b.others.size(), 2u);
    for (std::size_t kind = 0; kind < 2; ++kind)
        for (std::size_t k = 0; k < a.others[kind].grids.size(); ++k)
            for (std::size_t i = 0; i < a.others[kind].grids[k].size(); ++i)
                EXPECT_NEAR(a.others[kind].grids[k][i], b.others[kind].grids[k][i], 1e-3);
    EXPECT_GT(std::abs(a.others[0].grids[1][3 * 100]), 1.0f);
    // Four lights in a texture, by bytes.
    run("bake " + box + "-o c.vdb --resolution 6 --direct channels");
    run("bake " + box + "-o c.ktx2 -o c.dds --precision unorm8 --resolution 6 --direct channels");
    const Volume exact = read_volume(folder_ / "c.vdb");
    EXPECT_EQ(exact.metadata.at("shadow_channels"), R"([["sun"],["point"],[],[]])");
    for (const char* file : {"c.ktx2", "c.dds"}) {
        const Volume bytes = read_volume(folder_ / file);
        ASSERT_EQ(bytes.others.size(), 1u);
        for (std::size_t k = 0; k < 4; ++k)
            for (std::size_t i = 0; i < exact.grid.size(); ++i)
                EXPECT_NEAR(bytes.others[0].grids[k][i], exact.others[0].grids[k][i],
                            0.5 / 255 + 1e-6);
    }
    EXPECT_EQ(std::filesystem::file_size(folder_ / "c_shadow.dds"), 148 + 4 * exact.grid.size());
    expect_error("bake " + box + "-o a.vdb --direct shadows", cmd::ExitCode::usage,
                 "is none of visibility, channels, shaft and sh");
    run("bake " + box + "-o d.vdb --resolution 6 --direct shaft --shaft-closing 0.3");
    EXPECT_EQ(read_volume(folder_ / "d.vdb").metadata.at("shaft_closing"), "0.3");
    EXPECT_EQ(run_json("info d.vdb")["grids"].back()["name"], "shaft");
    expect_error("bake " + box + "-o a.vdb --direct sh --shaft-closing 2", cmd::ExitCode::usage,
                 "--shaft-closing is of --direct shaft");
    expect_error("bake " + box + "-o a.vdb --sun-angle 1", cmd::ExitCode::usage, "--direct");
    expect_error("bake " + box + "-o a.vdb --direct sh --adaptive 0.1..0.2", cmd::ExitCode::usage,
                 "--adaptive");
}

TEST_F(SceneCli, LampsHaveASize) {
    const std::string box = LPVBAKE_EXAMPLES "/cornell_box.gltf --no-scene-lights --resolution 8 "
                                             "--point 0.3,1.6,0.3,5 --sun 20,40,1000 --bounces 0 ";
    const std::string direct = "--direct visibility ";
    const auto bake = [&](const std::string& options, const std::string& file) {
        const std::string text = run("bake " + box + direct + options + " -o " + file).err;
        return std::pair(read_volume(folder_ / file), text);
    };
    const auto [point, quiet] = bake("", "point.vdb");
    const auto [none, still] = bake("--lamp-radius 0", "none.vdb");
    const auto [large, told] = bake("--lamp-radius 'po*=0.2'", "large.vdb");
    const auto [huge, warned] = bake("--lamp-radius 0.2 --lamp-radius point=1.5", "huge.vdb");
    EXPECT_EQ(point.others[0].grids, none.others[0].grids);
    EXPECT_EQ(point.sh, large.sh);
    // The sun stays as it is.
    const std::size_t lamp =
        point.metadata.at("visibility").find("point") < point.metadata.at("visibility").find("sun")
            ? 0
            : 1;
    EXPECT_NE(point.others[0].grids[lamp], large.others[0].grids[lamp]);
    EXPECT_EQ(point.others[0].grids[1 - lamp], large.others[0].grids[1 - lamp]);
    EXPECT_EQ(told.find("surfaces stand inside"), told.npos);
    EXPECT_NE(warned.find("surfaces stand inside of the light \"point\", a sphere of 1.5 m"),
              warned.npos);
    expect_error("bake " + box + "-o a.vdb --lamp-radius 0.1", cmd::ExitCode::usage, "--direct");
    for (const char* what : {"--direct sh", "--medium scatter=0.1"})
        expect_error("bake " + box + what + " -o a.vdb --lamp-radius 1e9 --dry-run",
                     cmd::ExitCode::usage,
                     "--lamp-radius: the light \"point\" would be a sphere of 1e+09 m");
    expect_error("bake " + box + direct + "-o a.vdb --lamp-radius =1", cmd::ExitCode::usage,
                 "NAMES=METRES");
    expect_error("bake " + box + direct + "-o a.vdb --lamp-radius -1", cmd::ExitCode::usage, "-1");
    expect_error("bake " + box + direct + "-o a.vdb --lamp-radius sun=1", cmd::ExitCode::usage,
                 "--lamp-radius: no point or spot light of the name 'sun'; there are 'point'");
}

TEST_F(SceneCli, LightsThatAreStaticAreInTheFieldAndLitOnce) {
    spill(folder_ / "lights.json", json{{"lights",
                                         {{{"type", "point"},
                                           {"name", "Lamp 1"},
                                           {"intensity", 60},
                                           {"position", {0, 1.6, 0.3}}}}}}
                                       .dump());
    const std::string box = LPVBAKE_EXAMPLES "/cornell_box.gltf --no-scene-lights "
                                             "--lights lights.json ";
    run("bake " + box + "-o fixed.vdb --resolution 16 --static 'Lamp*' --beams 2");
    run("bake " + box + "-o plain.vdb --resolution 16");
    EXPECT_EQ(read_volume(folder_ / "fixed.vdb").metadata.at("static_lights"), "[\"Lamp 1\"]");
    // Of the picture as a whole: what is read of cells and what rays find at surfaces.
    const auto mean = [&](const std::string& volume, const std::string& show) {
        return run_json("render " + box + volume + " -o a.png --size 48x48 --samples 1 --show "
                        + show)["mean_luminance"]
            .get<double>();
    };
    EXPECT_NEAR(mean("fixed.vdb", "final"), mean("plain.vdb", "final"),
                0.15 * mean("plain.vdb", "final"));
    EXPECT_GT(mean("fixed.vdb", "indirect"), 1.3 * mean("plain.vdb", "indirect"));
    EXPECT_LT(mean("fixed.vdb", "direct"), 0.6 * mean("plain.vdb", "direct")); // it glows, too
    // What measures it takes them from it.
    run("reference -o truth.vdb --like fixed.vdb --rays 64 " LPVBAKE_EXAMPLES "/cornell_box.gltf");
    EXPECT_EQ(read_volume(folder_ / "truth.vdb").metadata.at("static_lights"), "[\"Lamp 1\"]");
    const json verified =
        run_json("verify fixed.vdb " LPVBAKE_EXAMPLES "/cornell_box.gltf --points 64");
    EXPECT_LT(verified["verified"]["cells"]["error"], 0.2);
    expect_error("bake " + box + "-o a.vdb --static Sun", cmd::ExitCode::usage,
                 "--static: no light of the name 'Sun'; there are 'Lamp 1'");
    expect_error("bake " + box + "-o a.vdb --static '*' --adaptive 0.1..0.2", cmd::ExitCode::usage,
                 "not of --at, --adaptive");
}

} // namespace
} // namespace lpvbake
