// lpvbake report: what bakes cost and how wrong they are.

#include "report/report.h"

#include "background.h"
#include "bake/plan.h"
#include "commands.h"
#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "options/toml.h"
#include "options/wording.h"
#include "report/page.h"
#include "report/plot.h"
#include "report/search.h"
#include "report/tables.h"
#include "scene_options.h"
#include "suite.h"
#include "text.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>

namespace lpvbake::cmd {
namespace {

const char manual[] =
#include "manual/report.txt.h"
    ;

struct ReportOptions : SceneOptions, RunOptions {
    std::vector<std::string> scenes;
    std::vector<std::string> outputs;
    std::string sweep;
    report::Goal goal;
    SuiteRun suite;
    /// Comma-separated values by the option of a sweep; empty: not given.
    std::vector<std::pair<std::string, std::string>> axes;
    int repeats = 3;
    uint64_t probes = 1000;
    std::optional<double> noise; ///< none: 1 %, for a wanted error more
    uint64_t rays = 1 << 16;
    uint64_t seed = 1;
    bool no_peer = false;
    bool no_slices = false;
};

std::string extension_of(const std::string& path) {
    for (const char* extension : {".html", ".svg", ".csv", ".json"})
        if (options::has_extension(path, extension))
            return extension;
    return {};
}

bool wants(const ReportOptions& o, const char* extension) {
    return std::ranges::any_of(
        o.outputs, [&](const std::string& path) { return extension_of(path) == extension; });
}

/// Runs the suite. Throws Error (argument) for options that the suite's file decides.
void run_suite(const ReportOptions& o, const options::Options& options) {
    const std::vector<std::string> taken{
        "suite",  "baseline", "update-baseline", "slack",  "time-slack", "case",   "cheap",
        "solver", "device",   "threads",         "format", "progress",   "config", "print-config"};
    for (const options::Option& option : options.rows())
        if (option.is_set() && std::ranges::find(taken, option.name()) == taken.end())
            throw Error(
                ErrorKind::argument,
                "--suite takes what it runs from its file, not "
                    + (option.is_positional() ? "the scene " + o.scenes[0] : "--" + option.name()));
    SuiteRun run = o.suite;
    if (const options::Option* solver = options.find("solver"); solver->is_set())
        run.selection.solvers = options::split(solver->given.back(), ',');
    run_suite(run, o);
}

/// All that can be known to be wrong before any work is done.
void check_options(const ReportOptions& o) {
    if (o.scenes.empty())
        throw Error(ErrorKind::argument, "no scene: lpvbake report SCENE... (see lpvbake report "
                                         "--help)");
    for (const std::string& output : o.outputs)
        if (extension_of(output).empty())
            throw Error(ErrorKind::argument,
                        output + ": the name of an output ends in .html, .svg, .csv or .json");
    std::vector<std::string> inputs = inputs_of(o, o);
    inputs.insert(inputs.end(), o.scenes.begin(), o.scenes.end());
    inputs.insert(inputs.end(), {o.sweep, o.suite.baseline.path});
    check_files(inputs, {}, o.outputs, true);
}

/// Throws Error (argument: names file, line and key).
std::vector<report::Sweep> read_sweeps(const std::string& path) {
    std::vector<report::Sweep> sweeps;
    for (const std::vector<options::ConfigEntry>& table :
         options::read_config_tables(path, "sweep")) {
        report::Sweep sweep;
        for (const options::ConfigEntry& entry : table) {
            const std::string place = path + ":" + std::to_string(entry.line) + ": ";
            if (entry.values.empty())
                throw Error(ErrorKind::argument, place + entry.key + " has no values");
            for (const std::string& value : entry.values)
                try {
                    report::check_sweep_value(entry.key, value);
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

/// Whether an error or a time is wanted.
bool has_goal(const ReportOptions& o) {
    return o.goal.error || o.goal.seconds;
}

std::vector<report::SweepRow> rows_of(const ReportOptions& o) {
    bake::BakeSettings base;
    base.grid.margin = o.grid_settings().margin;
    base.emitters = !o.no_emitters;
    report::Sweep listed;
    for (const auto& [option, values] : o.axes)
        if (!values.empty())
            listed.push_back({option, options::split(values, ',')});
    if (has_goal(o))
        return report::candidate_rows(listed, o.goal, base);
    if (!o.sweep.empty() && !listed.empty())
        throw Error(ErrorKind::argument,
                    "--sweep and --" + listed.front().option + " exclude each other");
    if (!o.sweep.empty())
        try {
            return report::sweep_rows(read_sweeps(o.sweep), base);
        } catch (const Error& error) {
            const std::string text = error.what();
            throw Error(error.kind, text.starts_with(o.sweep) ? text : o.sweep + ": " + text);
        }
    return report::sweep_rows(
        listed.empty() ? report::default_sweeps() : std::vector<report::Sweep>{listed}, base);
}

report::ReportSettings to_settings(const ReportOptions& o) {
    report::ReportSettings settings;
    settings.repeats = o.repeats;
    settings.probes = o.probes;
    settings.seed = o.seed;
    settings.truth = {o.noise.value_or(std::max(0.01, o.goal.error.value_or(0) / 3)), o.rays,
                      o.seed};
    settings.peer = !o.no_peer;
    settings.slices = settings.views = !o.no_slices && wants(o, ".html");
    return settings;
}

/// The rows with the box that is asked for in this scene.
std::vector<report::SweepRow> rows_in(const Scene& scene, const ReportOptions& o,
                                      std::vector<report::SweepRow> rows) {
    const std::optional<Bounds> box = o.box_in(scene);
    for (report::SweepRow& row : rows)
        row.settings.bounds = box;
    return rows;
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

/// `lpvbake bake SCENE` with the options that all rows share: what is set of those that bake has.
std::string shared_command(const options::Options& options, const std::string& scene) {
    options::Options bake;
    const options::Action keeps_fields = bake_command().declare(bake);
    std::string command =
        "lpvbake bake " + shell_word((scene.starts_with('-') ? "./" : "") + scene) + " -o out.vdb";
    const std::vector<std::string> own{"output", "format", "progress",
                                       "config", "error",  "time-budget"};
    const std::vector<std::string> swept = report::sweep_options();
    for (const options::Option& option : options.rows()) {
        const std::string name = option.name();
        if (option.is_positional() || !option.is_set() || !bake.find(name) || !option.in_files
            || std::ranges::count(own, name) > 0 || std::ranges::count(swept, name) > 0)
            continue;
        for (const std::string& value : option.given)
            command += " --" + name + (option.is_flag() ? "" : "=" + shell_word(value));
    }
    return command;
}

/// The command that repeats a row.
std::string row_command(const std::string& shared, const report::SweepRow& row) {
    std::string command = shared;
    for (const auto& [option, value] : row.options)
        command += " --" + option + " " + value;
    return command;
}

/// Before the work, since it is long.
void print_expected(double seconds, const ReportOptions& o) {
    std::printf("expected      about %s s in all, each row baked %s\n",
                report::rough(seconds).c_str(), counted(uint64_t(o.repeats), "time").c_str());
    std::fflush(stdout);
}

/// The head of the documents of dry runs.
report::Json plan_document() {
    return {{"command", "report"},
            {"version", LPVBAKE_VERSION},
            {"dry_run", true},
            {"scenes", report::Json::array()}};
}

/// Lists what would be baked, with estimates.
void print_plan(const ReportOptions& o, const options::Options& options,
                const std::vector<Scene>& scenes, const std::vector<report::SweepRow>& rows,
                const gpu::Device& device, Progress& progress) {
    report::Json document = plan_document();
    double seconds = 0;
    for (std::size_t i = 0; i < scenes.size(); ++i) {
        const std::string command = shared_command(options, o.scenes[i]);
        report::Json entries = report::Json::array();
        if (o.format == Format::text)
            std::printf("scene         %s\n", o.scenes[i].c_str());
        const bake::SceneFacts facts = bake::survey(scenes[i]);
        const std::vector<report::SweepRow> here = rows_in(scenes[i], o, rows);
        for (const report::SweepRow& row : here) {
            const bake::BakePlan plan = bake::plan_bake(facts, row.settings, device.info());
            const glm::ivec3 dims = plan.grid.dims;
            entries.push_back({{"name", report::row_name(row)},
                               {"command", row_command(command, row)},
                               {"dims", {dims.x, dims.y, dims.z}},
                               {"seconds", plan.seconds}});
            if (o.format == Format::text)
                std::printf("row           %-28s %4d x %4d x %4d cells, about %s s each\n",
                            report::row_name(row).c_str(), dims.x, dims.y, dims.z,
                            two_digits(plan.seconds).c_str());
        }
        const double here_seconds =
            report::expected_seconds(scenes[i], here, to_settings(o), device, progress);
        seconds += here_seconds;
        document["scenes"].push_back(
            {{"scene", o.scenes[i]}, {"rows", entries}, {"expected_seconds", here_seconds}});
    }
    if (o.format == Format::json)
        print_json(document);
    else
        print_expected(seconds, o);
}

void write_outputs(const ReportOptions& o, const report::Report& report) {
    std::string svg;
    if (wants(o, ".svg") || wants(o, ".html"))
        svg = report::plot_svg(report::plot_script(report), report.scenes.size());
    for (const std::string& output : o.outputs) {
        const std::string extension = extension_of(output);
        io::AtomicFile file(output);
        if (extension == ".html")
            file.write(report::report_page(report, svg));
        else if (extension == ".svg")
            file.write(svg);
        else if (extension == ".csv")
            file.write(report::report_csv(report));
        else
            file.write(report::report_json(report).dump(2, ' ', false,
                                                        report::Json::error_handler_t::replace)
                       + "\n");
        file.seal();
        file.publish();
    }
}

/// Measures all rows in all scenes.
void run_rows(const ReportOptions& o, const options::Options& options,
              const std::vector<Scene>& scenes, const std::vector<report::SweepRow>& rows,
              const gpu::Device& device, TerminalProgress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    report::Report report;
    report.device = device.info().name;
    report.threads = unsigned(threads_at_work());
    report.settings = to_settings(o);
    if (o.format == Format::text) {
        double expected = 0;
        for (const Scene& scene : scenes)
            expected += report::expected_seconds(scene, rows_in(scene, o, rows), report.settings,
                                                 device, progress);
        progress.erase();
        print_expected(expected, o);
    }
    for (std::size_t i = 0; i < scenes.size(); ++i) {
        progress.set_subject(o.scenes[i]);
        report.scenes.push_back(report::measure_scene(scenes[i], rows_in(scenes[i], o, rows),
                                                      report.settings, device, progress));
        report::SceneReport& scene = report.scenes.back();
        scene.path = o.scenes[i];
        const std::string command = shared_command(options, o.scenes[i]);
        for (report::RowResult& row : scene.rows) {
            row.command = row_command(command, row.row);
            for (std::string& warning : row.warnings)
                warning = options::in_options(warning);
        }
        for (std::string& warning : scene.warnings)
            progress.warn(warning = options::in_options(warning));
    }
    report.seconds = seconds_since(begin);
    progress.set_subject("");
    progress.begin("write", 0);
    write_outputs(o, report);
    progress.end();
    if (o.format == Format::json)
        print_json(report::report_json(report));
    else {
        std::cout << report::report_text(report);
        for (const std::string& output : o.outputs)
            std::cout << "wrote         " << output << '\n';
    }
    finish_stdout();
    const std::string worse = judge_by_baseline(o.suite.baseline, report::baseline_of(report));
    if (!worse.empty())
        throw Error(ErrorKind::difference, worse);
}

/// Seeks settings for what is wanted, scene by scene, or tells how long that would take.
void run_search(const ReportOptions& o, const options::Options& options,
                const std::vector<Scene>& scenes, const std::vector<report::SweepRow>& rows,
                const gpu::Device& device, TerminalProgress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    const report::ReportSettings settings = to_settings(o);
    const unsigned threads = unsigned(threads_at_work());
    report::Json document = o.dry_run ? plan_document()
                                      : report::Json{{"command", "report"},
                                                     {"version", LPVBAKE_VERSION},
                                                     {"device", device.info().name},
                                                     {"threads", threads},
                                                     {"repeats", o.repeats},
                                                     {"seed", o.seed},
                                                     {"scenes", report::Json::array()}};
    document["goal"] = report::goal_json(o.goal);
    const bool text = o.format == Format::text;
    if (text && !o.dry_run)
        std::printf("device        %s\nthreads       %u\n", device.info().name.c_str(), threads);
    std::string missed;
    for (std::size_t i = 0; i < scenes.size(); ++i) {
        progress.set_subject(o.scenes[i]);
        report::SearchedScene scene{o.scenes[i], scene::triangle_count(scenes[i]), {}, {}};
        scene.search = report::begin_search(scenes[i], rows_in(scenes[i], o, rows), o.goal,
                                            settings, device, progress);
        const std::string command = shared_command(options, o.scenes[i]);
        for (report::Candidate& candidate : scene.search.candidates)
            candidate.command = row_command(command, candidate.row);
        progress.erase();
        if (text) {
            std::printf("scene         %s\nexpected      %s\n", o.scenes[i].c_str(),
                        report::expected_text(scene.search).c_str());
            std::fflush(stdout);
        }
        if (o.dry_run) {
            document["scenes"].push_back(report::search_plan_json(scene));
            if (text)
                print_text(report::search_plan_text(scene));
            continue;
        }
        scene.result = report::search(scenes[i], scene.search, settings, device, progress);
        for (report::Trial& trial : scene.result.trials)
            for (std::string& warning : trial.warnings)
                warning = options::in_options(warning);
        document["scenes"].push_back(report::search_json(scene));
        progress.end();
        if (text)
            print_text(report::search_text(scene));
        if (!scene.result.found && missed.empty())
            missed = report::nearest_text(scene);
    }
    progress.end();
    document["seconds"] = seconds_since(begin);
    if (!text)
        print_json(document);
    finish_stdout();
    if (!missed.empty())
        throw Error(ErrorKind::difference, missed);
}

void run(const ReportOptions& o, const options::Options& options) {
    check_options(o);
    check_baseline(o.suite.baseline);
    const std::vector<report::SweepRow> rows = rows_of(o);
    const GivenLights lights = command_line_lights(o);
    probe_outputs(o.outputs);
    if (!o.dry_run && (wants(o, ".svg") || wants(o, ".html")))
        report::require_gnuplot();
    limit_threads(o.threads);
    const image::ImageModulePreload preload = image::preload_image_module();

    watch_signals();
    TerminalProgress progress(o.progress);
    std::vector<Scene> scenes;
    for (const std::string& path : o.scenes) {
        SceneOptions one = o;
        one.scene = path;
        progress.set_subject(path);
        progress.begin("load", 0);
        probe_scene(one);
        scenes.push_back(load_scene(one, lights));
        for (const std::string& warning : scenes.back().warnings)
            progress.warn(warning);
    }
    const gpu::Device device({o.device, false});
    if (has_goal(o)) {
        run_search(o, options, scenes, rows, device, progress);
    } else if (o.dry_run) {
        progress.end();
        print_plan(o, options, scenes, rows, device, progress);
    } else {
        run_rows(o, options, scenes, rows, device, progress);
    }
}

/// A row for each option that a sweep can set, whose values are checked one by one.
void add_axes(options::Options& options, ReportOptions& o) {
    options::Options bake;
    const options::Action keeps_fields = bake_command().declare(bake);
    for (const std::string& name : report::sweep_options())
        o.axes.push_back({name, ""});
    for (auto& axis : o.axes) {
        const std::string& name = axis.first;
        const options::Option& of_bake = *bake.find(name);
        options
            .value(
                "--" + name, axis.second, "V,V,...",
                [name](const std::string& text) {
                    for (const std::string& part : options::split(text, ','))
                        try {
                            report::check_sweep_value(name, part);
                        } catch (const Error& error) { // "NAME: " is told
                            throw Error(error.kind, error.what() + name.size() + 2);
                        }
                    return text;
                },
                of_bake.type + ": " + of_bake.help)
            .record();
    }
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<ReportOptions>();
    ReportOptions& o = *fields;
    options.texts("scene", o.scenes, "FILE...", "glTF 2.0 files, .gltf or .glb");
    options
        .texts("-o,--output", o.outputs, "FILE",
               "Report to write: .html, .svg, .csv or .json; may be repeated")
        .keep_to_one_run();
    options.group("Goal");
    options
        .share("--error", o.goal.error, 1e-6, 1,
               "Find settings with which bakes of the scene err by no more: see below")
        .exclude({"output", "sweep", "quality", "baseline", "no-peer", "no-slices"});
    options
        .value("--time-budget", o.goal.seconds, "TIME", options::parse_seconds,
               "Find settings with which a bake takes no longer, as 10s; both: settings that keep "
               "both")
        .exclude({"output", "sweep", "quality", "baseline", "no-peer", "no-slices"});
    options.group("Sweep");
    options.text("--sweep", o.sweep, "FILE", "TOML file of values: see below");
    add_axes(options, o);
    BaselineOptions& baseline = o.suite.baseline;
    options.group("Baseline");
    options.text("--baseline", baseline.path, "FILE",
                 "JSON file of earlier numbers: exit code 7 if one became worse");
    options
        .flag("--update-baseline", baseline.update,
              "Write the numbers into the file instead; rows that are not measured stay")
        .need("baseline");
    options
        .share("--slack", baseline.slack.errors, 0, 10,
               "How much larger an error, or an energy's distance from 1, may be")
        .need("baseline");
    options
        .share("--time-slack", baseline.slack.seconds, 0, 1000,
               "The same for times, which are not compared without it")
        .need("baseline");
    options.group("Suite");
    options.text("--suite", o.suite.suite, "FILE",
                 "JSON file of hard cases to run instead: see below");
    options
        .texts("--case", o.suite.selection.cases, "NAME",
               "Case to run; may be repeated; default: all")
        .need("suite");
    options.flag("--cheap", o.suite.selection.cheap, "Run the cheap cases alone").need("suite");
    options.group("Grid");
    add_bounds_options(options, o);
    add_light_options(options, o);

    options.group("Measure");
    options.number("--repeats", o.repeats, 1, 1000, "Of each bake");
    options.number("--probes", o.probes, 1, 100'000, "Cells of each grid, and points on surfaces")
        .record();
    options
        .share("--noise", o.noise, 1e-6, 1,
               "Trace the reference until its noise is at most this; default: 1%, with --error a "
               "third of it if that is more")
        .implies([&o] { return options::number_text(to_settings(o).truth.noise); })
        .record();
    options.number("--rays", o.rays, 64, 1 << 24, "From each probe of the reference at most")
        .record();
    options.number("--seed", o.seed, 0, 4294967295, "Draws probes, surface points and paths")
        .record();
    options.flag("--no-peer", o.no_peer, "Leave out the path-traced probes");
    options.flag("--no-slices", o.no_slices, "Leave out the pictures of the page");
    add_device_option(options, o);
    add_dry_run_option(options, o, "List the rows with grids and estimates of their time");
    add_run_options(options, o);
    return [fields, &options] {
        if (fields->suite.suite.empty())
            run(*fields, options);
        else
            run_suite(*fields, options);
    };
}

} // namespace

options::Command report_command() {
    return {"report", "Bakes by many settings and tells speed against error.", manual, declare};
}

} // namespace lpvbake::cmd
