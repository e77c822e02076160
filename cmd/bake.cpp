// lpvbake bake: from a glTF file to volume files.

#include "bake.h"

#include "commands.h"
#include "error.h"
#include "image/image.h"
#include "result.h"
#include "scene_options.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <future>
#include <memory>

namespace lpvbake {
namespace {

using Clock = std::chrono::steady_clock;

const char summary[] = "Bakes the light that a scene's surfaces send on into volume files.";

const char manual[] =
    R"(The field holds the reflected light of directional, point and spot lights, and the light of
emissive surfaces and of the sky (--sky), direct and reflected; --bounces says how often, once with
the lpv solver and without end with the others unless told. Lengths are metres, +Y is up. Lights come from the file
(KHR_lights_punctual), from --sun, --point and --lights; at least one light or emitter is needed.

Examples:
  lpvbake bake room.glb -o room.vdb
  lpvbake bake room.glb -o room.vdb -o room.exr --resolution 64
  lpvbake bake town.gltf -o town.vdb --bounds -120,-5,-120,120,20,120 --sun 30,50,100000,#fff1e0
  lpvbake bake hall.glb -o hall.exr --point 0,2.5,0,200 --exr-packing channel --precision half
  lpvbake bake room.glb -o room.vdb --print-config > room.toml
  lpvbake bake --config room.toml --resolution 128

Outputs are written under a temporary name and renamed: there is the old file or the new one, never
a part. The same input gives the same bytes, whatever --threads says.

--threads bounds the program's own threads (oneTBB) and, through LP_NUM_THREADS, those of Mesa's
CPU driver llvmpipe. 0 takes every core, and leaves LP_NUM_THREADS as the environment has it.

JSON (--format json), one object; sizes in bytes, times in seconds:
  {"command": "bake", "version", "scene", "triangles", "device": {"index", "name", "type", "uuid", "driver",
   "api"}, "grid": {"dims": [x, y, z], "cell", "origin": [x, y, z], "cells"}, "dry_run",
   "outputs": [{"path", "bytes", "files": [{"path", "bytes"}]}], "stages": [{"name", "seconds", "detail"}], "seconds",
   "peak_memory", "warnings": [...]}
With --dry-run, "outputs" have no bytes, "seconds" is an estimate, "peak_memory" is absent, and
"rsm": {"maps", "size"}, "device_bytes" and "host_bytes" say what it takes.)";

/// Options as given; `to_settings` makes them the core's enums and structs.
struct BakeOptions : SceneOptions, RunOptions {
    OutputOptions outputs;
    std::string solver = "lpv";
    std::string quality = "balanced";
    std::string bounces; ///< empty: 1 for lpv, all for the others
    int sh_order = 0;    ///< 0: 1 for lpv, 2 for the others
    int rsm_size = 0;
    int rsm_kernel = 4;
    int iterations = 0;
    std::optional<double> tolerance;
    std::string occlusion = "face";
    std::optional<int> directions;
    bool first_flight = false;
    std::optional<int> vpls;
    int rsm_samples = 0;
    std::string device;
    bool validation = false;
    bool dry_run = false;
};

/// In the order of --help.
std::vector<Setting> settings_of(const BakeOptions& o) {
    std::vector<Setting> settings;
    if (!o.scene.empty())
        settings.push_back({"scene", toml_string(o.scene), false});
    if (!o.outputs.paths.empty())
        settings.push_back({"output", toml_array(o.outputs.paths), false});
    append_grid_settings(o, settings);
    append_light_settings(o, settings);
    settings.insert(settings.end(), {
                                        {"solver", toml_string(o.solver), true},
                                        {"quality", toml_string(o.quality), true},
                                    });
    if (!o.bounces.empty())
        settings.push_back({"bounces", toml_string(o.bounces), true});
    if (o.tolerance)
        settings.push_back({"tolerance", toml_number(*o.tolerance), true});
    if (o.directions)
        settings.push_back({"directions", std::to_string(*o.directions), true});
    if (o.vpls)
        settings.push_back({"vpls", std::to_string(*o.vpls), true});
    settings.insert(settings.end(), {
                                        {"sh-order", std::to_string(o.sh_order), true},
                                        {"first-flight", toml_flag(o.first_flight), true},
                                        {"rsm-size", std::to_string(o.rsm_size), true},
                                        {"rsm-kernel", std::to_string(o.rsm_kernel), true},
                                        {"rsm-samples", std::to_string(o.rsm_samples), true},
                                        {"iterations", std::to_string(o.iterations), true},
                                        {"occlusion", toml_string(o.occlusion), true},
                                        {"precision", toml_string(o.outputs.precision), false},
                                        {"exr-packing", toml_string(o.outputs.exr_packing), false},
                                        {"device", toml_string(o.device), false},
                                        {"threads", std::to_string(o.threads), false},
                                        {"validation", toml_flag(o.validation), false},
                                        {"format", toml_string(o.format), false},
                                        {"progress", toml_string(o.progress), false},
                                    });
    return settings;
}

/// All that can be known to be wrong before any work is done.
void check_options(const BakeOptions& o, bool cell_and_resolution) {
    check_paths("bake", o, o.outputs.paths);
    if (o.outputs.paths.empty() && !o.dry_run)
        throw Error(ExitCode::usage, "no output: add -o FILE.vdb or -o FILE.exr");
    if (cell_and_resolution)
        throw Error(ExitCode::usage, "--cell-size and --resolution exclude each other");
    if (o.solver == "lpv" && o.tolerance && *o.tolerance < 1e-7)
        throw Error(ExitCode::usage, "--tolerance: the lpv solver needs at least 1e-7");
    if (o.solver == "lpv" && o.sh_order > 1)
        throw Error(ExitCode::usage,
                    "--sh-order: the lpv solver knows order 1 only; take --solver sn or "
                    "gather");
}

BakeSettings to_settings(const BakeOptions& o) {
    BakeSettings settings;
    settings.grid = grid_settings(o);
    settings.bounds = grid_bounds(o);
    settings.rsm_size = o.rsm_size;
    settings.rsm_kernel = o.rsm_kernel;
    settings.emitters = !o.no_emitters;
    settings.solver = o.solver == "sn"       ? Solver::sn
                      : o.solver == "gather" ? Solver::gather
                                             : Solver::lpv;
    const bool lpv = settings.solver == Solver::lpv;
    set_quality(o.quality == "fast"       ? Quality::fast
                : o.quality == "accurate" ? Quality::accurate
                                          : Quality::balanced,
                settings);
    settings.bounces = o.bounces.empty() ? default_bounces(settings.solver) : bounces_of(o.bounces);
    if (o.sh_order != 0)
        settings.sn.order = settings.gather.order = o.sh_order;
    settings.lpv.iterations = o.iterations;
    if (o.tolerance)
        (lpv ? settings.lpv.tolerance : settings.gather.tolerance) = float(*o.tolerance);
    if (o.directions)
        settings.sn.directions = *o.directions;
    settings.sn.first_flight = o.first_flight;
    if (o.vpls)
        settings.gather.vpls = *o.vpls;
    settings.rsm_samples = o.rsm_samples;
    settings.lpv.occlusion = o.occlusion == "none" ? Occlusion::none
                             : o.occlusion == "sh" ? Occlusion::sh
                                                   : Occlusion::face;
    return settings;
}

// ---------------------------------------------------------------- running

/// The document of --format json, as far as a dry run shares it.
Json describe(const BakeOptions& o, const gpu::DeviceInfo& device, uint64_t triangles,
              const Grid& grid, const std::vector<StageReport>& stages,
              const std::vector<std::string>& warnings) {
    Json document{{"command", "bake"},
                  {"version", LPVBAKE_VERSION},
                  {"scene", o.scene},
                  {"triangles", triangles},
                  {"device",
                   {{"index", device.index},
                    {"name", device.name},
                    {"type", device.type},
                    {"uuid", device.uuid},
                    {"driver", device.driver},
                    {"api", device.api}}},
                  {"grid", grid_json(grid)},
                  {"dry_run", o.dry_run},
                  {"outputs", Json::array()},
                  {"stages", Json::array()},
                  {"warnings", warnings}};
    for (const StageReport& stage : stages)
        document["stages"].push_back(
            {{"name", stage.name}, {"seconds", stage.seconds}, {"detail", stage.detail}});
    return document;
}

void print_plan(const BakeOptions& o, const gpu::DeviceInfo& device, const BakePlan& plan,
                const std::vector<std::string>& warnings) {
    if (o.format == "json") {
        Json document = describe(o, device, plan.triangles, plan.grid, plan.stages, warnings);
        for (const std::string& output : o.outputs.paths)
            document["outputs"].push_back({{"path", output}});
        document["seconds"] = plan.seconds;
        document["rsm"] = {{"maps", plan.rsm_maps}, {"size", plan.rsm_size}};
        document["device_bytes"] = plan.device_bytes;
        document["host_bytes"] = plan.host_bytes;
        print_json(document);
        return;
    }
    std::printf("device        %s\n", device.name.c_str());
    print_grid(plan.grid);
    std::printf("scene         %llu triangles\n", static_cast<unsigned long long>(plan.triangles));
    std::printf("maps          %d of %d x %d texels\n", plan.rsm_maps, plan.rsm_size,
                plan.rsm_size);
    std::printf("memory        %s on the device, about %s beside it\n",
                bytes_text(plan.device_bytes).c_str(), bytes_text(plan.host_bytes).c_str());
    std::printf("time          about %.2g s\n", plan.seconds);
    for (const StageReport& stage : plan.stages)
        std::printf("%-12s  %s\n", stage.name.c_str(), stage.detail.c_str());
    for (const std::string& output : o.outputs.paths)
        std::printf("output        %s\n", output.c_str());
}

void print_result(const BakeOptions& o, const gpu::DeviceInfo& device, uint64_t triangles,
                  const Grid& grid, const std::vector<StageReport>& stages,
                  const std::vector<Written>& outputs, double seconds,
                  const std::vector<std::string>& warnings) {
    if (o.format == "json") {
        Json document = describe(o, device, triangles, grid, stages, warnings);
        for (const Written& output : outputs)
            document["outputs"].push_back(output.json());
        document["seconds"] = seconds;
        document["peak_memory"] = peak_memory();
        print_json(document);
        return;
    }
    std::printf("device        %s\n", device.name.c_str());
    print_grid(grid);
    for (const StageReport& stage : stages)
        std::printf("%-12s  %7.3f s  %s\n", stage.name.c_str(), stage.seconds,
                    stage.detail.c_str());
    std::printf("%-12s  %7.3f s  peak memory %s\n", "total", seconds,
                bytes_text(peak_memory()).c_str());
    for (const Written& output : outputs)
        output.print();
}

void run(const BakeOptions& o) {
    const Clock::time_point begin = Clock::now();
    const BakeSettings settings = to_settings(o);
    const std::vector<Light> lights = command_line_lights(o);
    probe_outputs(o.outputs.paths);
    probe_scene(o);
    const auto thread_limit = limit_threads(o.threads);
    ImageModulePreload preload;
    if (mentions_images(o))
        preload = preload_image_module();

    watch_signals();
    TerminalProgress progress(progress_style(o.progress));
    std::vector<StageReport> stages;

    progress.begin("load", 0);
    auto opening = std::async(std::launch::async, [&o] {
        return std::make_unique<gpu::Device>(gpu::DeviceOptions{o.device, o.validation});
    });
    const Scene scene = load_scene(o, lights);
    for (const std::string& warning : scene.warnings)
        progress.warn(warning);
    stages.push_back({"load", seconds_since(begin),
                      std::to_string(triangle_count(scene)) + " triangles, "
                          + std::to_string(scene.lights.size()) + " lights"});
    stop_if_signalled();

    const Clock::time_point waiting = Clock::now();
    const std::unique_ptr<gpu::Device> device = opening.get();
    stages.push_back(
        {"open", seconds_since(waiting), "the device, opened while the scene was loaded"});

    if (o.dry_run) {
        const BakePlan plan = plan_bake(scene, settings, device->info());
        for (const std::string& warning : plan.warnings)
            progress.warn(warning);
        progress.clear();
        print_plan(o, device->info(), plan, progress.warnings());
        return;
    }

    Baked baked = bake(scene, settings, *device, progress);
    stages.insert(stages.end(), baked.stages.begin(), baked.stages.end());
    for (const std::string& warning : baked.warnings)
        progress.warn(warning);
    fill_metadata(o, scene, settings_of(o), baked.volume);

    const Clock::time_point writing = Clock::now();
    std::vector<Written> written;
    progress.begin("write", o.outputs.paths.size());
    for (const std::string& output : o.outputs.paths) {
        progress.advance(written.size());
        written.push_back(write_output(o.outputs, output, baked.volume, progress));
    }
    stages.push_back(
        {"write", seconds_since(writing),
         std::to_string(written.size()) + (written.size() == 1 ? " output" : " outputs")});
    device->check_validation();
    progress.clear();
    print_result(o, device->info(), triangle_count(scene), baked.volume.grid, stages, written,
                 seconds_since(begin), progress.warnings());
}

} // namespace

void add_bake(CLI::App& root, Action& action) {
    auto options = std::make_shared<BakeOptions>();
    BakeOptions& o = *options;
    CLI::App* app = root.add_subcommand("bake", summary);
    app->footer(manual);

    OptionList list(*app);
    list.text("scene", o.scene, "FILE", "glTF 2.0 file, .gltf or .glb");
    list.list("-o,--output", o.outputs.paths, "FILE",
              "Volume to write: NAME.vdb, or NAME.exr, which becomes\nNAME_sh_l0.exr, ... and "
              "NAME.json; may be repeated");
    CLI::Option* resolution = add_grid_options(list, o);
    add_light_options(list, o);

    list.group("Solver");
    list.choice("--solver", o.solver, "lpv|sn|gather",
                "lpv: classic propagation. sn: discrete ordinates. gather: from\n"
                "clusters of patches straight to the cells");
    list.choice("--quality", o.quality, "fast|balanced|accurate",
                "sn and gather: time against error (directions, clusters, rays,\ntolerance)");
    add_bounces_option(list, o.bounces)
        ->description(
            "Reflections of light at most, 0 to 10000, or all; default: 1\nfor lpv, inf for "
            "the others");
    list.number("--sh-order", o.sh_order, 0, 4,
                "Highest band of the spherical harmonics; 0: 1 for lpv, 2 for\nthe others")
        ->capture_default_str();
    list.number("--directions", o.directions, 48, 384, "sn: directions over the sphere");
    list.flag("--first-flight", o.first_flight,
              "sn: rays, not neighbours, bring light to cells next to surfaces");
    list.number("--vpls", o.vpls, 16, 1'000'000,
                "gather: clusters of patches whose visibility a cell tests");
    list.number("--rsm-size", o.rsm_size, 0, 16384,
                "Texels along a side of a reflective shadow map; 0: from the grid")
        ->capture_default_str();
    list.number("--rsm-kernel", o.rsm_kernel, 1, 64,
                "Texels along a side of a block that becomes virtual point lights")
        ->capture_default_str();
    list.number("--rsm-samples", o.rsm_samples, 0, 65536,
                "gather: texels of each map from which a cell takes the first\n"
                "reflection of punctual lights, noisily; 0: from clusters")
        ->capture_default_str();
    list.number("--iterations", o.iterations, 0, 1'000'000,
                "Propagation steps; 0: until --tolerance")
        ->capture_default_str();
    list.number("--tolerance", o.tolerance, 0, 1,
                "lpv: share of the injected power still under way at which\n"
                "propagation ends (0.01); gather: difference of irradiance below\n"
                "which cells are interpolated (0.3; 0: none)");
    list.choice("--occlusion", o.occlusion, "none|sh|face",
                "Blocking between cells: none, sh (SH geometry volume), face (a\n"
                "transmittance a face; does not leak)");

    add_output_options(list, o.outputs);

    list.group("Run");
    list.text("--device", o.device, "NAME", "Index, UUID or part of the name; default: the first");
    list.flag("--validation", o.validation, "Load Vulkan's validation layer; messages are errors");
    list.flag("--dry-run", o.dry_run, "Print grid, memory, outputs and an estimate of the time")
        ->configurable(false);
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
