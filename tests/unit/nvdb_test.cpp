// NanoVDB files, beside OpenVDB's and as NanoVDB's own library reads them.
#include "io/io.h"
#include "io/nvdb.h"
#include "io/vdb_grids.h"
#include "unit/volumes.h"
#include "volume/grids.h"

#include <nanovdb/util/IO.h>
#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include <cstring>

using namespace lpvbake;

namespace {

/// Whether both have the same values, to the bit, and the same active cells and places.
template <class Value, class OpenGrid>
void expect_same_grid(const nanovdb::GridHandle<>& handle, const openvdb::GridBase::Ptr& base,
                      glm::ivec3 dims) {
    const auto* nano = handle.grid<Value>();
    const auto open = openvdb::gridPtrCast<OpenGrid>(base);
    ASSERT_TRUE(nano && open) << base->getName();
    EXPECT_EQ(nano->activeVoxelCount(), open->activeVoxelCount());
    const auto nano_values = nano->getAccessor();
    const auto open_values = open->getConstAccessor();
    for (int z = -1; z <= dims.z; ++z)
        for (int y = -1; y <= dims.y; ++y)
            for (int x = -1; x <= dims.x; ++x) {
                const Value a = nano_values.getValue({x, y, z});
                const auto b = open_values.getValue({x, y, z});
                EXPECT_EQ(std::memcmp(&a, &b, sizeof a), 0) << x << ' ' << y << ' ' << z;
                EXPECT_EQ(nano_values.isActive({x, y, z}), open_values.isValueOn({x, y, z}));
            }
    const auto a = nano->indexToWorld(nanovdb::Vec3d(1, 2, 3));
    const auto b = open->indexToWorld(openvdb::Vec3d(1, 2, 3));
    for (int axis = 0; axis < 3; ++axis)
        EXPECT_DOUBLE_EQ(a[axis], b[axis]);
}

/// A file's first grid, and where it begins.
size_t first_grid(const std::string& bytes) {
    return bytes.find(bytes.substr(0, 8), 8);
}

} // namespace

TEST(NanoVdb, RoundTripsExactly) {
    for (const glm::ivec3 dims :
         {glm::ivec3(1), glm::ivec3(7, 13, 9), glm::ivec3(33, 1, 2), glm::ivec3(1, 1, 4100)})
        for (const int order : {0, 1, 2}) {
            const TemporaryFolder folder;
            const Volume volume = random_volume(dims, order, dims.x != 1, 1);
            const WriteReport report = io::write_volume(folder / "a.nvdb", volume, Precision::full);
            EXPECT_EQ(report.bytes(), std::filesystem::file_size(folder / "a.nvdb"));
            EXPECT_TRUE(report.warnings.empty());
            expect_equal(read_volume(folder / "a.nvdb"), volume);
        }
}

TEST(NanoVdb, HoldsWhatTheVdbHolds) {
    const TemporaryFolder folder;
    const glm::ivec3 dims(9, 17, 5);
    Volume volume = random_volume(dims, 1, true, 2);
    for (glm::vec3& c : volume.walls[1])
        c = glm::vec3(0.25f); // blocks of one value are tiles
    for (const bool corner : {false, true}) {
        const volume::Encoding encoding{.axes = volume::Axes::unreal, .corner_index = corner};
        for (const char* name : {"a.vdb", "a.nvdb"})
            io::write_volume(folder / name, volume, Precision::full, {}, encoding);
        openvdb::io::File file(folder / "a.vdb");
        file.open();
        const auto names = nanovdb::io::readGridMetaData(folder / "a.nvdb");
        size_t count = 0;
        const openvdb::GridPtrVecPtr grids = file.getGrids();
        for (const openvdb::GridBase::Ptr& open : *grids) {
            const auto nano = nanovdb::io::readGrid(folder / "a.nvdb", open->getName());
            const glm::ivec3 turned(dims.x, dims.z, dims.y);
            if (open->isType<openvdb::FloatGrid>())
                expect_same_grid<float, openvdb::FloatGrid>(nano, open, turned);
            else
                expect_same_grid<nanovdb::Vec3f, openvdb::Vec3SGrid>(nano, open, turned);
            ++count;
        }
        EXPECT_EQ(count, names.size());
        EXPECT_EQ(count, 4 + 4 + 1 + 2 + 1u); // density too
    }
}

TEST(NanoVdb, EveryGridHasTheDescription) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({3, 4, 5}, 0, false, 3);
    io::write_volume(folder / "a.nvdb", volume, Precision::full);
    for (const char* name : {"sh_l0", "validity", "density"}) {
        const auto handle = nanovdb::io::readGrid(folder / "a.nvdb", name);
        const auto* grid = reinterpret_cast<const nanovdb::GridData*>(handle.data());
        ASSERT_EQ(grid->mBlindMetadataCount, 1u);
        const nanovdb::GridBlindMetaData* blind = grid->blindMetaData(0);
        EXPECT_STREQ(blind->mName, "lpvbake");
        const std::string text(blind->getBlindData<char>(), blind->mElementCount);
        const auto json = nlohmann::json::parse(text);
        EXPECT_EQ(json["format"], "lpvbake grids");
        EXPECT_EQ(json["grid"]["dims"], (nlohmann::json{3, 4, 5}));
        EXPECT_EQ(json["grids"]["sh_l0"]["units"], "cd/m^2");
        EXPECT_EQ(json["grids"].size(), 1 + 1 + 2 + 1u);
        EXPECT_EQ(json["metadata"]["solver"], "none");
        EXPECT_EQ(json["index_position"], "center");
    }
}

TEST(NanoVdb, ToolsOfNanoVdbFindItValid) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.nvdb";
    io::write_volume(path, random_volume({7, 6, 5}, 1, true, 4), Precision::full);
    const std::string text = output_of("nanovdb_print " + path);
    for (const char* expected : {"sh_l1_y", "Vec3f", "occlusion_l1_x", "validity", "wall_1", "FOG",
                                 "7 x 6 x 5", "contains the following 12 grids"})
        EXPECT_NE(text.find(expected), std::string::npos) << expected << " in\n" << text;
    const std::string verdict = output_of("nanovdb_validate -v " + path);
    EXPECT_NE(verdict.find("\"wall_1\": passed"), std::string::npos) << verdict;
    EXPECT_EQ(verdict.find("failed"), std::string::npos) << verdict;
    // It would say: a bit of a value, which is before what we have added to the grid.
    std::string bytes = slurp(path);
    const size_t grid = first_grid(bytes);
    int64_t end = 0;
    std::memcpy(&end, &bytes[grid + 640], sizeof end);
    bytes[grid + size_t(end) - 6] ^= 1;
    spill(path, bytes);
    EXPECT_NE(output_of("(nanovdb_validate -v " + path + "; true)").find("checksum"),
              std::string::npos);
}

TEST(NanoVdb, BytesDependOnContentAlone) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({40, 17, 23}, 1, true, 5);
    std::string once;
    for (const size_t threads : {1u, 2u, 4u}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        // What memory held before does not show.
        std::vector<std::vector<char>> litter(64, std::vector<char>(70000, char(threads)));
        litter.clear();
        io::write_volume(folder / "a.nvdb", volume, Precision::full);
        const std::string bytes = slurp(folder / "a.nvdb");
        if (once.empty())
            once = bytes;
        EXPECT_TRUE(bytes == once) << threads;
    }
}

TEST(NanoVdb, HalfIsFullAndSaysSo) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({3, 3, 3}, 1, false, 6);
    const WriteReport report = io::write_volume(folder / "a.nvdb", volume, Precision::half);
    EXPECT_EQ(report.precision, Precision::full);
    EXPECT_EQ(report.warnings.size(), 1u);
    expect_equal(read_volume(folder / "a.nvdb"), volume);
}

TEST(NanoVdb, RejectsDamagedFiles) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.nvdb";
    const Volume volume = random_volume({4, 5, 6}, 0, false, 7);
    io::write_volume(path, volume, Precision::full);
    const std::string good = slurp(path);
    const auto kind = [&](const std::string& bytes) {
        spill(path, bytes);
        return error_of("a.nvdb", [&] { read_volume(path); }).kind;
    };
    for (const size_t length : {0, 7, 15, 16, 100, 191, 200, 500, 1000, 100000})
        EXPECT_EQ(kind(good.substr(0, length)), ErrorKind::invalid) << length;
    EXPECT_EQ(kind(good.substr(0, good.size() - 1)), ErrorKind::invalid);
    const size_t grid = first_grid(good), tree = grid + sizeof(nanovdb::GridData);
    uint64_t root = 0;
    std::memcpy(&root, &good[tree + 24], 8);
    root += tree;
    using Root = nanovdb::NanoRoot<nanovdb::Vec3f>::DataType;
    const size_t tile = root + sizeof(Root);
    const size_t upper = tile + sizeof(Root::Tile);
    using Upper = nanovdb::NanoUpper<nanovdb::Vec3f>::DataType;
    // Magic, counts of grids and names; sizes; type; blind data; root; tiles; children.
    const std::pair<size_t, uint64_t> fields[] = {{0, 0},
                                                  {16, ~0ull},
                                                  {16, good.size()},
                                                  {grid, 0},
                                                  {grid + 636, 1},
                                                  {grid + 640, ~0ull},
                                                  {grid + 640, 1 << 20},
                                                  {tree + 24, ~0ull},
                                                  {tree + 24, 1},

                                                  {tile + 8, 1ull << 40},

                                                  {upper + offsetof(Upper, mTable), 1ull << 40}};
    for (const auto& [offset, value] : fields) {
        std::string bad = good;
        std::memcpy(&bad[offset], &value, 8);
        const ErrorKind found = kind(bad);
        EXPECT_EQ(found, ErrorKind::invalid) << offset << ' ' << value;
    }
    // Made by another program, which knows nothing of descriptions.
    io::write_volume(folder / "b.vdb", volume, Precision::full);
    EXPECT_EQ(
        output_of("nanovdb_convert -f " + folder / "b.vdb" + " " + folder / "b.nvdb").find("rror"),
        std::string::npos);
    EXPECT_EQ(error_of("b.nvdb", [&] { read_volume(folder / "b.nvdb"); }).kind, ErrorKind::invalid);
}
