// How much memory it takes to write and to read a volume, as the system counts it.
#include "io/target.h"
#include "unit/volumes.h"
#include "volume/grids.h"

#include <tbb/global_control.h>

#include <malloc.h>

namespace lpvbake {
namespace {

/// A line of /proc/self/status, bytes.
double status(const std::string& key) {
    std::ifstream in("/proc/self/status");
    for (std::string line; std::getline(in, line);)
        if (line.starts_with(key + ":"))
            return 1024 * std::stod(line.substr(key.size() + 1));
    ADD_FAILURE() << "no " << key;
    return 0;
}

/// How far resident memory rose at most while `act` ran, bytes.
template <class Act>
double growth(const Act& act) {
    malloc_trim(0);
    std::ofstream("/proc/self/clear_refs") << 5; // VmHWM begins anew
    const double before = status("VmRSS");
    EXPECT_LT(status("VmHWM"), before + 1e6) << "this system cannot measure it";
    act();
    return status("VmHWM") - before;
}

class Memory : public testing::Test {
protected:
    Memory() {
        mallopt(M_MMAP_THRESHOLD, 1 << 16); // what is freed goes back at once
        io::write_volume(folder_ / "warm.exr", random_volume({2, 2, 2}, 1, false, 1),
                         Precision::full);
        read_volume(folder_ / "warm.exr"); // what is loaded to read it stays
    }

    static Volume make() {
        Volume volume;
        volume.grid.dims = glm::ivec3(size);
        volume.sh_order = 2;
        for (const auto& [kind, count] : {std::pair(0, 9), {1, 4}, {2, 1}, {3, 2}})
            volume::set_grids(volume, *volume::grid_kinds()[size_t(kind)], count);
        int i = 0;
        for (const volume::GridView& grid : volume::grids_of(volume))
            for (float& value : grid.values())
                value = float(++i % 97) / 8; // no two cells beside each other alike
        std::ranges::fill(volume.validity, 1.0f);
        return volume;
    }

    static constexpr int size = 72;
    static constexpr double grid = 4.0 * 3 * size * size * size; ///< RGB, bytes
    static constexpr double whole = grid / 3 * (27 + 4 + 1 + 6);
    /// Each thread makes a picture.
    tbb::global_control one_thread_{tbb::global_control::max_allowed_parallelism, 1};
    TemporaryFolder folder_;
};

TEST_F(Memory, CopiesAreSeen) {
    const Volume volume = make();
    EXPECT_GT(growth([&] { const Volume copy = volume; }), 0.99 * whole);
}

TEST_F(Memory, WritingTakesAGridBesideTheVolume) {
    for (const char* target : {"generic", "blender", "unreal"})
        for (const char* name : {"a.vdb", "a.exr"}) {
            Volume volume = make();
            // A grid of OpenVDB's or a picture of four channels, and the file's bytes of it; the
            // density, which cells are active, and a grid while it turns.
            EXPECT_LT(growth([&] {
                          io::write_for(*io::target_named(target), folder_ / name,
                                        std::move(volume));
                      }),
                      3.5 * grid)
                << target << " " << name;
        }
}

TEST_F(Memory, AVolumeThatIsKeptIsCopiedOnlyWhereItChanges) {
    const Volume volume = make();
    const auto written = [&](const char* target) {
        return growth([&] { io::write_for(*io::target_named(target), folder_ / "a.vdb", volume); });
    };
    EXPECT_LT(written("generic"), 3.5 * grid);
    EXPECT_GT(written("blender"), 0.99 * whole);
    EXPECT_LT(written("blender"), whole + 3.5 * grid);
}

TEST_F(Memory, ReadingTakesAGridBesideTheVolume) {
    for (const char* target : {"generic", "blender"})
        for (const char* name : {"a.vdb", "a.exr"}) {
            io::write_for(*io::target_named(target), folder_ / name, make());
            Volume volume;
            EXPECT_LT(growth([&] { volume = read_volume(folder_ / name); }), whole + 3.5 * grid)
                << target << " " << name;
        }
}

} // namespace
} // namespace lpvbake
