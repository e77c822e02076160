// Grids of our .nvdb files on the device, as PNanoVDB.h reads them there, beside the same volume's
// .vdb.
#include "device.h"
#include "gpu/nanovdb_voxels.comp.h"
#include "io/io.h"
#include "unit/volumes.h"
#include "volume/grids.h"

#include <nanovdb/util/IO.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <map>

namespace lpvbake::gpu {
namespace {

using Voxels = std::vector<glm::uvec4>;

class NanoVdbTest : public testing::DeviceTest {
protected:
    /// A grid as it lies in the file.
    std::vector<uint32_t> grid_of(const std::string& name) {
        const auto handle = nanovdb::io::readGrid(folder_ / "a.nvdb", name);
        std::vector<uint32_t> words(handle.size() / 4);
        std::memcpy(words.data(), handle.data(), handle.size());
        return words;
    }

    Voxels read(const std::vector<uint32_t>& words, const Grid& grid, uint32_t width = 3) {
        const Buffer source(device(), words.size() * 4),
            target(device(), grid.size() * sizeof(glm::uvec4));
        upload(device(), source, 0, std::as_bytes(std::span(words)));
        struct {
            glm::vec3 origin;
            float cell;
            glm::uvec3 dims;
        } const push{glm::vec3(grid.origin), float(grid.cell), glm::uvec3(grid.dims)};
        static_assert(sizeof push == push_bytes);
        if (!programs_.contains(width)) {
            constexpr std::array bindings{Binding::storage, Binding::storage};
            programs_.emplace(width, Program(device(), shaders::nanovdb_voxels_comp, bindings,
                                             push_bytes, std::array<uint32_t, 2>{64, width == 3}));
        }
        const Program& program = programs_.at(width);
        const std::array windows{whole(source), whole(target)};
        Batch batch(device());
        batch.dispatch(program, windows, std::as_bytes(std::span(&push, 1)),
                       {uint32_t(grid.size() + 63) / 64, 1, 1});
        batch.run();
        Voxels voxels(grid.size());
        download(device(), target, 0, std::as_writable_bytes(std::span(voxels)));
        return voxels;
    }

    /// What the .vdb has there.
    static Voxels expected(const volume::ConstGridView& grid) {
        const auto width = std::size_t(grid.kind->width());
        Voxels voxels(grid.cells);
        for (std::size_t cell = 0; cell < grid.cells; ++cell) {
            for (std::size_t c = 0; c < width; ++c)
                voxels[cell][glm::length_t(c)] =
                    std::bit_cast<uint32_t>(grid.data[width * cell + c]);
            voxels[cell].w = width == 3 ? 6 : 1; // Vec3f, float
        }
        return voxels;
    }

    static constexpr uint32_t push_bytes = 28;
    std::map<uint32_t, Program> programs_; ///< by numbers a voxel
    TemporaryFolder folder_;
};

TEST_F(NanoVdbTest, ShadersReadTheVdbsVoxelsToTheBit) {
    Volume written = random_volume({9, 17, 33}, 1, true, 2); // several leaves each way
    written.grid.origin = {-3, 0.5, 7};
    written.grid.cell = 0.25;
    for (glm::vec3& c : written.walls[1])
        c = glm::vec3(0.25f); // blocks of one value are tiles
    for (const char* name : {"a.vdb", "a.nvdb"})
        io::write_volume(folder_ / name, written, Precision::full);
    const Volume volume = read_volume(folder_ / "a.vdb");
    const std::vector<volume::ConstGridView> grids = volume::grids_of(volume);
    EXPECT_EQ(grids.size(), 4 + 4 + 1 + 2u);
    for (const volume::ConstGridView& grid : grids)
        EXPECT_EQ(read(grid_of(grid.name()), volume.grid, uint32_t(grid.kind->width())),
                  expected(grid))
            << grid.name();
}

TEST_F(NanoVdbTest, BrokenGridsAreSeen) {
    const Volume volume = random_volume({9, 17, 33}, 1, true, 2);
    io::write_volume(folder_ / "a.nvdb", volume, Precision::full);
    const volume::ConstGridView light = volume::grids_of(volume)[0];
    const std::vector<uint32_t> whole = grid_of("sh_l0");
    ASSERT_EQ(read(whole, volume.grid), expected(light));
    EXPECT_NE(read(grid_of("sh_l1_y"), volume.grid), expected(light)) << "another grid";
    // One bit of a value in a leaf; the place of the lattice.
    const auto lit = std::ranges::find_if(volume.sh[0], [](glm::vec3 c) { return c.y != 0; });
    const uint32_t value = std::bit_cast<uint32_t>(lit->y);
    std::vector<uint32_t> changed = whole;
    *std::find(changed.begin(), changed.end(), value) ^= 1;
    EXPECT_NE(read(changed, volume.grid), expected(light)) << "a bit";
    Grid elsewhere = volume.grid;
    elsewhere.origin.y += elsewhere.cell;
    EXPECT_NE(read(whole, elsewhere), expected(light)) << "a cell further";
    std::swap(elsewhere.origin.x, elsewhere.origin.z);
    EXPECT_NE(read(whole, elsewhere), expected(light)) << "axes swapped";
}

} // namespace
} // namespace lpvbake::gpu
