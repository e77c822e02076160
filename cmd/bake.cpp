// lpvbake bake: from a glTF file to volume files.

#include "bake.h"

#include "commands.h"
#include "config.h"
#include "error.h"
#include "image/image.h"
#include "io/io.h"
#include "scene/gltf/light_file.h"
#include "scene/gltf/load.h"
#include "scene/lights.h"
#include "scene_hash.h"
#include "terminal.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include <cctype>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <future>
#include <iostream>
#include <memory>
#include <optional>

#include <sys/resource.h>
#include <unistd.h>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

const char summary[] = "Bakes the light that a scene's surfaces send on into volume files.";

const char manual[] =
    R"(The field holds light after at least one reflection from directional, point and spot lights, and
all light of emissive surfaces. Lengths are metres, +Y is up. Lights come from the file
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
   "outputs": [{"path", "bytes"}], "stages": [{"name", "seconds", "detail"}], "seconds",
   "peak_memory", "warnings": [...]}
With --dry-run, "outputs" have no bytes, "seconds" is an estimate, "peak_memory" is absent, and
"rsm": {"maps", "size"}, "device_bytes" and "host_bytes" say what it takes.)";

/// Options as given; `to_settings` makes them the core's enums and structs.
struct BakeOptions {
    std::string scene;
    std::vector<std::string> outputs;
    int resolution = 32;
    double cell_size = 0;
    std::string bounds;
    int margin = 1;
    std::vector<std::string> suns;
    std::vector<std::string> points;
    std::vector<std::string> light_files;
    bool no_scene_lights = false;
    bool no_emitters = false;
    int rsm_size = 0;
    int rsm_kernel = 4;
    int iterations = 0;
    double tolerance = 1e-2;
    std::string occlusion = "face";
    double max_albedo = 0.95;
    std::string metallic = "reflect";
    std::string backfaces = "block";
    std::string precision = "float";
    std::string exr_packing = "band";
    std::string device;
    int threads = 0;
    bool validation = false;
    std::string format = "text";
    std::string progress = "auto";
    bool dry_run = false;
    bool print_config = false;
    std::string config;
};

/// What becomes of an option outside the process: all in --print-config, `shapes_result` alone in
/// the metadata of the outputs, which depend on nothing else.
struct Setting {
    const char* name;
    std::string toml;
    bool shapes_result;
};

std::string toml_array(const std::vector<std::string>& values) {
    std::string text = "[";
    for (const std::string& value : values)
        text += (text.size() > 1 ? ", " : "") + toml_string(value);
    return text + "]";
}

/// In the order of --help. Options at "not given" (no bounds, no cell size) are left out.
std::vector<Setting> settings_of(const BakeOptions& o) {
    const auto flag = [](bool value) { return std::string(value ? "true" : "false"); };
    std::vector<std::string>
        light_names; // without folders: outputs do not tell where they were made
    for (const std::string& path : o.light_files)
        light_names.push_back(fs::path(path).filename().string());
    std::vector<Setting> settings;
    if (!o.scene.empty())
        settings.push_back({"scene", toml_string(o.scene), false});
    if (!o.outputs.empty())
        settings.push_back({"output", toml_array(o.outputs), false});
    if (o.cell_size > 0)
        settings.push_back({"cell-size", toml_number(o.cell_size), true});
    else
        settings.push_back({"resolution", std::to_string(o.resolution), true});
    if (!o.bounds.empty())
        settings.push_back({"bounds", toml_string(o.bounds), true});
    settings.insert(settings.end(), {
                                        {"margin", std::to_string(o.margin), true},
                                        {"sun", toml_array(o.suns), true},
                                        {"point", toml_array(o.points), true},
                                        {"lights", toml_array(o.light_files), false},
                                        {"no-scene-lights", flag(o.no_scene_lights), true},
                                        {"no-emitters", flag(o.no_emitters), true},
                                        {"rsm-size", std::to_string(o.rsm_size), true},
                                        {"rsm-kernel", std::to_string(o.rsm_kernel), true},
                                        {"iterations", std::to_string(o.iterations), true},
                                        {"tolerance", toml_number(o.tolerance), true},
                                        {"occlusion", toml_string(o.occlusion), true},
                                        {"max-albedo", toml_number(o.max_albedo), true},
                                        {"metallic", toml_string(o.metallic), true},
                                        {"backfaces", toml_string(o.backfaces), true},
                                        {"precision", toml_string(o.precision), false},
                                        {"exr-packing", toml_string(o.exr_packing), false},
                                        {"device", toml_string(o.device), false},
                                        {"threads", std::to_string(o.threads), false},
                                        {"validation", flag(o.validation), false},
                                        {"format", toml_string(o.format), false},
                                        {"progress", toml_string(o.progress), false},
                                    });
    return settings;
}

// ---------------------------------------------------------------- reading the command line

CLI::Validator one_of(const char* choices) {
    return {[choices](std::string& text) -> std::string {
                for (const std::string& choice : CLI::detail::split(choices, '|'))
                    if (choice == text)
                        return {};
                return "'" + text + "' is none of " + choices;
            },
            ""};
}

std::optional<double> parse_number(const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (text.empty() || std::isspace(static_cast<unsigned char>(text[0])) || *end != '\0'
        || !std::isfinite(value))
        return std::nullopt;
    return value;
}

/// A finite number in [lo, hi], written in digits alone if `whole`.
CLI::Validator within(double lo, double hi, bool whole) {
    return {[lo, hi, whole](std::string& text) -> std::string {
                const std::optional<double> value = parse_number(text);
                const bool digits = text.find_first_not_of("0123456789") == std::string::npos;
                if (value && *value >= lo && *value <= hi && (digits || !whole))
                    return {};
                return "'" + text + "' is not a " + (whole ? "whole " : "") + "number from "
                       + toml_number(lo) + " to " + toml_number(hi);
            },
            ""};
}

Bounds parse_bounds(const std::string& text) {
    Bounds bounds;
    const std::vector<std::string> parts = CLI::detail::split(text, ',');
    bool good = parts.size() == 6;
    for (int i = 0; good && i < 6; ++i) {
        const std::optional<double> value = parse_number(parts[std::size_t(i)]);
        good = value.has_value();
        if (good)
            (i < 3 ? bounds.lo : bounds.hi)[i % 3] = *value;
    }
    if (!good)
        throw Error(ExitCode::usage,
                    "--bounds: '" + text
                        + "' is not six finite numbers x0,y0,z0,x1,y1,z1 in metres");
    for (int axis = 0; axis < 3; ++axis)
        if (bounds.lo[axis] > bounds.hi[axis])
            throw Error(ExitCode::usage, std::string("--bounds: ") + "xyz"[axis] + "0 is above "
                                             + "xyz"[axis] + "1 in '" + text + "'");
    return bounds;
}

/// Applies what the command line did not set.
void apply_config(CLI::App& app, const std::string& path) {
    for (const ConfigEntry& entry : read_config(path, app.get_name())) {
        const std::string place = path + ":" + std::to_string(entry.line) + ": ";
        CLI::Option* option = app.get_option_no_throw("--" + entry.key);
        if (!option)
            option = app.get_option_no_throw(entry.key);
        if (!option || !option->get_configurable())
            throw Error(ExitCode::usage, place + "'" + entry.key + "' is not an option of "
                                             + app.get_name() + " that a file can set");
        if (option->count() > 0)
            continue;
        const bool many = option->get_items_expected_max() > 1;
        if (entry.values.size() != 1 && !many)
            throw Error(ExitCode::usage, place + entry.key + " takes one value");
        try {
            for (const std::string& value : entry.values)
                option->add_result(option->get_expected_max() == 0
                                       ? option->get_flag_value("--" + entry.key, value)
                                       : value);
            if (!entry.values.empty())
                option->run_callback();
        } catch (const CLI::ParseError& error) {
            throw Error(ExitCode::usage, place + error.what());
        }
    }
}

bool has_extension(const std::string& path, const char* extension) {
    std::string own = fs::path(path).extension().string();
    for (char& c : own)
        c = char(std::tolower(static_cast<unsigned char>(c)));
    return own == extension;
}

/// All that can be known to be wrong before any work is done.
void check_options(const BakeOptions& o, bool resolution_given) {
    if (o.scene.empty())
        throw Error(ExitCode::usage,
                    "no scene: lpvbake bake SCENE -o OUTPUT (see lpvbake bake --help)");
    if (o.outputs.empty() && !o.dry_run)
        throw Error(ExitCode::usage, "no output: add -o FILE.vdb or -o FILE.exr");
    if (o.cell_size > 0 && resolution_given)
        throw Error(ExitCode::usage, "--cell-size and --resolution exclude each other");
    std::vector<fs::path> names;
    for (const std::string& output : o.outputs) {
        if (!volume_format(output))
            throw Error(ExitCode::usage, output + ": the name of an output ends in .vdb or .exr");
        const fs::path name = fs::weakly_canonical(fs::absolute(output));
        for (const fs::path& other : names)
            if (other == name)
                throw Error(ExitCode::usage, output + ": given twice as an output");
        names.push_back(name);
        for (const std::string& lights : o.light_files)
            if (has_extension(output, ".exr")
                && fs::path(name).replace_extension(".json")
                       == fs::weakly_canonical(fs::absolute(lights)))
                throw Error(ExitCode::usage,
                            output + ": its sidecar would replace the light file " + lights);
    }
}

/// Makes and removes a file beside each output, so that a bake does not end with nowhere to go.
void probe_outputs(const std::vector<std::string>& outputs) {
    for (const std::string& output : outputs) {
        const fs::path folder = fs::absolute(output).parent_path();
        std::error_code ignored;
        if (!fs::is_directory(folder, ignored))
            throw Error(ExitCode::file, output + ": its folder does not exist");
        if (fs::is_directory(output, ignored))
            throw Error(ExitCode::file, output + ": is a folder");
        std::string probe = (folder / ".lpvbake-probe-XXXXXX").string();
        const int file = mkstemp(probe.data());
        if (file < 0)
            throw Error(ExitCode::file, output + ": cannot be written: " + std::strerror(errno));
        close(file);
        unlink(probe.c_str());
    }
}

MaterialRules to_rules(const BakeOptions& o) {
    return {float(o.max_albedo), o.metallic == "black", o.backfaces == "cull"};
}

BakeSettings to_settings(const BakeOptions& o) {
    BakeSettings settings;
    settings.grid = {o.resolution, o.cell_size, o.margin};
    if (!o.bounds.empty())
        settings.bounds = parse_bounds(o.bounds);
    settings.rsm_size = o.rsm_size;
    settings.rsm_kernel = o.rsm_kernel;
    settings.emitters = !o.no_emitters;
    settings.lpv.iterations = o.iterations;
    settings.lpv.tolerance = float(o.tolerance);
    settings.lpv.occlusion = o.occlusion == "none" ? Occlusion::none
                             : o.occlusion == "sh" ? Occlusion::sh
                                                   : Occlusion::face;
    return settings;
}

std::vector<Light> command_line_lights(const BakeOptions& o) {
    std::vector<Light> lights;
    for (const std::string& text : o.suns)
        lights.push_back(parse_sun(text));
    for (const std::string& text : o.points)
        lights.push_back(parse_point(text));
    for (const std::string& path : o.light_files) {
        std::vector<Light> more = load_lights(path);
        lights.insert(lights.end(), more.begin(), more.end());
    }
    return lights;
}

// ---------------------------------------------------------------- running

/// True if the file mentions images, which then have to be decoded. A guess to gain time by.
bool mentions_images(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::string head(1 << 20, '\0');
    file.read(head.data(), std::streamsize(head.size()));
    head.resize(std::size_t(file.gcount()));
    return head.find("\"images\"") != std::string::npos;
}

uint64_t peak_memory() {
    struct rusage usage = {};
    getrusage(RUSAGE_SELF, &usage);
    return uint64_t(usage.ru_maxrss) * 1024; // the kernel counts KiB
}

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

std::string bytes_text(uint64_t bytes) {
    char text[32];
    if (bytes < 10'000)
        std::snprintf(text, sizeof text, "%llu B", static_cast<unsigned long long>(bytes));
    else if (bytes < 10'000'000)
        std::snprintf(text, sizeof text, "%.1f KiB", double(bytes) / 1024);
    else
        std::snprintf(text, sizeof text, "%.1f MiB", double(bytes) / (1024 * 1024));
    return text;
}

struct Written {
    std::string path;
    uint64_t bytes = 0;
};

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
                  {"grid",
                   {{"dims", {grid.dims.x, grid.dims.y, grid.dims.z}},
                    {"cell", grid.cell},
                    {"origin", {grid.origin.x, grid.origin.y, grid.origin.z}},
                    {"cells", grid.size()}}},
                  {"dry_run", o.dry_run},
                  {"outputs", Json::array()},
                  {"stages", Json::array()},
                  {"warnings", warnings}};
    for (const StageReport& stage : stages)
        document["stages"].push_back(
            {{"name", stage.name}, {"seconds", stage.seconds}, {"detail", stage.detail}});
    return document;
}

void print_json(const Json& document) {
    std::cout << document.dump(2, ' ', false, Json::error_handler_t::replace) << '\n';
}

void print_grid(const Grid& grid) {
    std::printf("grid          %d x %d x %d cells of %.4g m from (%.5g, %.5g, %.5g)\n", grid.dims.x,
                grid.dims.y, grid.dims.z, grid.cell, grid.origin.x, grid.origin.y, grid.origin.z);
}

void print_plan(const BakeOptions& o, const gpu::DeviceInfo& device, const BakePlan& plan,
                const std::vector<std::string>& warnings) {
    if (o.format == "json") {
        Json document = describe(o, device, plan.triangles, plan.grid, plan.stages, warnings);
        for (const std::string& output : o.outputs)
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
    for (const std::string& output : o.outputs)
        std::printf("output        %s\n", output.c_str());
}

void print_result(const BakeOptions& o, const gpu::DeviceInfo& device, uint64_t triangles,
                  const Grid& grid, const std::vector<StageReport>& stages,
                  const std::vector<Written>& outputs, double seconds,
                  const std::vector<std::string>& warnings) {
    if (o.format == "json") {
        Json document = describe(o, device, triangles, grid, stages, warnings);
        for (const Written& output : outputs)
            document["outputs"].push_back({{"path", output.path}, {"bytes", output.bytes}});
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
        std::printf("wrote         %s (%s)\n", output.path.c_str(),
                    bytes_text(output.bytes).c_str());
}

void fill_metadata(const BakeOptions& o, const Scene& scene, Volume& volume) {
    std::string settings;
    for (const Setting& setting : settings_of(o))
        if (setting.shapes_result)
            settings += (settings.empty() ? "" : "; ") + (setting.name + (" = " + setting.toml));
    volume.metadata.try_emplace("tool", "lpvbake " LPVBAKE_VERSION);
    volume.metadata.try_emplace("scene", fs::path(o.scene).filename().string());
    volume.metadata.try_emplace("scene_hash", scene_hash(scene));
    volume.metadata.try_emplace("settings", settings);
}

void run(const BakeOptions& o) {
    const Clock::time_point begin = Clock::now();
    const BakeSettings settings = to_settings(o);
    std::vector<Light> lights = command_line_lights(o);
    if (!o.dry_run)
        probe_outputs(o.outputs);
    if (access(o.scene.c_str(), R_OK) != 0)
        throw Error(ExitCode::file, o.scene + ": " + std::strerror(errno));

    // Both before any thread starts that would read them.
    std::optional<tbb::global_control> thread_limit;
    if (o.threads > 0) {
        thread_limit.emplace(tbb::global_control::max_allowed_parallelism, std::size_t(o.threads));
        setenv("LP_NUM_THREADS", std::to_string(o.threads).c_str(), 1);
        setenv("OPENIMAGEIO_THREADS", std::to_string(o.threads).c_str(), 1);
    }
    ImageModulePreload preload;
    if (mentions_images(o.scene))
        preload = preload_image_module();

    watch_signals();
    TerminalProgress progress(progress_style(o.progress));
    std::vector<StageReport> stages;

    progress.begin("load", 0);
    auto opening = std::async(std::launch::async, [&o] {
        return std::make_unique<gpu::Device>(gpu::DeviceOptions{o.device, o.validation});
    });
    Scene scene = load_gltf(o.scene, to_rules(o));
    if (o.no_scene_lights)
        scene.lights.clear();
    scene.lights.insert(scene.lights.end(), lights.begin(), lights.end());
    for (const std::string& warning : scene.warnings)
        progress.warn(warning);
    stages.push_back({"load", seconds_since(begin),
                      std::to_string(triangle_count(scene)) + " triangles, "
                          + std::to_string(scene.lights.size()) + " lights"});
    stop_if_signalled();

    const Clock::time_point waiting = Clock::now();
    const std::unique_ptr<gpu::Device> device = opening.get();
    stages.push_back({"device", seconds_since(waiting), "opened while the scene was loaded"});

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
    fill_metadata(o, scene, baked.volume);

    const Clock::time_point writing = Clock::now();
    const Precision precision = o.precision == "half" ? Precision::half : Precision::full;
    const Packing packing = o.exr_packing == "channel" ? Packing::channel : Packing::band;
    std::vector<Written> written;
    progress.begin("write", o.outputs.size());
    for (const std::string& output : o.outputs) {
        progress.advance(written.size());
        const WriteReport report = write_volume(output, baked.volume, precision, packing);
        for (const std::string& warning : report.warnings)
            progress.warn(warning);
        written.push_back({output, report.bytes});
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

    const char* group = "Options";
    const auto text = [&](const char* names, auto& value, const char* type, const char* help) {
        return app->add_option(names, value, help)->type_name(type)->group(group);
    };
    // Repeatable, one value each time: what follows may be the scene.
    const auto list = [&](const char* names, auto& values, const char* type, const char* help) {
        return text(names, values, type, help)->allow_extra_args(false);
    };
    const auto number = [&](const char* names, auto& value, double lo, double hi,
                            const char* help) {
        const bool whole = std::is_integral_v<std::decay_t<decltype(value)>>;
        return text(names, value, whole ? "N" : "X", help)->check(within(lo, hi, whole));
    };
    const auto choice = [&](const char* names, std::string& value, const char* choices,
                            const char* help) {
        return text(names, value, choices, help)->check(one_of(choices))->capture_default_str();
    };
    const auto flag = [&](const char* names, bool& value, const char* help) {
        return app->add_flag(names, value, help)->group(group);
    };

    text("scene", o.scene, "FILE", "glTF 2.0 file, .gltf or .glb");
    list("-o,--output", o.outputs, "FILE", "Volume to write, .vdb or .exr; may be repeated");

    group = "Grid";
    CLI::Option* resolution = number("--resolution", o.resolution, 3, 65536,
                                     "Cells along the longest axis, margins included; at least 3");
    resolution->capture_default_str();
    number("--cell-size", o.cell_size, 1e-9, 1e9, "Edge of a cell, metres; replaces --resolution");
    text("--bounds", o.bounds, "X0,Y0,Z0,X1,Y1,Z1",
         "Box to fit the grid to, metres; default: the scene's");
    number("--margin", o.margin, 0, 1024, "Whole cells around the box on each side")
        ->capture_default_str();

    group = "Light";
    list("--sun", o.suns, "AZIMUTH,ELEVATION,LUX[,COLOUR]",
         "Directional light: where it stands, degrees from +Z towards +X and\n"
         "above the horizon; COLOUR #rrggbb or R:G:B linear; may be repeated");
    list("--point", o.points, "X,Y,Z,CANDELA[,COLOUR]", "Point light, metres; may be repeated");
    list("--lights", o.light_files, "FILE",
         "JSON file of lights in the terms of KHR_lights_punctual;\nmay be repeated");
    flag("--no-scene-lights", o.no_scene_lights, "Leave out the lights of the file");
    flag("--no-emitters", o.no_emitters, "Emissive surfaces give no light");
    number("--max-albedo", o.max_albedo, 0, 1, "Reflectance is clamped to this, 0 to 1")
        ->capture_default_str();
    choice("--metallic", o.metallic, "black|reflect",
           "Metal reflects its base colour, or (strict PBR) nothing");
    choice("--backfaces", o.backfaces, "block|cull",
           "Light stops at the back of single-sided surfaces, or passes");

    group = "Solver";
    number("--rsm-size", o.rsm_size, 0, 16384,
           "Texels along a side of a reflective shadow map; 0: from the grid")
        ->capture_default_str();
    number("--rsm-kernel", o.rsm_kernel, 1, 64,
           "Texels along a side of a block that becomes virtual point lights")
        ->capture_default_str();
    number("--iterations", o.iterations, 0, 1'000'000, "Propagation steps; 0: until --tolerance")
        ->capture_default_str();
    number("--tolerance", o.tolerance, 1e-7, 1,
           "Share of the injected power still under way at which\npropagation ends")
        ->capture_default_str();
    choice("--occlusion", o.occlusion, "none|sh|face",
           "Blocking between cells: none, sh (SH geometry volume), face (a\n"
           "scalar a face, does not leak)");

    group = "Output";
    choice("--precision", o.precision, "float|half", "Of stored numbers");
    choice("--exr-packing", o.exr_packing, "band|channel",
           "An RGB file a coefficient, or an RGBA file a colour channel");

    group = "Run";
    text("--device", o.device, "NAME", "Index, UUID or part of the name; default: the first");
    number("--threads", o.threads, 0, 1024, "CPU threads; 0: one a core")->capture_default_str();
    flag("--validation", o.validation, "Load Vulkan's validation layer; messages are errors");
    choice("--format", o.format, "text|json", "Form of the result");
    choice("--progress", o.progress, "auto|bar|plain|none",
           "On standard error; auto: a bar on a terminal");
    flag("--dry-run", o.dry_run, "Print grid, memory, outputs and an estimate of the time")
        ->configurable(false);
    text("--config", o.config, "FILE", "TOML file of options; the command line comes first")
        ->configurable(false);
    flag("--print-config", o.print_config, "Print every option as --config reads it")
        ->configurable(false);

    app->callback([app, resolution, options, &action] {
        const bool resolution_given = resolution->count() > 0;
        const bool cell_given = options->cell_size > 0;
        if (!options->config.empty())
            apply_config(*app, options->config);
        // Either one on the command line takes the place of the other in the file.
        if (resolution_given && !cell_given)
            options->cell_size = 0;
        const bool both =
            cell_given ? resolution_given : options->cell_size > 0 && resolution->count() > 0;
        action = [options, both] {
            if (options->print_config) {
                for (const Setting& setting : settings_of(*options))
                    std::printf("%s = %s\n", setting.name, setting.toml.c_str());
                return;
            }
            check_options(*options, both);
            run(*options);
        };
    });
}

} // namespace lpvbake
