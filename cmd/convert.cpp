// lpvbake convert: a volume in another file format, convention or order.

#include "bake/volume_fit.h"
#include "commands.h"
#include "io/levels.h"
#include "io/vdb.h"
#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "scene_options.h"
#include "volume/dilate.h"
#include "volume/sh.h"
#include "world_volume.h"

#include <algorithm>
#include <iterator>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/convert.txt.h"
    ;

struct ConvertOptions {
    std::string file;
    WorldOptions world;
    OutputOptions outputs;
    std::optional<int> sh_order; ///< none: the volume's
    FitOptions fit;
    std::string scene;             ///< whose surfaces it is fitted to; empty: its own walls
    std::optional<double> flatten; ///< metres
    Format format = Format::text;
};

/// The volume without the bands above `order`. Throws Error (argument) if it has not got so many.
void limit_order(Volume& volume, int order, const std::string& path) {
    if (order > volume.sh_order)
        throw Error(ErrorKind::argument, "--sh-order: " + path + " has order "
                                             + std::to_string(volume.sh_order) + ", not "
                                             + std::to_string(order));
    volume.sh_order = order;
    volume.sh.resize(std::size_t(volume::sh_count(order)));
}

/// Whether to fit to the target's program: as bake does, where it is not done and can be.
bool fits(const ConvertOptions& o, const Volume& volume) {
    const bool able = !volume.metadata.contains("fit")
                      && (!o.scene.empty() || (!volume.walls.empty() && !volume.validity.empty()));
    const bool asked = o.fit.fit.value_or(o.fit.evaluation != readers::Evaluation::linear);
    if (asked && !able)
        throw Error(ErrorKind::argument,
                    o.file
                        + (volume.metadata.contains("fit")
                               ? ": is fitted to what " + volume.metadata.at("fit")
                                     + " reads already; --fit none"
                               : ": has no grids of walls to fit to; --scene FILE has surfaces"));
    return able && fits(o.outputs, o.fit);
}

/// Of the volume with all of its bands.
bake::SurfacePoints points_of(const ConvertOptions& o, const Volume& volume,
                              TerminalProgress& progress) {
    if (o.scene.empty())
        return bake::wall_points(volume);
    const Scene scene = load_gltf(o.scene, {});
    for (const std::string& warning : scene.warnings)
        progress.warn(warning);
    return bake::scene_points(scene, volume, progress);
}

void fit(const ConvertOptions& o, const bake::SurfacePoints& to, TerminalProgress& progress,
         Volume& volume) {
    const readers::Reader reader = reader_of(*o.outputs.target, o.fit);
    bake::SurfaceFitSettings settings;
    settings.dering = o.outputs.storage().dering;
    const bake::SurfaceFit fit =
        bake::fit_to_points(reader, to.points, to.checks, settings, volume);
    volume.metadata["fit_to"] = o.scene.empty() ? "walls" : "surfaces";
    if (fit.fit.share == 0)
        progress.warn(o.file + ": no fit brings what " + reader.name
                      + " shows nearer to what the volume holds: it is as with --fit none");
}

/// One volume, or nested levels; flattened where that is asked for.
volume::VolumeSet read_levels(const ConvertOptions& o) {
    volume::VolumeSet set;
    if (io::is_manifest(o.file))
        set = io::read_levels(o.file);
    else if (io::is_world(o.file))
        set.levels.push_back(read_world(o.file, o.world));
    else
        set.levels.push_back(read_volume(o.file));
    if (o.flatten && !set.places.empty())
        throw Error(ErrorKind::unsupported,
                    o.file
                        + ": --flatten is for nested levels, and these volumes stand beside each "
                          "other; give the file of one");
    if (o.flatten) {
        set = {{volume::flatten(set, *o.flatten)}};
        for (const char* fact : {"level", "level_set"})
            set.levels.front().metadata.erase(fact);
    }
    for (Volume& volume : set.levels) // it is as no bake would write it
        for (const char* fact : {"bake_hash", "output_settings"})
            volume.metadata.erase(fact);
    return set;
}

/// Throws Error (argument) for what is not done to bricks.
void check_bricks(const ConvertOptions& o) {
    check_brick_outputs(o.outputs);
    check_level_outputs(o.outputs.paths, {o.file});
    if (o.fit.fit.value_or(false) || o.fit.dilate > 0 || !o.scene.empty()
        || o.fit.evaluation != readers::Evaluation::linear)
        throw Error(ErrorKind::argument, o.file
                                             + ": bricks are not fitted or filled; first make one "
                                               "volume of them by --flatten H");
}

/// Makes of a volume what is asked for.
void change(const ConvertOptions& o, TerminalProgress& progress, Volume& volume) {
    const bool fitted = fits(o, volume);
    const bake::SurfacePoints to = fitted ? points_of(o, volume, progress) : bake::SurfacePoints{};
    if (o.sh_order || o.fit.evaluation != readers::Evaluation::linear)
        limit_order(volume, o.sh_order.value_or(1), o.file);
    if (o.fit.dilate > 0) {
        volume::dilate(volume, o.fit.dilate);
        volume.metadata["dilate"] = std::to_string(o.fit.dilate);
    }
    if (fitted)
        fit(o, to, progress, volume);
}

void print_result(const ConvertOptions& o, const Grid& grid, const Volume& finest,
                  const std::vector<Written>& written, const TerminalProgress& progress) {
    report::Json document{{"command", "convert"},
                          {"file", o.file},
                          {"grid", report::grid_json(grid)},
                          {"sh_order", finest.sh_order},
                          {"outputs", outputs_json(written)},
                          {"warnings", progress.warnings()}};
    add_fit(finest, document);
    print_json(document);
}

/// Whether tiles of a world are copied into the outputs as they are, grid by grid.
bool is_export(const ConvertOptions& o) {
    const io::Target storage = o.outputs.storage();
    const volume::Encoding usual;
    return io::is_world(o.file) && !o.sh_order && !o.flatten && o.fit.dilate == 0
           && !o.fit.fit.value_or(false) && o.scene.empty()
           && o.fit.evaluation == readers::Evaluation::linear
           && o.outputs.target == io::target_named("generic")
           && storage.encoding.convention == usual.convention && storage.encoding.axes == usual.axes
           && !storage.encoding.corner_index
           && (storage.precision == Precision::full || storage.precision == Precision::half)
           && std::ranges::all_of(o.outputs.paths, [](const std::string& path) {
                  return io::volume_format(path) == &io::vdb_format;
              });
}

void run_export(const ConvertOptions& o, const io::WorldVolume& world) {
    TerminalProgress progress(ProgressStyle::none);
    std::vector<Written> written;
    Volume header;
    for (const std::string& path : o.outputs.paths) {
        const io::WorldExport made =
            io::export_world(world, path, o.outputs.storage().precision, progress);
        header.sh_order = made.sh_order;
        written.push_back({path, made.report.files});
        tell("wrote " + path);
    }
    if (o.format == Format::json) {
        print_result(o, world.grid, header, written, progress);
        return;
    }
    print_grid(world.grid);
    print_outputs(written);
}

void run(const ConvertOptions& o) {
    for (const std::string& path : o.outputs.paths)
        if (!io::volume_format(path))
            throw Error(ErrorKind::argument,
                        path + ": unknown kind of volume file; use " + io::format_list());
    std::vector<std::string> inputs{o.file};
    if (io::is_manifest(o.file)) {
        std::ranges::copy(io::level_files(o.file), std::back_inserter(inputs));
        if (!o.flatten)
            check_level_outputs(o.outputs.paths, inputs);
    }
    check_scenario(o.world, {o.file});
    std::optional<io::WorldVolume> world;
    if (io::is_world(o.file)) {
        world.emplace(open_world(o.file, o.world));
        inputs = files_of(*world);
    }
    check_files({o.scene}, inputs, o.outputs.paths);
    check_fit(o.outputs, o.fit, o.sh_order.value_or(0));
    watch_signals();
    if (is_export(o) && io::can_export(*world)) {
        run_export(o, *world);
        return;
    }
    TerminalProgress progress(ProgressStyle::none);
    volume::VolumeSet set = read_levels(o);
    if (set.bricks)
        check_bricks(o);
    if (!set.places.empty())
        check_level_outputs(o.outputs.paths, inputs, set.places);
    const std::optional<PackedScene> packed =
        o.scene.empty() ? std::nullopt : packed_for(o.outputs.paths, o.scene, {});
    for (Volume& volume : set.levels)
        if (set.bricks && o.sh_order)
            limit_order(volume, *o.sh_order, o.file);
        else if (!set.bricks)
            change(o, progress, volume);
    const std::vector<Written> written =
        write_levels(o.outputs, o.outputs.paths, set, progress, packed);
    const Volume& finest = set.levels.front();
    if (o.format == Format::json) {
        print_result(o, set.finest(), finest, written, progress);
        return;
    }
    if (set.bricks)
        print_grid(set.finest());
    for (const Volume& volume : set.levels)
        if (!set.bricks)
            print_grid(volume.grid);
    print_outputs(written);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<ConvertOptions>();
    ConvertOptions& o = *fields;
    options
        .text("file", o.file, "IN",
              "Volume: " + io::format_list(" or ", true)
                  + ", the .levels.json of nested ones, the .volumes.json of ones beside each "
                    "other and the .world.json of tiles too")
        .require();
    options.texts("output", o.outputs.paths, "OUT", "Volumes to write: " + io::format_list())
        .require();
    options.number("--sh-order", o.sh_order, 0, 4, "Highest band to keep; default: the volume's");
    options.number("--flatten", o.flatten, 1e-9, 1e9,
                   "Resample the nested levels of a .levels.json into one volume of cells of H "
                   "metres, or a volume into other cells");
    options.number("--dilate", o.fit.dilate, 0, 1024,
                   "Rings of cells inside geometry to fill from those around them");
    options.choice(
        "--fit", o.fit.fit, options::Choices<bool>{{"none", false}, {"surfaces", true}},
        "surfaces: values with which the target's program shows on surfaces what our own "
        "sampler reads there; default: as for bake, where the volume has walls and is not "
        "fitted");
    add_evaluation_option(options, o.fit);
    options.text(
        "--scene", o.scene, "FILE",
        "The volume's scene, glTF 2.0: surfaces to fit to, default the volume's walls, and "
        "what a .glb holds beside the volume");
    add_scenario_option(options, o.world);
    add_cells_option(options, o.world);
    add_output_options(options, o.outputs);
    add_format_option(options, o.format);
    return [fields] { run(*fields); };
}

} // namespace

options::Command convert_command() {
    return {"convert", "Writes a volume in another format, convention or order.", manual, declare};
}

} // namespace lpvbake::cmd
