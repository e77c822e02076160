// lpvbake report: what bakes cost and how wrong they are.

#include "report/report.h"

#include "bake/plan.h"
#include "commands.h"
#include "error.h"
#include "image/image.h"
#include "io/atomic_file.h"
#include "report/page.h"
#include "report/plot.h"
#include "report/tables.h"
#include "result.h"
#include "scene_options.h"
#include "suite.h"

#include <tbb/task_arena.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

namespace lpvbake {
namespace {

using Clock = std::chrono::steady_clock;
namespace fs = std::filesystem;

const char summary[] = "Bakes by many settings and tells speed against error.";

const char manual[] =
    R"(Every row is a bake, made --repeats times; its time is the median of the repeats, without loading
and writing. Its error is measured against a path-traced reference of the light that the bake means
to hold, converged to --noise: at --probes cells outside geometry, drawn from its grid by --seed, the
irradiance on planes with the 26 directions to a cell's neighbours as normals, in red, green and
blue, sum |E - T| over sum T. The table has
  error    against the true irradiance
  same SH  against the reference's own coefficients of the same bands: what the solver adds to what
           spherical harmonics cost anyway, which stands in the lines "exact"
  energy   luminance of the constant band over the reference's
  surface  at up to --probes points spread evenly over the fronts of the scene's surfaces that light
           reaches, the same for all grids, towards the surface's normal; read from the cells
           around that are valid and faced
  unity, threejs, vrc, bevy
           what these programs show there of the files that --target writes for them; Unreal and
           Godot read as Unity does
  *        the Pareto front: no other row is as fast and as accurate
Beside them stand path-traced probes of few rays, which one could use instead: their time is
measured at the same probes, on the same threads, and scaled to all valid cells of the grid.
The ratio is the time in which they reach the row's error in the same SH bands, over the row's time.
Beside their rays a second stands what Embree alone makes of the same rays.

Without --sweep, and without lists of values on the command line, each solver is baked with one bounce
at 16, 32 and 64 cells, lpv in each mode of occlusion and the others in each quality, and lpv at 32
cells also cut off after 16 iterations and with maps of 128 texels. --resolution, --occlusion, ...
take lists instead: all their combinations are baked.
A sweep file has one or more tables, each of which stands for all combinations of its values:
  [[sweep]]
  resolution = [16, 32, 64]
  occlusion = ["none", "face"]
  [[sweep]]
  resolution = 32
  iterations = [8, 16, 32]
Options that a sweep can set: solver, bounces, quality, sh-order, resolution, occlusion, iterations,
tolerance, rsm-size, rsm-kernel, rsm-samples, directions, vpls; all others are the same for every row.

Examples:
  lpvbake report room.glb
  lpvbake report room.glb street.glb -o report.html -o report.csv
  lpvbake report room.glb --resolution 16,32 --occlusion face --repeats 5 --noise 0.5%
  lpvbake report room.glb --sweep sweep.toml --format json --no-peer
  lpvbake report room.glb --sweep sweep.toml --dry-run
  lpvbake report --suite cases/suite.json --case two-rooms

-o writes by its extension: .html a page with plot, tables, slices and the command of each row, in
one file; .svg the plot; .csv; .json as below. The plot is drawn by gnuplot.

JSON (--format json, -o FILE.json), one object; seconds, metres, errors as fractions:
  {"command": "report", "version", "device", "threads", "repeats", "seed", "scenes": [{"scene",
   "triangles", "grids": [{"dims", "cell", "origin", "valid_cells", "probes", "reference": {"noise",
   "rays", "converged", "seconds"}, "floors": [{"sh_order", ERROR}], "peer": [{"rays", "seconds":
   TIME (all valid cells), "measured_seconds" (the probes), "rays_per_second", "embree_rays_per_second",
   "orders": [{"sh_order", "error": {ERROR}, "projected": {ERROR}}]}]}], "rows": [{"name",
   "options": {name: value}, "command", "grid" (index), "sh_order", "seconds": TIME, "stages":
   [{"name", "seconds": TIME, "detail"}], "error": {ERROR}, "projected": {ERROR}, "surface":
   {ERROR} or null, "readers": {name: {ERROR}}, "front", "peer": null or {"relation": "crosses"|"beyond"
   (not reached at its most rays)|"already" (better at its fewest), "factor"}, "warnings"}],
   "surfaces": {"points", "noise", "rays"}, "verdicts", "warnings"}], "seconds"}
  TIME is {"median", "min", "max"}, ERROR "relative_l1", "relative_rms", "energy_ratio", "negative"
  (values clamped to 0); infinite numbers are null. With --dry-run scenes have "rows": [{"name",
  "command", "dims", "seconds" (estimate)}] alone.)";

struct ReportOptions : SceneOptions, RunOptions {
    std::vector<std::string> scenes;
    std::vector<std::string> outputs;
    std::string sweep;
    std::string suite;
    std::vector<std::string> cases;
    bool cheap = false;
    /// Comma-separated values by the option of a sweep; empty: not given.
    std::vector<std::pair<std::string, std::string>> axes;
    int repeats = 3;
    uint64_t probes = 1000;
    double noise = 0.01;
    uint64_t rays = 1 << 16;
    uint64_t seed = 1;
    bool no_peer = false;
    bool no_slices = false;
    std::string device;
    bool dry_run = false;
};

/// What a list of values is of.
const char* help_of(const std::string& option) {
    static const std::map<std::string, const char*> helps = {
        {"solver", "sn, gather, lpv"},
        {"bounces", "Reflections of light at most, or inf"},
        {"quality", "gather, sn: fast, balanced, accurate"},
        {"directions", "sn: directions over the sphere"},
        {"sh-order", "Highest band of the spherical harmonics"},
        {"vpls", "gather: clusters whose visibility a cell tests"},
        {"rsm-samples", "gather: texels a cell takes of each map"},
        {"resolution", "Cells along the longest axis"},
        {"occlusion", "lpv: none, sh, face"},
        {"iterations", "lpv: propagation steps; 0: until --tolerance"},
        {"tolerance", "gather, lpv: when a field is smooth, or done"},
        {"rsm-size", "lpv, --rsm-samples: texels along a map's side"},
        {"rsm-kernel", "lpv: texels along the side of a virtual light"},
    };
    return helps.at(option);
}

/// In the order of --help.
std::vector<Setting> settings_of(const ReportOptions& o) {
    std::vector<Setting> settings;
    if (!o.scenes.empty())
        settings.push_back({"scene", toml_array(o.scenes), false});
    if (!o.outputs.empty())
        settings.push_back({"output", toml_array(o.outputs), false});
    if (!o.sweep.empty())
        settings.push_back({"sweep", toml_string(o.sweep), false});
    if (!o.suite.empty())
        settings.push_back({"suite", toml_string(o.suite), false});
    if (!o.cases.empty())
        settings.push_back({"case", toml_array(o.cases), false});
    if (o.cheap)
        settings.push_back({"cheap", toml_flag(o.cheap), false});
    for (const auto& [option, values] : o.axes)
        if (!values.empty())
            settings.push_back({option.c_str(), toml_string(values), true});
    if (!o.bounds.empty())
        settings.push_back({"bounds", toml_string(o.bounds), true});
    settings.push_back({"margin", std::to_string(o.margin), true});
    append_light_settings(o, settings);
    settings.insert(settings.end(), {
                                        {"repeats", std::to_string(o.repeats), false},
                                        {"probes", std::to_string(o.probes), true},
                                        {"noise", toml_number(o.noise), true},
                                        {"rays", std::to_string(o.rays), true},
                                        {"seed", std::to_string(o.seed), true},
                                        {"no-peer", toml_flag(o.no_peer), false},
                                        {"no-slices", toml_flag(o.no_slices), false},
                                        {"device", toml_string(o.device), false},
                                        {"threads", std::to_string(o.threads), false},
                                        {"format", toml_string(o.format), false},
                                        {"progress", toml_string(o.progress), false},
                                    });
    return settings;
}

std::string extension_of(const std::string& path) {
    for (const char* extension : {".html", ".svg", ".csv", ".json"})
        if (has_extension(path, extension))
            return extension;
    return {};
}

bool wants(const ReportOptions& o, const char* extension) {
    return std::ranges::any_of(
        o.outputs, [&](const std::string& path) { return extension_of(path) == extension; });
}

/// What a run of a suite takes of the options; throws Error (argument) for what contradicts it.
SuiteRun suite_run(const ReportOptions& o) {
    const auto refuse = [](const std::string& what) {
        throw Error(ErrorKind::argument, "--suite takes what it runs from its file, not " + what);
    };
    if (!o.scenes.empty())
        refuse("the scene " + o.scenes.front());
    if (!o.outputs.empty())
        refuse("an output; its table goes to standard output");
    for (const auto& [given, option] :
         {std::pair{!o.sweep.empty(), "--sweep"}, std::pair{!o.bounds.empty(), "--bounds"},
          std::pair{!o.suns.empty(), "--sun"}, std::pair{!o.points.empty(), "--point"},
          std::pair{!o.light_files.empty(), "--lights"},
          std::pair{o.no_scene_lights, "--no-scene-lights"},
          std::pair{o.no_emitters, "--no-emitters"}, std::pair{o.dry_run, "--dry-run"}})
        if (given)
            refuse(option);
    SuiteRun run{o.suite, {o.cases, {}, o.cheap}, o.device, o.threads, o.format, o.progress};
    for (const auto& [option, values] : o.axes)
        if (!values.empty()) {
            if (option != "solver")
                refuse("--" + option);
            run.selection.solvers = CLI::detail::split(values, ',');
        }
    return run;
}

/// All that can be known to be wrong before any work is done.
void check_options(const ReportOptions& o) {
    if (!o.cases.empty() || o.cheap)
        throw Error(ErrorKind::argument, "--case and --cheap need --suite FILE");
    if (o.scenes.empty())
        throw Error(ErrorKind::argument, "no scene: lpvbake report SCENE... (see lpvbake report "
                                         "--help)");
    std::vector<fs::path> names;
    for (const std::string& output : o.outputs) {
        if (extension_of(output).empty())
            throw Error(ErrorKind::argument,
                        output + ": the name of an output ends in .html, .svg, .csv or .json");
        const fs::path name = fs::weakly_canonical(fs::absolute(output));
        if (std::ranges::find(names, name) != names.end())
            throw Error(ErrorKind::argument, output + ": given twice as an output");
        names.push_back(name);
        std::vector<std::string> inputs = o.light_files;
        inputs.insert(inputs.end(), o.scenes.begin(), o.scenes.end());
        inputs.push_back(o.sweep);
        for (const std::string& input : inputs)
            if (!input.empty() && fs::weakly_canonical(fs::absolute(input)) == name)
                throw Error(ErrorKind::argument, output + ": would replace the input " + input);
    }
}

/// Throws Error (argument: names file, line and key).
std::vector<Sweep> read_sweeps(const std::string& path) {
    std::vector<Sweep> sweeps;
    for (const std::vector<ConfigEntry>& table : read_config_tables(path, "sweep")) {
        Sweep sweep;
        for (const ConfigEntry& entry : table) {
            const std::string place = path + ":" + std::to_string(entry.line) + ": ";
            if (entry.values.empty())
                throw Error(ErrorKind::argument, place + entry.key + " has no values");
            for (const std::string& value : entry.values)
                try {
                    check_sweep_value(entry.key, value);
                } catch (const Error& error) {
                    throw Error(error.kind, place + error.what());
                }
            sweep.push_back({entry.key, entry.values});
        }
        if (!sweep.empty())
            sweeps.push_back(std::move(sweep));
    }
    if (sweeps.empty())
        throw Error(ErrorKind::argument, path
                                             + ": no sweep in it; it takes lines such as "
                                               "resolution = [16, 32]");
    return sweeps;
}

std::vector<SweepRow> rows_of(const ReportOptions& o, const BakeSettings& base) {
    Sweep listed;
    for (const auto& [option, values] : o.axes)
        if (!values.empty()) {
            const std::vector<std::string> parts = CLI::detail::split(values, ',');
            for (const std::string& part : parts)
                try {
                    check_sweep_value(option, part);
                } catch (const Error& error) {
                    throw Error(error.kind, "--" + std::string(error.what()));
                }
            listed.push_back({option, parts});
        }
    if (!o.sweep.empty() && !listed.empty())
        throw Error(ErrorKind::argument,
                    "--sweep and --" + listed.front().option + " exclude each other");
    if (!o.sweep.empty())
        try {
            return sweep_rows(read_sweeps(o.sweep), base);
        } catch (const Error& error) {
            const std::string text = error.what();
            throw Error(error.kind, text.starts_with(o.sweep) ? text : o.sweep + ": " + text);
        }
    return sweep_rows(listed.empty() ? default_sweeps() : std::vector<Sweep>{listed}, base);
}

BakeSettings base_settings(const ReportOptions& o) {
    BakeSettings settings;
    settings.grid.margin = o.margin;
    settings.bounds = grid_bounds(o);
    settings.emitters = !o.no_emitters;
    return settings;
}

ReportSettings to_settings(const ReportOptions& o) {
    ReportSettings settings;
    settings.repeats = o.repeats;
    settings.probes = o.probes;
    settings.seed = o.seed;
    settings.truth = {o.noise, o.rays, o.seed};
    settings.peer = !o.no_peer;
    settings.slices = !o.no_slices && wants(o, ".html");
    return settings;
}

/// A word as a POSIX shell takes it.
std::string shell_word(const std::string& text) {
    const std::string plain =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./,:+=@%";
    if (!text.empty() && text.find_first_not_of(plain) == std::string::npos)
        return text;
    std::string quoted = "'";
    for (const char c : text)
        quoted += c == '\'' ? "'\\''" : std::string(1, c);
    return quoted + "'";
}

/// `lpvbake bake SCENE` with the options that all rows share.
std::string shared_command(const ReportOptions& o, const std::string& scene) {
    std::string command =
        "lpvbake bake " + shell_word((scene.starts_with('-') ? "./" : "") + scene) + " -o out.vdb";
    const auto add = [&](const char* option, const std::string& value) {
        command += std::string(" ") + option + "=" + shell_word(value);
    };
    if (!o.bounds.empty())
        add("--bounds", o.bounds);
    if (o.margin != 1)
        add("--margin", std::to_string(o.margin));
    for (const std::string& sun : o.suns)
        add("--sun", sun);
    for (const std::string& point : o.points)
        add("--point", point);
    for (const std::string& file : o.light_files)
        add("--lights", file);
    if (!o.sky.empty())
        add("--sky", o.sky);
    if (o.sky_rotation != 0)
        add("--sky-rotation", toml_number(o.sky_rotation));
    if (o.no_scene_lights)
        command += " --no-scene-lights";
    if (o.no_emitters)
        command += " --no-emitters";
    if (o.max_albedo != 0.95)
        add("--max-albedo", toml_number(o.max_albedo));
    if (o.metallic != "reflect")
        add("--metallic", o.metallic);
    if (o.backfaces != "block")
        add("--backfaces", o.backfaces);
    if (!o.device.empty())
        add("--device", o.device);
    if (o.threads != 0)
        add("--threads", std::to_string(o.threads));
    return command;
}

/// Lists what would be baked, with estimates.
void print_plan(const ReportOptions& o, const std::vector<Scene>& scenes,
                const std::vector<SweepRow>& rows, const gpu::DeviceInfo& device) {
    Json document{{"command", "report"},
                  {"version", LPVBAKE_VERSION},
                  {"dry_run", true},
                  {"scenes", Json::array()}};
    double seconds = 0;
    for (std::size_t i = 0; i < scenes.size(); ++i) {
        SceneReport listed;
        listed.command = shared_command(o, o.scenes[i]);
        Json entries = Json::array();
        if (o.format == "text")
            std::printf("scene         %s\n", o.scenes[i].c_str());
        const SceneFacts facts = survey(scenes[i]);
        for (const SweepRow& row : rows) {
            const BakePlan plan = plan_bake(facts, row.settings, device);
            seconds += plan.seconds * o.repeats;
            RowResult result;
            result.row = row;
            const glm::ivec3 dims = plan.grid.dims;
            entries.push_back({{"name", row_name(result)},
                               {"command", row_command(listed, result)},
                               {"dims", {dims.x, dims.y, dims.z}},
                               {"seconds", plan.seconds}});
            if (o.format == "text")
                std::printf("row           %-28s %4d x %4d x %4d cells, about %.2g s each\n",
                            row_name(result).c_str(), dims.x, dims.y, dims.z, plan.seconds);
        }
        document["scenes"].push_back({{"scene", o.scenes[i]}, {"rows", entries}});
    }
    if (o.format == "json")
        print_json(document);
    else
        std::printf("bakes         about %.2g s in all, %d of each row; the reference comes on "
                    "top\n",
                    seconds, o.repeats);
}

void write_outputs(const ReportOptions& o, const Report& report) {
    std::string svg;
    if (wants(o, ".svg") || wants(o, ".html"))
        svg = plot_svg(plot_script(report), report.scenes.size());
    for (const std::string& output : o.outputs) {
        const std::string extension = extension_of(output);
        AtomicFile file(output);
        if (extension == ".html")
            file.write(report_page(report, svg));
        else if (extension == ".svg")
            file.write(svg);
        else if (extension == ".csv")
            file.write(report_csv(report));
        else
            file.write(report_json(report).dump(2, ' ', false, Json::error_handler_t::replace)
                       + "\n");
        file.seal();
        file.publish();
    }
}

void run(const ReportOptions& o) {
    const Clock::time_point begin = Clock::now();
    const std::vector<SweepRow> rows = rows_of(o, base_settings(o));
    const std::vector<Light> lights = command_line_lights(o);
    probe_outputs(o.outputs);
    if (!o.dry_run && (wants(o, ".svg") || wants(o, ".html")))
        require_gnuplot();
    const auto thread_limit = limit_threads(o.threads);
    const ImageModulePreload preload = preload_image_module();

    watch_signals();
    TerminalProgress progress(progress_style(o.progress));
    progress.begin("load", 0);
    std::vector<Scene> scenes;
    for (const std::string& path : o.scenes) {
        ReportOptions one = o;
        one.scene = path;
        probe_scene(one);
        scenes.push_back(load_scene(one, lights));
        for (const std::string& warning : scenes.back().warnings)
            progress.warn(warning);
    }
    const gpu::Device device({o.device, false});
    if (o.dry_run) {
        progress.clear();
        print_plan(o, scenes, rows, device.info());
        return;
    }

    Report report;
    report.device = device.info().name;
    report.threads = unsigned(tbb::this_task_arena::max_concurrency());
    report.settings = to_settings(o);
    for (std::size_t i = 0; i < scenes.size(); ++i) {
        report.scenes.push_back(measure_scene(scenes[i], rows, report.settings, device, progress));
        SceneReport& scene = report.scenes.back();
        scene.path = o.scenes[i];
        scene.command = shared_command(o, o.scenes[i]);
        for (const std::string& warning : scene.warnings)
            progress.warn(warning);
    }
    report.seconds = seconds_since(begin);
    progress.begin("write", 0);
    write_outputs(o, report);
    progress.clear();
    if (o.format == "json")
        print_json(report_json(report));
    else {
        std::cout << report_text(report);
        for (const std::string& output : o.outputs)
            std::cout << "wrote         " << output << '\n';
    }
}

} // namespace

void add_report(CLI::App& root, Action& action) {
    auto options = std::make_shared<ReportOptions>();
    ReportOptions& o = *options;
    CLI::App* app = root.add_subcommand("report", summary);
    app->footer(std::string(manual) + "\n\n" + suite_manual);

    OptionList list(*app);
    list.text("scene", o.scenes, "FILE...", "glTF 2.0 files, .gltf or .glb");
    list.list("-o,--output", o.outputs, "FILE",
              "Report to write: .html, .svg, .csv or .json; may be repeated");
    list.group("Sweep");
    list.text("--sweep", o.sweep, "FILE", "TOML file of values: see below");
    for (const std::string& option : sweep_options())
        o.axes.push_back({option, ""});
    for (auto& [option, values] : o.axes)
        list.text("--" + option, values, "V,V,...", help_of(option));
    list.group("Suite");
    list.text("--suite", o.suite, "FILE", "JSON file of hard cases to run instead: see below");
    list.list("--case", o.cases, "NAME", "Case to run; may be repeated; default: all");
    list.flag("--cheap", o.cheap, "Run the cheap cases alone");
    list.group("Grid");
    list.text("--bounds", o.bounds, "X0,Y0,Z0,X1,Y1,Z1",
              "Box to fit the grids to, metres; default: the scene's");
    list.number("--margin", o.margin, 0, 1024, "Whole cells around the box on each side")
        ->capture_default_str();
    add_light_options(list, o);

    list.group("Measure");
    list.number("--repeats", o.repeats, 1, 1000, "Of each bake")->capture_default_str();
    list.number("--probes", o.probes, 1, 100'000, "Cells of each grid, and points on surfaces")
        ->capture_default_str();
    list.text("--noise", o.noise, "X|X%", "Trace the reference until its noise is at most this")
        ->transform(share_or_percent())
        ->capture_default_str();
    list.number("--rays", o.rays, 64, 1 << 24, "From each probe of the reference at most")
        ->capture_default_str();
    list.number("--seed", o.seed, 0, 4294967295, "Draws probes, surface points and paths")
        ->capture_default_str();
    list.flag("--no-peer", o.no_peer, "Leave out the path-traced probes");
    list.flag("--no-slices", o.no_slices, "Leave out the pictures of the page");

    list.group("Run");
    list.text("--device", o.device, "NAME", "Index, UUID or part of the name; default: the first");
    list.flag("--dry-run", o.dry_run, "List the rows with grids and estimates of their time")
        ->configurable(false);
    add_run_options(list, o);

    app->callback([app, options, &action] {
        if (!options->config.empty())
            apply_config(*app, options->config);
        action = [options] {
            if (options->print_config) {
                print_config(settings_of(*options));
                return;
            }
            if (!options->suite.empty()) {
                run_suite(suite_run(*options));
                return;
            }
            check_options(*options);
            run(*options);
        };
    });
}

} // namespace lpvbake
