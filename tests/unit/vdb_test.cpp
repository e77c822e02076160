// OpenVDB files: round trips, what other readers see, bytes, and rejections.
#include "io/vdb.h"

#include "io/io.h"
#include "unit/volumes.h"
#include "volume/grids.h"

#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>

using namespace lpvbake;

namespace {

const std::string reader =
    "/usr/bin/python3 -c \"import pyopenvdb as vdb, sys\nfile = sys.argv[1]\n";

/// The same with 16 x 16 x 16 equal cells, and as many without light.
Volume with_uniform_part(Volume volume) {
    for (int z = 8; z < 24; ++z)
        for (int y = 8; y < 24; ++y)
            for (int x = 8; x < 40; ++x) {
                const size_t cell = volume.grid.index({x, y, z});
                for (const volume::GridView& grid : volume::grids_of(volume)) {
                    const auto width = size_t(grid.kind->width());
                    std::fill_n(grid.data + width * cell, width, x < 24 ? 0.25f : 0.0f);
                }
            }
    return volume;
}

/// The file, read and written by OpenVDB itself, leaf by leaf, under the UUID of the file.
std::string rewritten(const std::string& path, const Volume& volume) {
    openvdb::initialize();
    openvdb::io::File file(path);
    file.open(/*delayLoad=*/false);
    std::vector<std::string> names;
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        names.push_back(grid.name());
    names.emplace_back("density");
    openvdb::GridPtrVec grids;
    for (const std::string& name : names)
        grids.push_back(file.readGrid(name));
    openvdb::io::File(path + ".again.vdb").write(grids, *file.getMetadata());
    std::string bytes = slurp(path + ".again.vdb");
    return bytes.replace(21, 36, file.getUniqueTag());
}

/// Half has 11 significant bits, and a spacing of 2^-24 near zero.
void expect_half(float expected, float found) {
    EXPECT_NEAR(found, expected, std::abs(expected) / 2048 + 1.0f / (1 << 25));
}

} // namespace

TEST(Vdb, FullPrecisionRoundTripsExactly) {
    const TemporaryFolder folder;
    for (int order : {0, 1, 2, 4})
        for (bool occlusion : {false, true})
            for (glm::ivec3 dims : {glm::ivec3(1), glm::ivec3(7, 13, 9), glm::ivec3(33, 1, 2)}) {
                const Volume volume =
                    random_volume(dims, order, occlusion, unsigned(order + dims.x));
                const std::string path = folder / "a.vdb";
                const WriteReport report = io::write_volume(path, volume, Precision::full);
                EXPECT_TRUE(report.warnings.empty());
                EXPECT_EQ(report.bytes(), std::filesystem::file_size(path));
                expect_equal(io::read_vdb(path), volume);
            }
    EXPECT_EQ(folder.count(), 1);
}

TEST(Vdb, AbsentValidityStaysAbsent) {
    const TemporaryFolder folder;
    Volume volume = random_volume({4, 5, 6}, 1, false, 1);
    volume.validity.clear();
    io::write_volume(folder / "a.vdb", volume, Precision::full);
    expect_equal(io::read_vdb(folder / "a.vdb"), volume);
}

TEST(Vdb, HalfRoundTripsWithinHalf) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({33, 40, 29}, 1, true, 2);
    const WriteReport full = io::write_volume(folder / "full.vdb", volume, Precision::full);
    const WriteReport halved = io::write_volume(folder / "half.vdb", volume, Precision::half);
    EXPECT_TRUE(halved.warnings.empty());
    EXPECT_LT(double(halved.bytes()), 0.7 * double(full.bytes()));
    const Volume back = io::read_vdb(folder / "half.vdb");
    for (size_t i = 0; i < volume.grid.size(); ++i) {
        for (size_t k = 0; k < 4; ++k) {
            for (int c = 0; c < 3; ++c)
                expect_half(volume.sh[k][i][c], back.sh[k][i][c]);
            expect_half(volume.occlusion[k][i], back.occlusion[k][i]);
        }
        EXPECT_EQ(back.validity[i], volume.validity[i]);
    }
}

TEST(Vdb, HalfThatDoesNotFitIsWrittenInFull) {
    const TemporaryFolder folder;
    Volume volume = random_volume({5, 5, 5}, 1, false, 3);
    volume.sh[2][17] = {0, -65505, 0};
    const WriteReport report = io::write_volume(folder / "a.vdb", volume, Precision::half);
    ASSERT_EQ(report.warnings.size(), 1u);
    EXPECT_NE(report.warnings[0].find("sh_l1_z reaches 65505"), std::string::npos)
        << report.warnings[0];
    expect_equal(io::read_vdb(folder / "a.vdb"), volume);
    volume.sh[2][17] = {0, -65504, 0};
    EXPECT_TRUE(io::write_volume(folder / "a.vdb", volume, Precision::half).warnings.empty());
    const Volume dim = random_volume({5, 5, 5}, 1, false, 3, 1e-7f);
    EXPECT_EQ(io::write_volume(folder / "dim.vdb", dim, Precision::half).warnings.size(), 1u);
    expect_equal(io::read_vdb(folder / "dim.vdb"), dim);
}

TEST(Vdb, BytesDependOnContentAlone) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({40, 17, 23}, 1, true, 4);
    const auto bytes = [&](int threads, const Volume& what, Precision precision) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                        size_t(threads));
        const std::string path = folder / ("t" + std::to_string(threads) + ".vdb");
        io::write_volume(path, what, precision);
        return slurp(path);
    };
    // Leaves are written 128 together. Here are 45, and 180 with uniform ones.
    for (const Volume& what : {volume, with_uniform_part(random_volume({47, 34, 45}, 1, true, 5))})
        for (const Precision precision : {Precision::full, Precision::half}) {
            const std::string alone = bytes(1, what, precision);
            for (const int threads : {2, 3, 4})
                EXPECT_TRUE(alone == bytes(threads, what, precision)) << threads;
            EXPECT_TRUE(alone == rewritten(folder / "t1.vdb", what)) << "not as OpenVDB has it";
        }
    const std::string one = bytes(1, volume, Precision::full);
    Volume other = volume;
    other.metadata["solver"] = "some";
    const std::string two = bytes(1, other, Precision::full);
    EXPECT_NE(one.substr(21, 36), two.substr(21, 36)) << "different files share a UUID";
    // 8-4-4-4-12 hexadecimal digits, version 8, variant 1.
    const std::string uuid = one.substr(21, 36);
    EXPECT_EQ(uuid.find_first_not_of("0123456789abcdef-"), std::string::npos);
    EXPECT_EQ(uuid[8], '-');
    EXPECT_EQ(uuid[14], '8');
    EXPECT_NE(std::string("89ab").find(uuid[19]), std::string::npos);
}

TEST(Vdb, OpensInVdbPrint) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.vdb";
    io::write_volume(path, random_volume({7, 13, 9}, 1, true, 5), Precision::full);
    const std::string text = output_of("vdb_print -l -m " + path);
    for (const char* expected : {"sh_l0",
                                 "sh_l1_y",
                                 "sh_l1_z",
                                 "sh_l1_x",
                                 "occlusion_l0",
                                 "occlusion_l1_y",
                                 "occlusion_l1_z",
                                 "occlusion_l1_x",
                                 "validity",
                                 "wall_0",
                                 "lpv:units: cells",
                                 "density",
                                 "lpv:convention",
                                 "radiance",
                                 "lpv:solver",
                                 "vector_type: invariant",
                                 "class: fog volume",
                                 "lpv:units: cd/m^2",
                                 "lpv:grid_dims: [7, 13, 9]",
                                 "lpv:probe_position: center",
                                 "lpv:axes: gltf",
                                 "lpv:direction: incident",
                                 "lpv:quantity: luminance",
                                 "lpv:cell_size: 0.1"})
        EXPECT_NE(text.find(expected), std::string::npos) << expected << " not in\n" << text;
}

// OpenVDB's own Python module is the oracle of values, places and activity.
TEST(Vdb, OpensInPython) {
    const TemporaryFolder folder;
    Volume volume = random_volume({3, 4, 5}, 1, false, 6);
    // One cell each: valid but black; inside but lit; inside and black.
    const size_t valid = volume.grid.index({0, 0, 0}), lit = volume.grid.index({1, 0, 0}),
                 black = volume.grid.index({2, 0, 0});
    for (size_t i : {valid, lit, black}) {
        for (auto& cells : volume.sh)
            cells[i] = glm::vec3(0);
        for (auto& cells : volume.walls)
            cells[i] = glm::vec3(0);
        volume.validity[i] = 0;
    }
    volume.validity[valid] = 1;
    volume.sh[3][lit] = {0, 0, 4};
    volume.sh[0][volume.grid.index({2, 3, 4})] = {1, 2, 3};
    const std::string path = folder / "a.vdb";
    io::write_volume(path, volume, Precision::full);
    EXPECT_EQ(output_of(reader + R"(
grids = {g.name: g for g in vdb.readAllGridMetadata(file)}
print(sorted(grids))
for name in ('sh_l0', 'sh_l1_x', 'density', 'validity'):
    grid = vdb.read(file, name)
    access = grid.getConstAccessor()
    print(name, [access.isValueOn((x, 0, 0)) for x in (0, 1, 2)])
x = vdb.read(file, 'sh_l1_x').getConstAccessor()
print(x.getValue((1, 0, 0)))
l0 = vdb.read(file, 'sh_l0')
print(l0.getConstAccessor().getValue((2, 3, 4)))
print([round(v, 9) for v in l0.transform.indexToWorld((0, 0, 0))], [round(v, 9) for v in l0.transform.voxelSize()])
print('%.5f' % vdb.read(file, 'density').getConstAccessor().getValue((2, 3, 4)))
print(l0.gradientSize if hasattr(l0, 'gradientSize') else l0.vectorType)
" )" + path),
              "['density', 'sh_l0', 'sh_l1_x', 'sh_l1_y', 'sh_l1_z', 'validity', 'wall_0', "
              "'wall_1']\n"
              "sh_l0 [True, True, False]\n"
              "sh_l1_x [True, True, False]\n"
              "density [True, True, False]\n"
              "validity [True, True, False]\n"
              "(0.0, 0.0, 4.0)\n"
              "(1.0, 2.0, 3.0)\n"
              "[-1.05, 2.35, 0.75] [0.1, 0.1, 0.1]\n"
              // (0.2126 + 2 * 0.7152 + 3 * 0.0722) / (2 sqrt(pi))
              "0.52458\n"
              "invariant\n");
}

TEST(Vdb, EmptySpaceCostsNothing) {
    const TemporaryFolder folder;
    Volume volume;
    volume.grid = {{0, 0, 0}, 1, {64, 64, 64}};
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size()));
    volume.validity.assign(volume.grid.size(), 0);
    const uint64_t none = io::write_volume(folder / "a.vdb", volume, Precision::full).bytes();
    EXPECT_LT(none, 20000u);
    expect_equal(io::read_vdb(folder / "a.vdb").sh == volume.sh ? volume : Volume(), volume);
    // Uniform space becomes tiles.
    volume.validity.assign(volume.grid.size(), 1);
    EXPECT_LT(io::write_volume(folder / "a.vdb", volume, Precision::full).bytes(),
              2 * none + 100000);
    EXPECT_EQ(io::read_vdb(folder / "a.vdb").validity, volume.validity);
}

TEST(Vdb, RefusesWhatIsNotAVolume) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.vdb";
    const auto refused = [&](const Volume& volume) {
        const Error error =
            error_of(path, [&] { io::write_volume(path, volume, Precision::full); });
        EXPECT_EQ(error.kind, ErrorKind::failure);
        EXPECT_EQ(folder.count(), 0);
        return std::string(error.what());
    };
    const Volume good = random_volume({3, 4, 5}, 1, true, 7);
    for (float bad : {std::numeric_limits<float>::infinity(), std::nanf("")}) {
        Volume volume = good;
        volume.sh[1][volume.grid.index({2, 1, 4})].z = bad;
        EXPECT_NE(
            refused(volume).find("grid sh_l1_y has a value that is not finite in cell (2, 1, 4)"),
            std::string::npos);
        volume = good;
        volume.occlusion[3][0] = bad;
        EXPECT_NE(refused(volume).find("occlusion_l1_x"), std::string::npos);
        volume = good;
        volume.validity[0] = bad;
        refused(volume);
        volume = good;
        volume.walls[1][0].z = bad;
        EXPECT_NE(refused(volume).find("wall_1"), std::string::npos);
        volume = good;
        volume.grid.origin.y = bad;
        refused(volume);
    }
    Volume volume = good;
    volume.sh.pop_back();
    refused(volume);
    volume = good;
    volume.sh[2].pop_back();
    refused(volume);
    volume = good;
    volume.occlusion.pop_back();
    refused(volume);
    volume = good;
    volume.walls.resize(4, volume.walls[0]);
    refused(volume);
    volume = good;
    volume.grid.dims = {0, 4, 5};
    refused(volume);
}

TEST(Vdb, RejectsDamagedFiles) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.vdb";
    io::write_volume(path, random_volume({5, 6, 7}, 1, false, 8), Precision::full);
    const std::string good = slurp(path);
    const auto kind = [&](const std::string& bytes) {
        spill(path, bytes);
        return error_of(path, [&] { io::read_vdb(path); }).kind;
    };
    for (size_t length = 0; length < good.size(); length += 997)
        EXPECT_EQ(kind(good.substr(0, length)), ErrorKind::invalid) << length;
    EXPECT_EQ(kind(good.substr(0, good.size() - 1)), ErrorKind::invalid);
    EXPECT_EQ(kind(good + '\0'), ErrorKind::invalid);
    for (size_t at = 0; at < good.size(); at += 331) {
        std::string bad = good;
        bad[at] = char(bad[at] ^ 0x10);
        EXPECT_EQ(kind(bad), ErrorKind::invalid) << at;
    }
    EXPECT_EQ(kind(std::string(5000, 'x')), ErrorKind::invalid);
    std::filesystem::remove(path);
    EXPECT_EQ(error_of(path, [&] { io::read_vdb(path); }).kind, ErrorKind::file);
    std::filesystem::create_directory(path);
    EXPECT_EQ(error_of(path, [&] { io::read_vdb(path); }).kind, ErrorKind::file);
    EXPECT_EQ(
        error_of(path,
                 [&] {
                     io::write_volume(path, random_volume({2, 2, 2}, 0, false, 1), Precision::full);
                 })
            .kind,
        ErrorKind::file);
}

TEST(Vdb, RejectsFilesOfOthers) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.vdb";
    output_of(reader
              + "grid = vdb.FloatGrid()\ngrid.fill((0,0,0), (3,3,3), 1.0)\ngrid.name = 'sh_l0'\n"
                "vdb.write(file, grids=[grid])\" "
              + path);
    const Error error = error_of(path, [&] { io::read_vdb(path); });
    EXPECT_EQ(error.kind, ErrorKind::invalid);
    EXPECT_NE(std::string(error.what()).find("not written by lpvbake"), std::string::npos);
}

TEST(Io, DispatchesOnTheExtension) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({3, 4, 5}, 1, true, 9);
    for (const char* name : {"a.vdb", "b.VDB", "c.exr", "d.Exr"}) {
        io::write_volume(folder / name, volume, Precision::full);
        expect_equal(read_volume(folder / name), volume);
    }
    for (const char* name : {"a.png", "a", "vdb"}) {
        const Error error =
            error_of(name, [&] { io::write_volume(folder / name, volume, Precision::full); });
        EXPECT_EQ(error.kind, ErrorKind::argument);
        EXPECT_NE(std::string(error.what()).find(".vdb, .nvdb, .exr, .ktx2, .dds, .glb or .tres"),
                  std::string::npos);
        EXPECT_EQ(error_of(name, [&] { read_volume(folder / name); }).kind, ErrorKind::argument);
    }
}
