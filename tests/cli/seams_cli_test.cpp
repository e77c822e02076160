// Tiles of one scene beside each other: what they differ by in the cells that both have.
#include "cli/run.h"
#include "lpvbake/file.h"
#include "report/seams.h"
#include "text.h"

namespace lpvbake {
namespace {

class SeamsCli : public ::testing::Test {
protected:
    /// "room.gltf", "street.gltf", "hall.gltf"
    void SetUp() override {
        const std::string command = "python3 '" LPVBAKE_EXAMPLES "/make_scenes.py' '"
                                    + folder_.path().string() + "' > /dev/null";
        ASSERT_EQ(std::system(command.c_str()), 0);
    }
    /// Of four tiles along z from `first` on, each `step` long, x and y from `lo` to `hi`.
    double seam(const std::string& scene, const char* lo, const char* hi, int first, int step,
                const std::string& options) {
        std::vector<Volume> tiles;
        for (int z = first; z < first + 4 * step; z += step) {
            const std::string bake =
                "bake " + scene + format(" --bounds=%s,%d,%s,%d --margin 1 ", lo, z, hi, z + step)
                + options + " -q -o tile.vdb";
            const CliResult result = run_lpvbake(folder_, bake);
            EXPECT_EQ(result.status, 0) << bake << "\n" << result.err;
            tiles.push_back(lpvbake::read_volume(folder_ / "tile.vdb"));
        }
        report::Seam all;
        for (std::size_t i = 0; i + 1 < tiles.size(); ++i)
            all += report::seam_between(tiles[i], tiles[i + 1]);
        EXPECT_GT(all.cells, 500u);
        return all.share();
    }
    /// A street of houses, 6 to 9 m high, in the sun.
    double street(const std::string& solver, int surroundings,
                  const char* sky = "--sky '#b0d0ff,6000'") {
        return seam("street.gltf", "-16,0", "16,11", -30, 15,
                    format("--cell-size 1 --solver %s --surroundings %d %s", solver.c_str(),
                           surroundings, sky));
    }
    /// A closed hall, 6 m high and 20 m long, that the sun shines into; each wall is one piece.
    double hall(const std::string& solver, int surroundings) {
        return seam(
            "hall.gltf", "-6.5,-0.5", "6.5,6.5", -10, 5,
            format("--cell-size 0.5 --solver %s --surroundings %d", solver.c_str(), surroundings));
    }

    TemporaryFolder folder_;
};

TEST_F(SeamsCli, OfAStreetAreSmallAndFallWithWhatCounts) {
    const double none = street("sn", 0), near = street("sn", 5), all = street("sn", 20);
    EXPECT_LE(all, 0.015); // 0.9 %
    EXPECT_LT(all, 0.9 * near);
    EXPECT_LT(near, 0.9 * none);
    EXPECT_LE(street("gather", 20), 0.04); // 2.7 %
    // All that cells hold is reflected then, and of the same error it is a larger share.
    EXPECT_LE(street("sn", 20, ""), 0.025); // 2.1 %
}

/// What counts has to reach the ends of a room: without them light falls in, and a tile that has
/// one more than its neighbour has other light.
TEST_F(SeamsCli, OfARoomAreSmallWhereAllOfItCounts) {
    const double part = hall("sn", 6), all = hall("sn", 20);
    EXPECT_LE(all, 0.02);                 // 1.5 %
    EXPECT_LE(hall("gather", 20), 0.035); // 2.6 %
    EXPECT_GT(part, 2 * all);             // 6.3 %
}

} // namespace
} // namespace lpvbake
