#include "scene_options.h"

#include "file_error.h"
#include "io/atomic_file.h"
#include "io/bricks.h"
#include "io/glb.h"
#include "io/levels.h"
#include "io/points.h"
#include "io/vdb.h"
#include "lpvbake/error.h"
#include "lpvbake/scene.h"
#include "machine.h"
#include "options/lights.h"
#include "scene/gltf/near.h"
#include "scene/scene_hash.h"
#include "text.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <future>
#include <iterator>
#include <system_error>
#include <thread>

#include <tbb/global_control.h>

#include <fcntl.h>
#include <unistd.h>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

/// Of --default-light.
const Sky default_sky{glm::vec3(1000), nullptr};
constexpr const char* default_light = "a white sky of 1000 nits";

double parse_time(const std::string& text) {
    const std::optional<double> time = options::parse_number(text);
    if (!time)
        options::refuse(text, "is not a number of seconds");
    return *time;
}

void add_role_options(options::Options& options, LoadSettings& load) {
    const auto add = [&](const char* name, std::optional<Role> role, const char* help) {
        options
            .values(
                name, load.roles, "PATTERN",
                [role](const std::string& pattern) {
                    if (pattern.empty())
                        options::refuse(pattern, "is empty");
                    return RoleRule{pattern, role};
                },
                help)
            .record(options::Recorded::if_changed);
    };
    add("--exclude", std::nullopt,
        "Surfaces that are not loaded: nodes with all below them and their lights, meshes and "
        "materials whose names fit a pattern, such as 'Door*'; of one kind alone node:GLOB, "
        "mesh:GLOB, material:GLOB; or by extras: extras:KEY, extras:KEY=GLOB; may be repeated, as "
        "the three below, of which the last that fits counts");
    add("--receive-only", Role::receive_only,
        "Surfaces that light passes, and none comes from; volumes are fitted to them and measured "
        "on them");
    add("--cast-only", Role::cast_only,
        "Surfaces that are black, and that no grid is fitted to nor anything measured on");
    add("--lights-only", Role::lights_only,
        "Surfaces whose emission lights, but that light passes; no grid is fitted to them");
}

} // namespace

// COLOUR,NITS has neither a name with letters nor a dot or slash in a name.
SkyOption parse_sky_option(const std::string& text) {
    SkyPicture picture{text};
    const std::size_t comma = text.rfind(',');
    if (const auto scale = comma == std::string::npos
                               ? std::nullopt
                               : options::parse_number(text.substr(comma + 1)))
        picture = {text.substr(0, comma), *scale};
    const bool name = picture.path.find_first_of("./") != std::string::npos
                      && picture.path.find_first_not_of("0123456789.:,+-eE ") != std::string::npos;
    if (!name || text.front() == '#')
        return options::parse_sky(text);
    if (picture.scale < 0)
        options::refuse(text, "has a negative SCALE");
    return picture;
}

void add_load_options(options::Options& options, LoadSettings& load) {
    options.group("Scene");
    options
        .text("--scene,--scene-name", load.scene, "NAME|INDEX",
              "Scene of the file; default: the one that the file names")
        .record(options::Recorded::if_changed);
    options
        .text("--animation", load.animation, "NAME|INDEX",
              "Pose the scene by an animation; default: none, the first where --time is given")
        .record(options::Recorded::if_changed);
    options.value("--time", load.time, "SECONDS", parse_time, "Time of the animation; default: 0")
        .record(options::Recorded::if_changed);
    options.text("--variant", load.variant, "NAME|INDEX", "Material variant of the file")
        .record(options::Recorded::if_changed);
    // Textures are halved to fit into memory, so that it may show in the result.
    options
        .value("--max-memory", load.max_memory, "SIZE", options::parse_bytes,
               "Memory that loading the scene may take", "4G")
        .record(options::Recorded::if_changed);
    add_role_options(options, load);
    options.flag("--strict", load.strict, "Take warnings of the scene for errors");
    options.flag("--allow-external", load.allow_external,
                 "Let the scene read files outside its folder");
}

BoxOption parse_box(const std::string& text) {
    if (std::ranges::count(text, ',') == 5
        || text.find_first_not_of("0123456789.,+-eE ") == std::string::npos)
        return options::parse_bounds(text);
    return text;
}

void add_bounds_options(options::Options& options, SceneOptions& o) {
    options
        .value("--bounds", o.bounds, "X0,Y0,Z0,X1,Y1,Z1|NODES", parse_box,
               "Box to fit the grid to, metres; or that of all nodes whose names fit a pattern, "
               "such as 'Hall*'; default: the scene's")
        .record(options::Recorded::if_changed);
    options
        .number("--margin", o.margin, 0, 1024,
                "Whole cells around the box on each side; default: 1, with --bounds 0")
        .implies([&o] { return options::number_text(o.grid_settings().margin); })
        .record();
}

void add_grid_options(options::Options& options, SceneOptions& o) {
    options.group("Grid");
    options
        .number("--resolution", o.grid.resolution, 3, 65536,
                "Cells along the longest axis, margins included; at least 3")
        .record();
    options::Option& cell = options.number("--cell-size", o.grid.cell, 1e-9, 1e9,
                                           "Edge of a cell, metres; replaces --resolution");
    cell.usual.clear();
    cell.read = [read = cell.read](const std::string& text) {
        if (!options::parse_number(text))
            options::refuse(text, "is no number of metres, such as 0.25");
        return read(text);
    };
    cell.exclude({"resolution"}).record(options::Recorded::if_changed);
    add_bounds_options(options, o);
}

void add_scene_option(options::Options& options, SceneOptions& o) {
    options.text(
        "scene", o.scene, "FILE",
        "glTF 2.0 file, .gltf or .glb; -: from standard input, with all that it refers to in it");
}

void add_light_options(options::Options& options, SceneOptions& o) {
    add_load_options(options, o.load);
    options.group("Light");
    options
        .values("--sun", o.suns, "AZIMUTH,ELEVATION,LUX[,COLOUR]", options::parse_sun,
                "Directional light: where it stands, degrees from +Z towards +X and above the "
                "horizon; COLOUR #rrggbb or R:G:B linear; may be repeated")
        .record();
    options
        .values("--point", o.points, "X,Y,Z,CANDELA[,COLOUR]", options::parse_point,
                "Point light, metres; may be repeated")
        .record();
    options
        .texts("--lights", o.light_files, "FILE",
               "JSON file of lights in the terms of KHR_lights_punctual; may be repeated")
        .record(options::Recorded::if_changed);
    options
        .value("--sky", o.sky, "COLOUR,NITS|FILE[,SCALE]", parse_sky_option,
               "Light from beyond the scene: the same from everywhere, COLOUR as for --sun; or an "
               "equirectangular picture (HDR, EXR, ...), whose values times SCALE (1) are nits and "
               "whose middle stands at +X")
        .record();
    options
        .number("--sky-rotation", o.sky_rotation, -360, 360,
                "Degrees by which the picture is turned around +Y, from +Z towards +X")
        .record(options::Recorded::if_changed);
    options.flag("--no-scene-lights", o.no_scene_lights, "Leave out the lights of the file")
        .record();
    options
        .values("--light-scale", o.light_scales, "NAMES=X", parse_light_scale,
                "Multiply lights and emissive materials whose names fit a pattern, such as "
                "'Lamp*=0.5'; may be repeated")
        .record(options::Recorded::if_changed);
    options
        .values(
            "--no-light", o.light_scales, "NAMES",
            [](const std::string& names) { return LightScale{names}; },
            "Leave them out; may be repeated")
        .record(options::Recorded::if_changed);
    options
        .flag("--default-light", o.default_light,
              std::string("Where nothing else gives light: ") + default_light)
        .record(options::Recorded::if_changed);
    options.flag("--no-emitters", o.no_emitters, "Emissive surfaces give no light").record();
    options
        .number("--max-albedo", o.load.rules.max_albedo, 0, 1,
                "Reflectance is clamped to this, 0 to 1")
        .record();
    options
        .choice("--metallic", o.load.rules.metallic_black,
                options::Choices<bool>{{"black", true}, {"reflect", false}},
                "Metal reflects its base colour, or (strict PBR) nothing")
        .record();
    options
        .choice("--backfaces", o.load.rules.cull_backfaces,
                options::Choices<bool>{{"block", false}, {"cull", true}},
                "Light stops at the back of single-sided surfaces, or passes")
        .record();
}

void add_static_option(options::Options& options, SceneOptions& o) {
    options
        .texts("--static", o.statics, "NAMES",
               "Punctual lights whose names fit a pattern, such as 'Lamp*', are static: the field "
               "holds their direct light, too, and programs do not add it; may be repeated")
        .record(options::Recorded::if_changed);
}

GivenLights command_line_lights(const SceneOptions& o) {
    GivenLights given{o.suns, {}};
    std::ranges::copy(o.points, std::back_inserter(given.lights));
    for (const std::string& path : o.light_files)
        std::ranges::copy(load_lights(path, given.warnings), std::back_inserter(given.lights));
    if (o.load.strict && !given.warnings.empty())
        throw Error(ErrorKind::invalid, given.warnings.front() + " (--strict)");
    if (o.sky_rotation != 0 && !o.sky_picture())
        throw Error(ErrorKind::argument, "--sky-rotation turns the picture of --sky FILE");
    return given;
}

volume::GridSettings SceneOptions::grid_settings() const {
    volume::GridSettings settings = grid;
    settings.margin = margin.value_or(volume::usual_margin(bounds.index() != 0));
    return settings;
}

std::optional<Bounds> box_in(const BoxOption& box, const char* option, const Scene& scene) {
    if (const auto* names = std::get_if<std::string>(&box))
        return box_of_nodes(*names, option, scene);
    const auto* given = std::get_if<Bounds>(&box);
    return given ? std::optional(*given) : std::nullopt;
}

std::optional<Bounds> SceneOptions::box_in(const Scene& in) const {
    return cmd::box_in(bounds, "--bounds", in);
}

Scene load_scene(const SceneOptions& o, const GivenLights& given,
                 std::span<const scene::Surroundings> boxes) {
    Scene scene = boxes.empty() ? load_gltf(o.scene, o.load)
                                : scene::gltf::load_near(o.scene, o.load,
                                                         {{boxes.begin(), boxes.end()},
                                                          scene::directions_of(given.lights)});
    if (o.no_scene_lights)
        scene.lights.clear();
    std::ranges::copy(given.lights, std::back_inserter(scene.lights));
    std::ranges::copy(given.warnings, std::back_inserter(scene.warnings));
    if (const SkyPicture* picture = o.sky_picture())
        scene.sky = load_sky(picture->path, scene.warnings, picture->scale, o.sky_rotation,
                             o.load.max_memory);
    else if (const Sky* sky = std::get_if<Sky>(&o.sky))
        scene.sky = *sky;
    scale_lights(o.light_scales, scene);
    make_static(o.statics, scene);
    if (o.default_light && scene.lights.empty() && !scene::has_sky(scene)
        && (o.no_emitters || !scene::has_emitters(scene))) {
        scene.sky = default_sky;
        scene.warnings.push_back(scene.path + ": gives no light: it is lit by " + default_light);
    }
    return scene;
}

bool mentions_images(const SceneOptions& o) {
    if (o.sky_picture())
        return true;
    if (o.scene == standard_input)
        return false; // to be read once
    std::ifstream file(o.scene, std::ios::binary);
    std::string head(1 << 20, '\0');
    file.read(head.data(), std::streamsize(head.size()));
    head.resize(std::size_t(file.gcount()));
    return head.find("\"images\"") != std::string::npos;
}

io::Target OutputOptions::storage() const {
    io::Target storage = io::with_precision(*target, precision.value_or(target->precision));
    storage.encoding.convention = convention.value_or(storage.encoding.convention);
    storage.encoding.axes = axes.value_or(storage.encoding.axes);
    storage.pictures.packing = packing.value_or(storage.pictures.packing);
    storage.dering = dering.value_or(storage.dering);
    if (l1_scale != 1 && target != io::target_named("vrc"))
        throw Error(ErrorKind::argument, "--l1-scale is for --target vrc");
    storage.l1_scale = l1_scale;
    for (const std::string& path : paths)
        io::check_precision(path, storage.precision, storage.pictures.packing);
    if (columns > 0)
        storage.pictures.columns = columns;
    return storage;
}

void add_evaluation_option(options::Options& options, FitOptions& o) {
    options::Choices<readers::Evaluation> choices;
    for (const char* name : {"linear", "geomerics", "zh3"})
        choices.emplace_back(name, *readers::evaluation_named(name));
    options
        .choice("--evaluation", o.evaluation, choices,
                "generic, unity and vrc: what shaders make of bands 0 and 1, which --fit surfaces "
                "goes by: their sum, or what lpv_irradiance_l1_nonlinear and lpv_irradiance_l1_zh3 "
                "of examples/shaders do; these have no higher bands")
        .record(options::Recorded::if_changed);
}

bool fits(const OutputOptions& o, const FitOptions& fit) {
    return fit.fit.value_or(o.target->dilate > 0 && fit.dilate == 0);
}

readers::Reader reader_of(const io::Target& target, const FitOptions& fit) {
    const readers::Reader& reader =
        *readers::reader_named(&target == io::target_named("generic") ? "lpvbake" : target.name);
    return fit.evaluation == readers::Evaluation::linear
               ? reader
               : readers::with_evaluation(reader, fit.evaluation);
}

void check_fit(const OutputOptions& o, const FitOptions& fit, int order) {
    if (fits(o, fit) && fit.dilate > 0)
        throw Error(ErrorKind::argument,
                    "--fit surfaces and --dilate exclude each other: fitted cells "
                    "are filled already");
    if (fit.evaluation == readers::Evaluation::linear)
        return;
    const std::string option = std::string("--evaluation ") + readers::name_of(fit.evaluation);
    if (!reader_of(*o.target, {}).gives_coefficients)
        throw Error(ErrorKind::argument, option + " is for shaders of generic, unity and vrc; "
                                             + o.target->name + " has a formula of its own");
    if (!fits(o, fit))
        throw Error(ErrorKind::argument, option + " is what a fit goes by: --fit surfaces");
    if (order > 1)
        throw Error(ErrorKind::argument,
                    option + " is of order 1, not of --sh-order " + std::to_string(order));
}

void add_output_options(options::Options& options, OutputOptions& o) {
    options.group("Output");
    options::Choices<const io::Target*> targets;
    for (const io::Target& target : io::all_targets())
        targets.emplace_back(target.name, &target);
    options.choice("--target", o.target, targets,
                   "Program that reads the files: sets the options below that are not given, see "
                   "lpvbake convert --help, and writes what it needs beside them");
    options::Choices<Precision> precisions;
    for (const Precision precision :
         {Precision::full, Precision::half, Precision::rgb9e5, Precision::unorm8, Precision::bc6h})
        precisions.emplace_back(io::name_of(precision), precision);
    options
        .choice(
            "--precision", o.precision, precisions,
            "Type of the stored numbers; rgb9e5, of .ktx2, .dds and .glb packed by band or "
            "cube: 32 bits for the colours of the mean or of a cube, half for all else; unorm8, "
            "of .ktx2 and .dds: the mean in 32 bits, all other light over it in 8 bits a number "
            "(order 2 in 28 bytes a cell), or bc6h: in blocks, a byte for three (order 2 in 10 "
            "bytes); what that adds to the error is told")
        .implies([&o] { return io::name_of(o.storage().precision); });
    options
        .choice("--sh-convention", o.convention,
                options::choices_named<volume::ShConvention>(volume::convention_names()),
                "Signs and factors of the stored coefficients")
        .implies([&o] { return volume::name_of(o.storage().encoding.convention); });
    options
        .choice("--axes", o.axes, options::choices_named<volume::Axes>(volume::axes_names()),
                "Axes of cells, directions and positions")
        .implies([&o] { return volume::name_of(o.storage().encoding.axes); });
    options
        .choice("--packing", o.packing, options::choices_named<io::Packing>(io::packing_names()),
                "One RGB file per coefficient, one RGBA file per colour channel, as VRC Light "
                "Volumes, Bevy and three.js have it, or, with --precision unorm8, by ratio, with "
                "bc6h by block")
        .implies([&o] { return io::name_of(o.storage().pictures.packing); });
    options
        .choice("--dering", o.dering, options::Choices<bool>{{"on", true}, {"off", false}},
                "Change bands 1 and 2 as little as can be so that no cell has negative irradiance; "
                "default: on for unity, unreal, godot, threejs and vrc, whose shaders show it")
        .implies([&o] { return o.storage().dering ? "on" : "off"; });
    options.number("--l1-scale", o.l1_scale, io::least_l1_scale, io::most_l1_scale,
                   "vrc: multiplies band 1 of what is written; 1.65 matches what VRC Light Volumes "
                   "makes of every bake that it packs itself, 1 shows the light");
    options.number("--exr-columns", o.columns, 0, 16384,
                   "Slices in a row of an EXR's picture; 0: nearly square");
}

void add_format_option(options::Options& options, Format& format) {
    options.choice("--format", format,
                   options::Choices<Format>{{"text", Format::text}, {"json", Format::json}},
                   "Form of the result, and of an error");
    options
        .flag("-q,--quiet", verbosity.quiet,
              "Nothing on standard error but errors: no progress, no warnings")
        .exclude({"verbose"});
    options.flag("-v,--verbose", verbosity.verbose,
                 "Tell on standard error what is read and written and which settings hold; "
                 "--progress auto is plain then");
}

void add_device_option(options::Options& options, RunOptions& o) {
    options.group("Run");
    options.text("--device", o.device, "NAME",
                 "Index, UUID or part of the name; default: the first");
}

void add_isa_option(options::Options& options, RunOptions& o) {
    options::Choices<visibility::Isa> choices;
    for (const visibility::Isa isa : visibility::isas)
        choices.emplace_back(visibility::name_of(isa), isa);
    options
        .choice("--isa", o.isa, choices,
                "Instruction set that rays are traced with, which rounds them: the same bytes on "
                "several machines take one that all have; auto: avx2, on older processors their "
                "best")
        .record(options::Recorded::if_changed);
}

void add_dry_run_option(options::Options& options, RunOptions& o, const char* help) {
    options.flag("--dry-run", o.dry_run, help).keep_out_of_files();
}

void add_run_options(options::Options& options, RunOptions& o) {
    options.group("Run");
    options.number("--threads", o.threads, 0, 1024,
                   "CPU threads; 0: as many as the process may use, by affinity and control group");
    add_format_option(options, o.format);
    options.choice(
        "--progress", o.progress,
        options::Choices<ProgressStyle>{{"auto", ProgressStyle::automatic},
                                        {"bar", ProgressStyle::bar},
                                        {"plain", ProgressStyle::plain},
                                        {"percent", ProgressStyle::percent},
                                        {"openjd", ProgressStyle::openjd},
                                        {"none", ProgressStyle::none}},
        "On standard error; plain: lines of scene, stage, per cent and time; percent: of "
        "the whole, at most a line a second; openjd: the same as Open Job Description "
        "has it; auto: a bar on a terminal");
    options
        .texts("--config", o.configs, "FILE",
               "TOML file of options: keys before the first header are for all commands, those in "
               "[bake] for bake, and so on; the command line comes first, then the last file; may "
               "be repeated")
        .keep_out_of_files();
    options
        .flag("--print-config", o.print_config,
              "Print every option but scene and outputs as --config reads it")
        .keep_out_of_files();
}

std::vector<std::string> inputs_of(const SceneOptions& scene, const RunOptions& run) {
    std::vector<std::string> inputs = scene.light_files;
    inputs.push_back(scene.scene);
    inputs.insert(inputs.end(), run.configs.begin(), run.configs.end());
    if (const SkyPicture* picture = scene.sky_picture())
        inputs.push_back(picture->path);
    return inputs;
}

namespace {

/// Absolute, without links unless one leads to no path, as /dev/stdin does of a pipe.
fs::path place_of(const std::string& path) {
    const fs::path whole = fs::absolute(path);
    std::error_code failed;
    fs::path place = fs::weakly_canonical(whole, failed);
    return failed ? whole : place;
}

/// Whether the file is one of those that the volume of this name has.
bool has_file(const std::string& volume, const std::string& file) {
    const fs::path own = place_of(volume), other = place_of(file);
    if (own == other)
        return true;
    const io::VolumeFormat* format = io::readable_format(volume);
    if (!format || !format->files || own.parent_path() != other.parent_path())
        return false;
    const std::string sidecar = format->sidecar, name = own.filename().string();
    const std::string stem = !sidecar.empty() && name.ends_with(sidecar)
                                 ? name.substr(0, name.size() - sidecar.size())
                                 : own.stem().string();
    return (!sidecar.empty() && other.filename() == stem + sidecar)
           || (other.filename().string().starts_with(stem + "_")
               && options::has_extension(file, format->extension));
}

bool is_same(const std::string& a, const std::string& b) {
    return place_of(a) == place_of(b);
}

} // namespace

void check_files(const std::vector<std::string>& inputs, const std::vector<std::string>& volumes,
                 const std::vector<std::string>& outputs, bool pictures) {
    for (const std::string& output : outputs) {
        const auto replace = [&](const std::string& input) {
            throw Error(ErrorKind::argument, output + ": would replace the input " + input);
        };
        for (const std::string& input : inputs)
            if (!input.empty() && (pictures ? is_same(output, input) : has_file(output, input)))
                replace(input);
        for (const std::string& input : volumes)
            if (has_file(input, output) || (!pictures && has_file(output, input)))
                replace(input);
        for (const std::string& other : outputs)
            if (&other < &output && is_same(other, output))
                throw Error(ErrorKind::argument, output + ": given twice as an output");
    }
}

void check_paths(const char* command, const SceneOptions& scene, const RunOptions& run,
                 const std::vector<std::string>& outputs, const std::string& points, bool parts) {
    if (scene.scene.empty())
        throw Error(ErrorKind::argument, std::string("no scene: lpvbake ") + command
                                             + " SCENE -o OUTPUT (see lpvbake " + command
                                             + " --help)");
    if (const io::VolumeFormat* volume = io::volume_format(scene.scene);
        volume && volume != &io::glb_format)
        throw Error(ErrorKind::argument, scene.scene + ": is a volume; lpvbake " + command
                                             + " takes a scene, a .gltf or .glb");
    const bool at_points = !points.empty();
    for (const std::string& output : outputs)
        if (const io::VolumeFormat* kind = io::volume_format(output); parts) {
            if (kind && kind != &io::vdb_format)
                throw Error(ErrorKind::argument,
                            output
                                + ": a part is an OpenVDB file, whatever its name, but not one "
                                  "that ends in "
                                + kind->extension + "; lpvbake merge writes those");
        } else if (at_points ? !io::is_lit_point_format(output) : !kind)
            throw Error(ErrorKind::argument,
                        output + ": the name of an output "
                            + (at_points ? "of --at ends in " + io::lit_point_format_list()
                                         : "ends in " + io::format_list()));
    std::vector<std::string> inputs = inputs_of(scene, run);
    inputs.push_back(points);
    check_files(inputs, {}, outputs, at_points);
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
            throw Error(kind_of_file_error(errno),
                        output + ": cannot be written: " + std::strerror(errno));
        close(file);
    }
}

void probe_scene(const SceneOptions& o) {
    if (o.scene == standard_input)
        return;
    if (access(o.scene.c_str(), R_OK) != 0)
        throw Error(kind_of_file_error(errno), o.scene + ": " + std::strerror(errno));
    io::refuse_pipes(o.scene, o.scene);
}

void fill_metadata(const SceneOptions& o, const Scene& scene, const std::string& settings,
                   Volume& volume) {
    volume.metadata.try_emplace("tool", "lpvbake " LPVBAKE_VERSION);
    volume.metadata.try_emplace("scene", fs::path(o.scene).filename().string());
    volume.metadata.try_emplace("scene_hash", scene::scene_hash(scene));
    volume.metadata.try_emplace("settings", settings);
    if (o.default_light && o.sky.index() == 0 && scene::has_sky(scene))
        volume.metadata.try_emplace("default_light", default_light);
}

std::string outputs_help() {
    std::string text = "Volume to write: ";
    for (const io::VolumeFormat* format : io::volume_formats())
        text += (format == io::volume_formats().front() ? "" : ", or ") + std::string(format->help);
    return text + "; may be repeated";
}

std::optional<PackedScene> packed_for(const std::vector<std::string>& outputs,
                                      const std::string& scene, const LoadSettings& load) {
    const auto is_glb = [](const std::string& output) {
        return io::volume_format(output) == &io::glb_format;
    };
    if (std::ranges::none_of(outputs, is_glb))
        return {};
    PackedScene packed = pack_gltf(scene, load);
    io::check_has_no_volume(packed, scene);
    return packed;
}

std::vector<Written> write_outputs(const OutputOptions& o, const std::vector<std::string>& paths,
                                   Volume& volume, TerminalProgress& progress,
                                   const std::optional<PackedScene>& scene) {
    io::Target storage = o.storage();
    storage.pictures.scene = scene ? &*scene : nullptr;
    volume.metadata.erase("target");
    if (o.target != io::target_named("generic"))
        volume.metadata["target"] = o.target->name;
    Volume whole;
    whole.grid = volume.grid;
    whole.sh_order = volume.sh_order;
    whole.metadata = volume.metadata;
    std::swap(whole, volume); // what stays has no grids
    std::vector<Written> written;
    progress.begin("write", paths.size());
    for (const std::string& path : paths) {
        progress.advance(written.size());
        const bool last = &path == &paths.back();
        const WriteReport report = // NOLINTNEXTLINE(bugprone-use-after-move): by the last one alone
            last ? io::write_for(storage, path, std::move(whole))
                 : io::write_for(storage, path, whole);
        for (const std::string& warning : report.warnings)
            progress.warn(warning);
        for (const WriteReport::File& file : report.files)
            tell("wrote " + file.path);
        written.push_back({path, report.files, report.packing});
    }
    return written;
}

void check_level_outputs(const std::vector<std::string>& paths,
                         const std::vector<std::string>& inputs,
                         const std::vector<volume::Place>& places) {
    const auto manifest_of = [&](const std::string& path) {
        return io::manifest_path(path, !places.empty());
    };
    for (const std::string& path : paths) {
        if (io::volume_format(path) == &io::glb_format)
            throw Error(ErrorKind::argument, path
                                                 + ": a .glb has room for one light volume, not "
                                                   "for several; write another kind of file");
        const auto writes = [&](const std::string& file) {
            const std::size_t count = places.empty() ? volume::most_levels : places.size();
            for (std::size_t i = places.empty() ? 1 : 0; i < count; ++i)
                if (has_file(io::member_path(path, places, i), file))
                    return true;
            return is_same(manifest_of(path), file);
        };
        for (const std::string& input : inputs)
            if (!input.empty() && writes(input))
                throw Error(ErrorKind::argument, path + ": would replace the input " + input);
        for (const std::string& other : paths)
            if (&other != &path && is_same(manifest_of(other), manifest_of(path)))
                throw Error(ErrorKind::argument,
                            path + " and " + other + " would share the manifest "
                                + manifest_of(path) + "; give them other names");
            else if (&other != &path
                     && (writes(other) || writes(manifest_of(other))
                         || has_file(path, manifest_of(other))))
                throw Error(ErrorKind::argument, path + " and " + other + " would share files of "
                                                     + (places.empty() ? "levels" : "volumes")
                                                     + "; give them other names");
    }
}

void check_brick_outputs(const OutputOptions& o) {
    for (const std::string& path : o.paths)
        if (!io::takes_bricks(path))
            throw Error(ErrorKind::argument,
                        path + ": bricks are written as " + io::brick_format_list());
    const io::Target storage = o.storage();
    const volume::Encoding usual;
    if (o.target != io::target_named("generic") || o.packing
        || storage.encoding.convention != usual.convention || storage.encoding.axes != usual.axes
        || (storage.precision != Precision::full && storage.precision != Precision::half))
        throw Error(ErrorKind::argument,
                    "bricks are written as they are, in float or half: --target, --packing, "
                    "--sh-convention and --axes are of one volume; first convert --flatten");
}

namespace {

std::vector<Written> write_bricks(const OutputOptions& o, const std::vector<std::string>& paths,
                                  const volume::VolumeSet& set, TerminalProgress& progress) {
    check_brick_outputs(o);
    std::vector<Written> written;
    progress.begin("write", paths.size());
    for (const std::string& path : paths) {
        progress.advance(written.size());
        WriteReport report = io::write_bricks(path, set, o.storage().precision);
        for (const std::string& warning : report.warnings)
            progress.warn(warning);
        for (const WriteReport::File& file : report.files)
            tell("wrote " + file.path);
        written.push_back({path, std::move(report.files)});
    }
    return written;
}

} // namespace

std::vector<Written> write_levels(const OutputOptions& o, const std::vector<std::string>& paths,
                                  volume::VolumeSet& set, TerminalProgress& progress,
                                  const std::optional<PackedScene>& scene) {
    if (set.bricks)
        return write_bricks(o, paths, set, progress);
    const bool placed = !set.places.empty();
    if (set.levels.size() == 1 && !placed)
        return write_outputs(o, paths, set.levels.front(), progress, scene);
    check_level_outputs(paths, {}, set.places);
    std::vector<Written> written;
    std::vector<Grid> grids;
    for (const Volume& level : set.levels)
        grids.push_back(level.grid);
    io::check_places(*o.target, set.places, grids);
    for (const std::string& path : paths) {
        Written& own = written.emplace_back(Written{path, {}});
        const bool last = &path == &paths.back();
        io::PublishTogether together; // the old files or the new ones, the manifest last
        for (std::size_t i = 0; i < set.levels.size(); ++i) {
            Volume& level = set.levels[i];
            level.metadata[placed ? "volume" : "level"] =
                placed ? set.places[i].name : std::to_string(i);
            level.metadata[placed ? "volume_set" : "level_set"] =
                fs::path(io::manifest_path(path, placed)).filename().string();
            std::optional<Volume> copy;
            if (!last)
                copy = level;
            std::vector<Written> one = write_outputs(o, {io::member_path(path, set.places, i)},
                                                     last ? level : *copy, progress);
            std::ranges::move(one.front().files, std::back_inserter(own.files));
            if (i == 0)
                own.packing = one.front().packing;
        }
        own.files.push_back(
            io::write_manifest(path, grids, o.storage().encoding.axes, set.blend, set.places));
        together.publish();
        tell("wrote " + own.files.back().path);
    }
    return written;
}

report::Json outputs_json(const std::vector<Written>& outputs) {
    report::Json list = report::Json::array();
    for (const Written& output : outputs) {
        report::Json files = report::Json::array();
        uint64_t bytes = 0;
        for (const WriteReport::File& file : output.files) {
            files.push_back({{"path", file.path}, {"bytes", file.bytes}});
            bytes += file.bytes;
        }
        list.push_back({{"path", output.path}, {"bytes", bytes}, {"files", files}});
        if (output.packing)
            list.back()["packing_error"] = {{"cells", output.packing->cells},
                                            {"filtered", output.packing->filtered}};
    }
    return list;
}

report::Json planned_json(const std::vector<Written>& outputs) {
    report::Json list = outputs_json(outputs);
    for (report::Json& output : list) {
        output.erase("bytes");
        for (report::Json& file : output["files"])
            file.erase("bytes");
    }
    return list;
}

void print_outputs(const std::vector<Written>& outputs) {
    for (const Written& output : outputs) {
        if (const auto& added = output.packing)
            std::printf("packed        %s: adds %s %% to the error at cells, %s %% between "
                        "them by a texture unit's filter\n",
                        output.path.c_str(), two_digits(100 * added->cells).c_str(),
                        two_digits(100 * added->filtered).c_str());
        for (const WriteReport::File& file : output.files)
            std::printf("wrote         %s (%s)\n", file.path.c_str(),
                        bytes_text(file.bytes).c_str());
    }
}

namespace {

/// Whether so many threads may be there at once.
bool can_start(int count) {
    std::promise<void> all;
    const std::shared_future<void> release = all.get_future().share();
    std::vector<std::jthread> threads;
    bool can = true;
    try {
        for (int i = 0; i < count; ++i)
            threads.emplace_back([release] { release.wait(); });
    } catch (const std::system_error&) {
        can = false;
    }
    all.set_value();
    return can;
}

} // namespace

void limit_threads(int threads) {
    // TBB's, Mesa's on the CPU, and the few that those start beside. Mesa's waits for ever for one
    // that it could not start.
    const int allowed = machine_threads();
    const int wanted = threads > 0 ? threads : allowed;
    if (wanted > 1 && !can_start(2 * wanted + 6)) {
        print_warning("too few threads can be started (ulimit -u, the container's limit of PIDs): "
                      "computing on one");
        threads = 1;
    }
    if (threads == 0 && allowed < sysconf(_SC_NPROCESSORS_ONLN))
        threads = allowed;
    if (threads == 0)
        return;
    // Mesa's driver for the CPU draws on the thread that asks where it is given none of its own.
    setenv("LP_NUM_THREADS", std::to_string(threads == 1 ? 0 : threads).c_str(), 1);
    setenv("OPENIMAGEIO_THREADS", std::to_string(threads).c_str(), 1);
    // Kept to the end: TBB starts threads once it may.
    [[maybe_unused]] static const auto* const limit =
        new tbb::global_control(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
}

Run::Run(const SceneOptions& scene, const RunOptions& run, const std::vector<std::string>& outputs)
    : progress(run.progress, scene.scene),
      scene_(scene),
      lights_(command_line_lights(scene)) {
    probe_outputs(outputs);
    probe_scene(scene);
    limit_threads(run.threads);
    if (mentions_images(scene))
        preload_ = image::preload_image_module();
    watch_signals();
}

Scene Run::load(std::span<const scene::Surroundings> boxes) {
    progress.begin("load", 0);
    tell("reads " + scene_.scene);
    Scene scene = load_scene(scene_, lights_, boxes);
    warn(scene.warnings);
    return scene;
}

void Run::end_stage(const char* name, const std::string& detail) {
    stages.push_back({name, seconds_since(lap_), detail});
    begin_stage();
}

void Run::warn(const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings)
        progress.warn(warning);
}

} // namespace lpvbake::cmd
