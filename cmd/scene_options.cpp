#include "scene_options.h"

#include "error.h"
#include "io/target.h"
#include "scene/gltf/light_file.h"
#include "scene/gltf/sky_file.h"
#include "scene/lights.h"
#include "scene_hash.h"

#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include <fcntl.h>
#include <unistd.h>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;

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
        throw Error(ErrorKind::argument,
                    "--bounds: '" + text
                        + "' is not six finite numbers x0,y0,z0,x1,y1,z1 in metres");
    for (int axis = 0; axis < 3; ++axis)
        if (bounds.lo[axis] > bounds.hi[axis])
            throw Error(ErrorKind::argument, std::string("--bounds: ") + "xyz"[axis] + "0 is above "
                                                 + "xyz"[axis] + "1 in '" + text + "'");
    return bounds;
}

/// "inf", or a whole number up to 10,000.
CLI::Validator bounces_or_inf() {
    return {[](std::string& text) -> std::string {
                const std::optional<double> value = parse_number(text);
                const bool digits = text.find_first_not_of("0123456789") == std::string::npos;
                if (text == "inf" || (value && digits && *value <= 10'000))
                    return {};
                return "'" + text + "' is neither a whole number from 0 to 10000 nor inf";
            },
            ""};
}

/// Bytes of "1500", "512M", "4G", "0.5T".
uint64_t parse_bytes(const char* option, const std::string& text) {
    constexpr std::string_view units = "KMGT";
    std::string digits = text;
    int shift = 0;
    if (const size_t unit =
            text.empty() ? std::string_view::npos
                         : units.find(char(std::toupper(static_cast<unsigned char>(text.back()))));
        unit != std::string_view::npos) {
        digits.pop_back();
        shift = 10 * (int(unit) + 1);
    }
    const std::optional<double> value = parse_number(digits);
    if (!value || !(*value > 0) || !(std::ldexp(*value, shift) < 0x1p62))
        throw Error(ErrorKind::argument,
                    std::string(option) + ": '" + text + "' is not a size such as 512M or 4G");
    return uint64_t(std::ldexp(*value, shift));
}

struct SkyPicture {
    std::string path;
    double scale = 1;
};

/// What FILE[,SCALE] of --sky says; none where it is COLOUR,NITS, of which neither a name with
/// letters nor a dot or slash in a name is part.
std::optional<SkyPicture> sky_picture(const std::string& text) {
    SkyPicture picture{text};
    const std::size_t comma = text.rfind(',');
    if (const auto scale =
            comma == std::string::npos ? std::nullopt : parse_number(text.substr(comma + 1))) {
        picture = {text.substr(0, comma), *scale};
        if (!(*scale >= 0))
            throw Error(ErrorKind::argument, "--sky " + text + ": SCALE is negative");
    }
    const bool name = picture.path.find_first_of("./") != std::string::npos
                      && picture.path.find_first_not_of("0123456789.:,+-eE ") != std::string::npos;
    return name && text.front() != '#' ? std::optional(picture) : std::nullopt;
}

} // namespace

CLI::Option* add_bounces_option(OptionList& list, std::string& bounces) {
    CLI::Option* option =
        list.text("--bounces", bounces, "N|inf", "Reflections of light at most, 0 to 10000, or all")
            ->check(bounces_or_inf());
    if (!bounces.empty())
        option->capture_default_str();
    return option;
}

std::optional<int> bounces_of(const std::string& option) {
    return option == "inf" ? std::nullopt : std::optional(std::atoi(option.c_str()));
}

void add_load_options(OptionList& list, LoadOptions& o) {
    list.group("Scene");
    list.text("--scene,--scene-name", o.scene_name, "NAME|INDEX",
              "Scene of the file; default: the one that the file names");
    list.text("--animation", o.animation, "NAME|INDEX",
              "Pose the scene by an animation; default: none, the first\nwhere --time is given");
    list.text("--time", o.time, "SECONDS", "Time of the animation; default: 0");
    list.text("--variant", o.variant, "NAME|INDEX", "Material variant of the file");
    list.flag("--strict", o.strict, "Take warnings of the scene for errors");
    list.flag("--allow-external", o.allow_external, "Let the scene read files outside its folder");
    list.text("--max-memory", o.max_memory, "SIZE", "Memory that loading the scene may take")
        ->capture_default_str();
}

LoadSettings load_settings(const LoadOptions& o) {
    LoadSettings settings;
    settings.scene = o.scene_name;
    settings.animation = o.animation;
    if (!o.time.empty()) {
        settings.time = parse_number(o.time);
        if (!settings.time)
            throw Error(ErrorKind::argument, "--time: '" + o.time + "' is not a number of seconds");
    }
    settings.variant = o.variant;
    settings.strict = o.strict;
    settings.allow_external = o.allow_external;
    settings.max_memory = parse_bytes("--max-memory", o.max_memory);
    return settings;
}

CLI::Option* add_grid_options(OptionList& list, SceneOptions& o) {
    list.group("Grid");
    CLI::Option* resolution =
        list.number("--resolution", o.resolution, 3, 65536,
                    "Cells along the longest axis, margins included; at least 3");
    resolution->capture_default_str();
    list.number("--cell-size", o.cell_size, 1e-9, 1e9,
                "Edge of a cell, metres; replaces --resolution");
    list.text("--bounds", o.bounds, "X0,Y0,Z0,X1,Y1,Z1",
              "Box to fit the grid to, metres; default: the scene's");
    list.number("--margin", o.margin, 0, 1024, "Whole cells around the box on each side")
        ->capture_default_str();
    return resolution;
}

void add_output_options(OptionList& list, OutputOptions& o) {
    list.group("Output");
    list.choice("--target", o.target, choices_of(target_names()),
                "Program that reads the files: sets the options below that are not\ngiven, see "
                "lpvbake convert --help, and writes what it needs beside them");
    list.choice("--precision", o.precision, "float|half", "Type of the stored numbers");
    list.choice("--sh-convention", o.sh_convention, choices_of(convention_names()),
                "Signs and factors of the stored coefficients");
    list.choice("--axes", o.axes, choices_of(axes_names()),
                "Axes of cells, directions and positions");
    list.choice("--exr-packing", o.exr_packing, choices_of(packing_names()),
                "One RGB file per coefficient, one RGBA file per colour channel, or as\nVRC Light "
                "Volumes, Bevy and three.js have it");
    list.number("--exr-columns", o.exr_columns, 0, 16384,
                "Slices in a row of an EXR's picture; 0: nearly square")
        ->capture_default_str();
}

void add_run_options(OptionList& list, RunOptions& o) {
    list.number("--threads", o.threads, 0, 1024, "CPU threads; 0: one a core")
        ->capture_default_str();
    list.choice("--format", o.format, "text|json", "Form of the result");
    list.choice("--progress", o.progress, "auto|bar|plain|none",
                "On standard error; auto: a bar on a terminal");
    list.text("--config", o.config, "FILE", "TOML file of options; the command line comes first")
        ->configurable(false);
    list.flag("--print-config", o.print_config, "Print every option as --config reads it")
        ->configurable(false);
}

void add_light_options(OptionList& list, SceneOptions& o) {
    add_load_options(list, o.load);
    list.group("Light");
    list.list("--sun", o.suns, "AZIMUTH,ELEVATION,LUX[,COLOUR]",
              "Directional light: where it stands, degrees from +Z towards +X and\n"
              "above the horizon; COLOUR #rrggbb or R:G:B linear; may be repeated");
    list.list("--point", o.points, "X,Y,Z,CANDELA[,COLOUR]",
              "Point light, metres; may be repeated");
    list.list("--lights", o.light_files, "FILE",
              "JSON file of lights in the terms of KHR_lights_punctual;\nmay be repeated");
    list.text("--sky", o.sky, "COLOUR,NITS|FILE[,SCALE]",
              "Light from beyond the scene: the same from everywhere, COLOUR as\nfor --sun; or an "
              "equirectangular picture (HDR, EXR, ...), whose\nvalues times SCALE (1) are nits and "
              "whose middle stands at +X");
    list.number("--sky-rotation", o.sky_rotation, -360, 360,
                "Degrees by which the picture is turned around +Y, from +Z towards\n+X")
        ->capture_default_str();
    list.flag("--no-scene-lights", o.no_scene_lights, "Leave out the lights of the file");
    list.flag("--no-emitters", o.no_emitters, "Emissive surfaces give no light");
    list.number("--max-albedo", o.max_albedo, 0, 1, "Reflectance is clamped to this, 0 to 1")
        ->capture_default_str();
    list.choice("--metallic", o.metallic, "black|reflect",
                "Metal reflects its base colour, or (strict PBR) nothing");
    list.choice("--backfaces", o.backfaces, "block|cull",
                "Light stops at the back of single-sided surfaces, or passes");
}

bool settle(CLI::App& app, const CLI::Option& resolution, const std::string& config,
            SceneOptions& o) {
    const bool resolution_given = resolution.count() > 0;
    const bool cell_given = o.cell_size > 0;
    if (!config.empty())
        apply_config(app, config);
    // Either one on the command line takes the place of the other in the file.
    if (resolution_given && !cell_given)
        o.cell_size = 0;
    return cell_given ? resolution_given : o.cell_size > 0 && resolution.count() > 0;
}

void append_grid_settings(const SceneOptions& o, std::vector<Setting>& settings) {
    if (o.cell_size > 0)
        settings.push_back({"cell-size", toml_number(o.cell_size), true});
    else
        settings.push_back({"resolution", std::to_string(o.resolution), true});
    if (!o.bounds.empty())
        settings.push_back({"bounds", toml_string(o.bounds), true});
    settings.push_back({"margin", std::to_string(o.margin), true});
}

void append_light_settings(const SceneOptions& o, std::vector<Setting>& settings) {
    const LoadOptions standard;
    const auto add = [&](const char* name, const std::string& value, const std::string& usual) {
        settings.push_back({name, toml_string(value), value != usual});
    };
    add("scene-name", o.load.scene_name, standard.scene_name);
    add("animation", o.load.animation, standard.animation);
    add("time", o.load.time, standard.time);
    add("variant", o.load.variant, standard.variant);
    // Textures are halved to fit into memory, so that it may show in the result.
    add("max-memory", o.load.max_memory, standard.max_memory);
    settings.push_back({"strict", toml_flag(o.load.strict), false});
    settings.push_back({"allow-external", toml_flag(o.load.allow_external), false});
    settings.insert(settings.end(),
                    {
                        {"sun", toml_array(o.suns), true},
                        {"point", toml_array(o.points), true},
                        {"lights", toml_array(o.light_files), false},
                        {"sky", toml_string(o.sky), true},
                        {"sky-rotation", toml_number(o.sky_rotation), o.sky_rotation != 0},
                        {"no-scene-lights", toml_flag(o.no_scene_lights), true},
                        {"no-emitters", toml_flag(o.no_emitters), true},
                        {"max-albedo", toml_number(o.max_albedo), true},
                        {"metallic", toml_string(o.metallic), true},
                        {"backfaces", toml_string(o.backfaces), true},
                    });
}

GridSettings grid_settings(const SceneOptions& o) {
    return {o.resolution, o.cell_size, o.margin};
}

std::optional<Bounds> grid_bounds(const SceneOptions& o) {
    return o.bounds.empty() ? std::nullopt : std::optional(parse_bounds(o.bounds));
}

std::vector<Light> command_line_lights(const SceneOptions& o) {
    std::vector<Light> lights;
    for (const std::string& text : o.suns)
        lights.push_back(parse_sun(text));
    for (const std::string& text : o.points)
        lights.push_back(parse_point(text));
    for (const std::string& path : o.light_files) {
        std::vector<Light> more = load_lights(path);
        lights.insert(lights.end(), more.begin(), more.end());
    }
    if (!o.sky.empty() && !sky_picture(o.sky))
        parse_sky(o.sky);
    if (o.sky_rotation != 0 && (o.sky.empty() || !sky_picture(o.sky)))
        throw Error(ErrorKind::argument, "--sky-rotation turns the picture of --sky FILE");
    return lights;
}

Scene load_scene(const SceneOptions& o, const std::vector<Light>& lights) {
    LoadSettings settings = load_settings(o.load);
    settings.rules = {float(o.max_albedo), o.metallic == "black", o.backfaces == "cull"};
    Scene scene = load_gltf(o.scene, settings);
    if (o.no_scene_lights)
        scene.lights.clear();
    scene.lights.insert(scene.lights.end(), lights.begin(), lights.end());
    if (const auto picture = o.sky.empty() ? std::nullopt : sky_picture(o.sky))
        scene.sky = load_sky(picture->path, picture->scale, o.sky_rotation, settings.max_memory,
                             scene.warnings);
    else if (!o.sky.empty())
        scene.sky = parse_sky(o.sky);
    return scene;
}

bool mentions_images(const SceneOptions& o) {
    if (!o.sky.empty() && sky_picture(o.sky))
        return true;
    std::ifstream file(o.scene, std::ios::binary);
    std::string head(1 << 20, '\0');
    file.read(head.data(), std::streamsize(head.size()));
    head.resize(std::size_t(file.gcount()));
    return head.find("\"images\"") != std::string::npos;
}

void check_paths(const char* command, const SceneOptions& scene,
                 const std::vector<std::string>& outputs) {
    if (scene.scene.empty())
        throw Error(ErrorKind::argument, std::string("no scene: lpvbake ") + command
                                             + " SCENE -o OUTPUT (see lpvbake " + command
                                             + " --help)");
    std::vector<fs::path> names;
    for (const std::string& output : outputs) {
        if (!volume_format(output))
            throw Error(ErrorKind::argument,
                        output + ": the name of an output ends in " + format_list());
        const fs::path name = fs::weakly_canonical(fs::absolute(output));
        for (const fs::path& other : names)
            if (other == name)
                throw Error(ErrorKind::argument, output + ": given twice as an output");
        names.push_back(name);
        for (const std::string& lights : scene.light_files)
            if (const std::string sidecar = volume_format(output)->sidecar;
                !sidecar.empty()
                && fs::path(name).replace_extension(sidecar)
                       == fs::weakly_canonical(fs::absolute(lights)))
                throw Error(ErrorKind::argument,
                            output + ": its sidecar would replace the light file " + lights);
    }
}

void probe_outputs(const std::vector<std::string>& outputs) {
    for (const std::string& output : outputs) {
        const fs::path folder = fs::absolute(output).parent_path();
        std::error_code ignored;
        if (!fs::is_directory(folder, ignored))
            throw Error(ErrorKind::file, output + ": its folder does not exist");
        if (fs::is_directory(output, ignored))
            throw Error(ErrorKind::file, output + ": is a folder");
        // Without a name where the file system can, so that nothing is left whatever happens.
        int file = open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600);
        if (file < 0 && (errno == EOPNOTSUPP || errno == EISDIR || errno == EINVAL)) {
            std::string probe = (folder / ".lpvbake-probe-XXXXXX").string();
            file = mkstemp(probe.data());
            if (file >= 0)
                unlink(probe.c_str());
        }
        if (file < 0)
            throw Error(ErrorKind::file, output + ": cannot be written: " + std::strerror(errno));
        close(file);
    }
}

void probe_scene(const SceneOptions& o) {
    if (access(o.scene.c_str(), R_OK) != 0)
        throw Error(ErrorKind::file, o.scene + ": " + std::strerror(errno));
}

void fill_metadata(const SceneOptions& o, const Scene& scene, const std::vector<Setting>& settings,
                   Volume& volume) {
    std::string text;
    for (const Setting& setting : settings)
        if (setting.shapes_result && setting.given)
            text += (text.empty() ? "" : "; ") + (setting.name + (" = " + setting.toml));
    volume.metadata.try_emplace("tool", "lpvbake " LPVBAKE_VERSION);
    volume.metadata.try_emplace("scene", fs::path(o.scene).filename().string());
    volume.metadata.try_emplace("scene_hash", scene_hash(scene));
    volume.metadata.try_emplace("settings", text);
}

namespace {

/// How the outputs are stored: as the target has it, but for what is given.
Target storage_of(const OutputOptions& o) {
    Target storage = *target_named(o.target);
    if (!o.precision.empty())
        storage.precision = o.precision == "half" ? Precision::half : Precision::full;
    if (!o.sh_convention.empty())
        storage.encoding.convention = *convention_named(o.sh_convention);
    if (!o.axes.empty())
        storage.encoding.axes = *axes_named(o.axes);
    if (!o.exr_packing.empty())
        storage.pictures.packing = *packing_named(o.exr_packing);
    if (o.exr_columns > 0)
        storage.pictures.columns = o.exr_columns;
    return storage;
}

} // namespace

void append_output_settings(const OutputOptions& o, std::vector<Setting>& settings) {
    const Target storage = storage_of(o);
    const auto add = [&](const char* name, const std::string& given, const char* value) {
        settings.push_back({name, toml_string(value), false, !given.empty()});
    };
    add("target", o.target, storage.name);
    add("precision", o.precision, storage.precision == Precision::half ? "half" : "float");
    add("sh-convention", o.sh_convention, name_of(storage.encoding.convention));
    add("axes", o.axes, name_of(storage.encoding.axes));
    add("exr-packing", o.exr_packing, name_of(storage.pictures.packing));
    settings.push_back({"exr-columns", std::to_string(o.exr_columns), false});
}

std::string outputs_help() {
    std::string text = "Volume to write: ";
    for (const VolumeFormat* format : volume_formats())
        text += (format == volume_formats().front() ? "" : ", or ") + std::string(format->help);
    return text + "; may be repeated";
}

std::vector<Written> write_outputs(const OutputOptions& o, const std::vector<std::string>& paths,
                                   Volume& volume, TerminalProgress& progress) {
    const Target storage = storage_of(o);
    Volume whole = std::move(volume);
    volume.metadata = whole.metadata; // lattice and order are no more than copied
    std::vector<Written> written;
    progress.begin("write", paths.size());
    for (const std::string& path : paths) {
        progress.advance(written.size());
        const WriteReport report = &path == &paths.back()
                                       ? write_for(storage, path, std::move(whole))
                                       : write_for(storage, path, whole);
        for (const std::string& warning : report.warnings)
            progress.warn(warning);
        written.push_back({path, report.files});
    }
    return written;
}

Json Written::json() const {
    Json document{{"path", path}, {"bytes", 0}, {"files", Json::array()}};
    uint64_t bytes = 0;
    for (const WriteReport::File& file : files) {
        document["files"].push_back({{"path", file.path}, {"bytes", file.bytes}});
        bytes += file.bytes;
    }
    document["bytes"] = bytes;
    return document;
}

void Written::print() const {
    for (const WriteReport::File& file : files)
        std::printf("wrote         %s (%s)\n", file.path.c_str(), bytes_text(file.bytes).c_str());
}

std::unique_ptr<tbb::global_control> limit_threads(int threads) {
    if (threads == 0)
        return nullptr;
    setenv("LP_NUM_THREADS", std::to_string(threads).c_str(), 1);
    setenv("OPENIMAGEIO_THREADS", std::to_string(threads).c_str(), 1);
    return std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                 std::size_t(threads));
}

} // namespace lpvbake
