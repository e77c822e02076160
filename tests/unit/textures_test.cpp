// 3D textures: KTX2 and DDS.
#include "io/dds.h"
#include "io/io.h"
#include "io/ktx2.h"
#include "unit/volumes.h"
#include "volume/compare.h"

#include <Imath/half.h>
#include <nlohmann/json.hpp>
#include <tbb/global_control.h>
#include <zstd.h>

#include <bit>
#include <cmath>
#include <cstring>

using namespace lpvbake;
using nlohmann::json;

namespace {

template <class Number>
Number at(const std::string& bytes, size_t offset) {
    Number value;
    std::memcpy(&value, &bytes.at(offset + sizeof value - 1) + 1 - sizeof value, sizeof value);
    return value;
}

constexpr size_t dds_head = 148;

/// The texels of the one level.
std::string texels_of_ktx2(const std::string& bytes) {
    std::string texels(at<uint64_t>(bytes, 96), '\0');
    EXPECT_EQ(ZSTD_decompress(texels.data(), texels.size(), &bytes[at<uint64_t>(bytes, 80)],
                              at<uint64_t>(bytes, 88)),
              texels.size());
    return texels;
}

/// Light of a room: the mean rises along x, all else is at most `share` of it.
Volume smooth_volume(glm::ivec3 dims, int order, float share, float scale = 100) {
    Volume volume = random_volume(dims, order, false, 7);
    for (size_t i = 0; i < volume.grid.size(); ++i) {
        const glm::vec3 at = glm::vec3(volume.grid.cell_at(i)) / glm::vec3(dims);
        volume.sh[0][i] = scale * glm::vec3(1 + at.x, 1.5f + at.x * at.y, 0.5f + at.z);
        for (size_t k = 1; k < volume.sh.size(); ++k)
            volume.sh[k][i] =
                share * std::sin(3 * at.x + 2 * at.y + 4 * at.z + float(k)) * volume.sh[0][i];
    }
    return volume;
}

/// Light without a sign.
Volume bright_volume(glm::ivec3 dims, int order, unsigned seed) {
    Volume volume = random_volume(dims, order, false, seed);
    for (glm::vec3& c : volume.sh[0])
        c = glm::abs(c);
    return volume;
}

const char* const extensions[] = {".ktx2", ".dds"};

} // namespace

TEST(Textures, FullPrecisionRoundTripsExactly) {
    for (const char* extension : extensions)
        for (const glm::ivec3 dims : {glm::ivec3(1), glm::ivec3(7, 13, 9), glm::ivec3(33, 1, 2)})
            for (const int order : {0, 1, 2, 4})
                for (const io::Packing packing :
                     {io::Packing::band, io::Packing::channel, io::Packing::atlas}) {
                    if (packing != io::Packing::band && (order == 0 || order == 4))
                        continue;
                    const TemporaryFolder folder;
                    const std::string path = folder / "a.b" + extension;
                    Volume volume = random_volume(dims, order, dims.x != 1, 1);
                    const WriteReport report =
                        io::write_volume(path, volume, Precision::full, {packing});
                    uint64_t bytes = 0;
                    for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
                        bytes += entry.file_size();
                    EXPECT_EQ(report.bytes(), bytes);
                    if (packing == io::Packing::atlas) {
                        volume.occlusion.clear();
                        volume.validity.clear();
                        volume.walls.clear();
                    }
                    expect_equal(io::read_volume(path, volume::grid_kinds()), volume);
                    for (const WriteReport::File& file : report.files)
                        if (dims.x == 7)
                            expect_equal(read_volume(file.path), volume);
                }
}

TEST(Textures, BothHoldTheSameTexels) {
    const Volume volume = bright_volume({5, 4, 3}, 2, 2);
    for (const io::Packing packing : {io::Packing::band, io::Packing::cube, io::Packing::channel})
        for (const Precision precision : {Precision::full, Precision::half, Precision::rgb9e5}) {
            if (precision == Precision::rgb9e5 && packing == io::Packing::channel)
                continue;
            const TemporaryFolder folder;
            const WriteReport ktx2 =
                io::write_volume(folder / "a.ktx2", volume, precision, {packing});
            const WriteReport dds =
                io::write_volume(folder / "a.dds", volume, precision, {packing});
            EXPECT_TRUE(ktx2.warnings.empty());
            ASSERT_EQ(ktx2.files.size() + 1, dds.files.size());
            for (size_t f = 0; f < ktx2.files.size(); ++f) {
                const std::string a = texels_of_ktx2(slurp(ktx2.files[f].path));
                EXPECT_FALSE(a.empty());
                EXPECT_EQ(a, slurp(dds.files[f].path).substr(dds_head)) << ktx2.files[f].path;
            }
        }
}

TEST(Textures, TexelsAreCellsInOrder) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({5, 4, 3}, 1, false, 3);
    io::write_volume(folder / "a.dds", volume, Precision::full, {io::Packing::band});
    const std::string colours = slurp(folder / "a_sh_l1_z.dds"),
                      numbers = slurp(folder / "a_validity.dds");
    for (size_t i = 0; i < volume.grid.size(); ++i) {
        for (int c = 0; c < 3; ++c)
            EXPECT_EQ(at<float>(colours, dds_head + 16 * i + 4 * size_t(c)), volume.sh[2][i][c]);
        EXPECT_EQ(at<float>(colours, dds_head + 16 * i + 12), 1.0f); // no alpha
        EXPECT_EQ(at<float>(numbers, dds_head + 4 * i), volume.validity[i]);
    }
    io::write_volume(folder / "b.dds", volume, Precision::half, {io::Packing::channel});
    const std::string green = slurp(folder / "b_g.dds");
    const size_t cell = volume.grid.index({3, 2, 1}), coefficients[] = {0, 1, 2, 3};
    for (const size_t k : coefficients)
        EXPECT_EQ(at<uint16_t>(green, dds_head + 8 * cell + 2 * k),
                  Imath::half(volume.sh[k][cell].g).bits());
}

TEST(Textures, HeadersAreAsTheirSpecificationsSay) {
    const TemporaryFolder folder;
    const Volume volume = bright_volume({5, 4, 3}, 1, 4);
    // Vulkan's and DXGI's numbers of R16F, RGBA16F and RGB9E5, size of a scalar, bytes of a texel.
    const struct {
        const char* name;
        Precision precision;
        uint32_t vulkan, dxgi, scalar, texel, samples;
    } cases[] = {{"validity", Precision::half, 76, 54, 2, 2, 1},
                 {"sh_l0", Precision::half, 97, 10, 2, 8, 4},
                 {"validity", Precision::full, 100, 41, 4, 4, 1},
                 {"sh_l0", Precision::full, 109, 2, 4, 16, 4},
                 {"sh_l0", Precision::rgb9e5, 123, 67, 4, 4, 6}};
    for (const auto& [name, precision, vulkan, dxgi, scalar, texel, samples] : cases) {
        for (const char* extension : extensions)
            io::write_volume(folder / "a" + extension, volume, precision, {io::Packing::band});
        const std::string ktx2 = slurp(folder / "a_" + name + ".ktx2");
        EXPECT_EQ(ktx2.substr(0, 12), std::string("\xABKTX 20\xBB\r\n\x1A\n", 12));
        const uint32_t descriptor = 4 + 24 + 16 * samples;
        const uint32_t words[] = {vulkan, scalar, 5, 4,   3,          0,
                                  1,      1,      2, 104, descriptor, 104 + descriptor};
        for (size_t i = 0; i < std::size(words); ++i)
            EXPECT_EQ(at<uint32_t>(ktx2, 12 + 4 * i), words[i]) << name << ' ' << i;
        EXPECT_EQ(at<uint32_t>(ktx2, 104), descriptor);
        EXPECT_EQ(at<uint32_t>(ktx2, 124), texel);
        const uint32_t pairs = at<uint32_t>(ktx2, 60);
        EXPECT_EQ(at<uint64_t>(ktx2, 80), 104 + descriptor + pairs);
        EXPECT_EQ(at<uint64_t>(ktx2, 80) + at<uint64_t>(ktx2, 88), ktx2.size());
        EXPECT_EQ(at<uint64_t>(ktx2, 96), 5 * 4 * 3 * texel);

        const std::string dds = slurp(folder / "a_" + name + ".dds");
        EXPECT_EQ(dds.substr(0, 4), "DDS ");
        const std::pair<size_t, uint32_t> fields[] = {
            {4, 124},      {8, 0x80100f},   {12, 4},     {16, 5},  {20, 5 * texel},
            {24, 3},       {28, 1},         {76, 32},    {80, 4},  {84, 0x30315844},
            {108, 0x1008}, {112, 0x200000}, {128, dxgi}, {132, 4}, {140, 1}};
        for (const auto& [offset, value] : fields)
            EXPECT_EQ(at<uint32_t>(dds, offset), value) << name << ' ' << offset;
        EXPECT_EQ(dds.size(), dds_head + 5 * 4 * 3 * texel);
    }
}

TEST(Textures, Unorm8IsLightOverItsMean) {
    for (const int order : {0, 1, 2, 4})
        for (const float scale : {100.0f, 1e6f, 1e-6f}) {
            const TemporaryFolder folder;
            const Volume volume = smooth_volume({9, 6, 5}, order, 0.7f, scale);
            const io::Pictures ratio{io::Packing::ratio};
            const WriteReport ktx2 =
                io::write_volume(folder / "a.ktx2", volume, Precision::unorm8, ratio);
            const WriteReport dds =
                io::write_volume(folder / "a.dds", volume, Precision::unorm8, ratio);
            EXPECT_TRUE(ktx2.warnings.empty());
            for (size_t f = 0; f < ktx2.files.size(); ++f)
                EXPECT_EQ(texels_of_ktx2(slurp(ktx2.files[f].path)),
                          slurp(dds.files[f].path).substr(dds_head));

            // As the description tells a shader to: texel of a ratio, times the mean.
            const json described = json::parse(slurp(folder / "a.dds.json"));
            uint64_t light = 0;
            for (const json& file : described["files"]) {
                if (!file.contains("low"))
                    continue;
                const std::string texels =
                    slurp(folder / file["file"].get<std::string>()).substr(dds_head);
                light += texels.size() / volume.grid.size();
                for (size_t c = 0; c < file["channels"].size(); ++c) {
                    const std::string name = file["channels"][c];
                    const double low = file["low"][c], step = (double(file["high"][c]) - low) / 255;
                    size_t k = 0;
                    while (!name.starts_with(volume::grid_name(volume::light_kind(), int(k)) + "."))
                        ++k;
                    const auto colour = glm::length_t(std::string("rgb").find(name.back()));
                    for (size_t i = 0; k > 0 && i < volume.grid.size(); ++i) {
                        if (!volume.is_valid(i))
                            continue;
                        const double mean = volume.sh[0][i][colour],
                                     is = (low + step * uint8_t(texels[4 * i + c])) * mean;
                        EXPECT_NEAR(is, volume.sh[k][i][colour], (0.52 * step + 0.006) * mean);
                    }
                }
            }
            EXPECT_EQ(light, order == 0 ? 4u : order == 1 ? 16u : order == 2 ? 28u : 76u);

            // What is told is what diff finds.
            const Volume back = io::read_volume(folder / "a.ktx2", volume::grid_kinds());
            ASSERT_TRUE(ktx2.packing);
            EXPECT_DOUBLE_EQ(ktx2.packing->cells,
                             volume::compare(back, volume, {{}, 0}).relative_l1);
            EXPECT_GT(ktx2.packing->cells, 0);
            EXPECT_LT(ktx2.packing->cells, 0.006);
            EXPECT_LT(ktx2.packing->filtered, 0.02);
            EXPECT_NEAR(std::stod(back.metadata.at("packing_error")), ktx2.packing->cells, 1e-5);
            // Packed again, errors add up.
            io::write_volume(folder / "b.ktx2", back, Precision::unorm8, ratio);
            EXPECT_GE(std::stod(read_volume(folder / "b.ktx2").metadata.at("packing_error")),
                      std::stod(back.metadata.at("packing_error")));
        }
}

TEST(Textures, Unorm8TellsWhatItCannotHold) {
    const TemporaryFolder folder;
    const io::Pictures ratio{io::Packing::ratio};
    Volume volume = smooth_volume({8, 8, 8}, 2, 0.5f);
    const auto error = [&] {
        return io::write_volume(folder / "a.ktx2", volume, Precision::unorm8, ratio).packing->cells;
    };
    const double usual = error();
    // Some cells have a ratio of their own: their range costs all others less than it would cost
    // them, so that they are clipped.
    for (size_t i = 0; i < 3; ++i)
        volume.sh[1][200 + i] = glm::vec3(1e4f);
    volume.validity.assign(volume.grid.size(), 1.0f);
    const double outliers = error();
    EXPECT_GT(outliers, usual);
    // A mean below 0 becomes 0, with all of the cell's light.
    for (size_t i = 0; i < volume.grid.size(); i += 4)
        volume.sh[0][i] *= -1;
    EXPECT_GT(error(), 10 * usual);
    const Volume back = read_volume(folder / "a.ktx2");
    for (const glm::vec3& mean : back.sh[0])
        EXPECT_GE(mean.r, 0);
    // What is no light is half, and has to fit that.
    volume.walls[0][0].x = 1e5f;
    EXPECT_EQ(error_of("a.ktx2", error).kind, ErrorKind::unsupported);
    volume.walls.clear();
    for (const auto& [name, precision, packing] :
         {std::tuple("a.vdb", Precision::unorm8, io::Packing::ratio),
          {"a.exr", Precision::unorm8, io::Packing::ratio},
          {"a.exr", Precision::half, io::Packing::ratio},
          {"a.ktx2", Precision::half, io::Packing::ratio},
          {"a.ktx2", Precision::unorm8, io::Packing::channel},
          {"a.ktx2", Precision::bc6h, io::Packing::band},
          {"a.dds", Precision::half, io::Packing::block},
          {"a.exr", Precision::bc6h, io::Packing::block}}) {
        const std::string path = folder / name;
        const auto write = [&] {
            io::write_volume(path, volume, precision, {packing});
            return 0;
        };
        EXPECT_EQ(error_of(name, write).kind, ErrorKind::argument) << name;
    }
}

TEST(Textures, Bc6hIsBlocksOverABase) {
    const io::Pictures block{io::Packing::block};
    for (const glm::ivec3 dims : {glm::ivec3(8, 12, 3), glm::ivec3(9, 6, 5), glm::ivec3(1)})
        for (const int order : {0, 1, 2, 4}) {
            const TemporaryFolder folder;
            const Volume volume = smooth_volume(dims, order, 0.7f, 1e6f);
            const WriteReport ktx2 =
                io::write_volume(folder / "a.ktx2", volume, Precision::bc6h, block);
            const WriteReport dds =
                io::write_volume(folder / "a.dds", volume, Precision::bc6h, block);
            EXPECT_TRUE(ktx2.warnings.empty());
            const size_t blocks = size_t((dims.x + 3) / 4 * ((dims.y + 3) / 4) * dims.z);
            for (size_t f = 0; f < ktx2.files.size(); ++f) {
                const std::string texels = texels_of_ktx2(slurp(ktx2.files[f].path));
                EXPECT_EQ(texels, slurp(dds.files[f].path).substr(dds_head));
                if (f < volume.sh.size() + 1) { // a byte a cell
                    EXPECT_EQ(texels.size(), 16 * blocks);
                }
            }
            const json described = json::parse(slurp(folder / "a.dds.json"));
            for (const json& file : described["files"]) {
                const bool is_light = file["file"] == "a_base.dds" || file.contains("low");
                EXPECT_EQ(file.contains("texels"), is_light && (dims.x % 4 > 0 || dims.y % 4 > 0));
            }
            for (const std::string& path : {folder / "a.ktx2", folder / "a.dds"}) {
                const Volume back = io::read_volume(path, volume::grid_kinds());
                EXPECT_TRUE(back.others.empty());
                const double error = volume::compare(back, volume, {{}, 0}).relative_l1;
                EXPECT_DOUBLE_EQ(ktx2.packing->cells, error);
                EXPECT_LT(error, dims.x == 1 ? 0.003 : 0.06) << order; // few cells, steep
                EXPECT_EQ(back.walls.size(), volume.walls.size());
            }
        }
}

TEST(Textures, Bc6hHasTheHeadersOfBlocks) {
    const TemporaryFolder folder;
    for (const char* extension : extensions)
        io::write_volume(folder / "a" + extension, smooth_volume({9, 6, 5}, 1, 0.5f),
                         Precision::bc6h, {io::Packing::block});
    const struct {
        const char* name;
        uint32_t vulkan, dxgi, model, sample, upper;
    } cases[] = {{"base", 143, 95, 133, 0x80, 0x3f800000}, {"sh_l0", 145, 98, 134, 0, 0xffffffff}};
    for (const auto& [name, vulkan, dxgi, model, sample, upper] : cases) {
        const std::string ktx2 = slurp(folder / "a_" + name + ".ktx2"),
                          dds = slurp(folder / "a_" + name + ".dds");
        const uint32_t words[] = {vulkan, 1, 12, 8, 5, 0, 1, 1, 2, 104, 44, 148};
        for (size_t i = 0; i < std::size(words); ++i)
            EXPECT_EQ(at<uint32_t>(ktx2, 12 + 4 * i), words[i]) << name << ' ' << i;
        const uint32_t descriptor[] = {
            44, 0, 2 | 40 << 16, model | 0x10100, 0x0303, 16, 0, 127 << 16 | sample << 24,
            0,  0, upper};
        for (size_t i = 0; i < std::size(descriptor); ++i)
            EXPECT_EQ(at<uint32_t>(ktx2, 104 + 4 * i), descriptor[i]) << name << ' ' << i;
        const uint32_t texels = 3 * 2 * 5 * 16;
        EXPECT_EQ(at<uint64_t>(ktx2, 96), texels);
        const std::pair<size_t, uint32_t> fields[] = {
            {8, 0x881007}, {12, 8}, {16, 12}, {20, texels}, {24, 5}, {128, dxgi}, {132, 4}};
        for (const auto& [offset, value] : fields)
            EXPECT_EQ(at<uint32_t>(dds, offset), value) << name << ' ' << offset;
        EXPECT_EQ(dds.size(), dds_head + texels);
    }
    // A block of a mode that is not written.
    std::string broken = slurp(folder / "a_sh_l0.dds");
    broken[dds_head + 32] = 0;
    std::ofstream(folder / "a_sh_l0.dds", std::ios::binary) << broken;
    EXPECT_EQ(error_of("a.dds", [&] { read_volume(folder / "a.dds"); }).kind, ErrorKind::invalid);
}

TEST(Textures, BlocksForgetCellsInsideGeometry) {
    // Half of each block lies in a wall and is dark: what is seen gets all of the precision, unless
    // a fit gave those cells values that programs read.
    const TemporaryFolder folder;
    Volume volume = smooth_volume({16, 16, 4}, 1, 0.5f);
    for (size_t i = 0; i < volume.grid.size(); ++i) {
        volume.validity[i] = float(volume.grid.cell_at(i).x % 4 > 1);
        for (auto& cells : volume.sh)
            cells[i] *= volume.validity[i];
    }
    const auto write = [&] {
        return io::write_volume(folder / "a.ktx2", volume, Precision::bc6h, {io::Packing::block})
            .packing->cells;
    };
    const double left_out = write();
    volume.metadata["fit"] = "generic";
    const double kept = write();
    EXPECT_LT(left_out, 0.01);
    EXPECT_LT(left_out, 0.8 * kept);
}

TEST(Textures, RangesOfOtherThanLightAreRefused) {
    const TemporaryFolder folder;
    io::write_volume(folder / "a.dds", smooth_volume({4, 4, 4}, 1, 0.5f), Precision::unorm8,
                     {io::Packing::ratio});
    const std::string path = folder / "a.dds.json";
    const json good = json::parse(slurp(path));
    const auto refused = [&](const auto& change) {
        json broken = good;
        change(broken["files"]);
        std::ofstream(path) << broken.dump();
        return error_of("a.dds", [&] { return read_volume(path); }).kind == ErrorKind::invalid;
    };
    EXPECT_TRUE(refused([](json& files) { files[1]["low"].push_back(0); }));
    EXPECT_TRUE(refused([](json& files) { files[1].erase("high"); }));
    EXPECT_TRUE(refused([](json& files) { files[1]["high"][0] = "1"; }));
    EXPECT_TRUE(refused([](json& files) { files[1]["high"][0] = 1e300; }));
    EXPECT_TRUE(refused([](json& files) {
        files.back()["low"] = files.back()["high"] = {0, 0, 0};
    }));
    std::ofstream(path) << good.dump();
    EXPECT_EQ(read_volume(path).sh.size(), 4u);
}

TEST(Textures, Rgb9e5IsTheNearestOfItsKind) {
    const TemporaryFolder folder;
    Volume volume = bright_volume({40, 25, 3}, 0, 5);
    volume.walls.clear();
    volume.sh[0][0] = {65408, 1, 0};
    volume.sh[0][1] = {0x1p-15f, 0x1p-24f, 0x1p-26f};
    volume.sh[0][2] = {1023.9f, 0.5f, 1000};
    volume.sh[0][0] = {65500, 1, 0}; // beyond what it holds
    const Precision precision = Precision::rgb9e5;
    EXPECT_TRUE(io::write_volume(folder / "a.dds", volume, precision).warnings.empty());
    const Volume back = io::read_dds(folder / "a.dds");
    EXPECT_EQ(back.sh[0][0], glm::vec3(65408, 0, 0));
    for (size_t i = 1; i < volume.grid.size(); ++i) {
        const glm::vec3 &is = back.sh[0][i], was = volume.sh[0][i];
        // Half of a step; the largest colour has 9 digits, or is rounded up to the next power of 2.
        const float most = std::max({was.x, was.y, was.z, 0x1p-16f});
        const float step = std::exp2(float(std::ilogb(most * 513 / 512.0f) + 1 - 9));
        for (int c = 0; c < 3; ++c)
            EXPECT_LE(std::abs(is[c] - was[c]), step / 2) << i << ' ' << most;
    }
    // It has no sign, and a range.
    for (const auto& [value, kept] : {std::pair(-1.0f, Precision::half), {7e4f, Precision::full}}) {
        volume.sh[0][5].g = value;
        const WriteReport report = io::write_volume(folder / "b.ktx2", volume, precision);
        EXPECT_EQ(report.precision, kept);
        EXPECT_EQ(report.warnings.size(), 1u);
        EXPECT_EQ(io::read_ktx2(folder / "b.ktx2").sh[0][5].g, value);
    }
    const auto refused = [&](const char* name, io::Packing packing) {
        return error_of(name,
                        [&] { io::write_volume(folder / name, volume, precision, {packing}); })
            .kind;
    };
    for (const char* name : {"c.vdb", "c.exr"})
        EXPECT_EQ(refused(name, io::Packing::band), ErrorKind::argument);
    EXPECT_EQ(refused("c.ktx2", io::Packing::atlas), ErrorKind::argument);
}

TEST(Textures, BytesDependOnContentAlone) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({20, 17, 13}, 1, true, 6);
    for (const char* extension : extensions) {
        std::vector<std::string> once;
        for (const size_t threads : {1u, 4u}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            const WriteReport report =
                io::write_volume(folder / "a" + extension, volume, Precision::half);
            std::vector<std::string> all;
            for (const WriteReport::File& file : report.files)
                all.push_back(slurp(file.path));
            if (once.empty())
                once = all;
            EXPECT_TRUE(once == all) << extension << ' ' << threads;
        }
    }
}

TEST(Textures, OneFileMayBeRenamedAndManyBelongTogether) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({4, 5, 6}, 1, false, 7);
    io::write_volume(folder / "a.ktx2", volume, Precision::full, {io::Packing::atlas});
    std::filesystem::rename(folder / "a_atlas.ktx2", folder / "of another name.ktx2");
    EXPECT_EQ(io::read_ktx2(folder / "of another name.ktx2").sh, volume.sh);

    io::write_volume(folder / "b.ktx2", volume, Precision::full, {io::Packing::band});
    Volume other = volume;
    other.metadata["solver"] = "some";
    io::write_volume(folder / "c.ktx2", other, Precision::full, {io::Packing::band});
    std::filesystem::rename(folder / "c_sh_l1_y.ktx2", folder / "b_sh_l1_y.ktx2");
    EXPECT_EQ(error_of("b_sh_l1_y", [&] { io::read_ktx2(folder / "b.ktx2"); }).kind,
              ErrorKind::invalid);
    EXPECT_EQ(error_of("c_sh_l1_y", [&] { io::read_ktx2(folder / "c.ktx2"); }).kind,
              ErrorKind::file);

    io::write_volume(folder / "d.ktx2", volume, Precision::full, {io::Packing::channel});
    io::write_volume(folder / "d.ktx2", volume, Precision::full, {io::Packing::band});
    EXPECT_EQ(error_of("d.ktx2", [&] { io::read_ktx2(folder / "d.ktx2"); }).kind,
              ErrorKind::invalid); // which of the two?
    EXPECT_EQ(io::read_ktx2(folder / "d_sh_l0.ktx2").sh, volume.sh);

    io::write_volume(folder / "e.dds", volume, Precision::full, {io::Packing::channel});
    io::write_volume(folder / "e.dds", volume, Precision::full, {io::Packing::band});
    EXPECT_EQ(error_of("e_r.dds", [&] { io::read_dds(folder / "e_r.dds"); }).kind,
              ErrorKind::invalid);
}

TEST(Textures, RefusesToWrite) {
    const TemporaryFolder folder;
    Volume wide;
    wide.grid.dims = {2049, 1, 1};
    wide.sh_order = 0;
    wide.sh.assign(1, std::vector<glm::vec3>(2049));
    for (const char* name : {"a.ktx2", "a.dds"}) {
        const auto kind = [&](const Volume& volume, io::Packing packing) {
            return error_of(
                       name,
                       [&] { io::write_volume(folder / name, volume, Precision::half, {packing}); })
                .kind;
        };
        EXPECT_EQ(kind(wide, io::Packing::band), ErrorKind::unsupported);
        EXPECT_EQ(kind(random_volume({3, 3, 3}, 4, false, 8), io::Packing::channel),
                  ErrorKind::unsupported);
        Volume bad = random_volume({3, 3, 3}, 1, false, 8);
        bad.sh[0][0].x = std::nanf("");
        EXPECT_EQ(kind(bad, io::Packing::band), ErrorKind::failure);
    }
    EXPECT_EQ(folder.count(), 0);
}

TEST(Textures, RejectsDamagedFiles) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({4, 5, 6}, 1, false, 9);
    for (const char* extension : extensions) {
        const std::string path = folder / "a_r" + extension;
        io::write_volume(folder / "a" + extension, volume, Precision::full, {io::Packing::channel});
        const std::string good = slurp(path);
        const auto kind = [&](const std::string& bytes) {
            spill(path, bytes);
            return error_of("a_r", [&] { read_volume(folder / "a" + extension); }).kind;
        };
        for (size_t length = 0; length < good.size(); length += 23)
            EXPECT_EQ(kind(good.substr(0, length)), ErrorKind::invalid) << length;
        // Each field of the heads at its largest and, but for those that may be 0, at 0.
        const bool is_ktx2 = std::string(extension) == ".ktx2";
        const std::vector<size_t> fields =
            is_ktx2 ? std::vector<size_t>{0, 12, 20, 24, 28, 36, 40, 44, 56, 60, 80, 88}
                    : std::vector<size_t>{0, 12, 16, 24, 84, 128, 132, 140};
        for (const size_t field : fields)
            for (const char byte : {'\0', '\xff'}) {
                std::string bad = good;
                bad.replace(field, 4, 4, byte);
                EXPECT_EQ(kind(bad), ErrorKind::invalid) << extension << ' ' << field;
            }
        std::string nan = good;
        if (!is_ktx2) {
            nan.replace(dds_head, 4, "\0\0\xc0\x7f", 4);
            spill(path, nan);
            EXPECT_EQ(error_of("a", [&] { read_volume(folder / "a.dds"); }).kind,
                      ErrorKind::invalid);
        }
    }
    // A level that would inflate to more than it should.
    io::write_volume(folder / "b.ktx2", volume, Precision::full, {io::Packing::atlas});
    std::string bytes = slurp(folder / "b_atlas.ktx2");
    const std::string zeros(1 << 20, '\0');
    std::string level(ZSTD_compressBound(zeros.size()), '\0');
    level.resize(ZSTD_compress(level.data(), level.size(), zeros.data(), zeros.size(), 1));
    const uint64_t size = level.size();
    bytes.replace(88, 8, reinterpret_cast<const char*>(&size), 8);
    bytes.replace(at<uint64_t>(bytes, 80), std::string::npos, level);
    spill(folder / "b_atlas.ktx2", bytes);
    EXPECT_EQ(error_of("b_atlas", [&] { io::read_ktx2(folder / "b_atlas.ktx2"); }).kind,
              ErrorKind::invalid);
}
