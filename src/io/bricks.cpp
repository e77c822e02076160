#include "io/bricks.h"

#include "image/image.h"
#include "io/atomic_file.h"
#include "io/dds.h"
#include "io/exr.h"
#include "io/io.h"
#include "io/ktx2.h"
#include "io/vdb.h"
#include "lpvbake/error.h"
#include "quoted.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

constexpr const VolumeFormat* brick_formats[] = {&vdb_format, &exr_format, &ktx2_format,
                                                 &dds_format};

bool is_sparse(const std::string& path) {
    return volume_format(path) == &vdb_format;
}

std::string beside(const std::string& path, const std::string& end) {
    return fs::path(path).replace_extension().string() + end;
}

std::string atlas_path(const std::string& path) {
    return beside(path, "_atlas" + fs::path(path).extension().string());
}

std::string index_path(const std::string& path) {
    return beside(path, "_bricks.exr");
}

std::string name_of(const std::string& path) {
    return fs::path(path).filename().string();
}

Json array_of(const auto& v) {
    return {v.x, v.y, v.z};
}

Target target_of(Precision precision) {
    return with_precision(*target_named("generic"), precision);
}

/// Where in a set's bricks those of a level stand, the finest level first.
std::span<const Volume> bricks_of(const volume::VolumeSet& set, int level) {
    const auto all = set.bricks->bricks();
    const auto begin = std::ranges::lower_bound(all, level, {}, &volume::Brick::level);
    const auto end = std::ranges::upper_bound(all, level, {}, &volume::Brick::level);
    return std::span(set.levels)
        .subspan(std::size_t(begin - all.begin()), std::size_t(end - begin));
}

BrickPlaces places_of(const volume::BrickLevels& levels, int level,
                      std::span<const volume::Brick> bricks) {
    BrickPlaces places{levels.lattice(level), {}};
    for (const volume::Brick& brick : bricks)
        if (brick.level == level)
            places.first.push_back(volume::brick_cells * brick.at);
    return places;
}

/// Layers left to right, then down, in a picture that is about square.
Layout layout_of(glm::ivec3 dims) {
    const int columns = std::clamp(
        int(std::lround(std::sqrt(double(dims.z) * dims.y / std::max(dims.x, 1)))), 1, dims.z);
    return {columns, (dims.z + columns - 1) / columns};
}

WriteReport::File write_index(const std::string& path, const volume::BrickTree& tree) {
    const Grid places{{}, 1, tree.levels().places(0)};
    const Layout layout = layout_of(places.dims);
    const volume::BrickStack stack(tree.bricks().size());
    image::Pixels picture{layout.columns * places.dims.x, layout.rows * places.dims.y, 4, {}};
    picture.samples.assign(std::size_t(picture.width) * std::size_t(picture.height) * 4, 0.0f);
    for (std::size_t i = 0; i < places.size(); ++i) {
        const glm::ivec3 at = places.cell_at(i);
        const glm::ivec2 texel{at.z % layout.columns * places.dims.x + at.x,
                               at.z / layout.columns * places.dims.y + at.y};
        const uint32_t brick = tree.finest()[i];
        const glm::vec4 value(stack.first(brick), 1 << tree.bricks()[brick].level);
        std::copy_n(&value.x, 4,
                    &picture.samples[4
                                     * (std::size_t(texel.y) * std::size_t(picture.width)
                                        + std::size_t(texel.x))]);
    }
    const std::string name = index_path(path);
    const auto bytes =
        image::encode_exr(picture, false, {{"lpv:content", "places of bricks"}}, name);
    AtomicFile file(name);
    file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    const uint64_t size = file.seal();
    file.publish();
    return {name, size};
}

Json manifest_of(const std::string& path, const volume::BrickTree& tree) {
    Json levels = Json::array();
    for (int level = 0; level < tree.levels().count; ++level) {
        const Grid grid = tree.levels().lattice(level);
        const glm::dvec3 lo = grid.center(glm::ivec3(0)), hi = grid.center(grid.dims - 1);
        Json bricks = Json::array();
        for (const volume::Brick& brick : tree.bricks())
            for (int axis = 0; axis < 3 && brick.level == level; ++axis)
                bricks.push_back(brick.at[axis]);
        Json one{{"origin", array_of(grid.origin)},
                 {"cell", grid.cell},
                 {"dims", array_of(grid.dims)},
                 {"box", {lo.x, lo.y, lo.z, hi.x, hi.y, hi.z}},
                 {"bricks", bricks}};
        if (is_sparse(path))
            one["file"] = name_of(level_path(path, std::size_t(level)));
        levels.push_back(one);
    }
    Json manifest{{"format", bricks_format_name},
                  {"version", 1},
                  {"levels", levels},
                  {"edge", volume::brick_cells},
                  {"stitched", true}};
    if (!is_sparse(path)) {
        const glm::ivec3 dims = tree.levels().places(0);
        const Layout layout = layout_of(dims);
        manifest["atlas"] = {{"file", name_of(atlas_path(path))},
                             {"slots", array_of(volume::BrickStack(tree.bricks().size()).slots)},
                             {"index",
                              {{"file", name_of(index_path(path))},
                               {"dims", array_of(dims)},
                               {"columns", layout.columns},
                               {"rows", layout.rows}}}};
    }
    manifest["axes"] = "gltf";
    return manifest;
}

void add(WriteReport more, WriteReport& report) {
    std::ranges::move(more.files, std::back_inserter(report.files));
    std::ranges::move(more.warnings, std::back_inserter(report.warnings));
    report.precision = more.precision;
}

} // namespace

bool takes_bricks(const std::string& path) {
    return volume_format(path, brick_formats) != nullptr;
}

std::string brick_format_list() {
    return format_list(" or ", false, brick_formats);
}

std::vector<std::string> brick_files(const std::string& path, std::size_t levels,
                                     const Volume& grids) {
    std::vector<std::string> files;
    if (is_sparse(path))
        for (std::size_t level = 0; level < levels; ++level)
            files.push_back(level_path(path, level));
    else {
        files = files_for(target_of(Precision::full), atlas_path(path), grids);
        files.push_back(index_path(path));
    }
    files.push_back(manifest_path(path));
    return files;
}

WriteReport write_bricks(const std::string& path, const volume::VolumeSet& set,
                         Precision precision) {
    const volume::BrickTree& tree = *set.bricks;
    const std::string manifest = manifest_path(path);
    WriteReport report;
    PublishTogether together; // the old files or the new ones, the manifest last
    const auto named = [&](Volume volume) {
        volume.metadata = set.levels.front().metadata;
        volume.metadata["level_set"] = name_of(manifest);
        return volume;
    };
    if (is_sparse(path))
        for (int level = 0; level < tree.levels().count; ++level) {
            Volume stack = named(volume::stacked(bricks_of(set, level)));
            stack.metadata["level"] = std::to_string(level);
            const std::string file = level_path(path, std::size_t(level));
            const BrickPlaces places = places_of(tree.levels(), level, tree.bricks());
            add(write_vdb(file, Stored(std::move(stack), {}, file), precision, &places), report);
        }
    else {
        add(write_for(target_of(precision), atlas_path(path), named(volume::stacked(set.levels))),
            report);
        report.files.push_back(write_index(path, tree));
    }
    AtomicFile file(manifest);
    file.write(manifest_of(path, tree).dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
    const uint64_t bytes = file.seal();
    file.publish();
    together.publish();
    report.files.push_back({manifest, bytes});
    return report;
}

// ---------------------------------------------------------------- reading

namespace {

template <class T>
T required(const std::string& path, const Json& json, const char* name) {
    try {
        return json.at(name).get<T>();
    } catch (const Json::exception&) {
        reject(path, std::string("has no \"") + name + "\" that bricks can have; bake them again");
    }
}

std::string file_beside(const std::string& path, const Json& json) {
    const auto file = required<std::string>(path, json, "file");
    if (file.empty() || file.find('/') != std::string::npos || is_manifest(file)
        || !readable_format(file))
        reject(path, "lists " + printable(file) + ", which is no volume file beside it");
    return (fs::path(path).parent_path() / file).string();
}

/// The first level that is listed, and the bricks of all.
volume::BrickTree tree_in(const std::string& path, const Json& manifest) {
    const auto listed = required<std::vector<Json>>(path, manifest, "levels");
    if (listed.empty() || listed.size() > volume::most_levels)
        reject(path, "lists no levels, or more than " + std::to_string(volume::most_levels));
    volume::BrickLevels levels;
    levels.count = int(listed.size());
    const auto dims = required<std::array<int, 3>>(path, listed.front(), "dims");
    const auto origin = required<std::array<double, 3>>(path, listed.front(), "origin");
    levels.finest = {{origin[0], origin[1], origin[2]},
                     required<double>(path, listed.front(), "cell"),
                     {dims[0], dims[1], dims[2]}};
    const int root = volume::brick_cells << (levels.count - 1);
    double places = 1;
    for (const int n : dims) {
        if (n < root + 1 || n > 1 << 24 || (n - 1) % root != 0)
            reject(path, "has \"dims\" that are not filled by bricks; bake them again");
        places *= (n - 1) / volume::brick_cells;
    }
    if (places > double(volume::most_brick_places) || !(levels.finest.cell > 0)
        || !std::isnormal(levels.finest.cell))
        reject(path, "has a lattice that no bricks stand on; bake them again");
    std::vector<volume::Brick> bricks;
    for (int level = 0; level < levels.count; ++level) {
        const auto at = required<std::vector<int>>(path, listed[std::size_t(level)], "bricks");
        if (at.size() % 3 != 0)
            reject(path, "has \"bricks\" that are not threes of numbers");
        for (std::size_t i = 0; i < at.size(); i += 3)
            bricks.push_back({level, {at[i], at[i + 1], at[i + 2]}});
    }
    try {
        return {levels, std::move(bricks)};
    } catch (const Error& error) {
        reject(path, error.what());
    }
}

} // namespace

std::vector<std::string> files_of_bricks(const std::string& path, const Json& manifest) {
    if (manifest.contains("atlas")) {
        const Json index = required<Json>(path, manifest["atlas"], "index");
        return {file_beside(path, manifest["atlas"]), file_beside(path, index)};
    }
    std::vector<std::string> files;
    for (const Json& level : required<std::vector<Json>>(path, manifest, "levels"))
        files.push_back(file_beside(path, level));
    return files;
}

volume::VolumeSet read_bricks(const std::string& path, const Json& manifest) {
    volume::VolumeSet set;
    set.bricks = tree_in(path, manifest);
    const volume::BrickTree& tree = *set.bricks;
    std::vector<Grid> grids;
    for (const volume::Brick& brick : tree.bricks())
        grids.push_back(tree.levels().grid_of(brick));
    if (manifest.contains("atlas")) {
        const std::string file = file_beside(path, manifest["atlas"]);
        const Volume atlas = lpvbake::read_volume(file);
        try {
            set.levels = volume::unstacked(atlas, grids);
        } catch (const Error& error) {
            reject(path, printable(name_of(file)) + " is of another bake: " + error.what());
        }
        return set;
    }
    for (int level = 0; level < tree.levels().count; ++level) {
        const std::string file = file_beside(path, manifest["levels"][std::size_t(level)]);
        if (!is_sparse(file))
            reject(path, "lists " + printable(name_of(file)) + " for a level of bricks, no .vdb");
        const BrickPlaces places = places_of(tree.levels(), level, tree.bricks());
        const Volume stack = read_vdb(file, places);
        if (!set.levels.empty())
            check_alike(path, printable(name_of(file)), set.levels.front(), stack);
        std::vector<Volume> bricks = volume::unstacked(
            stack, std::span(grids).subspan(set.levels.size(), places.first.size()));
        std::ranges::move(bricks, std::back_inserter(set.levels));
    }
    return set;
}

} // namespace lpvbake::io
