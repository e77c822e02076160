#include "io/levels.h"

#include "io/atomic_file.h"
#include "io/bricks.h"
#include "io/described.h"
#include "io/io.h"
#include "lpvbake/error.h"
#include "quoted.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* end_of_name = ".levels.json";
constexpr const char* format_name = "lpvbake levels";
constexpr int version = 1;
constexpr uint64_t most_bytes = 64 << 20; // of many bricks

Json array_of(glm::dvec3 v) {
    return {v.x, v.y, v.z};
}

double number_in(const std::string& path, const Json& json, const char* name) {
    const auto found = json.find(name);
    if (found == json.end() || !found->is_number() || !std::isfinite(found->get<double>()))
        reject(path, std::string("has no number \"") + name + "\"");
    return found->get<double>();
}

Json parse(const std::string& path) {
    const Json json = Json::parse(read_file(path, most_bytes), nullptr, false);
    if (!json.is_object()
        || (json.value("format", Json()) != format_name
            && json.value("format", Json()) != bricks_format_name))
        reject(path, "is no manifest of levels, or damaged; bake the levels again");
    if (json.value("version", Json()) != version)
        reject(path, "has another \"version\" than " + std::to_string(version)
                         + ", which is all that this lpvbake reads");
    const auto levels = json.find("levels");
    if (levels == json.end() || !levels->is_array() || levels->empty()
        || levels->size() > volume::most_levels)
        reject(path, "lists no levels, or more than " + std::to_string(volume::most_levels));
    return json;
}

std::string file_in(const std::string& path, const Json& level) {
    const Json file = level.is_object() ? level.value("file", Json()) : Json();
    if (!file.is_string() || file.get<std::string>().empty()
        || file.get<std::string>().find('/') != std::string::npos)
        reject(path, "has a level without the name of a \"file\" beside it");
    const std::string name = file.get<std::string>();
    if (is_manifest(name) || !readable_format(name))
        reject(path, "has a level in " + printable(name) + ", which is no kind of volume file");
    return name;
}

/// Files of the levels beyond `kept` that the manifest of a former bake lists, if there is one.
std::vector<std::string> further_levels(const std::string& manifest, std::size_t kept) {
    std::vector<std::string> files, further;
    try {
        files = level_files(manifest);
    } catch (const Error&) { // it is replaced whatever it holds
    }
    for (std::size_t level = std::max<std::size_t>(kept, 1); level < files.size(); ++level) {
        const std::string own = "_level" + std::to_string(level);
        if (!fs::path(files[level]).stem().string().ends_with(own)) // not of our naming
            continue;
        further.push_back(files[level]);
        const VolumeFormat* format = volume_format(files[level]);
        if (!format || format->sidecar[0] == '\0')
            continue;
        const std::string sidecar = sidecar_of(files[level], format->sidecar);
        std::ranges::move(left_behind(sidecar, {}), std::back_inserter(further));
        further.push_back(sidecar);
    }
    return further;
}

Volume read_level(const std::string& manifest, const std::string& file) {
    try {
        return lpvbake::read_volume((fs::path(manifest).parent_path() / file).string());
    } catch (const Error& error) {
        if (error.kind != ErrorKind::file)
            throw;
        throw Error(error.kind,
                    manifest + ": " + error.what()
                        + "; keep all files of the levels beside it, or bake them again");
    }
}

/// The samples of a level nest in those of the next.
void check_nested(const std::string& path, const std::string& file, const Grid& fine,
                  const Grid& coarse) {
    const double ratio = coarse.cell / fine.cell;
    bool nests = ratio > 1.5 && std::abs(ratio - std::round(ratio)) < 1e-6 * ratio;
    for (int axis = 0; axis < 3; ++axis) {
        const double first =
            (fine.center(glm::ivec3(0)) - coarse.center(glm::ivec3(0)))[axis] / coarse.cell;
        const double last = first + (fine.dims[axis] - 1) / ratio;
        nests = nests && std::abs(first - std::round(first)) < 1e-4 && first > -1e-4
                && last < coarse.dims[axis] - 1 + 1e-4;
    }
    if (!nests)
        reject(path, file + " does not lie in the next level, sample on sample");
}

} // namespace

std::string level_path(const std::string& path, std::size_t level) {
    const fs::path whole(path);
    return level == 0 ? path
                      : (whole.parent_path()
                         / (whole.stem().string() + "_level" + std::to_string(level)
                            + whole.extension().string()))
                            .string();
}

std::string manifest_path(const std::string& path) {
    return fs::path(path).replace_extension().string() + end_of_name;
}

bool is_manifest(const std::string& path) {
    return path.ends_with(end_of_name);
}

void check_alike(const std::string& path, const std::string& file, const Volume& first,
                 const Volume& other) {
    const auto differ = [&](const std::string& what) {
        reject(path, file + " is of another bake than the finest level: they differ in " + what
                         + "; bake all levels together");
    };
    for (const char* fact : {"scene_hash", "settings"}) {
        const auto a = first.metadata.find(fact), b = other.metadata.find(fact);
        if ((a == first.metadata.end()) != (b == other.metadata.end())
            || (a != first.metadata.end() && a->second != b->second))
            differ(fact);
    }
    if (first.sh_order != other.sh_order)
        differ("the order of the harmonics");
}

WriteReport::File write_manifest(const std::string& path, const std::vector<Grid>& grids,
                                 volume::Axes axes, double blend) {
    Json levels = Json::array();
    for (std::size_t i = 0; i < grids.size(); ++i) {
        const Grid grid = volume::turned_grid(grids[i], volume::from_gltf(axes));
        const glm::dvec3 lo = grid.center(glm::ivec3(0)), hi = grid.center(grid.dims - 1);
        levels.push_back({{"file", fs::path(level_path(path, i)).filename().string()},
                          {"origin", array_of(grid.origin)},
                          {"cell", grid.cell},
                          {"dims", {grid.dims.x, grid.dims.y, grid.dims.z}},
                          {"box", {lo.x, lo.y, lo.z, hi.x, hi.y, hi.z}}});
    }
    const Json manifest{{"format", format_name},
                        {"version", version},
                        {"levels", levels},
                        {"blend", blend},
                        {"axes", volume::name_of(axes)}};
    const std::string name = manifest_path(path);
    const std::vector<std::string> further = further_levels(name, grids.size());
    AtomicFile file(name);
    file.write(text_of(manifest));
    const uint64_t bytes = file.seal();
    file.publish();
    remove_files(further);
    return {name, bytes};
}

std::vector<std::string> level_files(const std::string& manifest) {
    const Json json = parse(manifest);
    if (json["format"] == bricks_format_name)
        return files_of_bricks(manifest, json);
    std::vector<std::string> files;
    for (const Json& level : json["levels"])
        files.push_back((fs::path(manifest).parent_path() / file_in(manifest, level)).string());
    return files;
}

volume::VolumeSet read_levels(const std::string& path) {
    const Json json = parse(path);
    if (json["format"] == bricks_format_name)
        return read_bricks(path, json);
    volume::VolumeSet set;
    set.blend = number_in(path, json, "blend");
    if (!(set.blend > 0))
        reject(path, "has a \"blend\" that is not above 0");
    std::vector<std::string> files;
    for (const Json& level : json["levels"]) {
        const std::string file = printable(file_in(path, level));
        const Volume& read = set.levels.emplace_back(read_level(path, file_in(path, level)));
        const double cell = number_in(path, level, "cell");
        if (std::abs(cell - read.grid.cell) > 1e-6 * read.grid.cell)
            reject(path, file
                             + " has other cells than are listed: of another bake; bake all "
                               "levels together");
        if (set.levels.size() > 1) {
            const Volume& finer = set.levels[set.levels.size() - 2];
            check_alike(path, file, set.levels.front(), read);
            check_nested(path, files.back(), finer.grid, read.grid);
        }
        files.push_back(file);
    }
    return set;
}

} // namespace lpvbake::io
