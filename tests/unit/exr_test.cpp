// EXR flipbooks and their sidecars.
#include "io/exr.h"

#include "image/image.h"
#include "unit/volumes.h"

#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include <cmath>
#include <set>

using namespace lpvbake;
using nlohmann::json;

namespace {

Pixels read_pixels(const std::string& path) {
    const std::string bytes = slurp(path);
    return decode_exr(std::as_bytes(std::span(bytes)), path, 1 << 24);
}

void expect_equal(const Volume& a, const Volume& b) {
    EXPECT_EQ(a.grid, b.grid);
    EXPECT_EQ(a.sh_order, b.sh_order);
    EXPECT_EQ(a.sh, b.sh);
    EXPECT_EQ(a.occlusion, b.occlusion);
    EXPECT_EQ(a.validity, b.validity);
    EXPECT_EQ(a.metadata, b.metadata);
}

} // namespace

TEST(Exr, FullPrecisionRoundTripsExactly) {
    for (glm::ivec3 dims :
         {glm::ivec3(1), glm::ivec3(7, 13, 9), glm::ivec3(33, 1, 2), glm::ivec3(2, 3, 31)})
        for (int order : {0, 1, 2, 4})
            for (Packing packing : {Packing::band, Packing::channel}) {
                if (packing == Packing::channel && order != 1)
                    continue;
                const TemporaryFolder folder;
                const Volume volume = random_volume(dims, order, dims.x != 1, 1);
                const WriteReport report =
                    write_exr(folder / "a.exr", volume, Precision::full, packing);
                expect_equal(read_exr(folder / "a.exr"), volume);
                expect_equal(read_exr(folder / "a.json"), volume);
                if (order == 1 && dims.x == 2)
                    for (const WriteReport::File& file : report.files)
                        expect_equal(read_exr(file.path), volume);
                uint64_t bytes = 0;
                for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
                    bytes += entry.file_size();
                EXPECT_EQ(report.bytes(), bytes);
            }
}

TEST(Exr, HalfRoundTripsWithinHalfOrIsFull) {
    const TemporaryFolder folder;
    Volume volume = random_volume({7, 6, 5}, 1, true, 2);
    EXPECT_TRUE(
        write_exr(folder / "a.exr", volume, Precision::half, Packing::band).warnings.empty());
    const Volume back = read_exr(folder / "a.exr");
    for (size_t k = 0; k < 4; ++k)
        for (size_t i = 0; i < volume.grid.size(); ++i)
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(back.sh[k][i][c], volume.sh[k][i][c],
                            std::abs(volume.sh[k][i][c]) / 2048 + 1e-7);
    volume.sh[0][3].x = 1e6f;
    EXPECT_EQ(write_exr(folder / "a.exr", volume, Precision::half, Packing::band).warnings.size(),
              1u);
    expect_equal(read_exr(folder / "a.exr"), volume);
    EXPECT_EQ(json::parse(slurp(folder / "a.json"))["precision"], "float");
}

TEST(Exr, FilesAndLayout) {
    const TemporaryFolder folder;
    const glm::ivec3 dims(4, 5, 11);
    const Volume volume = random_volume(dims, 1, true, 3);
    write_exr(folder / "scene.v2.exr", volume, Precision::full, Packing::band);
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
                                            "scene.v2_occlusion.exr", "scene.v2_validity.exr"}));
    // Slice 6 is the third tile of the second row.
    const Pixels l1z = read_pixels(folder / "scene.v2_sh_l1_z.exr");
    EXPECT_EQ(l1z.width, 16);
    EXPECT_EQ(l1z.height, 15);
    const glm::ivec3 cell(3, 2, 6);
    const size_t texel = size_t(5 + 2) * 16 + 8 + 3;
    for (size_t c = 0; c < 3; ++c)
        EXPECT_EQ(l1z.samples[texel * 3 + c], volume.sh[2][volume.grid.index(cell)][int(c)]);
    // The twelfth tile holds no slice.
    EXPECT_EQ(l1z.samples.back(), 0.0f);

    write_exr(folder / "c.exr", volume, Precision::full, Packing::channel);
    const Pixels green = read_pixels(folder / "c_g.exr");
    EXPECT_EQ(green.channels, 4);
    const Pixels occlusion = read_pixels(folder / "c_occlusion.exr");
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
        write_exr(folder / "a.exr", volume, Precision::half, Packing::band);
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
    const Error error = error_of(
        "b.exr", [&] { write_exr(folder / "b.exr", wide, Precision::half, Packing::band); });
    EXPECT_EQ(error.code, ExitCode::unsupported);
    EXPECT_NE(std::string(error.what()).find("write .vdb"), std::string::npos);
}

TEST(Exr, OpensInOiiotool) {
    const TemporaryFolder folder;
    write_exr(folder / "a.exr", random_volume({7, 6, 5}, 1, true, 4), Precision::half,
              Packing::channel);
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
        write_exr(folder / "a.exr", volume, Precision::half, Packing::channel);
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
                       [&] { write_exr(folder / "a.exr", volume, Precision::half, Packing::band); })
                  .code,
              ExitCode::failure);
    EXPECT_EQ(error_of("a.exr",
                       [&] {
                           write_exr(folder / "a.exr", random_volume({3, 3, 3}, 4, false, 6),
                                     Precision::half, Packing::channel);
                       })
                  .code,
              ExitCode::unsupported);
    EXPECT_EQ(folder.count(), 0);
}

TEST(Exr, RejectsDamagedFiles) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.json";
    write_exr(folder / "a.exr", random_volume({4, 5, 6}, 1, true, 7), Precision::full,
              Packing::band);
    const json good = json::parse(slurp(path));
    const auto code = [&](const std::string& bytes) {
        spill(path, bytes);
        return error_of("a", [&] { read_exr(folder / "a.exr"); }).code;
    };
    const std::string text = good.dump();
    for (size_t length = 0; length < text.size(); length += 31)
        EXPECT_EQ(code(text.substr(0, length)), ExitCode::invalid);
    EXPECT_EQ(code(std::string(100000, '[')), ExitCode::invalid);
    const auto changed = [&](const char* pointer, const json& value) {
        json bad = good;
        bad[json::json_pointer(pointer)] = value;
        return code(bad.dump());
    };
    EXPECT_EQ(changed("/format", "x"), ExitCode::invalid);
    EXPECT_EQ(changed("/version", 2), ExitCode::invalid);
    EXPECT_EQ(changed("/convention", "lightmap"), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/dims", {4, 5}), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/dims/2", 1e300), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/dims/2", 7), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/dims/0", 0), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/dims", {2000000000, 2000000000, 2000000000}), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/cell", -1), ExitCode::invalid);
    EXPECT_EQ(changed("/grid/cell", "x"), ExitCode::invalid);
    EXPECT_EQ(changed("/sh_order", 5), ExitCode::invalid);
    EXPECT_EQ(changed("/sh_order", 0), ExitCode::invalid);
    EXPECT_EQ(changed("/sh_order", 3), ExitCode::invalid);
    EXPECT_EQ(changed("/layout/columns", 1), ExitCode::invalid);
    EXPECT_EQ(changed("/layout/columns", 2000000000), ExitCode::invalid);
    EXPECT_EQ(changed("/files/0/file", "../a_sh_l0.exr"), ExitCode::invalid);
    EXPECT_EQ(changed("/files/0/file", "none.exr"), ExitCode::file);
    EXPECT_EQ(changed("/files/0/channels/0", "sh_l0.g"), ExitCode::invalid);
    EXPECT_EQ(changed("/files/0/channels", json::array()), ExitCode::invalid);
    EXPECT_EQ(changed("/files", json::array()), ExitCode::invalid);
    EXPECT_EQ(changed("/metadata", {{"a", 1}}), ExitCode::invalid);

    spill(path, text);
    const std::string picture = slurp(folder / "a_sh_l0.exr");
    for (size_t length = 0; length < picture.size(); length += 211) {
        spill(folder / "a_sh_l0.exr", picture.substr(0, length));
        EXPECT_EQ(error_of("a_sh_l0.exr", [&] { read_exr(folder / "a.exr"); }).code,
                  ExitCode::invalid);
    }
    std::filesystem::remove(path);
    EXPECT_EQ(error_of("a.json", [&] { read_exr(folder / "a.exr"); }).code, ExitCode::file);
}
