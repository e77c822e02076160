// lpvbake reference: the path-traced volume that bakes are measured against.

#include "reference/reference.h"

#include "commands.h"
#include "error.h"
#include "image/image.h"
#include "result.h"
#include "scene_options.h"
#include "text.h"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>

namespace lpvbake {
namespace {

using Clock = std::chrono::steady_clock;

const char summary[] = "Path-traces the volume that a bake of the same options should be.";

const char manual[] =
    R"(Incident luminance at the centre of each cell, projected to spherical harmonics, on the grid that
bake makes of the same scene and options: the light of directional, point and spot lights after 1 to
--bounces reflections, and of emissive surfaces and the sky after none to --bounces. All surfaces
count, also outside the grid. Needs no GPU.

The estimate has no systematic error, and its random one is known. Rays come in 64 independent
batches, each stratified; from their scatter come the standard error of every coefficient (-e
writes it as a volume of its own; the metadata standard_error hold each grid's root mean square)
and the noise: the standard error of a cell's irradiance, root mean square over the 26 directions
to its neighbours and RGB, its mean over the cells relative to their mean irradiance. With --noise,
rays are doubled until it is reached. In a scene whose light never fades, closed and of albedo 1,
--bounces inf is refused.

With --probes only so many cells are evaluated, drawn by --seed from those outside geometry; the
others are 0 and not valid. A cell's value does not depend on which others are evaluated, and the
same options give the same bytes, whatever --threads says.

Examples:
  lpvbake reference room.glb -o room_truth.vdb --noise 1%
  lpvbake reference room.glb -o truth.vdb -e truth_error.vdb --bounces inf --rays 16384
  lpvbake reference room.glb -o truth.vdb --probes 1000 --noise 0.5% --resolution 64
  lpvbake diff room.vdb room_truth.vdb

JSON (--format json), one object; sizes in bytes, times in seconds:
  {"command": "reference", "version", "scene", "triangles", "grid": {"dims": [x, y, z], "cell",
   "origin": [x, y, z], "cells"}, "sh_order", "bounces": N or null (all), "seed", "probes" (cells
   evaluated), "rays" (from each), "noise", "standard_error": [nits, a number a grid], "traced"
   (rays in all), "outputs": [{"path", "bytes", "files": [{"path", "bytes"}]}], "stages": [{"name", "seconds"}], "seconds",
   "peak_memory", "warnings": [...]})";

/// Rays a cell where --rays leaves the number open.
constexpr uint64_t usual_rays = 1024, most_rays = 1 << 20;

struct ReferenceOptions : SceneOptions, RunOptions {
    OutputOptions outputs;
    std::string error_output;
    std::string sh_order = "1";
    std::string bounces = "1";
    uint64_t rays = 0;
    double noise = 0;
    uint64_t probes = 0;
    uint64_t seed = 1;
};

/// In the order of --help.
std::vector<Setting> settings_of(const ReferenceOptions& o) {
    std::vector<Setting> settings;
    if (!o.scene.empty())
        settings.push_back({"scene", toml_string(o.scene), false});
    if (!o.outputs.paths.empty())
        settings.push_back({"output", toml_array(o.outputs.paths), false});
    if (!o.error_output.empty())
        settings.push_back({"error-output", toml_string(o.error_output), false});
    append_grid_settings(o, settings);
    append_light_settings(o, settings);
    settings.push_back({"sh-order", toml_string(o.sh_order), true});
    settings.push_back({"bounces", toml_string(o.bounces), true});
    settings.push_back({"rays", std::to_string(o.rays), true});
    if (o.noise > 0)
        settings.push_back({"noise", toml_number(o.noise), true});
    settings.push_back({"probes", std::to_string(o.probes), true});
    settings.push_back({"seed", std::to_string(o.seed), true});
    append_output_settings(o.outputs, settings);
    settings.push_back({"threads", std::to_string(o.threads), false});
    settings.push_back({"format", toml_string(o.format), false});
    settings.push_back({"progress", toml_string(o.progress), false});
    return settings;
}

ReferenceSettings to_settings(const ReferenceOptions& o) {
    ReferenceSettings settings;
    settings.paths.bounces = bounces_of(o.bounces);
    settings.paths.emitters = !o.no_emitters;
    settings.sh_order = std::atoi(o.sh_order.c_str());
    settings.rays = o.rays > 0 ? o.rays : o.noise > 0 ? most_rays : usual_rays;
    settings.noise = o.noise;
    settings.seed = o.seed;
    settings.probes = o.probes;
    return settings;
}

std::vector<std::string> all_outputs(const ReferenceOptions& o) {
    std::vector<std::string> all = o.outputs.paths;
    if (!o.error_output.empty())
        all.push_back(o.error_output);
    return all;
}

/// All that can be known to be wrong before any work is done.
void check_options(const ReferenceOptions& o, bool cell_and_resolution) {
    check_paths("reference", o, all_outputs(o));
    if (o.outputs.paths.empty())
        throw Error(ErrorKind::argument, "no output: add -o FILE" + format_list(" or -o FILE"));
    if (cell_and_resolution)
        throw Error(ErrorKind::argument, "--cell-size and --resolution exclude each other");
}

struct Stage {
    const char* name;
    double seconds;
};

void print_result(const ReferenceOptions& o, const Scene& scene, const Reference& reference,
                  const std::vector<Stage>& stages, const std::vector<Written>& outputs,
                  double seconds, const std::vector<std::string>& warnings) {
    const Volume& volume = reference.volume;
    if (o.format == "json") {
        Json document{{"command", "reference"},
                      {"version", LPVBAKE_VERSION},
                      {"scene", o.scene},
                      {"triangles", triangle_count(scene)},
                      {"grid", grid_json(volume.grid)},
                      {"sh_order", volume.sh_order},
                      {"bounces", nullptr},
                      {"seed", o.seed},
                      {"probes", reference.probes},
                      {"rays", reference.rays},
                      {"noise", reference.noise},
                      {"standard_error", reference.standard_error},
                      {"traced", reference.traced},
                      {"outputs", Json::array()},
                      {"stages", Json::array()},
                      {"seconds", seconds},
                      {"peak_memory", peak_memory()},
                      {"warnings", warnings}};
        if (o.bounces != "inf")
            document["bounces"] = std::atoi(o.bounces.c_str());
        for (const Written& output : outputs)
            document["outputs"].push_back(output.json());
        for (const Stage& stage : stages)
            document["stages"].push_back({{"name", stage.name}, {"seconds", stage.seconds}});
        print_json(document);
        return;
    }
    print_grid(volume.grid);
    std::printf("light         %s\n", volume.metadata.at("content").c_str());
    std::printf("rays          %llu from each of %s, %.4g M in all\n",
                static_cast<unsigned long long>(reference.rays),
                counted(reference.probes, "cell").c_str(), 1e-6 * double(reference.traced));
    std::printf("noise         %.3g %% of the mean irradiance\n", 100 * reference.noise);
    for (const Stage& stage : stages)
        std::printf("%-12s  %7.3f s\n", stage.name, stage.seconds);
    std::printf("%-12s  %7.3f s  peak memory %s\n", "total", seconds,
                bytes_text(peak_memory()).c_str());
    for (const Written& output : outputs)
        output.print();
}

void run(const ReferenceOptions& o) {
    const Clock::time_point begin = Clock::now();
    const ReferenceSettings settings = to_settings(o);
    const std::optional<Bounds> bounds = grid_bounds(o);
    const std::vector<Light> lights = command_line_lights(o);
    probe_outputs(all_outputs(o));
    probe_scene(o);
    const auto thread_limit = limit_threads(o.threads);
    ImageModulePreload preload;
    if (mentions_images(o))
        preload = preload_image_module();

    watch_signals();
    TerminalProgress progress(progress_style(o.progress));
    std::vector<Stage> stages;
    progress.begin("load", 0);
    const Scene scene = load_scene(o, lights);
    for (const std::string& warning : scene.warnings)
        progress.warn(warning);
    stages.push_back({"load", seconds_since(begin)});

    const Clock::time_point tracing = Clock::now();
    const Bounds box = bounds.value_or(bounds_of(scene));
    if (triangle_count(scene) == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to light");
    Reference reference =
        make_reference(scene, fit_grid(box.lo, box.hi, grid_settings(o)), settings, progress);
    for (const std::string& warning : reference.warnings)
        progress.warn(warning);
    stages.push_back({"trace", seconds_since(tracing)});

    const Clock::time_point writing = Clock::now();
    const std::vector<Setting> used = settings_of(o);
    fill_metadata(o, scene, used, reference.volume);
    fill_metadata(o, scene, used, reference.error);
    std::vector<Written> written =
        write_outputs(o.outputs, o.outputs.paths, reference.volume, progress);
    if (!o.error_output.empty())
        std::ranges::move(write_outputs(o.outputs, {o.error_output}, reference.error, progress),
                          std::back_inserter(written));
    stages.push_back({"write", seconds_since(writing)});
    progress.clear();
    print_result(o, scene, reference, stages, written, seconds_since(begin), progress.warnings());
}

} // namespace

void add_reference(CLI::App& root, Action& action) {
    auto options = std::make_shared<ReferenceOptions>();
    ReferenceOptions& o = *options;
    CLI::App* app = root.add_subcommand("reference", summary);
    app->footer(manual);

    OptionList list(*app);
    list.text("scene", o.scene, "FILE", "glTF 2.0 file, .gltf or .glb");
    list.list("-o,--output", o.outputs.paths, "FILE", outputs_help().c_str());
    list.text("-e,--error-output", o.error_output, "FILE",
              ("Volume of the standard errors to write, " + format_list()).c_str());
    CLI::Option* resolution = add_grid_options(list, o);
    add_light_options(list, o);

    list.group("Paths");
    list.choice("--sh-order", o.sh_order, "1|2|4", "Highest band of the spherical harmonics");
    add_bounces_option(list, o.bounces);
    list.number("--rays", o.rays, 0, 1e9,
                "Rays from each cell, rounded up to a multiple of 64; at most so\n"
                "many with --noise; 0: 1024, with --noise 1048576")
        ->capture_default_str();
    list.text("--noise", o.noise, "X|X%", "Trace until the noise of irradiance is at most this")
        ->transform(share_or_percent());
    list.number("--probes", o.probes, 0, 2147483647,
                "Evaluate only so many of the cells outside geometry; 0: all cells")
        ->capture_default_str();
    list.number("--seed", o.seed, 0, 4294967295, "Another one gives an independent estimate")
        ->capture_default_str();

    add_output_options(list, o.outputs);

    list.group("Run");
    add_run_options(list, o);

    app->callback([app, resolution, options, &action] {
        const bool both = settle(*app, *resolution, options->config, *options);
        action = [options, both] {
            if (options->print_config) {
                print_config(settings_of(*options));
                return;
            }
            check_options(*options, both);
            run(*options);
        };
    });
}

} // namespace lpvbake
