// `lpvbake bake --layers` and `lpvbake mix` from outside.
#include "cli/run.h"
#include "io/layers.h"
#include "scene/sun_arc.h"
#include "volume/compare.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>

#include <array>
#include <cmath>
#include <numbers>
#include <random>

namespace lpvbake {
namespace {

using cmd::ExitCode;
using nlohmann::json;

class LayersCli : public ::testing::Test {
protected:
    CliResult run(const std::string& arguments) { return run_lpvbake(folder_, arguments); }
    CliResult bake(const std::string& arguments) {
        return run("bake \"$ROOM\" --resolution 16 --quality fast --solver gather -q " + arguments);
    }
    bool exists(const std::string& name) const { return std::filesystem::exists(folder_ / name); }

    TemporaryFolder folder_;
};

/// Largest difference of a coefficient, of the largest in its cell.
double difference(const Volume& a, const Volume& b) {
    double most = 0.0;
    EXPECT_EQ(a.sh.size(), b.sh.size());
    for (std::size_t cell = 0; cell < a.grid.size(); ++cell) {
        double off = 0.0, largest = 0.0;
        for (std::size_t k = 0; k < a.sh.size(); ++k)
            for (int c = 0; c < 3; ++c) {
                off = std::max(off, std::abs(double(a.sh[k][cell][c]) - double(b.sh[k][cell][c])));
                largest = std::max(largest, std::abs(double(b.sh[k][cell][c])));
            }
        if (largest > 0.0)
            most = std::max(most, off / largest);
    }
    return most;
}

TEST_F(LayersCli, AreVolumesBesideThatOfAllLight) {
    ASSERT_EQ(bake("-o plain.vdb").status, 0);
    const CliResult baked = bake("-o a.vdb --layers lights,emitters --format json");
    ASSERT_EQ(baked.status, 0) << baked.err;
    const json manifest = json::parse(slurp(folder_ / "a.layers.json"));
    EXPECT_EQ(manifest["file"], "a.vdb");
    ASSERT_EQ(manifest["layers"].size(), 2u);
    EXPECT_EQ(manifest["layers"][0]["name"], "bulb");
    EXPECT_EQ(manifest["layers"][0]["kind"], "light");
    EXPECT_EQ(manifest["layers"][0]["file"], "a_layer_bulb.vdb");
    EXPECT_EQ(manifest["layers"][1]["kind"], "emitter");
    EXPECT_EQ(manifest["layers"][0]["lights"], json({0}));
    EXPECT_EQ(manifest["layers"][0]["emitters"], json::array());
    EXPECT_EQ(manifest["layers"][1]["lights"], json::array());
    EXPECT_EQ(manifest["layers"][1]["emitters"], json({"lamp"}));
    EXPECT_EQ(manifest["layers"][1]["sky"], false);
    const Volume plain = read_volume(folder_ / "plain.vdb"), all = read_volume(folder_ / "a.vdb");
    EXPECT_EQ(all.sh, plain.sh);
    EXPECT_EQ(all.walls, plain.walls);
    EXPECT_EQ(all.validity, plain.validity);
    const Volume bulb = read_volume(folder_ / "a_layer_bulb.vdb");
    EXPECT_EQ(bulb.walls, plain.walls);
    EXPECT_EQ(bulb.validity, plain.validity);
    EXPECT_EQ(bulb.metadata.at("layer"), "bulb");
    EXPECT_EQ(bulb.metadata.at("emitter_reflections"), "none");
    for (const json& layers : {json::parse(baked.out)["layers"],
                               json::parse(run("info a.vdb --format json").out)["layers"]}) {
        ASSERT_EQ(layers.size(), 2u);
        EXPECT_EQ(layers[0]["name"], "bulb");
        EXPECT_EQ(layers[0]["unit"], "scene");
        EXPECT_EQ(layers[0]["weight"], json({1, 1, 1}));
    }
    const json plan =
        json::parse(bake("-o a.vdb --layers lights,emitters --dry-run --format json").out);
    EXPECT_EQ(plan["outputs"][0]["files"].size(), 4u);
    EXPECT_GT(
        plan["host_bytes"].get<double>(),
        json::parse(bake("-o a.vdb --dry-run --format json").out)["host_bytes"].get<double>());
}

TEST_F(LayersCli, MixIsWhatABakeOfTheMixtureIs) {
    ASSERT_EQ(bake("-o a.vdb --layers lights,emitters").status, 0);
    ASSERT_EQ(run("mix a.vdb -o same.vdb").status, 0);
    const Volume all = read_volume(folder_ / "a.vdb");
    EXPECT_LT(difference(read_volume(folder_ / "same.vdb"), all), 1e-5);

    // All lights alike: another bake decides the same.
    ASSERT_EQ(bake("-o half.vdb --light-scale '*=0.5'").status, 0);
    const std::string lamp = json::parse(slurp(folder_ / "a.layers.json"))["layers"][1]["name"];
    ASSERT_EQ(run("mix a.vdb bulb=0.5 " + lamp + "=0.5 -o mixed.exr --format json").status, 0);
    const Volume mixed = read_volume(folder_ / "mixed.json");
    EXPECT_LT(difference(mixed, read_volume(folder_ / "half.vdb")), 1e-5);
    EXPECT_EQ(mixed.metadata.at("mix"), "bulb=0.5 " + lamp + "=0.5");
    EXPECT_FALSE(mixed.metadata.contains("layers"));
    EXPECT_EQ(mixed.walls, all.walls);

    // One light off, one coloured: another bake chooses its own clusters.
    ASSERT_EQ(bake("-o off.vdb --no-light bulb").status, 0);
    ASSERT_EQ(run("mix a.layers.json bulb=0 " + lamp + "='#ff0000' -o red.vdb").status, 0);
    const Volume off = read_volume(folder_ / "off.vdb"), red = read_volume(folder_ / "red.vdb");
    double sum = 0.0, error = 0.0;
    for (std::size_t cell = 0; cell < off.grid.size(); ++cell) {
        EXPECT_EQ(red.sh[0][cell].y, 0.0f);
        sum += double(off.sh[0][cell].x);
        error += std::abs(double(red.sh[0][cell].x) - double(off.sh[0][cell].x));
    }
    EXPECT_LT(error, 0.05 * sum);
    EXPECT_GT(error, 1e-6 * sum);
    EXPECT_EQ(run("info red.vdb").status, 0);
    EXPECT_EQ(run("diff red.vdb off.vdb --format json").status, int(ExitCode::difference));
    EXPECT_EQ(run("render \"$ROOM\" red.vdb -o red.png --size 32x32 --samples 1 -q").status, 0);
}

TEST_F(LayersCli, ASkyIsExchanged) {
    ASSERT_EQ(bake("-o a.vdb --layers sky:2 --sky '#ffffff,20'").status, 0);
    const json manifest = json::parse(slurp(folder_ / "a.layers.json"));
    ASSERT_EQ(manifest["layers"].size(), 11u); // sky, nine modes, the rest
    EXPECT_EQ(manifest["layers"][10]["name"], "rest");
    EXPECT_EQ(manifest["layers"][1]["unit"], "nits");
    EXPECT_EQ(manifest["layers"][1]["weight"], json({0, 0, 0}));
    const Volume all = read_volume(folder_ / "a.vdb");
    ASSERT_EQ(run("mix a.vdb -o same.vdb").status, 0);
    EXPECT_LT(difference(read_volume(folder_ / "same.vdb"), all), 1e-5);
    // The same sky as a picture, by its modes: binary PFM, from the bottom.
    std::string picture = "PF\n8 4\n-1.0\n";
    const float luminance = 20.0f;
    for (int i = 0; i < 8 * 4 * 3; ++i)
        picture.append(reinterpret_cast<const char*>(&luminance), sizeof luminance);
    spill(folder_ / "white.pfm", picture);
    const CliResult mixed = run("mix a.vdb sky=white.pfm -o mixed.vdb");
    ASSERT_EQ(mixed.status, 0) << mixed.err;
    EXPECT_LT(difference(read_volume(folder_ / "mixed.vdb"), all), 1e-4);
    ASSERT_EQ(run("mix a.vdb sky=0 -o dark.vdb").status, 0);
    EXPECT_GT(difference(read_volume(folder_ / "dark.vdb"), all), 0.1);
}

/// A picture of a sky whose luminance is above 0 and has bands up to `order`: PFM, from the bottom.
std::string picture_of_bands(int order, uint32_t seed) {
    constexpr int width = 128, height = 64;
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    std::vector<glm::vec3> weights;
    for (int k = 0; k < volume::sh_count(order); ++k)
        weights.emplace_back(normal(random), normal(random), normal(random));
    std::vector<glm::vec3> texels;
    glm::vec3 least(0.0f);
    for (int row = height - 1; row >= 0; --row)
        for (int column = 0; column < width; ++column) {
            const double down = std::numbers::pi * (row + 0.5) / height,
                         turn = 2.0 * std::numbers::pi * (0.75 - (column + 0.5) / width);
            const volume::ShValues y =
                volume::sh_basis(order, glm::vec3(std::sin(down) * std::sin(turn), std::cos(down),
                                                  std::sin(down) * std::cos(turn)));
            glm::vec3 sum(0.0f);
            for (std::size_t k = 1; k < weights.size(); ++k)
                sum += y[k] * weights[k];
            texels.push_back(sum);
            least = glm::min(least, sum);
        }
    std::string picture = "PF\n128 64\n-1.0\n";
    for (glm::vec3& texel : texels) {
        texel = 20.0f * (texel - 1.1f * least);
        picture.append(reinterpret_cast<const char*>(&texel), sizeof texel);
    }
    return picture;
}

/// Sum of the differences of irradiance, of all irradiance, both up and down at each cell.
double relative(const Volume& a, const Volume& b) {
    double off = 0.0, all = 0.0;
    std::vector<float> of_a(a.sh.size()), of_b(b.sh.size());
    for (std::size_t cell = 0; cell < a.grid.size(); ++cell)
        for (int c = 0; c < 3; ++c)
            for (int axis = 0; axis < 6; ++axis) {
                glm::vec3 n(0.0f);
                n[axis / 2] = axis % 2 ? 1.0f : -1.0f;
                for (std::size_t k = 0; k < a.sh.size(); ++k) {
                    of_a[k] = a.sh[k][cell][c];
                    of_b[k] = b.sh[k][cell][c];
                }
                const double is = double(volume::sh_irradiance(of_b, n));
                off += std::abs(double(volume::sh_irradiance(of_a, n)) - is);
                all += std::abs(is);
            }
    return off / all;
}

TEST_F(LayersCli, AnySkyComesOfATransfer) {
    const std::string alone = " --no-scene-lights --no-emitters ";
    for (const int order : {1, 2}) {
        const std::string with = alone + "--sh-order " + std::to_string(order) + " --sky ";
        ASSERT_EQ(bake("-o t.vdb --layers transfer" + with + "'#ffffff,20'").status, 0);
        ASSERT_EQ(bake("-o plain.vdb" + with + "'#ffffff,20'").status, 0);
        const Volume plain = read_volume(folder_ / "plain.vdb");
        EXPECT_EQ(read_volume(folder_ / "t.vdb").sh, plain.sh);
        ASSERT_EQ(run("mix t.vdb sky='#ffffff,20' -o mixed.vdb").status, 0);
        EXPECT_LT(difference(read_volume(folder_ / "mixed.vdb"), plain), 1e-5);
        ASSERT_EQ(run("mix t.vdb sky='#ffffff,20' sky_visibility=0 -o bounce.vdb").status, 0);
        ASSERT_EQ(run("mix t.vdb sky=0 sky_visibility=20 -o seen.vdb").status, 0);
        for (uint32_t seed = 1; seed <= 3; ++seed) {
            // Of bands of which all is known. The bake decides by its own light.
            spill(folder_ / "sky.pfm", picture_of_bands(2, seed));
            ASSERT_EQ(run("mix t.vdb sky=sky.pfm -o mixed.vdb").status, 0);
            ASSERT_EQ(bake("-o baked.vdb" + with + "sky.pfm").status, 0);
            const Volume mixed = read_volume(folder_ / "mixed.vdb"),
                         baked = read_volume(folder_ / "baked.vdb");
            EXPECT_LT(relative(mixed, baked), 0.02) << order << " " << seed;
            for (const char* less : {"bounce.vdb", "seen.vdb"}) // neither part is nothing
                EXPECT_GT(relative(read_volume(folder_ / less), plain), 0.05) << less;
        }
    }
    const json manifest = json::parse(slurp(folder_ / "t.layers.json"));
    ASSERT_EQ(manifest["layers"].size(), 11u); // the sky, what is seen, and nine modes
    EXPECT_EQ(manifest["layers"][1]["name"], "sky_visibility");
    EXPECT_EQ(manifest["layers"][1]["kind"], "visibility");
    EXPECT_EQ(manifest["layers"][10]["name"], "sky_bounce_8");
    EXPECT_EQ(manifest["layers"][10]["kind"], "bounce");
    EXPECT_EQ(manifest["layers"][10]["weight"], json({0, 0, 0}));
    const Volume seen = read_volume(folder_ / "t_layer_sky_visibility.vdb"),
                 bounce = read_volume(folder_ / "t_layer_sky_bounce_0.vdb");
    EXPECT_EQ(seen.sh_order, 4);
    EXPECT_EQ(seen.metadata.at("sky_reflections"), "0..0");
    EXPECT_EQ(bounce.metadata.at("sky_reflections"), "1..inf");
    EXPECT_EQ(bounce.metadata.at("content"), "sky after one reflection and more");
    EXPECT_EQ(json::parse(bake("-o a.exr --layers transfer:0 --sky '#ffffff,20' --dry-run "
                               "--format json")
                              .out)["outputs"][0]["files"]
                  .size(),
              5u * 14u + 16u + 1u);
}

TEST_F(LayersCli, SkyOcclusionIsTheLightOfAWhiteSky) {
    ASSERT_EQ(bake("-o t.vdb --sky '#ff8000,20' --layers transfer:0").status, 0);
    ASSERT_EQ(run("mix t.vdb sky=0 --sky-occlusion -o unity.vdb").status, 0);
    ASSERT_EQ(run("mix t.vdb sky=0 -o dark.vdb").status, 0);
    ASSERT_EQ(run("mix t.vdb rest=0 sky=1:1:1,1 -o white.vdb").status, 0);
    const Volume unity = read_volume(folder_ / "unity.vdb"),
                 white = read_volume(folder_ / "white.vdb");
    EXPECT_EQ(unity.sh, read_volume(folder_ / "dark.vdb").sh);
    const auto numbers = volume::grids_of(unity, volume::sky_occlusion_kind());
    const auto direction = volume::grids_of(unity, volume::sky_direction_kind());
    ASSERT_EQ(numbers.size(), 4u);
    ASSERT_EQ(direction.size(), 1u);
    EXPECT_EQ(numbers[3].name(), "sky_occlusion_l1_x");
    double brightest = 0.0;
    for (std::size_t cell = 0; cell < white.grid.size(); ++cell) {
        std::array<float, 4> grey{};
        for (std::size_t k = 0; k < 4; ++k)
            grey[k] = glm::dot(glm::vec3(0.2126f, 0.7152f, 0.0722f), white.sh[k][cell]);
        // As Unity's EvalSHSkyOcclusion has it, the numbers in its order: 1, x, y, z.
        const glm::vec3 n = glm::normalize(glm::vec3(0.3f, 0.8f, -0.4f));
        const float occlusion = 0.28209479f * numbers[0].data[cell]
                                + 0.48860251f
                                      * (numbers[3].data[cell] * n.x + numbers[1].data[cell] * n.y
                                         + numbers[2].data[cell] * n.z);
        EXPECT_NEAR(occlusion, volume::sh_irradiance(grey, n) / std::numbers::pi_v<float>, 1e-5f);
        brightest = std::max(brightest, double(numbers[0].data[cell]) * 0.28209479);
        const glm::vec3 from(direction[0].data[3 * cell], direction[0].data[3 * cell + 1],
                             direction[0].data[3 * cell + 2]);
        const glm::vec3 band(grey[3], grey[1], grey[2]);
        if (glm::length(band) > 0.0f) {
            EXPECT_LT(glm::distance(from, glm::normalize(band)), 1e-4f);
        } else {
            EXPECT_EQ(from, glm::vec3(0.0f));
        }
    }
    EXPECT_GT(brightest, 0.5);
    EXPECT_LT(brightest, 1.0 + 1e-4);
    // Its pictures hold the numbers of cells inside geometry, too.
    const CliResult pictures =
        run("mix t.vdb sky=0 --sky-occlusion -o u.exr --target unity --precision float");
    ASSERT_EQ(pictures.status, 0) << pictures.err;
    EXPECT_TRUE(exists("u_sky_occlusion.exr"));
    EXPECT_TRUE(exists("u_sky_direction.exr"));
    const Volume filled = read_volume(folder_ / "u.json");
    const auto of_all = volume::grids_of(filled, volume::sky_occlusion_kind());
    ASSERT_EQ(of_all.size(), 4u);
    std::size_t more = 0;
    for (std::size_t cell = 0; cell < white.grid.size(); ++cell)
        if (unity.is_valid(cell))
            EXPECT_NEAR(of_all[3].data[cell], numbers[3].data[cell], 1e-6f);
        else
            more += of_all[0].data[cell] != numbers[0].data[cell];
    EXPECT_GT(more, 100u);
    ASSERT_EQ(bake("-o plain.vdb --layers lights").status, 0);
    expect_one_error(run("mix plain.vdb --sky-occlusion -o x.vdb"), "mix", ExitCode::usage,
                     "transfer");
}

TEST_F(LayersCli, GroupsTakeWhatTheirPatternFits) {
    ASSERT_EQ(bake("-o a.vdb --point 0.5,1,0.5,10 --layers 'main=bul*' --layers lights").status, 0);
    const json layers = json::parse(slurp(folder_ / "a.layers.json"))["layers"];
    ASSERT_EQ(layers.size(), 3u);
    EXPECT_EQ(layers[0]["name"], "main");
    EXPECT_EQ(layers[0]["kind"], "group");
    EXPECT_EQ(layers[1]["name"], "point");
    EXPECT_EQ(layers[2]["name"], "rest");
    // A layer that is gone leaves no file.
    ASSERT_EQ(bake("-o a.vdb --point 0.5,1,0.5,10 --layers lights").status, 0);
    EXPECT_FALSE(exists("a_layer_main.vdb"));
    EXPECT_TRUE(exists("a_layer_bulb.vdb"));
}

TEST_F(LayersCli, OfLevelsAreLevels) {
    const std::string set = "--level -0.5,0,-0.5,0.5,1,0.5:0.125 --level -1,0,-1,1,2,1:0.25 ";
    const std::string to = "bake \"$ROOM\" --quality fast --solver gather -q " + set;
    ASSERT_EQ(run(to + "-o plain.vdb").status, 0);
    const CliResult baked = run(to + "-o a.vdb --layers lights,emitters");
    ASSERT_EQ(baked.status, 0) << baked.err;
    const json manifest = json::parse(slurp(folder_ / "a.layers.json"));
    EXPECT_EQ(manifest["file"], "a.levels.json");
    EXPECT_EQ(manifest["layers"][0]["file"], "a_layer_bulb.levels.json");
    EXPECT_EQ(read_volume(folder_ / "a_level1.vdb").sh,
              read_volume(folder_ / "plain_level1.vdb").sh);
    EXPECT_EQ(
        json::parse(run("info a.levels.json --format json").out)["levels"][1]["layers"].size(), 2u);
    for (const char* file : {"a.vdb", "a.levels.json", "a.layers.json"})
        ASSERT_EQ(run(std::string("mix ") + file + " -o same.vdb").status, 0) << file;
    ASSERT_EQ(run(to + "-o half.vdb --light-scale '*=0.5'").status, 0);
    const std::string lamp = manifest["layers"][1]["name"];
    ASSERT_EQ(run("mix a.vdb bulb=0.5 " + lamp + "=0.5 -o mixed.vdb").status, 0);
    for (const char* level : {".vdb", "_level1.vdb"}) {
        const std::string end = level;
        EXPECT_LT(
            difference(read_volume(folder_ / ("same" + end)), read_volume(folder_ / ("a" + end))),
            1e-5);
        EXPECT_LT(difference(read_volume(folder_ / ("mixed" + end)),
                             read_volume(folder_ / ("half" + end))),
                  1e-5);
    }
    EXPECT_EQ(run("info mixed.levels.json").status, 0);
    EXPECT_EQ(run(to + "-o a.vdb --layers lights,emitters --if-changed").out.substr(0, 9),
              "unchanged");
    expect_one_error(run("mix a.vdb -o a_layer_bulb_level1.vdb"), "mix", ExitCode::usage,
                     "would replace the input");
    // What the next bake has no level for is gone, and no more.
    ASSERT_EQ(bake("-o a.vdb --layers lights,emitters").status, 0);
    EXPECT_FALSE(exists("a_layer_bulb_level1.vdb"));
    EXPECT_FALSE(exists("a_layer_bulb.levels.json"));
    EXPECT_TRUE(exists("a_layer_bulb.vdb"));
    ASSERT_EQ(run("mix a.vdb -o same.vdb").status, 0);
}

TEST_F(LayersCli, MayHaveLargerCells) {
    ASSERT_EQ(bake("-o plain.vdb").status, 0);
    const std::string options = "-o a.vdb --layers lights,emitters --layers-level 1";
    const json plan = json::parse(bake(options + " --dry-run --format json").out);
    const CliResult baked = bake(options + " --format json");
    ASSERT_EQ(baked.status, 0) << baked.err;
    for (const json& told : {plan, json::parse(baked.out)}) {
        EXPECT_EQ(told["outputs"][0]["files"].size(), 5u);
        for (const json& file : told["outputs"][0]["files"])
            EXPECT_TRUE(exists(file["path"])) << file;
        EXPECT_EQ(told["layers_grid"]["cell"], 2 * told["grid"]["cell"].get<double>());
    }
    const Volume all = read_volume(folder_ / "a.vdb"),
                 whole = read_volume(folder_ / "a_layers.vdb");
    EXPECT_EQ(all.sh, read_volume(folder_ / "plain.vdb").sh);
    EXPECT_EQ(whole.grid.dims, (all.grid.dims + 1) / 2);
    EXPECT_EQ(whole.grid.origin, all.grid.origin);
    EXPECT_EQ(json::parse(slurp(folder_ / "a.layers.json"))["file"], "a_layers.vdb");
    EXPECT_EQ(read_volume(folder_ / "a_layer_bulb.vdb").walls, whole.walls);
    ASSERT_EQ(run("mix a.vdb -o same.vdb").status, 0);
    const Volume same = read_volume(folder_ / "same.vdb");
    EXPECT_LT(difference(same, whole), 1e-5);
    EXPECT_EQ(same.walls, whole.walls);

    // Where all around is air, it is the light of the eight small cells in each.
    double sum = 0.0, error = 0.0;
    for (std::size_t cell = 0; cell < whole.grid.size(); ++cell) {
        const glm::ivec3 at = whole.grid.cell_at(cell), first = 2 * at;
        glm::vec3 mean(0.0f);
        int valid = 0;
        for (int i = 0; i < 8; ++i) {
            const glm::ivec3 part = first + glm::ivec3(i & 1, i / 2 & 1, i / 4);
            if (!all.grid.contains(part))
                continue;
            const std::size_t fine = all.grid.index(part);
            mean += all.sh[0][fine] / 8.0f;
            valid += all.validity[fine] == 1.0f;
        }
        if (valid < 8 || whole.validity[cell] < 1.0f)
            continue;
        sum += double(mean.y);
        error += std::abs(double(mean.y) - double(whole.sh[0][cell].y));
    }
    EXPECT_GT(sum, 0.0);
    EXPECT_LT(error, 0.05 * sum);

    EXPECT_EQ(bake(options + " --if-changed").out.substr(0, 9), "unchanged");
    ASSERT_EQ(bake("-o a.vdb --layers lights,emitters").status, 0);
    EXPECT_FALSE(exists("a_layers.vdb"));
    for (const char* solver : {"sn", "lpv"}) {
        ASSERT_EQ(run(std::string("bake \"$ROOM\" --resolution 12 -q --solver ") + solver
                      + " -o b.vdb --layers lights --layers-level 2")
                      .status,
                  0);
        ASSERT_EQ(run("mix b.vdb -o same.vdb").status, 0);
        EXPECT_LT(
            difference(read_volume(folder_ / "same.vdb"), read_volume(folder_ / "b_layers.vdb")),
            1e-5)
            << solver;
    }
}

/// A picture of a sky of 10 + 8 x nits towards +x: binary PFM, from the bottom.
std::string sky_from_one_side() {
    constexpr int columns = 256, rows = 128;
    std::string picture = "PF\n256 128\n-1.0\n";
    for (int row = rows - 1; row >= 0; --row)
        for (int column = 0; column < columns; ++column) {
            const double polar = M_PI * (row + 0.5) / rows;
            const double turn = 2.0 * M_PI * ((column + 0.5) / columns - 0.5);
            const auto luminance = float(10.0 + 8.0 * std::sin(polar) * std::sin(turn));
            for (int c = 0; c < 3; ++c)
                picture.append(reinterpret_cast<const char*>(&luminance), sizeof luminance);
        }
    return picture;
}

TEST_F(LayersCli, OfVolumesAreVolumesAndTurnWithThem) {
    spill(folder_ / "sky.pfm", sky_from_one_side());
    spill(folder_ / "boxes.json",
          R"({"volumes": [{"name": "low", "box": [-1, 0, -1, 1, 1, 1], "cell": 0.25},
                          {"name": "high", "box": [-0.5, 0.5, -0.5, 0.5, 2.5, 0.5], "cell": 0.25,
                           "rotation": [0, 0.3826834, 0, 0.9238795], "priority": 1}]})");
    const std::string to = "bake \"$ROOM\" --quality fast --solver gather -q --volumes boxes.json "
                           "--sky sky.pfm --no-light bulb --no-emitters ";
    const CliResult baked = run(to + "-o a.vdb --layers sky:2");
    ASSERT_EQ(baked.status, 0) << baked.err;
    EXPECT_EQ(json::parse(slurp(folder_ / "a.layers.json"))["file"], "a.volumes.json");
    ASSERT_EQ(run("mix a.vdb -o same.vdb").status, 0);
    ASSERT_EQ(run("mix a.volumes.json sky=sky.pfm -o modes.vdb").status, 0);
    for (const char* output : {"a.vdb", "a.exr", "a_layer_sky.vdb"})
        expect_one_error(run(std::string("mix a.volumes.json -o ") + output), output,
                         ExitCode::usage, "would replace the input");
    ASSERT_EQ(run(to + "-o b.vdb --layers transfer").status, 0);
    ASSERT_EQ(run("mix b.volumes.json sky=sky.pfm -o any.vdb").status, 0);
    for (const char* name : {"low", "high"}) {
        const auto of = [&](const std::string& stem) {
            return read_volume(folder_ / (stem + "_" + name + ".vdb"));
        };
        EXPECT_LT(difference(of("same"), of("a")), 1e-5) << name;
        // The same sky by its modes, which are as turned as the box.
        const Volume all = of("a"), modes = of("modes");
        EXPECT_LT(difference(of("any"), modes), 1e-4) << name;
        double sum = 0.0, error = 0.0;
        for (std::size_t k = 0; k < all.sh.size(); ++k)
            for (std::size_t cell = 0; cell < all.grid.size(); ++cell) {
                sum += std::abs(double(all.sh[k][cell].y));
                error += std::abs(double(all.sh[k][cell].y) - double(modes.sh[k][cell].y));
            }
        EXPECT_LT(error, 0.005 * sum) << name;
    }
}

TEST_F(LayersCli, SunsOfADayMakeTheSunOfATime) {
    const std::string to = "bake \"$ROOM\" --resolution 12 --quality fast --solver gather -q "
                           "--no-light bulb --no-emitters ";
    const std::string suns = "--layers suns:9@48.1,11.6,06-21 --format json -o ";
    const CliResult baked = run(to + suns + "a.vdb");
    ASSERT_EQ(baked.status, 0) << baked.err;
    const json manifest = json::parse(slurp(folder_ / "a.layers.json"));
    ASSERT_EQ(manifest["layers"].size(), 9u);
    EXPECT_EQ(manifest["layers"][4]["kind"], "sun");
    EXPECT_EQ(manifest["layers"][4]["sun"]["date"], "06-21");
    EXPECT_EQ(std::string(manifest["layers"][4]["name"]).substr(0, 5), "sun_1");

    // At the time of a sun the volume is that of a bake under it.
    const double hour = manifest["layers"][4]["sun"]["hour"];
    const int minutes = int(std::lround(60 * hour));
    const scene::SunArc arc{48.1, 11.6, 6, 21};
    const auto bake_at = [&](double at, const std::string& name) {
        const glm::dvec3 towards = scene::towards_sun(arc, at);
        char sun[200];
        std::snprintf(sun, sizeof sun, "--sun %.9g,%.9g,%.9g -o ",
                      glm::degrees(std::atan2(towards.x, towards.z)),
                      glm::degrees(std::asin(towards.y)), scene::sun_illuminance(towards.y));
        ASSERT_EQ(run(to + sun + name).status, 0);
    };
    const auto error_of = [&](const std::string& name, const std::string& truth) {
        const Volume a = read_volume(folder_ / name), b = read_volume(folder_ / truth);
        return volume::compare(a, b, {}).relative_l1;
    };
    bake_at(hour, "noon.vdb");
    ASSERT_EQ(run("mix a.vdb sun=" + std::to_string(minutes / 60) + ":"
                  + std::to_string(minutes % 60) + " -o mixed.vdb")
                  .status,
              0);
    EXPECT_LT(error_of("mixed.vdb", "noon.vdb"), 0.04);
    ASSERT_EQ(run("mix a.vdb sun=off -o night.vdb").status, 0);
    ASSERT_EQ(run("mix a.vdb sun=1:00 -o late.vdb").status, 0);
    for (const char* name : {"night.vdb", "late.vdb"})
        EXPECT_EQ(
            read_volume(folder_ / name).sh[0],
            std::vector<glm::vec3>(read_volume(folder_ / name).sh[0].size(), glm::vec3(0.0f)));
    expect_one_error(run("mix a.vdb sun=25:00 -o b.vdb"), "25:00", ExitCode::usage, "19:30");

    EXPECT_GT(json::parse(baked.out)["suns_held_out"]["mean"], 0.01);
}

TEST_F(LayersCli, OfPointsAreFilesOfPoints) {
    spill(folder_ / "at.json", R"({"points": [[0, 1, 0.5], [0.5, 0.5, 0.5], [0, 1, 0.5]],
                                   "normals": [[0, 1, 0], [0, 0, 1], [0, 1, 0]]})");
    const std::string to = "bake \"$ROOM\" --quality fast -q --at at.json --sky '#ffffff,5' ";
    ASSERT_EQ(run(to + "-o plain.json").status, 0);
    const std::string layered = to + "-o a.json --layers lights,emitters,transfer:0 ";
    const json plan = json::parse(run(layered + "--dry-run --format json").out);
    ASSERT_EQ(run(layered).status, 0);
    ASSERT_EQ(plan["outputs"][0]["files"].size(), 7u); // all, lamps, sky, two of it, and the list
    for (const json& file : plan["outputs"][0]["files"])
        EXPECT_TRUE(exists(file["path"])) << file;
    const auto points_of = [&](const std::string& name) {
        return json::parse(slurp(folder_ / name))["points"];
    };
    const json all = points_of("a.json");
    EXPECT_EQ(all, points_of("plain.json"));
    double largest = 0.0, off = 0.0, irradiance_off = 0.0;
    for (std::size_t i = 0; i < all.size(); ++i)
        for (int c = 0; c < 3; ++c) {
            std::vector<double> sums(all[i]["sh"].size(), 0.0);
            double irradiance = 0.0;
            for (const char* layer : {"bulb", "lamp", "sky"}) {
                const json one = points_of(std::string("a_layer_") + layer + ".json")[i];
                irradiance += double(one["irradiance"][c]);
                for (std::size_t k = 0; k < sums.size(); ++k)
                    sums[k] += double(one["sh"][k][c]);
            }
            for (std::size_t k = 0; k < sums.size(); ++k) {
                off = std::max(off, std::abs(sums[k] - double(all[i]["sh"][k][c])));
                largest = std::max(largest, std::abs(double(all[i]["sh"][k][c])));
            }
            irradiance_off =
                std::max(irradiance_off, std::abs(irradiance - double(all[i]["irradiance"][c])));
        }
    EXPECT_GT(largest, 1.0);
    EXPECT_LT(off, 1e-5 * largest);
    EXPECT_LT(irradiance_off, 1e-4 * largest);
    EXPECT_EQ(points_of("a_layer_bulb.json")[0], points_of("a_layer_bulb.json")[2]);
    // A layer that is gone leaves no file.
    ASSERT_EQ(run(to + "-o a.json --layers lights").status, 0);
    EXPECT_FALSE(exists("a_layer_lamp.json"));
}

TEST_F(LayersCli, OfPropagationSumUpToo) {
    const std::string bake =
        "bake \"$ROOM\" --resolution 16 --solver lpv --bounces inf -q -o a.exr "
        "--layers lights,emitters ";
    ASSERT_EQ(run(bake).status, 0);
    const json plan = json::parse(run(bake + "--dry-run --format json").out);
    for (const json& file : plan["outputs"][0]["files"])
        EXPECT_TRUE(exists(file["path"])) << file;
    ASSERT_EQ(run("mix a.exr -o same.vdb").status, 0);
    EXPECT_LT(difference(read_volume(folder_ / "same.vdb"), read_volume(folder_ / "a.json")), 1e-5);
}

TEST_F(LayersCli, AreTheSameForAnyNumberOfThreads) {
    ASSERT_EQ(bake("-o a.vdb --layers lights,emitters --threads 1").status, 0);
    ASSERT_EQ(bake("-o b.vdb --layers lights,emitters --threads 2").status, 0);
    EXPECT_EQ(slurp(folder_ / "a_layer_bulb.vdb"), slurp(folder_ / "b_layer_bulb.vdb"));
}

TEST_F(LayersCli, WhatCannotBeIsRefusedByName) {
    const std::string to = "bake \"$ROOM\" --resolution 8 -o a.vdb ";
    const auto refused = [&](const std::string& arguments, const std::string& text) {
        expect_one_error(run(to + arguments), arguments, ExitCode::usage, text);
    };
    refused("--layers lamps", "is none of lights, emitters, sky");
    refused("--layers sky:3", "sky:N");
    refused("--layers suns:99@48,11,06-21", "1 to 48 suns");
    refused("--layers suns:12@48,11", "LATITUDE,LONGITUDE,MONTH-DAY");
    refused("--layers suns:12@48,11,13-21", "as 48.1,11.6,06-21");
    refused("--layers suns:12@80,11,12-21", "the sun does not rise");
    refused("--layers transfer:3 --sky '#ffffff,1'", "transfer:N");
    refused("--layers transfer", "there is no sky");
    refused("--layers transfer,sky:1 --sky '#ffffff,1'", "no sky that no layer has");
    refused("--layers transfer --sky '#ffffff,1' --solver sn", "is an option of gather");
    refused("--layers transfer --sky '#ffffff,1' --target unity --dering off --fit none", "mix");
    refused("--layers sky=*", "meaning of their own");
    refused("--layers x=nothing*", "'bulb'");
    refused("--layers sky", "there is no sky");
    refused("--layers lights --no-light bulb", "no punctual light is left");
    refused("--layers sky:1 --sky '#ffffff,1' --solver lpv",
            "--layers sky:N is an option of sn or gather");
    expect_one_error(run("bake \"$ROOM\" -o a.vdb --layers lights --solver lpv --level "
                         "-1,0,-1,1,2,1:0.2"),
                     "lpv, --level", ExitCode::usage,
                     "--layers of several volumes is an option of sn or gather");
    refused("--layers lights --adaptive 0.1..0.2", "--adaptive");
    refused("--layers lights --direct sh", "--direct");
    refused("--layers-level 1", "--layers");
    refused("--layers lights --layers-level 5", "--layers-level");
    refused("--layers lights --layers-level 3", "use a lower one");
    refused("--layers lights --layers-level 1 --level -1,0,-1,1,2,1:0.2", "--level");
    refused("--layers lights --fit surfaces", "--fit none");
    refused("--layers lights --dering on", "--dering off");
    expect_one_error(run("bake \"$ROOM\" --resolution 8 -o b.ktx2 --layers sky:1 --sky '#ffffff,1' "
                         "--precision rgb9e5"),
                     "rgb9e5", ExitCode::usage, "float or half");
    refused("--layers lights -o a.exr", "manifest");
    refused("--layers lights -o b.glb", ".glb");
    refused("--layers lights -o a_layer_bulb.vdb", "a_layer_bulb.vdb");

    ASSERT_EQ(bake("-o a.vdb --layers lights").status, 0);
    expect_one_error(run("mix a.vdb lamp=1 -o b.vdb"), "mix", ExitCode::usage, "it has bulb, rest");
    expect_one_error(run("mix a.vdb bulb -o b.vdb"), "mix", ExitCode::usage, "NAME=");
    expect_one_error(run("mix a.vdb bulb=1 bulb=0 -o b.vdb"), "mix", ExitCode::usage,
                     "two weights");
    ASSERT_EQ(run("mix a.vdb bulb=0.5 -o c.vdb").status, 0);
    EXPECT_NE(run("verify c.vdb \"$ROOM\" --points 16").err.find("is mixed of layers (bulb=0.5)"),
              std::string::npos);
    expect_one_error(run("mix a.vdb bulb=red -o b.vdb"), "mix", ExitCode::usage, "#RRGGBB");
    expect_one_error(run("mix a.vdb sky=b.hdr -o b.vdb"), "mix", ExitCode::usage, "sky:2");
    expect_one_error(run("mix a.vdb bulb=1 -o a_layer_bulb.vdb"), "mix", ExitCode::usage,
                     "would replace the input");
    expect_one_error(run("mix a.vdb bulb=1"), "mix", ExitCode::usage, "-o FILE");
    // Another layer, or another list, in the place of one.
    EXPECT_EQ(bake("-o a.vdb --layers lights --if-changed").out.substr(0, 9), "unchanged");
    std::filesystem::copy_file(folder_ / "a_layer_rest.vdb", folder_ / "a_layer_bulb.vdb",
                               std::filesystem::copy_options::overwrite_existing);
    expect_one_error(run("mix a.vdb -o b.vdb"), "mix", ExitCode::invalid, "of another bake");
    EXPECT_NE(bake("-o a.vdb --layers lights --if-changed").out.substr(0, 9), "unchanged");
    json fewer = json::parse(slurp(folder_ / "a.layers.json"));
    fewer["layers"].erase(1);
    spill(folder_ / "a.layers.json", fewer.dump());
    EXPECT_NE(bake("-o a.vdb --layers lights --if-changed").out.substr(0, 9), "unchanged");
    ASSERT_EQ(bake("-o plain.vdb").status, 0);
    expect_one_error(run("mix plain.vdb bulb=1 -o b.vdb"), "mix", ExitCode::file, "--layers");
    // A layer of another bake, and a damaged manifest.
    ASSERT_EQ(bake("-o c.vdb --layers lights --point 0,1,0,5").status, 0);
    std::filesystem::copy_file(folder_ / "c_layer_bulb.vdb", folder_ / "a_layer_bulb.vdb",
                               std::filesystem::copy_options::overwrite_existing);
    expect_one_error(run("mix a.vdb -o b.vdb"), "mix", ExitCode::invalid, "of another bake");
    spill(folder_ / "a.layers.json", "{\"format\": \"lpvbake layers\", \"version\": 1}");
    EXPECT_NE(run("mix a.vdb -o b.vdb").status, 0);
    EXPECT_FALSE(exists("b.vdb"));
}

} // namespace
} // namespace lpvbake
