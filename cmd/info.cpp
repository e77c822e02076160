// lpvbake info: what a scene or a volume holds.

#include "commands.h"
#include "io/chart.h"
#include "io/described.h"
#include "io/glb.h"
#include "io/levels.h"
#include "io/slice.h"
#include "lpvbake/error.h"
#include "options/wording.h"
#include "quoted.h"
#include "report/describe.h"
#include "scene/scene_hash.h"
#include "scene_options.h"
#include "text.h"
#include "world_volume.h"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

const char manual[] =
#include "manual/info.txt.h"
    ;

struct InfoOptions {
    std::string file;
    LoadSettings load;
    bool hash = false;
    WorldOptions world;
    std::optional<options::Slice> slice;
    std::string output;
    std::optional<float> white; ///< nits; none: the slice's own
    Format format = Format::text;
};

/// Returns by which scale.
io::SliceScale draw_slice(const InfoOptions& o, const Volume& volume) {
    options::check_slice(*o.slice, volume.grid);
    const auto [axis, index] = *o.slice;
    const io::SliceScale scale =
        o.white ? io::SliceScale{*o.white} : io::slice_scale(volume, axis, index);
    const io::Legend legend{std::string(1, "xyz"[axis]) + " = " + std::to_string(index) + ", nits",
                            [](double share) { return glm::vec3(float(share)); },
                            [&scale](double share) { return scale.luminance_at(share); }};
    io::write_png(o.output, io::chart(io::slice_picture(volume, axis, index, scale), volume.grid,
                                      axis, legend));
    return scale;
}

/// Throws Error (argument) for options that a volume has no use for.
void refuse_scene_options(const std::string& file, const options::Options& options) {
    for (const options::Option& option : options.rows())
        if (option.group == "Scene" && option.is_set())
            throw Error(ErrorKind::argument,
                        "--" + option.name() + ": " + file + " is a volume, not a scene");
}

/// What is told of a file.
struct Told {
    report::Json json;
    std::string text;
};

/// All bricks of a level as one volume: what they hold, and not where.
Told tell_of_bricks(const InfoOptions& o, const volume::VolumeSet& set) {
    const volume::BrickTree& tree = *set.bricks;
    Told told{{{"command", "info"},
               {"file", o.file},
               {"kind", "bricks"},
               {"bricks", report::Json::array()}},
              "bricks     " + o.file + format(", %zu of 8 x 8 x 8 cells\n", set.levels.size())};
    for (int level = 0; level < tree.levels().count; ++level) {
        const Grid grid = tree.levels().lattice(level);
        const auto bricks = std::ranges::count(tree.bricks(), level, &volume::Brick::level);
        const glm::ivec3 places = tree.levels().places(level);
        const double all = double(places.x) * places.y * places.z;
        told.json["bricks"].push_back({{"grid", report::grid_json(grid)}, {"count", bricks}});
        told.text +=
            format("level %d    %td bricks, %.3g %% of its lattice of %d x %d x %d samples "
                   "every %.4g m\n",
                   level, bricks, 100 * double(bricks) / all, grid.dims.x, grid.dims.y, grid.dims.z,
                   grid.cell);
    }
    const Volume all = volume::stacked(set.levels);
    told.json["volume"] = report::volume_json("all bricks", all);
    told.json["volume"]["slice"] = nullptr;
    told.text += report::volume_text("all bricks", all);
    return told;
}

Told tell_of_places(const InfoOptions& o, const volume::VolumeSet& set) {
    Told told{{{"command", "info"},
               {"file", o.file},
               {"kind", "volumes"},
               {"volumes", report::Json::array()}},
              "volumes    " + o.file + format(", %zu, by falling priority\n", set.levels.size())};
    for (std::size_t i = 0; i < set.levels.size(); ++i) {
        const volume::Place& place = set.places[i];
        const std::string title = volume::title_of(set, i);
        report::Json volume = report::volume_json(title, set.levels[i]);
        volume["slice"] = nullptr;
        told.json["volumes"].push_back({{"name", place.name},
                                        {"priority", place.priority},
                                        {"falloff", place.falloff},
                                        {"volume", volume}});
        told.text += report::volume_text(title, set.levels[i]);
        told.text +=
            format("place      priority %d, falloff %.4g m\n", place.priority, place.falloff);
    }
    return told;
}

Told tell_of_levels(const InfoOptions& o) {
    if (o.slice)
        throw Error(ErrorKind::argument,
                    "--slice: " + o.file + " is a set of volumes; give the file of one");
    const volume::VolumeSet set = io::read_levels(o.file);
    if (set.bricks)
        return tell_of_bricks(o, set);
    if (!set.places.empty())
        return tell_of_places(o, set);
    Told told{{{"command", "info"},
               {"file", o.file},
               {"kind", "levels"},
               {"blend", set.blend},
               {"levels", report::Json::array()}},
              "levels     " + o.file
                  + format(", %zu, finest first, blended over %.3g cells of the next\n",
                           set.levels.size(), set.blend)};
    for (std::size_t level = 0; level < set.levels.size(); ++level) {
        const std::string name = volume::title_of(set, level);
        told.json["levels"].push_back(report::volume_json(name, set.levels[level]));
        told.json["levels"].back()["slice"] = nullptr;
        told.text += report::volume_text(name, set.levels[level]);
    }
    return told;
}

/// Of one lighting: which of its tiles are there, and what the first of these says of itself. No
/// other is opened.
void tell_of_lighting(const io::WorldVolume& world, Told& told) {
    const glm::dvec3 dims(world.grid.dims);
    std::size_t there = 0;
    uint64_t bytes = 0, cells = 0;
    for (const io::WorldVolume::Tile& tile : world.tiles) {
        const glm::dvec3 own(tile.end - tile.begin);
        cells += uint64_t(own.x * own.y * own.z);
        if (!io::is_there(tile.file))
            continue;
        ++there;
        std::vector<std::string> files;
        io::add_with_textures(tile.file, files);
        for (const std::string& file : files) {
            std::error_code none; // of textures, that of the tile itself
            const uint64_t size = fs::file_size(file, none);
            bytes += none ? 0 : size;
        }
    }
    report::Json json{{"name", world.scenario},
                      {"grid", report::grid_json(world.grid)},
                      {"tiles", world.tiles.size()},
                      {"there", there},
                      {"cells", cells},
                      {"bytes", bytes},
                      {"sh_order", nullptr},
                      {"metadata", nullptr}};
    told.text += format("lighting   %s: %zu of %zu tiles are there, %s\n", world.scenario.c_str(),
                        there, world.tiles.size(), bytes_text(bytes).c_str());
    told.text += format("grid       %d x %d x %d cells of %.6g m, %.3g %% of them in tiles\n",
                        world.grid.dims.x, world.grid.dims.y, world.grid.dims.z, world.grid.cell,
                        100 * double(cells) / (dims.x * dims.y * dims.z));
    const glm::dvec3 at = world.grid.center(glm::ivec3(0));
    told.text += format("transform  index (i, j, k) at (%.6g, %.6g, %.6g) + %.6g (i, j, k) m\n",
                        at.x, at.y, at.z, world.grid.cell);
    if (there > 0) {
        const Volume header = header_of(world);
        json["sh_order"] = header.sh_order;
        json["metadata"] = header.metadata;
        for (const auto& [key, value] : header.metadata)
            told.text += "lpv:" + key + " = " + value + "\n";
    }
    told.json["lightings"].push_back(json);
}

Told tell_of_world(const InfoOptions& o) {
    if (o.slice)
        throw Error(ErrorKind::argument,
                    "--slice: " + o.file + " is of many tiles; give the file of one");
    const io::World world = io::read_world(o.file);
    Told told{
        {{"command", "info"},
         {"file", o.file},
         {"kind", "world"},
         {"program", world.program},
         {"scene", world.scene},
         {"cell", world.cell},
         {"tile", world.tile},
         {"surroundings", world.surroundings},
         {"lightings", report::Json::array()}},
        format("world      %s, of %s, by lpvbake %s: tiles of %d cells of %.6g m, lit by what "
               "is within %.6g m\n",
               o.file.c_str(), printable(world.scene).c_str(), printable(world.program).c_str(),
               world.tile, world.cell, world.surroundings)};
    for (const io::World::Scenario& each : world.scenarios)
        if (o.world.scenario.empty() || each.name == o.world.scenario)
            tell_of_lighting(io::world_volume(o.file, world, each.name), told);
    if (told.json["lightings"].empty())
        io::world_volume(o.file, world, o.world.scenario); // throws
    return told;
}

Told tell_of_volume(const InfoOptions& o) {
    if (io::is_world(o.file))
        return tell_of_world(o);
    if (io::is_manifest(o.file))
        return tell_of_levels(o);
    const Volume volume = read_volume(o.file);
    Told told{report::volume_json(o.file, volume), report::volume_text(o.file, volume)};
    told.json["slice"] = nullptr;
    if (o.slice) {
        const io::SliceScale scale = draw_slice(o, volume);
        told.json["slice"] = {
            {"output", o.output}, {"white", scale.white}, {"exponent", scale.exponent}};
        told.text += "wrote      " + o.output + ", white is " + format("%.4g nits\n", scale.white);
    }
    return told;
}

/// A .glb may hold its light, too.
Told tell_of_scene(const InfoOptions& o) {
    image::ImageModulePreload preload;
    SceneOptions scene_options;
    scene_options.scene = o.file;
    probe_scene(scene_options);
    const bool has_volume = io::volume_format(o.file) && io::has_light_volume(o.file);
    if (o.slice && !has_volume)
        throw Error(ErrorKind::argument, "--slice: " + o.file + " is a scene, not a volume");
    if (mentions_images(scene_options))
        preload = image::preload_image_module();
    LoadSettings settings = o.load;
    // What looks for every fault, or asks for every texel, needs them.
    settings.skip_colors = !o.load.strict && !o.hash;
    Scene scene = load_gltf(o.file, settings);
    for (std::string& warning : scene.warnings)
        print_warning(warning = options::in_options(warning));
    const std::string hash = o.hash ? scene::scene_hash(scene) : "";
    Told told{report::scene_json(o.file, scene, hash), report::scene_text(o.file, scene, hash)};
    told.json["volume"] = nullptr;
    if (has_volume) {
        const Told volume = tell_of_volume(o);
        told.json["volume"] = volume.json;
        told.text += volume.text;
    }
    return told;
}

void run(const InfoOptions& o, const options::Options& options) {
    if (o.slice.has_value() == o.output.empty())
        throw Error(ErrorKind::argument,
                    "--slice and -o belong together: --slice z=16 -o slice.png");
    if (!o.output.empty() && !options::has_extension(o.output, ".png"))
        throw Error(ErrorKind::argument, o.output + ": the name of a picture ends in .png");
    const bool is_scene = o.file == standard_input || options::has_extension(o.file, ".gltf")
                          || options::has_extension(o.file, ".glb");
    check_scenario(o.world, {o.file});
    if (!is_scene && !io::readable_format(o.file) && !io::is_world(o.file)) {
        SceneOptions file;
        file.scene = o.file;
        probe_scene(file); // where there is none, that is what is wrong
        throw Error(ErrorKind::argument, o.file + ": neither a scene (.gltf, .glb) nor a volume ("
                                             + io::format_list(", ", true) + ")");
    }
    if (!is_scene)
        refuse_scene_options(o.file, options);
    const Told told = is_scene ? tell_of_scene(o) : tell_of_volume(o);
    o.format == Format::json ? print_json(told.json) : print_text(told.text);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<InfoOptions>();
    InfoOptions& o = *fields;
    options.text("file", o.file, "FILE", "Scene or volume; -: a scene from standard input")
        .require();
    options.value("--slice", o.slice, "AXIS=INDEX", options::parse_slice,
                  "Layer of cells to draw, such as z=16; needs -o");
    options
        .number("--white", o.white, 1e-12, 1e12,
                "Mean luminance drawn white, nits; default: the 99th percentile of what is lit in "
                "the slice; where most of that is dark, it is lifted")
        .need("slice");
    options.text("-o,--output", o.output, "FILE", "PNG to write");
    add_format_option(options, o.format);
    add_scenario_option(options, o.world);
    add_load_options(options, o.load);
    options.flag("--hash", o.hash,
                 "Tell the hash that bakes by the file's own light record as scene_hash; it takes "
                 "all pictures, decoded");
    return [fields, &options] { run(*fields, options); };
}

} // namespace

options::Command info_command() {
    return {"info", "Tells what a scene or a volume file holds.", manual, declare};
}

} // namespace lpvbake::cmd
