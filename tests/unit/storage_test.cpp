// What is stored in so many bytes.
#include "bake/storage.h"
#include "unit/volumes.h"
#include "volume/grids.h"

#include <algorithm>
#include <cmath>

using namespace lpvbake;

namespace {

const Bounds box{glm::dvec3(0), glm::dvec3(4, 2, 3)};
const volume::GridSettings grid_settings{32, 0, 0};

Volume grids_of(int order) {
    Volume grids = random_volume(glm::ivec3(1), order, false, 1);
    grids.walls.resize(3, grids.walls[0]);
    return grids;
}

double bake_error(int order) {
    return order == 1 ? 0.13 : 0.025;
}

bake::Storage choose(bake::StorageWish wish) {
    return bake::choose_storage(box, grid_settings, wish, grids_of, bake_error);
}

bake::StorageWish wish(uint64_t bytes, const char* path) {
    return {bytes, {path}, *io::target_named("generic"), {}, {1, 2}, true};
}

} // namespace

TEST(Storage, BytesAreThoseOfTheTexels) {
    const TemporaryFolder folder;
    for (const char* extension : {".ktx2", ".dds"})
        for (const Precision precision : {Precision::full, Precision::half, Precision::rgb9e5,
                                          Precision::unorm8, Precision::bc6h}) {
            const io::Target target = io::with_precision(*io::target_named("generic"), precision);
            Volume volume = random_volume({9, 6, 5}, 2, false, 2);
            for (glm::vec3& mean : volume.sh[0])
                mean = glm::abs(mean);
            const uint64_t bytes =
                io::stored_bytes(target, folder / "a" + extension, grids_of(2), volume.grid.dims);
            volume.walls.resize(3, volume.walls[0]);
            uint64_t written = 0;
            for (const WriteReport::File& file :
                 io::write_for(target, folder / "a.dds", volume).files)
                if (file.path.ends_with("dds"))
                    written += file.bytes - 148;
            EXPECT_EQ(bytes, written) << io::name_of(precision);
        }
}

TEST(Storage, LeastErrorThatFits) {
    uint64_t last = 0;
    double error = 1;
    for (const uint64_t bytes : {20'000ull, 200'000ull, 2'000'000ull, 8'000'000ull, 1ull << 34}) {
        const bake::Storage chosen = choose(wish(bytes, "a.ktx2"));
        EXPECT_LE(chosen.bytes, bytes);
        EXPECT_GT(chosen.bytes, last);
        EXPECT_LT(chosen.error, error);
        EXPECT_GE(chosen.error, bake_error(chosen.order));
        last = chosen.bytes;
        error = chosen.error;
        // No other fits that is expected to err less.
        for (const int order : {1, 2})
            for (const Precision precision :
                 {Precision::full, Precision::half, Precision::unorm8, Precision::bc6h}) {
                bake::StorageWish one = wish(bytes, "a.ktx2");
                one.orders = {order};
                one.precision = precision;
                try {
                    EXPECT_GE(choose(one).error, chosen.error);
                } catch (const Error& refused) {
                    EXPECT_EQ(refused.kind, ErrorKind::argument);
                }
            }
    }
    EXPECT_EQ(choose(wish(1ull << 34, "a.ktx2")).resolution, 128);
    EXPECT_EQ(choose(wish(1ull << 34, "a.ktx2")).precision, Precision::full);
}

TEST(Storage, WhatIsGivenStays) {
    bake::StorageWish fixed = wish(8'000'000, "a.dds");
    fixed.any_resolution = false;
    EXPECT_EQ(choose(fixed).resolution, 32);
    fixed.orders = {1};
    fixed.precision = Precision::bc6h;
    EXPECT_EQ(choose(fixed).text, "order 1, 32 x 16 x 24 cells, bc6h");
    // .vdb has no form for packed light, nor have targets with a packing of their own.
    EXPECT_EQ(choose(wish(8'000'000, "a.vdb")).precision, Precision::half);
    bake::StorageWish unity = wish(8'000'000, "a.dds");
    unity.target = *io::target_named("unity");
    EXPECT_EQ(choose(unity).precision, Precision::half);
}

TEST(Storage, SaysWhatTheLeastIs) {
    const Error none = error_of("`bytes` 100", [] { choose(wish(100, "a.ktx2")); });
    EXPECT_EQ(none.kind, ErrorKind::argument);
    EXPECT_EQ(error_of("a.nvdb", [] { choose(wish(1 << 20, "a.nvdb")); }).kind,
              ErrorKind::argument);
}

TEST(StoredForTargets, GridsThatPicturesHaveNoPlaceForAreNamed) {
    TemporaryFolder folder;
    Volume volume = random_volume(glm::ivec3(4), 2, false, 1);
    volume::set_grids(volume, volume::kind_named("scatter"), 1);
    const auto warned = [&](const char* target) {
        const auto report = io::write_for(*io::target_named(target), folder / "a.exr", volume);
        return std::ranges::any_of(report.warnings, [](const std::string& each) {
            return each.find("no place for scatter") != std::string::npos;
        });
    };
    EXPECT_TRUE(warned("threejs"));
    EXPECT_TRUE(warned("vrc"));
    EXPECT_FALSE(warned("unity"));
}
