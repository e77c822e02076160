// lpvbake bake: from a glTF file to volume files.

#include "bake/bake.h"

#include "commands.h"
#include "error.h"
#include "image/image.h"
#include "readers/readers.h"
#include "result.h"
#include "scene_options.h"
#include "text.h"
#include "volume/dilate.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
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

--solver auto takes sn of order 2 unless options say otherwise. An option that one solver alone
has chooses that solver; one that the chosen solver does not have is an error. With --error the
fastest settings are taken that are expected to reach it (order 4 where 2 cannot), with --time-budget
the most accurate that fit, with both the fastest that do both; what is out of reach is told in a
warning. What is expected comes from a model, never from a clock: the error is that of the Cornell
box, and often a third of it in more evenly lit scenes; the time is that of two threads of a CPU,
without loading and writing. Grid, bounces and all that is given stay as they are.

Outputs are written under a temporary name and renamed: there is the old file or the new one, never
a part. The same input gives the same bytes, whatever --threads says.

--threads bounds the program's own threads (oneTBB) and, through LP_NUM_THREADS, those of Mesa's
CPU driver llvmpipe. 0 takes every core, and leaves LP_NUM_THREADS as the environment has it.

JSON (--format json), one object; sizes in bytes, times in seconds:
  {"command": "bake", "version", "scene", "triangles", "device": {"index", "name", "type", "uuid", "driver",
   "api"}, "grid": {"dims": [x, y, z], "cell", "origin": [x, y, z], "cells"}, "dry_run",
   "choice": {"solver", "sh_order", "vpls", "tolerance" or "directions", "text", "error" (expected),
   "seconds" (expected)}, "outputs": [{"path", "bytes", "files": [{"path", "bytes"}]}], "stages": [{"name", "seconds", "detail"}], "seconds",
   "peak_memory", "warnings": [...]}; after --fit surfaces also "fit": {"reader", "error" (on surfaces, a
   share), "energy", "leak" (into the dark, of the mean), "moved" (of irradiance in the air)}.
With --dry-run, "outputs" have no bytes, "seconds" is an estimate, "peak_memory" is absent, and
"skipped": [{"name", "why"}],
"rsm": {"maps", "size"}, "device_bytes" and "host_bytes" say what it takes.)";

/// Options as given; `to_settings` makes them the core's enums and structs.
struct BakeOptions : SceneOptions, RunOptions {
    OutputOptions outputs;
    std::string solver = "auto";
    std::optional<double> error; ///< a share
    std::string time_budget;
    std::string bounces; ///< empty: 1 for lpv, all for the others
    int sh_order = 0;    ///< 0: 1 for lpv, 2 for the others
    // What only some solvers have, as far as it is given.
    std::string quality;
    std::optional<int> directions;
    std::optional<int> vpls;
    std::optional<int> rsm_samples;
    std::optional<double> tolerance;
    std::string occlusion;
    std::optional<int> rsm_size;
    std::optional<int> rsm_kernel;
    std::optional<int> iterations;
    int dilate = 0;
    std::string fit = "none";
    std::string device;
    bool validation = false;
    bool dry_run = false;
};

/// An option that not every solver has.
struct SolverOption {
    const char* name;
    std::vector<const SolverKind*> solvers;
    bool given;
    std::string toml; ///< its value; what it is unless given
};

std::vector<SolverOption> solver_options(const BakeOptions& o) {
    const SolverKind *const sn = find_solver("sn"), *const gather = find_solver("gather"),
                            *const lpv = find_solver("lpv");
    const bool maps = o.rsm_samples.value_or(0) > 0;
    const auto whole = [](const std::optional<int>& value, int usual) {
        return std::to_string(value.value_or(usual));
    };
    return {
        {"quality",
         {gather, sn},
         !o.quality.empty(),
         toml_string(o.quality.empty() ? "balanced" : o.quality)},
        {"directions",
         {sn},
         o.directions.has_value(),
         whole(o.directions, int(find_parameter(*sn, "directions")->usual))},
        {"vpls",
         {gather},
         o.vpls.has_value(),
         whole(o.vpls, int(find_parameter(*gather, "vpls")->usual))},
        {"rsm-samples", {gather}, o.rsm_samples.has_value(), whole(o.rsm_samples, 0)},
        {"tolerance",
         {gather, lpv},
         o.tolerance.has_value(),
         toml_number(o.tolerance.value_or(find_parameter(*gather, "tolerance")->usual))},
        {"occlusion",
         {lpv},
         !o.occlusion.empty(),
         toml_string(o.occlusion.empty() ? "face" : o.occlusion)},
        {"rsm-size", maps ? std::vector{gather} : std::vector{lpv}, o.rsm_size.has_value(),
         whole(o.rsm_size, 0)},
        {"rsm-kernel", {lpv}, o.rsm_kernel.has_value(), whole(o.rsm_kernel, 4)},
        {"iterations", {lpv}, o.iterations.has_value(), whole(o.iterations, 0)},
    };
}

/// "gather", "sn or gather".
std::string names_of(const std::vector<const SolverKind*>& solvers) {
    std::string names;
    for (const SolverKind* solver : solvers)
        names += (names.empty() ? "" : " or ") + std::string(solver->name);
    return names;
}

/// The solvers that may be taken, best first: --solver, or those that have all options that are
/// given. Throws Error (argument) that names the option that none of them has.
std::vector<const SolverKind*> solvers_of(const BakeOptions& o) {
    std::vector<const SolverKind*> solvers = Wish().solvers;
    if (o.solver != "auto")
        std::erase_if(solvers, [&](const SolverKind* solver) { return solver->name != o.solver; });
    std::string why = o.solver == "auto" ? "" : "--solver " + o.solver;
    const auto keep = [&](const std::string& option, const std::vector<const SolverKind*>& with) {
        std::vector<const SolverKind*> left = solvers;
        std::erase_if(left,
                      [&](const SolverKind* solver) { return !std::ranges::count(with, solver); });
        if (left.empty())
            throw Error(ErrorKind::argument, "--" + option + " is an option of " + names_of(with)
                                                 + ", not of " + names_of(solvers) + " (" + why
                                                 + ")");
        if (left.size() < solvers.size())
            why = "--" + option;
        solvers = left;
    };
    for (const SolverOption& option : solver_options(o))
        if (option.given)
            keep(option.name, option.solvers);
    if (o.sh_order == 3)
        keep("sh-order 3", {find_solver("sn")});
    else if (o.sh_order > 1)
        keep("sh-order " + std::to_string(o.sh_order), {find_solver("gather"), find_solver("sn")});
    return solvers;
}

/// Seconds of "2s", "500ms", "1.5min", "2"; none unless it is a time above 0.
std::optional<double> seconds_of(const std::string& text) {
    for (const auto& [unit, scale] : {std::pair{"ms", 1e-3}, {"min", 60.0}, {"s", 1.0}, {"", 1.0}})
        if (text.ends_with(unit)) {
            const std::optional<double> value =
                parse_number(text.substr(0, text.size() - std::strlen(unit)));
            return value && *value > 0 ? std::optional(*value * scale) : std::nullopt;
        }
    return std::nullopt;
}

/// In the order of --help.
std::vector<Setting> settings_of(const BakeOptions& o) {
    std::vector<Setting> settings;
    if (!o.scene.empty())
        settings.push_back({"scene", toml_string(o.scene), false});
    if (!o.outputs.paths.empty())
        settings.push_back({"output", toml_array(o.outputs.paths), false});
    append_grid_settings(o, settings);
    append_light_settings(o, settings);
    settings.push_back({"solver", toml_string(o.solver), true});
    settings.push_back({"error", toml_number(o.error.value_or(0.04)), true, o.error.has_value()});
    settings.push_back({"time-budget", toml_string(o.time_budget.empty() ? "2s" : o.time_budget),
                        true, !o.time_budget.empty()});
    settings.push_back(
        {"bounces", toml_string(o.bounces.empty() ? "inf" : o.bounces), true, !o.bounces.empty()});
    settings.push_back({"sh-order", std::to_string(o.sh_order), true});
    for (const SolverOption& option : solver_options(o))
        settings.push_back({option.name, option.toml, true, option.given});
    settings.push_back({"dilate", std::to_string(o.dilate), true});
    settings.push_back({"fit", toml_string(o.fit), true, o.fit != "none"});
    append_output_settings(o.outputs, settings);
    settings.insert(settings.end(), {
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
        throw Error(ErrorKind::argument, "no output: add -o FILE" + format_list(" or -o FILE"));
    if (cell_and_resolution)
        throw Error(ErrorKind::argument, "--cell-size and --resolution exclude each other");
    if (solvers_of(o).front() == find_solver("lpv") && o.tolerance && *o.tolerance < 1e-7)
        throw Error(ErrorKind::argument, "--tolerance: the lpv solver needs at least 1e-7");
    if (o.fit == "surfaces" && o.dilate > 0)
        throw Error(ErrorKind::argument,
                    "--fit surfaces and --dilate exclude each other: fitted cells "
                    "are filled already");
    if (!o.quality.empty() && (o.error || !o.time_budget.empty()))
        throw Error(ErrorKind::argument, std::string("--quality and ")
                                             + (o.error ? "--error" : "--time-budget")
                                             + " exclude each other");
}

/// What is given of the options of solvers.
std::vector<ParameterValue> given(const BakeOptions& o) {
    std::vector<ParameterValue> values;
    const auto add = [&](const char* name, const auto& option) {
        if (option)
            values.push_back({name, double(*option)});
    };
    add("directions", o.directions);
    add("vpls", o.vpls);
    add("rsm-samples", o.rsm_samples);
    add("tolerance", o.tolerance);
    add("rsm-size", o.rsm_size);
    add("rsm-kernel", o.rsm_kernel);
    add("iterations", o.iterations);
    if (!o.occlusion.empty()) {
        const Parameter* occlusion = find_parameter(*find_solver("lpv"), "occlusion");
        values.push_back({"occlusion", *parse_value(*occlusion, o.occlusion)});
    }
    return values;
}

/// The row of a target's program; files for none in particular are read by our own sampler.
const readers::Reader* reader_of(const std::string& target) {
    return readers::reader_named(target == "generic" ? "lpvbake" : target);
}

/// All but what choose_settings chooses.
BakeSettings to_settings(const BakeOptions& o) {
    BakeSettings settings(*solvers_of(o).front());
    settings.grid = grid_settings(o);
    settings.bounds = grid_bounds(o);
    settings.emitters = !o.no_emitters;
    settings.solver.set(o.quality == "fast"       ? Quality::fast
                        : o.quality == "accurate" ? Quality::accurate
                                                  : Quality::balanced);
    if (!o.bounces.empty())
        settings.bounces = bounces_of(o.bounces);
    if (o.fit == "surfaces")
        settings.fit = reader_of(o.outputs.target);
    return settings;
}

Wish wish_of(const BakeOptions& o) {
    Wish wish;
    wish.solvers = solvers_of(o);
    if (o.sh_order > 0)
        wish.order = o.sh_order;
    wish.error = o.error;
    if (!o.time_budget.empty())
        wish.seconds = seconds_of(o.time_budget);
    wish.given = given(o);
    return wish;
}

// ---------------------------------------------------------------- running

/// The document of --format json, as far as a dry run shares it.
Json describe(const BakeOptions& o, const gpu::DeviceInfo& device, const Choice& choice,
              uint64_t triangles, const Grid& grid, const std::vector<StageReport>& stages,
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
                  {"choice",
                   {{"solver", choice.solver().kind().name},
                    {"sh_order", choice.solver().order()},
                    {"text", choice.text},
                    {"error", choice.error},
                    {"seconds", choice.plan.seconds}}},
                  {"outputs", Json::array()},
                  {"stages", Json::array()},
                  {"warnings", warnings}};
    for (const Parameter& parameter : choice.solver().kind().parameters)
        if (is_on_ladder(choice.solver().kind(), parameter.name)) {
            const double value = choice.solver()[parameter.name];
            if (parameter.kind == ValueKind::whole)
                document["choice"][parameter.name] = int64_t(value);
            else
                document["choice"][parameter.name] = value;
        }
    for (const StageReport& stage : stages)
        document["stages"].push_back(
            {{"name", stage.name}, {"seconds", stage.seconds}, {"detail", stage.detail}});
    return document;
}

void print_choice(const Choice& choice) {
    std::printf("choice        %s: about %.2g %% error in a Cornell box, %.2g s here\n",
                choice.text.c_str(), 100 * choice.error, choice.plan.seconds);
}

void print_plan(const BakeOptions& o, const gpu::DeviceInfo& device, const Choice& choice,
                const std::vector<std::string>& warnings) {
    const BakePlan& plan = choice.plan;
    if (o.format == "json") {
        Json document =
            describe(o, device, choice, plan.triangles, plan.grid, plan.stages, warnings);
        for (const std::string& output : o.outputs.paths)
            document["outputs"].push_back({{"path", output}});
        document["seconds"] = plan.seconds;
        document["skipped"] = Json::array();
        for (const SkippedStage& skipped : plan.skipped)
            document["skipped"].push_back({{"name", skipped.name}, {"why", skipped.why}});
        document["rsm"] = {{"maps", plan.maps.count}, {"size", plan.maps.size}};
        document["device_bytes"] = plan.device_bytes;
        document["host_bytes"] = plan.host_bytes;
        print_json(document);
        return;
    }
    std::printf("device        %s\n", device.name.c_str());
    print_grid(plan.grid);
    std::printf("scene         %s\n", counted(plan.triangles, "triangle").c_str());
    print_choice(choice);
    std::printf("memory        %s on the device, about %s beside it\n",
                bytes_text(plan.device_bytes).c_str(), bytes_text(plan.host_bytes).c_str());
    std::printf("time          about %.2g s, without loading and writing\n", plan.seconds);
    for (const StageReport& stage : plan.stages)
        std::printf("%-12s  %7.3f s  %s\n", stage.name.c_str(), stage.seconds,
                    stage.detail.c_str());
    for (const SkippedStage& skipped : plan.skipped)
        std::printf("skipped       %s: %s\n", skipped.name.c_str(), skipped.why.c_str());
    for (const std::string& output : o.outputs.paths)
        std::printf("output        %s\n", output.c_str());
}

void print_result(const BakeOptions& o, const gpu::DeviceInfo& device, const Choice& choice,
                  uint64_t triangles, const Volume& volume, const std::vector<StageReport>& stages,
                  const std::vector<Written>& outputs, double seconds,
                  const std::vector<std::string>& warnings) {
    if (o.format == "json") {
        Json document = describe(o, device, choice, triangles, volume.grid, stages, warnings);
        for (const Written& output : outputs)
            document["outputs"].push_back(output.json());
        if (const auto fit = volume.metadata.find("fit"); fit != volume.metadata.end()) {
            document["fit"] = {{"reader", fit->second}};
            for (const char* fact : {"error", "energy", "leak", "moved"})
                document["fit"][fact] =
                    *parse_number(volume.metadata.at("fit_" + std::string(fact)));
        }
        document["seconds"] = seconds;
        document["peak_memory"] = peak_memory();
        print_json(document);
        return;
    }
    std::printf("device        %s\n", device.name.c_str());
    print_grid(volume.grid);
    print_choice(choice);
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
    const BakeSettings base = to_settings(o);
    const Wish wish = wish_of(o);
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
                      counted(triangle_count(scene), "triangle") + ", "
                          + counted(scene.lights.size(), "light")});
    stop_if_signalled();

    const Clock::time_point waiting = Clock::now();
    const std::unique_ptr<gpu::Device> device = opening.get();
    stages.push_back(
        {"open", seconds_since(waiting), "the device, opened while the scene was loaded"});

    const Choice choice = choose_settings(survey(scene), base, wish, device->info());
    for (const std::string& warning : choice.warnings)
        progress.warn(warning);
    if (o.dry_run) {
        for (const std::string& warning : choice.plan.warnings)
            progress.warn(warning);
        progress.clear();
        print_plan(o, device->info(), choice, progress.warnings());
        return;
    }

    Baked baked = bake(scene, choice.plan, *device, progress);
    stages.insert(stages.end(), baked.stages.begin(), baked.stages.end());
    for (const std::string& warning : baked.warnings)
        progress.warn(warning);
    if (o.dilate > 0) {
        const Clock::time_point dilating = Clock::now();
        const std::size_t filled = dilate(baked.volume, o.dilate);
        baked.volume.metadata["dilate"] = std::to_string(o.dilate);
        stages.push_back({"dilate", seconds_since(dilating),
                          counted(filled, "cell") + " inside geometry filled"});
    }
    baked.volume.metadata["choice"] = choice.text;
    fill_metadata(o, scene, settings_of(o), baked.volume);

    const Clock::time_point writing = Clock::now();
    const std::vector<Written> written =
        write_outputs(o.outputs, o.outputs.paths, baked.volume, progress);
    stages.push_back({"write", seconds_since(writing), counted(written.size(), "output")});
    device->check_validation();
    progress.clear();
    print_result(o, device->info(), choice, triangle_count(scene), baked.volume, stages, written,
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
    list.list("-o,--output", o.outputs.paths, "FILE", outputs_help().c_str());
    CLI::Option* resolution = add_grid_options(list, o);
    add_light_options(list, o);

    list.group("Solver");
    list.choice("--solver", o.solver, "auto|gather|sn|lpv",
                "gather: from clusters of patches straight to the cells. sn:\ndiscrete ordinates. "
                "lpv: classic propagation. auto: by what is\nwanted (--error, --time-budget) and "
                "given; else sn");
    list.text("--error", o.error, "X|X%", "Error of irradiance that is wanted at most; see below")
        ->transform(share_or_percent());
    list.text("--time-budget", o.time_budget, "TIME",
              "Time that a bake may take, as 2s, 500ms or 1.5min (--time is\nthe animation's)")
        ->check(CLI::Validator(
            [](std::string& text) {
                return seconds_of(text) ? std::string() : "'" + text + "' is no time above 0";
            },
            ""));
    add_bounces_option(list, o.bounces)
        ->description("Reflections of light at most, 0 to 10000, or all; default: 1\nfor lpv, inf "
                      "for the others");
    list.number("--sh-order", o.sh_order, 0, 4,
                "Highest band of the spherical harmonics; 0: 1 for lpv, 2 for\nthe others")
        ->capture_default_str();
    list.text("--quality", o.quality, "fast|balanced|accurate",
              "gather and sn: time against error (directions, clusters, rays,\ntolerance); "
              "default: balanced")
        ->check(one_of("fast|balanced|accurate"));
    list.number("--directions", o.directions, 48, 384, "sn: directions over the sphere");
    list.number("--vpls", o.vpls, 16, 1'000'000,
                "gather: clusters of patches whose visibility a cell tests");
    list.number("--rsm-samples", o.rsm_samples, 0, 65536,
                "gather: texels of each map from which a cell takes the first\n"
                "reflection of punctual lights, noisily; 0: from clusters");
    list.number("--tolerance", o.tolerance, 0, 1,
                "gather: difference of irradiance below which cells are\n"
                "interpolated (0.3; 0: none); lpv: share of the injected power\n"
                "still under way at which propagation ends (0.01)");
    list.text("--occlusion", o.occlusion, "none|sh|face",
              "lpv: blocking between cells: none, sh (SH geometry volume), face\n(a transmittance "
              "a face; does not leak; the default)")
        ->check(one_of("none|sh|face"));
    list.number("--rsm-size", o.rsm_size, 0, 16384,
                "lpv, --rsm-samples: texels along a side of a reflective shadow\nmap; 0: from the "
                "grid");
    list.number("--rsm-kernel", o.rsm_kernel, 1, 64,
                "lpv: texels along a side of a block that becomes virtual point\nlights");
    list.number("--iterations", o.iterations, 0, 1'000'000,
                "lpv: propagation steps; 0: until --tolerance");

    add_output_options(list, o.outputs);
    list.number("--dilate", o.dilate, 0, 1024,
                "Rings of cells inside geometry to fill from cells around them;\nthe validity "
                "stays as it is")
        ->capture_default_str();

    list.choice(
        "--fit", o.fit, "none|surfaces",
        "surfaces: values with which the target's program shows on\nsurfaces the light that "
        "arrives there, though it reads cells\nbeyond walls; generic: our own sampler");

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
