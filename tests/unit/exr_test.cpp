// EXR flipbooks and their sidecars.
#include "io/exr.h"

#include "image/image.h"
#include "io/io.h"
#include "unit/volumes.h"

#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include <cmath>
#include <set>

using namespace lpvbake;
using nlohmann::json;

namespace {

image::Pixels read_pixels(const std::string& path) {
    const std::string bytes = slurp(path);
    return image::decode_exr(std::as_bytes(std::span(bytes)), path, 1 << 24);
}

} // namespace

TEST(Exr, FullPrecisionRoundTripsExactly) {
    for (glm::ivec3 dims :
         {glm::ivec3(1), glm::ivec3(7, 13, 9), glm::ivec3(33, 1, 2), glm::ivec3(2, 3, 31)})
        for (int order : {0, 1, 2, 4})
            for (io::Packing packing : {io::Packing::band, io::Packing::channel}) {
                if (packing == io::Packing::channel && order != 1)
                    continue;
                const TemporaryFolder folder;
                const Volume volume = random_volume(dims, order, dims.x != 1, 1);
                const WriteReport report =
                    io::write_volume(folder / "a.exr", volume, Precision::full, {packing});
                expect_equal(io::read_exr(folder / "a.exr"), volume);
                expect_equal(io::read_exr(folder / "a.json"), volume);
                if (order == 1 && dims.x == 2)
                    for (const WriteReport::File& file : report.files)
                        expect_equal(io::read_exr(file.path), volume);
                uint64_t bytes = 0;
                for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
                    bytes += entry.file_size();
                EXPECT_EQ(report.bytes(), bytes);
            }
}

TEST(Exr, HalfRoundTripsWithinHalfOrIsFull) {
    const TemporaryFolder folder;
    Volume volume = random_volume({7, 6, 5}, 1, true, 2);
    EXPECT_TRUE(io::write_volume(folder / "a.exr", volume, Precision::half, {io::Packing::band})
                    .warnings.empty());
    const Volume back = io::read_exr(folder / "a.exr");
    for (size_t k = 0; k < 4; ++k)
        for (size_t i = 0; i < volume.grid.size(); ++i)
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(back.sh[k][i][c], volume.sh[k][i][c],
                            std::abs(volume.sh[k][i][c]) / 2048 + 1e-7);
    volume.sh[0][3].x = 1e6f;
    EXPECT_EQ(io::write_volume(folder / "a.exr", volume, Precision::half, {io::Packing::band})
                  .warnings.size(),
              1u);
    expect_equal(io::read_exr(folder / "a.exr"), volume);
    EXPECT_EQ(json::parse(slurp(folder / "a.json"))["precision"], "float");
}

TEST(Exr, FilesAndLayout) {
    const TemporaryFolder folder;
    const glm::ivec3 dims(4, 5, 11);
    const Volume volume = random_volume(dims, 1, true, 3);
    io::write_volume(folder / "scene.v2.exr", volume, Precision::full, {io::Packing::band});
    const json sidecar = json::parse(slurp(folder / "scene.v2.json"));
    const int columns = sidecar["layout"]["columns"], rows = sidecar["layout"]["rows"];
    EXPECT_EQ(columns, 4); // 16 x 15 texels
    EXPECT_EQ(rows, 3);
    EXPECT_EQ(sidecar["layout"]["tile"], (json{4, 5}));
    EXPECT_EQ(sidecar["layout"]["slices"], 11);
    EXPECT_EQ(sidecar["grid"]["dims"], (json{4, 5, 11}));
    EXPECT_EQ(sidecar["grid"]["cell"].get<double>(), volume.grid.cell);
    EXPECT_EQ(sidecar["metadata"]["solver"], "none");
    std::set<std::string> files;
    for (const json& file : sidecar["files"])
        files.insert(file["file"]);
    EXPECT_EQ(files, (std::set<std::string>{"scene.v2_sh_l0.exr", "scene.v2_sh_l1_y.exr",
                                            "scene.v2_sh_l1_z.exr", "scene.v2_sh_l1_x.exr",
                                            "scene.v2_occlusion.exr", "scene.v2_validity.exr",
                                            "scene.v2_wall_0.exr", "scene.v2_wall_1.exr"}));
    // Slice 6 is the third tile of the second row.
    const image::Pixels l1z = read_pixels(folder / "scene.v2_sh_l1_z.exr");
    EXPECT_EQ(l1z.width, 16);
    EXPECT_EQ(l1z.height, 15);
    const glm::ivec3 cell(3, 2, 6);
    const size_t texel = size_t(5 + 2) * 16 + 8 + 3;
    for (size_t c = 0; c < 3; ++c)
        EXPECT_EQ(l1z.samples[texel * 3 + c], volume.sh[2][volume.grid.index(cell)][int(c)]);
    // The twelfth tile holds no slice.
    EXPECT_EQ(l1z.samples.back(), 0.0f);

    io::write_volume(folder / "c.exr", volume, Precision::full, {io::Packing::channel});
    const image::Pixels green = read_pixels(folder / "c_g.exr");
    EXPECT_EQ(green.channels, 4);
    const image::Pixels occlusion = read_pixels(folder / "c_occlusion.exr");
    for (size_t k = 0; k < 4; ++k) {
        EXPECT_EQ(green.samples[texel * 4 + k], volume.sh[k][volume.grid.index(cell)].y);
        EXPECT_EQ(occlusion.samples[texel * 4 + k], volume.occlusion[k][volume.grid.index(cell)]);
    }
    EXPECT_EQ(json::parse(slurp(folder / "c.json"))["files"][1]["channels"],
              (json{"sh_l0.g", "sh_l1_y.g", "sh_l1_z.g", "sh_l1_x.g"}));
}

TEST(Exr, PicturesAreNearSquareAndFitEngines) {
    const TemporaryFolder folder;
    const auto layout = [&](glm::ivec3 dims) {
        Volume volume;
        volume.grid = {{0, 0, 0}, 1, dims};
        volume.sh_order = 0;
        volume.sh.assign(1, std::vector<glm::vec3>(volume.grid.size()));
        io::write_volume(folder / "a.exr", volume, Precision::half, {io::Packing::band});
        const json sidecar = json::parse(slurp(folder / "a.json"))["layout"];
        return glm::ivec2(sidecar["columns"], sidecar["rows"]);
    };
    EXPECT_EQ(layout({32, 32, 32}), glm::ivec2(6, 6));
    EXPECT_EQ(layout({16, 16, 16}), glm::ivec2(4, 4));
    EXPECT_EQ(layout({1, 100, 100}), glm::ivec2(100, 1));
    EXPECT_EQ(layout({16384, 1, 20}), glm::ivec2(1, 20));
    Volume wide;
    wide.grid = {{0, 0, 0}, 1, {16385, 1, 1}};
    wide.sh_order = 0;
    wide.sh.assign(1, std::vector<glm::vec3>(16385));
    const Error error = error_of("b.exr", [&] {
        io::write_volume(folder / "b.exr", wide, Precision::half, {io::Packing::band});
    });
    EXPECT_EQ(error.kind, ErrorKind::unsupported);
    EXPECT_NE(std::string(error.what()).find("write .vdb"), std::string::npos);
}

TEST(Exr, AtlasIsThatOfThreeJs) {
    const TemporaryFolder folder;
    for (const int order : {1, 2}) {
        const glm::ivec3 dims(3, 2, 4);
        Volume volume = random_volume(dims, order, false, 9);
        volume.validity.clear(); // which has no place in it
        volume.walls.clear();
        io::write_volume(folder / "a.exr", volume, Precision::full, {io::Packing::atlas, 5});
        const image::Pixels atlas = read_pixels(folder / "a_atlas.exr");
        ASSERT_EQ(atlas.width, 5 * 3); // 7 (4 + 2) slices, five in a row
        ASSERT_EQ(atlas.height, 9 * 2);
        ASSERT_EQ(atlas.channels, 4);
        // Float f of a probe is channel f % 4 of block f / 4; each block stands between copies of
        // its first and last slices.
        for (int z = -1; z <= dims.z; ++z)
            for (int f = 0; f < 28; ++f) {
                const glm::ivec3 probe(2, 1, std::clamp(z, 0, dims.z - 1));
                const int slice = f / 4 * (dims.z + 2) + z + 1;
                const int x = slice % 5 * 3 + probe.x, y = slice / 5 * 2 + probe.y;
                const size_t k = size_t(f) / 3;
                const float expected =
                    k < volume.sh.size() ? volume.sh[k][volume.grid.index(probe)][f % 3] : 0.0f;
                EXPECT_EQ(atlas.samples[size_t((y * 15 + x) * 4 + f % 4)], expected)
                    << order << ' ' << z << ' ' << f;
            }
        expect_equal(io::read_exr(folder / "a.exr"), volume);
    }
}

TEST(Exr, PacksForVrcLightVolumes) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({3, 2, 4}, 1, false, 10);
    io::write_volume(folder / "a.exr", volume, Precision::full, {io::Packing::vrc, 0, true},
                     {.convention = volume::ShConvention::unity});
    const json sidecar = json::parse(slurp(folder / "a.json"));
    const auto channels = [&](size_t file) { return sidecar["files"][file]["channels"]; };
    EXPECT_EQ(channels(0), (json{"sh_l0.r", "sh_l0.g", "sh_l0.b", "sh_l1_z.r"}));
    EXPECT_EQ(channels(1), (json{"sh_l1_x.r", "sh_l1_x.g", "sh_l1_x.b", "sh_l1_z.g"}));
    EXPECT_EQ(channels(2), (json{"sh_l1_y.r", "sh_l1_y.g", "sh_l1_y.b", "sh_l1_z.b"}));
    const image::Pixels one = read_pixels(folder / "a_1.exr");
    EXPECT_FLOAT_EQ(one.samples[1], 0.32573501f * volume.sh[3][0].y);
    EXPECT_FLOAT_EQ(one.samples[3], 0.32573501f * volume.sh[2][0].y);
    const Volume back = io::read_exr(folder / "a.exr");
    for (size_t k = 0; k < 4; ++k)
        EXPECT_NEAR(back.sh[k][5].z, volume.sh[k][5].z, 1e-6 * std::abs(volume.sh[k][5].z));
}

TEST(Exr, CubeHoldsIrradianceOverPiOfSixSides) {
    const TemporaryFolder folder;
    const glm::ivec3 dims(3, 2, 4);
    Volume volume = random_volume(dims, 1, false, 11);
    for (glm::vec3& c : volume.sh[0])
        c = glm::vec3(4000.0f); // so that no side is dark
    io::write_volume(folder / "a.exr", volume, Precision::full, {io::Packing::cube, 3});
    const image::Pixels cube = read_pixels(folder / "a_cube.exr");
    ASSERT_EQ(cube.width, 3 * 3);
    ASSERT_EQ(cube.height, 4 * 2 * 2);
    // Of order 1, irradiance over pi is 0.282095 c0 + 2/3 0.488603 c.n.
    const size_t l1[] = {3, 1, 2};
    for (int axis = 0; axis < 3; ++axis)
        for (int side = 0; side < 2; ++side) {
            const glm::ivec3 cell(1, 1, 2);
            const int slice = axis * dims.z + cell.z;
            const int x = slice % 3 * 3 + cell.x, y = slice / 3 * 4 + side * dims.y + cell.y;
            const size_t i = volume.grid.index(cell);
            const float expected =
                0.28209479f * volume.sh[0][i].g
                + (side == 0 ? 1.0f : -1.0f) * 0.32573501f * volume.sh[l1[axis]][i].g;
            EXPECT_NEAR(cube.samples[size_t((y * 9 + x) * 3 + 1)], expected, 1e-6 * expected)
                << axis << ' ' << side;
        }
    EXPECT_EQ(error_of("a", [&] { io::read_exr(folder / "a.exr"); }).kind, ErrorKind::unsupported);
}

TEST(Exr, LeavesNoTileEmptyWhereThatIsAskedFor) {
    const TemporaryFolder folder;
    for (const int slices : {12, 13}) {
        io::write_volume(folder / "a.exr", random_volume({4, 4, slices}, 1, false, 12),
                         Precision::half, {.no_empty_tiles = true});
        const json layout = json::parse(slurp(folder / "a.json"))["layout"];
        EXPECT_EQ(int(layout["columns"]) * int(layout["rows"]), slices);
    }
}

TEST(Exr, OpensInOiiotool) {
    const TemporaryFolder folder;
    io::write_volume(folder / "a.exr", random_volume({7, 6, 5}, 1, true, 4), Precision::half,
                     {io::Packing::channel});
    const std::string text = output_of("oiiotool --info -v " + folder / "a_r.exr");
    for (const char* expected :
         {"14 x   18, 4 channel, half openexr", "channel list: R, G, B, A", "compression: \"zip\"",
          "lpv:columns: \"2\"", "lpv:rows: \"3\"", "lpv:grid_dims: \"[7,6,5]\"",
          "lpv:units: \"cd/m^2\"", "lpv:solver: \"none\"", "lpv:convention: \"radiance\"",
          "lpv:precision"})
        EXPECT_EQ(text.find(expected) != std::string::npos,
                  std::string(expected) != "lpv:precision")
            << expected << " in\n"
            << text;
}

TEST(Exr, BytesDependOnContentAlone) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({40, 17, 23}, 1, true, 5);
    const auto bytes = [&](size_t threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        io::write_volume(folder / "a.exr", volume, Precision::half, {io::Packing::channel});
        std::vector<std::string> all;
        for (const char* name :
             {"a.json", "a_r.exr", "a_g.exr", "a_b.exr", "a_occlusion.exr", "a_validity.exr"})
            all.push_back(slurp(folder / name));
        return all;
    };
    const auto one = bytes(1);
    for (size_t threads : {1u, 2u, 4u}) {
        const auto again = bytes(threads);
        for (size_t i = 0; i < one.size(); ++i)
            EXPECT_TRUE(one[i] == again[i]) << "file " << i << ", " << threads << " threads";
    }
}

TEST(Exr, RefusesToWrite) {
    const TemporaryFolder folder;
    Volume volume = random_volume({3, 3, 3}, 1, false, 6);
    volume.sh[0][0].x = std::nanf("");
    EXPECT_EQ(error_of("a.exr",
                       [&] {
                           io::write_volume(folder / "a.exr", volume, Precision::half,
                                            {io::Packing::band});
                       })
                  .kind,
              ErrorKind::failure);
    EXPECT_EQ(error_of("a.exr",
                       [&] {
                           io::write_volume(folder / "a.exr", random_volume({3, 3, 3}, 4, false, 6),
                                            Precision::half, {io::Packing::channel});
                       })
                  .kind,
              ErrorKind::unsupported);
    const std::pair<io::Packing, volume::Encoding> unfit[] = {
        {io::Packing::vrc, {}},
        {io::Packing::atlas, {.convention = volume::ShConvention::godot}},
        {io::Packing::cube, {.convention = volume::ShConvention::unity}}};
    volume = random_volume({3, 3, 3}, 1, false, 6);
    for (const auto& [packing, encoding] : unfit)
        EXPECT_EQ(error_of("a.exr",
                           [&] {
                               io::write_volume(folder / "a.exr", volume, Precision::half,
                                                {packing}, encoding);
                           })
                      .kind,
                  ErrorKind::unsupported);
    EXPECT_EQ(folder.count(), 0);
}

TEST(Exr, LeftoversOfAnotherVolumeAreNotRead) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({4, 5, 6}, 1, true, 7);
    io::write_volume(folder / "a.exr", volume, Precision::full, {io::Packing::band});
    io::write_volume(folder / "a.exr", volume, Precision::full, {io::Packing::channel});
    expect_equal(io::read_exr(folder / "a_r.exr"), volume);
    EXPECT_EQ(error_of("a", [&] { io::read_exr(folder / "a_sh_l0.exr"); }).kind,
              ErrorKind::invalid);
}

TEST(Exr, RejectsDamagedFiles) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.json";
    io::write_volume(folder / "a.exr", random_volume({4, 5, 6}, 1, true, 7), Precision::full,
                     {io::Packing::band});
    const json good = json::parse(slurp(path));
    const auto kind = [&](const std::string& bytes) {
        spill(path, bytes);
        return error_of("a", [&] { io::read_exr(folder / "a.exr"); }).kind;
    };
    const std::string text = good.dump();
    for (size_t length = 0; length < text.size(); length += 31)
        EXPECT_EQ(kind(text.substr(0, length)), ErrorKind::invalid);
    EXPECT_EQ(kind(std::string(100000, '[')), ErrorKind::invalid);
    const auto changed = [&](const char* pointer, const json& value) {
        json bad = good;
        bad[json::json_pointer(pointer)] = value;
        return kind(bad.dump());
    };
    EXPECT_EQ(changed("/format", "x"), ErrorKind::invalid);
    EXPECT_EQ(changed("/version", 2), ErrorKind::invalid);
    EXPECT_EQ(changed("/convention", "lightmap"), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/dims", {4, 5}), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/dims/2", 1e300), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/dims/2", 7), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/dims/0", 0), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/dims", {2000000000, 2000000000, 2000000000}), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/cell", -1), ErrorKind::invalid);
    EXPECT_EQ(changed("/grid/cell", "x"), ErrorKind::invalid);
    EXPECT_EQ(changed("/sh_order", 5), ErrorKind::invalid);
    EXPECT_EQ(changed("/sh_order", 0), ErrorKind::invalid);
    EXPECT_EQ(changed("/sh_order", 3), ErrorKind::invalid);
    EXPECT_EQ(changed("/layout/columns", 1), ErrorKind::invalid);
    EXPECT_EQ(changed("/layout/columns", 2000000000), ErrorKind::invalid);
    EXPECT_EQ(changed("/files/0/file", "../a_sh_l0.exr"), ErrorKind::invalid);
    EXPECT_EQ(changed("/files/0/file", "none.exr"), ErrorKind::file);
    EXPECT_EQ(changed("/files/0/channels/0", "sh_l0.g"), ErrorKind::invalid);
    EXPECT_EQ(changed("/files/0/channels", json::array()), ErrorKind::invalid);
    EXPECT_EQ(changed("/files", json::array()), ErrorKind::invalid);
    EXPECT_EQ(changed("/metadata", {{"a", 1}}), ErrorKind::invalid);

    spill(path, text);
    const std::string picture = slurp(folder / "a_sh_l0.exr");
    for (size_t length = 0; length < picture.size(); length += 211) {
        spill(folder / "a_sh_l0.exr", picture.substr(0, length));
        EXPECT_EQ(error_of("a_sh_l0.exr", [&] { io::read_exr(folder / "a.exr"); }).kind,
                  ErrorKind::invalid);
    }
    std::filesystem::remove(path);
    EXPECT_EQ(error_of("a.json", [&] { io::read_exr(folder / "a.exr"); }).kind, ErrorKind::file);
}
