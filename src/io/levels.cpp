#include "io/levels.h"

#include "io/atomic_file.h"
#include "io/bricks.h"
#include "io/described.h"
#include "io/io.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace lpvbake::io {
namespace {

namespace fs = std::filesystem;

/// What a manifest of levels, or of places, is called, and calls what it lists.
struct Words {
    const char* end_of_name;
    const char* format_name;
    const char* list;
    const char* one;
};
constexpr Words of_levels{".levels.json", "lpvbake levels", "levels", "level"};
constexpr Words of_places{".volumes.json", "lpvbake volumes", "volumes", "volume"};

const Words& words_of(const std::string& path) {
    return path.ends_with(of_places.end_of_name) ? of_places : of_levels;
}

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
    const Words& words = words_of(path);
    const Json json = Json::parse(read_file(path, most_bytes), nullptr, false);
    const Json format = json.is_object() ? json.value("format", Json()) : Json();
    if (format != words.format_name && !(&words == &of_levels && format == bricks_format_name))
        reject(path,
               std::string("is no manifest of ") + words.list + ", or damaged; bake them again");
    if (json.value("version", Json()) != version)
        reject(path, "has another \"version\" than " + std::to_string(version)
                         + ", which is all that this lpvbake reads");
    const std::size_t most = &words == &of_places ? volume::most_places : volume::most_levels;
    const auto list = json.find(words.list);
    if (list == json.end() || !list->is_array() || list->empty() || list->size() > most)
        reject(path,
               std::string("lists no ") + words.list + ", or more than " + std::to_string(most));
    return json;
}

std::string file_in(const std::string& path, const Json& level) {
    const Json file = level.is_object() ? level.value("file", Json()) : Json();
    if (!file.is_string() || file.get<std::string>().empty()
        || file.get<std::string>().find('/') != std::string::npos)
        reject(path, std::string("has a ") + words_of(path).one
                         + " without the name of a \"file\" beside it");
    const std::string name = file.get<std::string>();
    if (is_manifest(name) || !readable_format(name))
        reject(path, std::string("has a ") + words_of(path).one + " in " + printable(name)
                         + ", which is no kind of volume file");
    return name;
}

/// Files that the manifest of a former bake lists, if there is one, and a set of so many levels or
/// of these places does not have.
std::vector<std::string> further_files(const std::string& manifest, std::size_t levels,
                                       const std::vector<volume::Place>& places) {
    std::vector<std::string> files, further;
    try {
        files = level_files(manifest);
    } catch (const Error&) { // it is replaced whatever it holds
    }
    for (std::size_t i = places.empty() ? std::max<std::size_t>(levels, 1) : 0; i < files.size();
         ++i) {
        const std::string stem = fs::path(files[i]).stem().string();
        const auto begin =
            fs::path(set_stem(manifest)).filename().string() + "_"; // others are not of our naming
        const bool is_of_former =
            places.empty() ? stem.ends_with("_level" + std::to_string(i))
                           : stem.starts_with(begin)
                                 && std::ranges::none_of(places, [&](const volume::Place& place) {
                                        return stem == begin + place.name;
                                    });
        if (is_of_former)
            add_with_textures(files[i], further);
    }
    return further;
}

Volume read_level(const std::string& manifest, const std::string& file) {
    try {
        return lpvbake::read_volume((fs::path(manifest).parent_path() / file).string());
    } catch (const Error& error) {
        if (error.kind != ErrorKind::file)
            throw;
        throw Error(error.kind, manifest + ": " + error.what() + "; keep all files of the "
                                    + words_of(manifest).list + " beside it, or bake them again");
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

volume::Place place_in(const std::string& path, const Json& json) {
    const Json name = json.value("name", Json());
    if (!name.is_string() || name.get<std::string>().empty())
        reject(path, "has a volume without a \"name\"");
    const double priority = number_in(path, json, "priority");
    const double falloff = number_in(path, json, "falloff");
    if (priority != std::round(priority) || std::abs(priority) > 1e6 || falloff < 0)
        reject(path, "has a volume " + printable(name.get<std::string>())
                         + " whose \"priority\" is no whole number to a million or whose "
                           "\"falloff\" is below 0");
    return {printable(name.get<std::string>()), int(priority), falloff};
}

/// In the words of each program.
Json place_json(const volume::Place& place, const Grid& grid) {
    const glm::dvec3 size = grid.cell * glm::dvec3(grid.dims);
    return {{"turn", {grid.turn.x, grid.turn.y, grid.turn.z, grid.turn.w}},
            {"priority", place.priority},
            {"falloff", place.falloff},
            {"vrc", {{"weight", place.priority}, {"smooth_blending", place.falloff}}},
            {"bevy", {{"falloff", array_of(glm::min(2 * place.falloff / size, glm::dvec3(1)))}}},
            {"threejs", {{"priority", place.priority}}}};
}

} // namespace

std::string level_path(const std::string& path, std::size_t level) {
    return level == 0 ? path : with_suffix(path, "_level" + std::to_string(level));
}

std::string member_path(const std::string& path, const std::vector<volume::Place>& places,
                        std::size_t i) {
    return places.empty() ? level_path(path, i) : with_suffix(path, "_" + places[i].name);
}

std::string manifest_path(const std::string& path, bool placed) {
    return fs::path(path).replace_extension().string()
           + (placed ? of_places : of_levels).end_of_name;
}

bool is_manifest(const std::string& path) {
    return path.ends_with(of_levels.end_of_name) || path.ends_with(of_places.end_of_name);
}

std::string set_path(const std::string& path, std::size_t levels, bool placed) {
    return levels > 1 || placed ? manifest_path(path, placed) : path;
}

std::string set_stem(const std::string& set_path) {
    const std::size_t end = is_manifest(set_path)
                                ? std::string(words_of(set_path).end_of_name).size()
                                : fs::path(set_path).extension().string().size();
    return set_path.substr(0, set_path.size() - end);
}

void check_alike(const std::string& path, const std::string& file, const Volume& first,
                 const Volume& other) {
    const auto differ = [&](const std::string& what) {
        reject(path, file + " is of another bake than the first " + words_of(path).one
                         + ": they differ in " + what + "; bake all together");
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
                                 volume::Axes axes, double blend,
                                 const std::vector<volume::Place>& places) {
    const Words& words = places.empty() ? of_levels : of_places;
    Json list = Json::array();
    for (std::size_t i = 0; i < grids.size(); ++i) {
        const Grid grid = volume::turned_grid(grids[i], volume::from_gltf(axes));
        const double out = places.empty() ? 0.5 : 0.0; // cells
        const glm::dvec3 lo = grid.origin + grid.cell * out,
                         hi = grid.origin + grid.cell * (glm::dvec3(grid.dims) - out);
        Json& one = list.emplace_back(Json::object());
        if (!places.empty())
            one["name"] = places[i].name;
        one.update({{"file", fs::path(member_path(path, places, i)).filename().string()},
                    {"origin", array_of(grid.origin)},
                    {"cell", grid.cell},
                    {"dims", {grid.dims.x, grid.dims.y, grid.dims.z}},
                    {"box", {lo.x, lo.y, lo.z, hi.x, hi.y, hi.z}}});
        if (!places.empty())
            one.update(place_json(places[i], grid));
    }
    Json manifest{{"format", words.format_name}, {"version", version}, {words.list, list}};
    if (places.empty())
        manifest["blend"] = blend;
    manifest["axes"] = volume::name_of(axes);
    const std::string name = manifest_path(path, !places.empty());
    const std::vector<std::string> further = further_files(name, grids.size(), places);
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
    for (const Json& level : json[words_of(manifest).list])
        files.push_back((fs::path(manifest).parent_path() / file_in(manifest, level)).string());
    return files;
}

std::size_t most_places(const Target& target) {
    return &target == target_named("vrc") ? 32 : volume::most_places;
}

void check_places(const Target& target, const std::vector<volume::Place>& places,
                  const std::vector<Grid>& grids) {
    if (&target == target_named("vrc") && places.size() > most_places(target))
        throw Error(ErrorKind::argument,
                    format("`volume`: VRC Light Volumes shows %zu volumes at once, not %zu; bake "
                           "fewer, or larger ones",
                           most_places(target), places.size()));
    if (&target == target_named("threejs"))
        for (std::size_t i = 0; i < grids.size(); ++i)
            if (grids[i].is_turned())
                throw Error(ErrorKind::argument,
                            "`volume` " + in_quotes(places[i].name)
                                + " is turned, and three.js' LightProbeGridWebGL stands along the "
                                  "axes; give it a box along them, or turn the scene");
    if (&target == target_named("bevy"))
        if (const auto [a, b] = volume::overlapping(places, grids); !a.empty())
            throw Error(
                ErrorKind::argument,
                "`volume` " + in_quotes(a) + " overlaps " + in_quotes(b)
                    + ", and Bevy shows the mean of both there; give them boxes beside each "
                      "other");
}

volume::VolumeSet read_levels(const std::string& path) {
    const Json json = parse(path);
    if (json["format"] == bricks_format_name)
        return read_bricks(path, json);
    const bool placed = &words_of(path) == &of_places;
    volume::VolumeSet set;
    if (!placed)
        set.blend = number_in(path, json, "blend");
    if (!(set.blend > 0))
        reject(path, "has a \"blend\" that is not above 0");
    std::vector<std::string> files;
    for (const Json& level : json[words_of(path).list]) {
        const std::string file = printable(file_in(path, level));
        const Volume& read = set.levels.emplace_back(read_level(path, file_in(path, level)));
        const double cell = number_in(path, level, "cell");
        if (std::abs(cell - read.grid.cell) > 1e-6 * read.grid.cell)
            reject(path, file
                             + " has other cells than are listed: of another bake; bake all "
                               "together");
        if (set.levels.size() > 1)
            check_alike(path, file, set.levels.front(), read);
        if (placed) {
            set.places.push_back(place_in(path, level));
        } else if (set.levels.size() > 1) {
            const Volume& finer = set.levels[set.levels.size() - 2];
            check_nested(path, files.back(), finer.grid, read.grid);
        }
        files.push_back(file);
    }
    if (placed)
        volume::order_by_priority(set);
    return set;
}

} // namespace lpvbake::io
