// Tiles of a world as one volume: whose each cell is, the export, and what is refused.
#include "io/world_volume.h"

#include "io/vdb.h"
#include "unit/volumes.h"

#include <tbb/global_control.h>

#include <array>
#include <cmath>

using namespace lpvbake;

namespace {

constexpr int size = 8; ///< of a tile

/// Tiles of random cells, of which those in common differ from file to file.
class WorldVolume : public ::testing::Test {
protected:
    void add(glm::ivec3 begin, glm::ivec3 end, const char* scenario = "noon",
             Precision precision = Precision::full) {
        io::World::Row& row = world_.rows.emplace_back();
        const std::size_t i = world_.rows.size() - 1;
        row.scenario = scenario;
        row.tile = std::to_string(i);
        row.bounds = {glm::dvec3(begin) * world_.cell, glm::dvec3(end) * world_.cell};
        row.file = folder_ / (std::to_string(i) + ".vdb");
        row.hash = "hash" + std::to_string(i);
        write(i, precision);
    }
    Volume volume_of(std::size_t i) const {
        const io::World::Row& row = world_.rows[i];
        const glm::ivec3 dims(glm::round((row.bounds.hi - row.bounds.lo) / world_.cell));
        Volume volume = random_volume(dims + 2, 1, false, unsigned(i), 100);
        volume.grid.origin = row.bounds.lo - world_.cell;
        volume.grid.cell = world_.cell;
        volume.metadata["bake_hash"] = row.hash;
        volume.metadata["tracer"] = "Embree avx2";
        volume.metadata["place"] = row.tile;
        return volume;
    }
    void write(std::size_t i, Precision precision = Precision::full) const {
        io::write_volume(world_.rows[i].file, volume_of(i), precision);
    }
    /// An L on two floors, and one far off.
    void add_some() {
        add({0, -8, 0}, {8, 0, 8});
        add({8, -8, 0}, {16, -3, 8});
        add({0, -8, 8}, {8, 0, 16});
        add({0, 0, 0}, {8, 8, 8});
        add({8, -8, 8}, {16, 0, 16}, "dull");
        add({-16, -8, -40}, {-8, 0, -32});
    }
    io::WorldVolume noon() const { return io::world_volume("w.world.json", world_, "noon"); }
    Error refusal() {
        return error_of("w.world.json", [&] {
            const io::WorldVolume volume = noon();
            io::export_world(volume, folder_ / "all.vdb", Precision::full, progress_);
        });
    }

    TemporaryFolder folder_;
    Progress progress_; ///< nobody looks
    io::World world_{"0", "s.gltf", 0.75, size, 8, {{"noon", {}}, {"dull", {}}}, {}};
};

TEST_F(WorldVolume, EachCellIsOfTheTileWhoseBoundsHoldItElseOfTheFirst) {
    add_some();
    const io::WorldVolume volume = noon();
    EXPECT_EQ(volume.grid.dims, glm::ivec3(34, 18, 58));
    const Volume all = io::read_cells(volume, glm::ivec3(0), volume.grid.dims, 1 << 30);
    std::size_t own = 0, beside = 0, none = 0;
    std::vector<Volume> files;
    for (std::size_t i = 0; i < world_.rows.size(); ++i)
        files.push_back(io::read_vdb(world_.rows[i].file));
    for (std::size_t i = 0; i < all.grid.size(); ++i) {
        const glm::dvec3 centre = all.grid.center(all.grid.cell_at(i));
        const auto in = [&](std::size_t row, double more) {
            const Bounds& box = world_.rows[row].bounds;
            return world_.rows[row].scenario == "noon"
                   && glm::all(glm::lessThan(box.lo - more, centre))
                   && glm::all(glm::lessThan(centre, box.hi + more));
        };
        std::optional<std::size_t> owner;
        for (const double more : {0.0, world_.cell})
            for (std::size_t row = 0; row < world_.rows.size() && !owner; ++row)
                if (in(row, more)) {
                    owner = row;
                    ++(more > 0 ? beside : own);
                }
        if (!owner) {
            ++none;
            EXPECT_EQ(all.validity[i], 0);
            EXPECT_EQ(all.sh[3][i], glm::vec3(0));
            continue;
        }
        const Volume& file = files[*owner];
        const std::size_t there = file.grid.index(glm::ivec3(file.grid.to_grid(centre)));
        for (std::size_t k = 0; k < 4; ++k)
            ASSERT_EQ(all.sh[k][i], file.sh[k][there]) << i << " of row " << *owner;
        ASSERT_EQ(all.validity[i], file.validity[there]);
        for (std::size_t k = 0; k < 2; ++k)
            ASSERT_EQ(all.walls[k][i], file.walls[k][there]);
    }
    EXPECT_EQ(own, 4u * 512 + 320);
    EXPECT_GT(beside, 1000u);
    EXPECT_GT(none, 10000u);
    EXPECT_EQ(all.metadata.at("world"), "w.world.json");
    EXPECT_EQ(all.metadata.at("scenario"), "noon");
    EXPECT_EQ(all.metadata.at("solver"), "none");
    EXPECT_EQ(all.metadata.count("place"), 0u);
    EXPECT_EQ(all.metadata.count("bake_hash"), 0u);
    // A part of it opens what it needs: the others may be gone.
    std::filesystem::remove(world_.rows[5].file);
    const glm::ivec3 begin(16, 0, 32), end(34, 18, 50);
    const Volume part = io::read_cells(volume, begin, end, 1 << 30);
    for (std::size_t i = 0; i < part.grid.size(); ++i)
        ASSERT_EQ(part.sh[1][i], all.sh[1][all.grid.index(begin + part.grid.cell_at(i))]);
    EXPECT_EQ(part.grid.origin, all.grid.origin + 0.75 * glm::dvec3(begin));
}

TEST_F(WorldVolume, TheExportIsTheFileOfAllCells) {
    add_some();
    const io::WorldVolume volume = noon();
    for (const Precision precision : {Precision::full, Precision::half}) {
        io::write_volume(folder_ / "dense.vdb",
                         io::read_cells(volume, glm::ivec3(0), volume.grid.dims, 1 << 30),
                         precision);
        std::vector<std::string> bytes;
        for (const std::size_t threads : {1, 4}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            const io::WorldExport made =
                io::export_world(volume, folder_ / "all.vdb", precision, progress_);
            EXPECT_EQ(made.sh_order, 1);
            EXPECT_EQ(made.report.files.front().bytes,
                      std::filesystem::file_size(folder_ / "all.vdb"));
            EXPECT_TRUE(slurp(folder_ / "all.vdb") == slurp(folder_ / "dense.vdb")) << threads;
        }
    }
    EXPECT_GT(std::filesystem::file_size(folder_ / "all.vdb"), 50'000u);
}

TEST_F(WorldVolume, HalfTilesStayAsTheyAre) {
    add({0, 0, 0}, {8, 8, 8}, "noon", Precision::half);
    add({8, 0, 0}, {16, 8, 8}, "noon", Precision::half);
    const io::WorldVolume volume = noon();
    io::export_world(volume, folder_ / "all.vdb", Precision::half, progress_);
    const Volume all = io::read_cells(volume, glm::ivec3(0), volume.grid.dims, 1 << 30);
    EXPECT_EQ(io::read_vdb(folder_ / "all.vdb").sh, all.sh);
}

TEST_F(WorldVolume, BetweenTilesItCostsNothing) {
    add({0, 0, 0}, {8, 8, 8});
    add({800'000, 0, 800'000}, {800'008, 8, 800'008});
    const io::WorldVolume volume = noon();
    io::export_world(volume, folder_ / "far.vdb", Precision::full, progress_);
    EXPECT_LT(double(std::filesystem::file_size(folder_ / "far.vdb")),
              1.3
                  * double(std::filesystem::file_size(folder_ / "0.vdb")
                           + std::filesystem::file_size(folder_ / "1.vdb")));
    const Error error = error_of("w.world.json", [&] {
        io::read_cells(volume, glm::ivec3(0), volume.grid.dims, uint64_t(1) << 40);
    });
    EXPECT_EQ(error.kind, ErrorKind::memory);
    EXPECT_NE(std::string(error.what()).find("`max_memory`"), std::string::npos) << error.what();
}

TEST_F(WorldVolume, WhatIsNotOfThePlanIsRefused) {
    add_some();
    const auto refused = [&](ErrorKind kind, const std::string& why) {
        const Error error = refusal();
        EXPECT_EQ(error.kind, kind) << error.what();
        EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
        EXPECT_FALSE(std::filesystem::exists(folder_ / "all.vdb"));
    };
    std::filesystem::remove(world_.rows[2].file);
    refused(ErrorKind::file, "row 2 (noon, 2.vdb) is missing; bake it with");
    write(2);
    const auto with = [&](std::size_t row, const auto& change) {
        Volume volume = volume_of(row);
        change(volume);
        io::write_volume(world_.rows[row].file, volume, Precision::full);
    };
    with(2, [](Volume& volume) { volume.metadata["bake_hash"] = "hash0"; });
    refused(ErrorKind::invalid, "row 2 (noon, 2.vdb) is of another scene");
    with(2, [](Volume& volume) { volume.grid.origin.x += 0.75; });
    refused(ErrorKind::invalid, "row 2 (noon, 2.vdb) is of another scene");
    with(2, [](Volume& volume) { volume.metadata["tracer"] = "Embree sse2"; });
    refused(ErrorKind::invalid, "their rays were traced by Embree sse2 and Embree avx2");
    with(2, [](Volume& volume) { volume.walls.resize(1); });
    refused(ErrorKind::invalid, "has other grids than the first row");
    with(2, [](Volume& volume) { volume.sh[1][333].y = 1e6f; });
    EXPECT_EQ(
        error_of("w.world.json",
                 [&] { io::export_world(noon(), folder_ / "all.vdb", Precision::half, progress_); })
            .kind,
        ErrorKind::unsupported);
    io::write_volume(world_.rows[2].file, volume_of(2), Precision::full, {},
                     {volume::ShConvention::radiance, volume::Axes::unity});
    refused(ErrorKind::unsupported, "axes of its own");
    EXPECT_EQ(io::read_cells(noon(), glm::ivec3(0), noon().grid.dims, 1 << 30).sh_order, 1);
    Volume of_order_2 = random_volume(volume_of(2).grid.dims, 2, false, 2, 100);
    of_order_2.grid = volume_of(2).grid;
    of_order_2.metadata = volume_of(2).metadata;
    io::write_volume(world_.rows[2].file, of_order_2, Precision::full, {},
                     {volume::ShConvention::unity, volume::Axes::gltf});
    refused(ErrorKind::unsupported, "in a convention");
    write(2);
    EXPECT_EQ(error_of("w.world.json", [&] { io::world_volume("w.world.json", world_, ""); }).kind,
              ErrorKind::argument);
    EXPECT_EQ(error_of("w.world.json", [&] { io::world_volume("w.world.json", world_, "x"); }).kind,
              ErrorKind::argument);
    for (const glm::ivec3 moved : {glm::ivec3(4, 0, 0), glm::ivec3(0, 4, 0), glm::ivec3(8, 0, 0)}) {
        const Bounds before = world_.rows[3].bounds;
        world_.rows[3].bounds.lo += 0.75 * glm::dvec3(moved) * (moved.y > 0 ? -1.0 : 1.0);
        world_.rows[3].bounds.hi += 0.75 * glm::dvec3(moved) * (moved.y > 0 ? -1.0 : 1.0);
        if (moved.x == 8)
            world_.rows[3].bounds.hi.z += 0.75;
        refused(ErrorKind::invalid, "plan it again");
        world_.rows[3].bounds = before;
    }
    const io::WorldExport made =
        io::export_world(noon(), folder_ / "all.vdb", Precision::full, progress_);
    EXPECT_EQ(made.report.files.size(), 1u);
}

TEST_F(WorldVolume, AnExportThatIsEndedLeavesNoFile) {
    add_some();
    const io::WorldVolume volume = noon();
    const long files = folder_.count();
    struct Ending : Progress {
        std::size_t steps = 0, end = 0;
        void advance(uint64_t) override {
            if (steps++ == end)
                throw Error(ErrorKind::terminated, "terminated");
        }
    } counting;
    counting.end = ~std::size_t(0);
    io::export_world(volume, folder_ / "all.vdb", Precision::half, counting);
    EXPECT_EQ(counting.steps % volume.tiles.size(), 0u);
    EXPECT_GE(counting.steps, 4 * volume.tiles.size()); // grids
    std::filesystem::remove(folder_ / "all.vdb");
    for (std::size_t end = 0; end < counting.steps; end += 3) {
        Ending ending;
        ending.end = end;
        EXPECT_THROW(io::export_world(volume, folder_ / "all.vdb", Precision::half, ending), Error);
        EXPECT_EQ(folder_.count(), files);
    }
}

} // namespace
