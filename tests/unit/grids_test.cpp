// The tables of grids and of formats: rows that only this test has, through files, turns and
// comparisons.
#include "volume/grids.h"

#include "io/atomic_file.h"
#include "io/io.h"
#include "io/layout.h"
#include "unit/volumes.h"
#include "volume/compare.h"
#include "volume/convention.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake {
namespace {

/// What the test adds to the table: a row each.
constexpr GridKind wind{.name = "wind",
                        .channels = "xyz",
                        .turning = volume::Turning::vector,
                        .quantity = {"wind", "m/s"},
                        .subtracted = true};
constexpr GridKind fog{.name = "fog", .most = 2, .quantity = {"density of fog", "1/m"}};
constexpr GridKind ambience{.name = "ambience",
                            .turning = volume::Turning::harmonics,
                            .fewest = 4,
                            .most = 4,
                            .quantity = {"loudness", "dB"}};

std::vector<const GridKind*> with_toys() {
    std::vector<const GridKind*> kinds(volume::grid_kinds().begin(), volume::grid_kinds().end());
    kinds.insert(kinds.end(), {&wind, &fog, &ambience});
    return kinds;
}

Volume toy_volume() {
    Volume volume = random_volume({3, 4, 5}, 1, true, 11);
    volume::set_grids(volume, wind, 1);
    volume::set_grids(volume, fog, 2);
    volume::set_grids(volume, ambience, 4);
    std::mt19937 random(3);
    for (const OtherGrids& other : volume.others)
        for (const volume::GridView& grid : volume::grids_of(volume, *other.kind))
            for (float& value : grid.values())
                value = float(random() % 64) / 8;
    return volume;
}

std::vector<std::string> names_of(const Volume& volume) {
    std::vector<std::string> names;
    for (const volume::ConstGridView& grid : volume::grids_of(volume))
        names.push_back(grid.name());
    return names;
}

TEST(Grids, AreListedInTheOrderOfTheTable) {
    const Volume volume = toy_volume();
    EXPECT_EQ(
        names_of(volume),
        (std::vector<std::string>{"sh_l0", "sh_l1_y", "sh_l1_z", "sh_l1_x", "occlusion_l0",
                                  "occlusion_l1_y", "occlusion_l1_z", "occlusion_l1_x", "validity",
                                  "wall_0", "wall_1", "wind", "fog_0", "fog_1", "ambience_l0",
                                  "ambience_l1_y", "ambience_l1_z", "ambience_l1_x"}));
    EXPECT_TRUE(volume::grids_of(Volume()).empty());
}

TEST(Grids, ViewsShowTheVolumesOwnNumbers) {
    Volume volume = toy_volume();
    size_t numbers = 0;
    for (const volume::GridView& grid : volume::grids_of(volume)) {
        EXPECT_EQ(grid.cells, volume.grid.size()) << grid.name();
        numbers += grid.values().size();
    }
    EXPECT_EQ(numbers, volume.grid.size() * (4 * 3 + 4 + 1 + 2 * 3 + 3 + 2 + 4));
    volume::grids_of(volume, *volume::grid_kinds()[3])[1].data[3 * 7 + 2] = 42;
    EXPECT_EQ(volume.walls[1][7].z, 42);
    EXPECT_EQ(volume::grids_of(volume, wind)[0].channel_name(2), "wind.z");
    EXPECT_EQ(volume::grids_of(volume, fog)[1].channel_name(0), "fog_1");
    volume::set_grids(volume, wind, 0);
    EXPECT_TRUE(volume::grids_of(volume, wind).empty());
}

TEST(Grids, AToyIsWrittenAndReadInAnyAxes) {
    const TemporaryFolder folder;
    const Volume volume = toy_volume();
    for (const char* name : {"a.vdb", "a.exr"})
        for (const volume::Axes axes : {volume::Axes::gltf, volume::Axes::unity,
                                        volume::Axes::unreal, volume::Axes::blender}) {
            const std::string path = folder / name;
            io::write_volume(path, volume, Precision::full, {}, {.axes = axes});
            const Volume back = io::read_volume(path, with_toys());
            EXPECT_EQ(names_of(back), names_of(volume));
            const volume::Comparison same = volume::compare(back, volume, {});
            EXPECT_TRUE(same.identical) << path << volume::name_of(axes);
            EXPECT_EQ(same.grids.size(), names_of(volume).size());
            // A program that does not know the rows leaves them out.
            EXPECT_EQ(volume::compare(read_volume(path), volume, {}).only_b.size(), 7u);
        }
    EXPECT_NE(slurp(folder / "a.json").find("\"m/s\""), std::string::npos);
    EXPECT_NE(slurp(folder / "a.vdb").find("density of fog"), std::string::npos);
}

TEST(Grids, AToyTurnsAsItsRowSays) {
    const Volume volume = toy_volume();
    const glm::dmat3 turn = volume::from_gltf(volume::Axes::unreal); // (x, z, y)
    Volume turned = volume;
    volume::turn_axes(turn, turned);
    for (int z = 0; z < 5; ++z)
        for (int y = 0; y < 4; ++y)
            for (int x = 0; x < 3; ++x) {
                const size_t from = volume.grid.index({x, y, z}), to = turned.grid.index({x, z, y});
                const auto at = [](const Volume& v, const GridKind& kind, int k, size_t i) {
                    return volume::grids_of(v, kind)[size_t(k)].data[i];
                };
                EXPECT_EQ(at(turned, fog, 1, to), at(volume, fog, 1, from));
                const int axis[] = {0, 2, 1};
                for (int c = 0; c < 3; ++c)
                    EXPECT_EQ(at(turned, wind, 0, 3 * to + size_t(axis[c])),
                              at(volume, wind, 0, 3 * from + size_t(c)));
                const int band[] = {0, 2, 1, 3}; // y and z change places
                for (int k = 0; k < 4; ++k)
                    EXPECT_EQ(at(turned, ambience, band[k], to), at(volume, ambience, k, from));
            }
}

TEST(Grids, AToyIsComparedMeasuredAndChecked) {
    const Volume b = toy_volume();
    Volume a = b;
    volume::grids_of(a, wind)[0].data[3 * 17 + 1] += 8;
    const volume::Comparison c = volume::compare(a, b, {});
    EXPECT_FALSE(c.identical);
    const auto found = std::ranges::find(c.grids, "wind", &volume::GridDifference::name);
    ASSERT_NE(found, c.grids.end());
    EXPECT_EQ(found->max_abs, 8);
    EXPECT_EQ(found->cell, b.grid.cell_at(17));
    EXPECT_EQ(found->channel, 1);
    EXPECT_EQ(std::ranges::count_if(c.grids, [](const auto& grid) { return grid.cells > 0; }), 1);

    const Volume less = volume::difference(a, b);
    const volume::GridRange range = volume::range_of(volume::grids_of(less, wind)[0]);
    EXPECT_EQ(range.nonzero, 1u);
    EXPECT_EQ(range.max[1], 8);
    EXPECT_EQ(range.min[1], 0);
    EXPECT_NEAR(range.mean[1], 8.0 / 60, 1e-12);
    EXPECT_TRUE(volume::grids_of(less, fog).empty()) << "is not subtracted";

    a = b;
    volume::grids_of(a, fog)[0].data[3] = 70000;
    ASSERT_TRUE(io::half_misfit(a));
    EXPECT_TRUE(io::half_misfit(a)->starts_with("fog_0 reaches 70000"));
    volume::grids_of(a, fog)[0].data[3] = std::numeric_limits<float>::infinity();
    EXPECT_NE(
        std::string(
            error_of("x.vdb", [&] { io::check_volume(a, "x.vdb", ErrorKind::failure); }).what())
            .find("grid fog_0 has a value that is not finite in cell (0, 1, 0)"),
        std::string::npos);
    a = b;
    volume::set_grids(a, ambience, 3);
    EXPECT_NE(
        std::string(
            error_of("x.vdb", [&] { io::check_volume(a, "x.vdb", ErrorKind::failure); }).what())
            .find("3 grids of ambience are given, expected 4"),
        std::string::npos);
}

// ---- a format of its own: two functions and a row ----

/// L0 of a lattice of one row, as text.
WriteReport write_toy(const std::string& path, const io::Stored& stored, Precision,
                      const io::Pictures&) {
    std::ostringstream text;
    text << stored.volume().grid.dims.x;
    for (const glm::vec3& c : stored.volume().sh[0])
        text << ' ' << c.r;
    io::AtomicFile file(path);
    file.write(text.str());
    WriteReport report;
    report.files.push_back({path, file.seal()});
    file.publish();
    return report;
}

Volume read_toy(const std::string& path, volume::GridKinds) {
    std::ifstream in(path);
    Volume volume;
    volume.grid.dims = glm::ivec3(1);
    in >> volume.grid.dims.x;
    volume.sh_order = 0;
    volume::set_grids(volume, volume::light_kind(), 1);
    for (glm::vec3& c : volume.sh[0])
        in >> c.r;
    return volume;
}

constexpr io::VolumeFormat toy_format{.extension = ".toy",
                                      .sidecar = ".toytoo",
                                      .help = "NAME.toy",
                                      .write = write_toy,
                                      .read = read_toy};

TEST(Formats, AToyIsARow) {
    std::vector<const io::VolumeFormat*> formats(io::volume_formats().begin(),
                                                 io::volume_formats().end());
    formats.push_back(&toy_format);
    const TemporaryFolder folder;
    const std::string path = folder / "a.TOY";
    Volume volume;
    volume.grid.dims = {3, 1, 1};
    volume.sh_order = 0;
    volume::set_grids(volume, volume::light_kind(), 1);
    volume.sh[0][1].r = 2.5;
    const WriteReport report = io::write_volume(path, volume, Precision::full, {}, {}, formats);
    EXPECT_EQ(report.bytes(), std::filesystem::file_size(path));
    EXPECT_EQ(io::read_volume(path, volume::grid_kinds(), formats).sh, volume.sh);
    EXPECT_EQ(io::volume_format(path, formats), &toy_format);
    EXPECT_EQ(io::volume_format("a.toytoo", formats), nullptr);
    EXPECT_EQ(io::readable_format("a.toytoo", formats), &toy_format);
    EXPECT_EQ(io::format_list(" or ", false, formats),
              ".vdb, .nvdb, .exr, .ktx2, .dds, .glb, .tres or .toy");
    EXPECT_EQ(io::format_list(", ", true, formats),
              ".vdb, .nvdb, .exr, .ktx2, .dds, .glb, .tres, .toy, .json, .dds.json, .toytoo");

    // Others do not know it.
    EXPECT_EQ(io::volume_format(path), nullptr);
    EXPECT_EQ(io::readable_format("none"), nullptr);
    const Error error = error_of(path, [&] { read_volume(path); });
    EXPECT_EQ(error.kind, ErrorKind::argument);
    EXPECT_NE(std::string(error.what()).find("use .vdb, .nvdb, .exr, .ktx2, .dds, .glb or .tres"),
              std::string::npos);
}

} // namespace
} // namespace lpvbake
