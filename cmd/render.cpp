// lpvbake render: pictures of a scene that a volume lights.

#include "render/render.h"

#include "commands.h"
#include "error.h"
#include "io/atomic_file.h"
#include "io/slice.h"
#include "io/target.h"
#include "render/display.h"
#include "render/flip.h"
#include "render/view.h"
#include "result.h"
#include "scene_hash.h"
#include "scene_options.h"
#include "text.h"
#include "volume/dilate.h"
#include "volume/light_content.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

const char summary[] = "Draws a scene lit by a volume, as an engine shows it.";

const char manual[] =
    R"(What is seen is drawn with Vulkan; backs of single-sided materials are not drawn. Each point
reflects the direct light of punctual lights (the scene's, --sun, --point, --lights: give those of the
bake), with exact shadows, and the light that VOLUME holds; emissive surfaces glow, and where nothing
is, the sky is seen. Normals are the file's where it has some.

--camera takes
  NAME or INDEX                  a camera of the file (lpvbake info SCENE lists them)
  X,Y,Z:TX,TY,TZ[:FOV]           from X,Y,Z towards TX,TY,TZ, metres; FOV degrees from top to bottom
  orbit[:AZIMUTH,ELEVATION[,DISTANCE]]  from outside, the part of the scene that the volume covers
                                 in the picture; degrees from +Z towards +X and above the horizon,
                                 metres from its middle
  inside                         across the middle of a room, from before its farthest wall
and is the file's first camera; where it has none, inside if the middle is walled in on all sides,
else orbit.

--sampler facing weights the eight cells around a point by how far they lie before its surface, valid
ones alone that no wall hides; trilinear does not, and shows light from inside and behind walls. The
name of a target shows what its program makes of the file that the target writes, by its own lookup,
offset and formula; geomerics and zh3 are formulas that shaders may use for bands 0 and 1.

--show
  final       direct + indirect, nits        irradiance  of the volume's light, lux
  direct      of lights, glow and sky, nits  occlusion   of the geometry volume (lpv), 0 to 1
  indirect    what reflects the volume, nits validity    share of valid cells around a point; red:
  albedo      reflectance, 0 to 1                        none that could be read
  normal      unit vectors, world axes       cells       mean luminance of single cells, nits

An .exr holds these values as linear RGB, float. A .png shows them: light divided by 1.2 * 2^EV
(--exposure EV, that of a camera at ISO 100; auto takes the median as 18 % grey, and is printed), tone-
mapped by Khronos PBR Neutral (NeutralToneMapping of three.js, whose toneMappingExposure is
1 / (1.2 * 2^EV)) or clipped (--tone-map none), and sRGB-encoded; irradiance / pi; normals (n + 1) / 2.

--reference N traces N paths a pixel of the same view, with the light that the volume should hold
(its bounces), and tells how far the picture is from it: RMSE over pixels and RGB, of linear values,
and FLIP (Andersson et al. 2020), 0 to 1, of both as a .png shows them. --reference-output writes it.
The noise that is printed with it is its own standard error, an upper bound.

The same options give the same bytes, whatever --threads says.

Examples:
  lpvbake render room.glb room.vdb -o room.png
  lpvbake render room.glb room.vdb -o room.png -o room.exr --camera 0,1.6,3:0,1,0:60 --exposure 6
  lpvbake render town.gltf town.vdb -o town.png --sun 30,50,100000 --camera orbit:45,30 --size 1280x720
  lpvbake render room.glb room.vdb -o a.png --reference 256 --reference-output b.png
  lpvbake render room.glb room.vdb -o light.png --show irradiance --sampler trilinear

JSON (--format json), one object; sizes in bytes, times in seconds:
  {"command": "render", "version", "scene", "volume", "triangles", "device": name, "grid": {"dims",
   "cell", "origin", "cells"}, "size": [width, height], "samples", "show", "sampler", "camera": {"name",
   "eye", "target" (a point ahead), "fov" (degrees)}, "dry_run", "exposure" (EV), "mean_luminance"
   (of the picture), "rays", "reference": null or {"paths", "mean_luminance", "rmse", "relative_rmse"
   (over its mean), "ratio" (of the means), "flip", "noise", "rays"}, "outputs": [{"path", "bytes", "files":
   [{"path", "bytes"}]}], "stages": [{"name", "seconds"}], "seconds", "peak_memory", "warnings": [...]}
With --dry-run what the picture would tell is absent.)";

struct RenderOptions : SceneOptions, RunOptions {
    std::string volume;
    std::vector<std::string> outputs;
    std::string camera;
    std::string size;
    int samples = 16;
    std::string show = "final";
    std::string sampler = "facing";
    std::string exposure = "auto";
    std::string tone_map = "neutral";
    int reference = 0;
    std::vector<std::string> reference_outputs;
    std::string device;
    bool validation = false;
    bool dry_run = false;
};

constexpr const char* show_names[] = {"final",      "direct",    "indirect", "albedo", "normal",
                                      "irradiance", "occlusion", "validity", "cells"};
constexpr int most_pixels_a_side = 16384;

/// In the order of --help.
std::vector<Setting> settings_of(const RenderOptions& o) {
    std::vector<Setting> settings;
    const auto add = [&](const char* name, const std::string& value) {
        if (!value.empty())
            settings.push_back({name, toml_string(value), false});
    };
    add("scene", o.scene);
    add("volume", o.volume);
    if (!o.outputs.empty())
        settings.push_back({"output", toml_array(o.outputs), false});
    append_light_settings(o, settings);
    add("camera", o.camera);
    add("size", o.size);
    settings.push_back({"samples", std::to_string(o.samples), true});
    add("show", o.show);
    add("sampler", o.sampler);
    add("exposure", o.exposure);
    add("tone-map", o.tone_map);
    settings.push_back({"reference", std::to_string(o.reference), false});
    if (!o.reference_outputs.empty())
        settings.push_back({"reference-output", toml_array(o.reference_outputs), false});
    add("device", o.device);
    settings.push_back({"validation", toml_flag(o.validation), false});
    settings.push_back({"threads", std::to_string(o.threads), false});
    add("format", o.format);
    add("progress", o.progress);
    return settings;
}

// ---------------------------------------------------------------- reading the command line

/// As many finite numbers as commas part; none for any other text.
std::optional<std::vector<double>> parse_numbers(const std::string& text) {
    std::vector<double> numbers;
    for (const std::string& part : CLI::detail::split(text, ',')) {
        const std::optional<double> value = parse_number(part);
        if (!value)
            return std::nullopt;
        numbers.push_back(*value);
    }
    return numbers;
}

std::optional<glm::ivec2> parse_size(const std::string& text) {
    const std::vector<std::string> parts = CLI::detail::split(text, 'x');
    glm::ivec2 size(0);
    if (parts.size() != 2)
        return std::nullopt;
    for (int axis = 0; axis < 2; ++axis) {
        const std::string& part = parts[std::size_t(axis)];
        const std::optional<double> value = parse_number(part);
        if (!value || part.find_first_not_of("0123456789") != std::string::npos || *value < 1
            || *value > most_pixels_a_side)
            return std::nullopt;
        size[axis] = int(*value);
    }
    return size;
}

[[noreturn]] void reject_camera(const std::string& text, const std::string& why) {
    throw Error(ErrorKind::argument, "--camera: '" + text + "' " + why
                                         + "; it takes NAME, INDEX, X,Y,Z:TX,TY,TZ[:FOV], "
                                           "orbit[:AZIMUTH,ELEVATION[,DISTANCE]] or inside");
}

/// X,Y,Z:TX,TY,TZ[:FOV]; none for another form.
std::optional<Camera> parse_eye(const std::string& text) {
    const std::vector<std::string> parts = CLI::detail::split(text, ':');
    if (parts.size() < 2 || parts.size() > 3)
        return std::nullopt;
    const auto eye = parse_numbers(parts[0]), target = parse_numbers(parts[1]);
    const double fov = parts.size() == 3 ? parse_number(parts[2]).value_or(0) : 45;
    if (!eye || !target || eye->size() != 3 || target->size() != 3)
        return std::nullopt;
    const glm::dvec3 from((*eye)[0], (*eye)[1], (*eye)[2]);
    const glm::dvec3 to((*target)[0], (*target)[1], (*target)[2]);
    if (!(fov >= 0.01 && fov <= 175))
        reject_camera(text, "has no FOV from 0.01 to 175 degrees");
    if (const double way = glm::length(to - from); !(way > 0 && std::isfinite(way)))
        reject_camera(text, "looks at the eye's own place");
    Camera camera = look_at(from, to, glm::radians(fov));
    camera.name = text;
    return camera;
}

std::optional<Orbit> parse_orbit(const std::string& text) {
    Orbit orbit;
    if (text == "orbit")
        return orbit;
    if (!text.starts_with("orbit:"))
        return std::nullopt;
    const auto numbers = parse_numbers(text.substr(6));
    if (!numbers || numbers->size() < 2 || numbers->size() > 3)
        reject_camera(text, "is no orbit");
    orbit.azimuth = glm::radians((*numbers)[0]);
    orbit.elevation = glm::radians((*numbers)[1]);
    if (std::abs((*numbers)[1]) > 90)
        reject_camera(text, "has an elevation beyond 90 degrees");
    if (numbers->size() == 3) {
        orbit.distance = (*numbers)[2];
        if (!(orbit.distance > 0))
            reject_camera(text, "has no distance above 0");
    }
    return orbit;
}

/// A camera of the file by name or index; null where there is none.
const Camera* camera_of(const Scene& scene, const std::string& text) {
    for (const Camera& camera : scene.cameras)
        if (!text.empty() && camera.name == text)
            return &camera;
    const bool index = !text.empty() && text.size() < 7
                       && text.find_first_not_of("0123456789") == std::string::npos;
    const std::size_t i = index ? std::stoul(text) : 0;
    if ((index || text.empty()) && i < scene.cameras.size())
        return &scene.cameras[i];
    if (index)
        throw Error(ErrorKind::argument, "--camera: " + text + ": the file has "
                                             + counted(scene.cameras.size(), "camera")
                                             + ", counted from 0");
    return nullptr;
}

/// What of the scene the volume covers; all of it where that is nothing.
Bounds seen_box(const Scene& scene, const Grid& grid) {
    const Bounds all = bounds_of(scene);
    Bounds box = all;
    box.lo = glm::max(box.lo, grid.origin);
    box.hi = glm::min(box.hi, grid.origin + grid.cell * glm::dvec3(grid.dims));
    return glm::any(glm::greaterThan(box.lo, box.hi)) ? all : box;
}

/// The camera, and the picture's size: of a camera that has an aspect, as high as usual.
Camera choose_camera(const RenderOptions& o, const Scene& scene, const Volume& volume,
                     const Visibility& visibility, glm::ivec2& size) {
    const glm::ivec2 given = parse_size(o.size).value_or(glm::ivec2(960, 540));
    size = given;
    if (const Camera* own = camera_of(scene, o.camera)) {
        Camera camera = *own;
        if (camera.name.empty())
            camera.name = std::to_string(own - scene.cameras.data());
        if (o.size.empty() && camera.aspect > 0)
            size.x = int(
                std::clamp(std::round(size.y * camera.aspect), 1.0, double(most_pixels_a_side)));
        return camera;
    }
    const Frame frame = frame_of(volume.grid);
    const Bounds box = seen_box(scene, volume.grid);
    std::string kind = o.camera;
    if (kind.empty())
        kind = is_room(box, visibility, frame) ? "inside" : "orbit";
    if (const std::optional<Orbit> orbit = parse_orbit(kind)) {
        Camera camera =
            orbit_camera(box, *orbit, glm::radians(45.0), double(size.x) / double(size.y));
        camera.name = kind;
        return camera;
    }
    if (kind == "inside") {
        Camera camera = inside_camera(box, visibility, frame, glm::radians(60.0));
        camera.name = kind;
        return camera;
    }
    if (const std::optional<Camera> camera = parse_eye(kind))
        return *camera;
    std::string names;
    for (const Camera& camera : scene.cameras)
        names += (names.empty() ? " (it has " : ", ") + camera.name;
    reject_camera(o.camera, "is no camera of the file" + names + (names.empty() ? "" : ")"));
}

/// All that can be known to be wrong before any work is done.
void check_options(const RenderOptions& o) {
    if (o.scene.empty() || o.volume.empty())
        throw Error(ErrorKind::argument, "no scene or no volume: lpvbake render SCENE VOLUME -o "
                                         "OUTPUT (see lpvbake render --help)");
    if (o.outputs.empty() && !o.dry_run)
        throw Error(ErrorKind::argument, "no output: add -o FILE.png or -o FILE.exr");
    if (!o.reference_outputs.empty() && o.reference == 0)
        throw Error(ErrorKind::argument, "--reference-output needs --reference N");
    if (o.reference > 0 && (o.show == "occlusion" || o.show == "validity" || o.show == "cells"))
        throw Error(ErrorKind::argument, "--reference: paths know nothing of --show " + o.show);
    if (!o.size.empty() && !parse_size(o.size))
        throw Error(ErrorKind::argument,
                    "--size: '" + o.size
                        + "' is not WIDTHxHEIGHT, such as 1280x720, each from 1 "
                          "to "
                        + std::to_string(most_pixels_a_side));
    if (!o.camera.empty()) { // wrong numbers are wrong whatever cameras there are
        parse_orbit(o.camera);
        parse_eye(o.camera);
    }
    if (o.exposure != "auto") {
        const std::optional<double> ev = parse_number(o.exposure);
        if (!ev || std::abs(*ev) > 64)
            throw Error(ErrorKind::argument, "--exposure: '" + o.exposure
                                                 + "' is neither an EV from -64 to 64 nor auto");
    }
    std::vector<fs::path> names{fs::weakly_canonical(o.scene), fs::weakly_canonical(o.volume)};
    for (const std::string& lights : o.light_files)
        names.push_back(fs::weakly_canonical(lights));
    const std::size_t inputs = names.size();
    for (const auto* outputs : {&o.outputs, &o.reference_outputs})
        for (const std::string& output : *outputs) {
            if (!has_extension(output, ".png") && !has_extension(output, ".exr"))
                throw Error(ErrorKind::argument,
                            output + ": the name of a picture ends in .png or .exr");
            const fs::path name = fs::weakly_canonical(output);
            const auto at = std::ranges::find(names, name) - names.begin();
            if (std::size_t(at) < names.size())
                throw Error(ErrorKind::argument,
                            output
                                + (std::size_t(at) < inputs ? ": would replace an input"
                                                            : ": given twice as an output"));
            names.push_back(name);
        }
}

// ---------------------------------------------------------------- what is drawn

Volume read(const std::string& path) {
    Volume volume = read_volume(path);
    const bool is_difference = volume.metadata.contains("minuend");
    if (is_difference || volume.metadata.contains("quantity"))
        throw Error(ErrorKind::invalid,
                    path + ": holds " + (is_difference ? "the difference of two volumes" : "errors")
                        + ", not light; give a volume of bake or reference");
    return volume;
}

/// Whether the volume holds light of a kind of source; where that is unknown it is taken to.
bool holds(const Volume& volume, std::optional<Reflections> LightContent::*source) {
    const std::optional<LightContent> content = content_in(volume.metadata);
    return !content || (*content).*source;
}

/// What makes the volume one of another scene or other lights, if it is looked at.
void warn_of_mismatch(const RenderOptions& o, const Scene& scene, const Volume& volume,
                      TerminalProgress& progress) {
    if (o.show == "direct" || o.show == "albedo" || o.show == "normal")
        return;
    const auto& metadata = volume.metadata;
    if (const auto hash = metadata.find("scene_hash");
        hash != metadata.end() && hash->second != scene_hash(scene)) {
        progress.warn(o.volume
                      + ": is of another scene or other lights; give those of its bake, which "
                        "lpvbake info lists");
    }
    const Bounds bounds = bounds_of(scene);
    const Grid& grid = volume.grid;
    const double slack = 0.5 * grid.cell;
    const glm::dvec3 end = grid.origin + grid.cell * glm::dvec3(grid.dims);
    if (glm::any(glm::lessThan(bounds.lo, grid.origin - slack))
        || glm::any(glm::greaterThan(bounds.hi, end + slack)))
        progress.warn(o.volume
                      + ": ends inside the scene, beyond it its outermost cells are read; bake "
                        "with larger --bounds");
    const auto miss = [&](bool present, std::optional<Reflections> LightContent::*source,
                          const char* name) {
        if (present && !holds(volume, source))
            progress.warn(o.volume + ": holds no light of " + name
                          + ", which the picture lacks; bake with it");
    };
    miss(!o.no_emitters && has_emitters(scene), &LightContent::emitters, "emitters");
    miss(has_sky(scene), &LightContent::sky, "the sky");
    miss(!scene.lights.empty(), &LightContent::punctual, "punctual lights");
}

/// Which light the volume holds, as its metadata say.
PathRules rules_of(const RenderOptions& o, const Volume& volume) {
    PathRules rules;
    rules.emitters = !o.no_emitters && holds(volume, &LightContent::emitters);
    const auto bounces = volume.metadata.find("bounces");
    rules.bounces = bounces == volume.metadata.end() ? std::nullopt : bounces_of(bounces->second);
    return rules;
}

Pixels displayed(const RenderOptions& o, const Pixels& picture, Show show, double ev) {
    return to_display(picture, show, ev, o.tone_map == "none" ? ToneMap::none : ToneMap::neutral);
}

Written write_picture(const RenderOptions& o, const std::string& path, const Pixels& picture,
                      Show show, double ev) {
    if (has_extension(path, ".png")) {
        write_png(path, displayed(o, picture, show, ev));
        return {path, {{path, fs::file_size(path)}}};
    }
    const bool light = show == Show::final || show == Show::direct || show == Show::indirect
                       || show == Show::cells;
    const auto bytes = encode_exr(picture, false,
                                  {{"lpv:tool", "lpvbake " LPVBAKE_VERSION},
                                   {"lpv:quantity", o.show},
                                   {"lpv:units", light                      ? "cd/m^2"
                                                 : show == Show::irradiance ? "lux"
                                                                            : "1"}},
                                  path);
    AtomicFile file(path);
    file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    const uint64_t size = file.seal();
    file.publish();
    return {path, {{path, size}}};
}

// ---------------------------------------------------------------- the result

struct StageTime {
    const char* name;
    double seconds;
};

/// Everything that the two forms of the result say.
struct RenderResult {
    const RenderOptions& options;
    const Scene& scene;
    const Volume& volume;
    std::string device;
    ViewSettings view;
    Rendering rendering;
    double exposure = 0;
    std::optional<Rendering> reference;
    PictureError error;
    double flip = 0;
    std::vector<Written> outputs;
    std::vector<StageTime> stages;
    double seconds = 0;
};

glm::dvec3 eye_of(const Camera& camera) {
    return glm::dvec3(camera.to_world[3]);
}

glm::dvec3 target_of(const Camera& camera) {
    return eye_of(camera) - glm::normalize(glm::dvec3(camera.to_world[2]));
}

Json to_json(glm::dvec3 v) {
    return {v.x, v.y, v.z};
}

void print_json_result(const RenderResult& r, const std::vector<std::string>& warnings) {
    const RenderOptions& o = r.options;
    Json document{{"command", "render"},
                  {"version", LPVBAKE_VERSION},
                  {"scene", o.scene},
                  {"volume", o.volume},
                  {"triangles", triangle_count(r.scene)},
                  {"device", r.device},
                  {"grid", grid_json(r.volume.grid)},
                  {"size", {r.view.size.x, r.view.size.y}},
                  {"samples", o.samples},
                  {"show", o.show},
                  {"sampler", o.sampler},
                  {"camera",
                   {{"name", r.view.camera.name},
                    {"eye", to_json(eye_of(r.view.camera))},
                    {"target", to_json(target_of(r.view.camera))},
                    {"fov", glm::degrees(r.view.camera.yfov)}}},
                  {"dry_run", o.dry_run}};
    if (!o.dry_run) {
        document["exposure"] = r.exposure;
        document["mean_luminance"] = mean_luminance(r.rendering.picture);
        document["rays"] = r.rendering.rays;
        document["reference"] = nullptr;
        if (r.reference)
            document["reference"] = {{"paths", o.reference},
                                     {"mean_luminance", mean_luminance(r.reference->picture)},
                                     {"rmse", r.error.rmse},
                                     {"relative_rmse", r.error.relative},
                                     {"ratio", r.error.ratio},
                                     {"flip", r.flip},
                                     {"noise", r.reference->noise},
                                     {"rays", r.reference->rays}};
    }
    document["outputs"] = Json::array();
    for (const Written& output : r.outputs)
        document["outputs"].push_back(output.json());
    if (o.dry_run)
        for (const auto* outputs : {&o.outputs, &o.reference_outputs})
            for (const std::string& output : *outputs)
                document["outputs"].push_back({{"path", output}});
    document["stages"] = Json::array();
    for (const StageTime& stage : r.stages)
        document["stages"].push_back({{"name", stage.name}, {"seconds", stage.seconds}});
    document["seconds"] = r.seconds;
    document["peak_memory"] = peak_memory();
    document["warnings"] = warnings;
    print_json(document);
}

void print_text_result(const RenderResult& r) {
    const RenderOptions& o = r.options;
    const Camera& camera = r.view.camera;
    const glm::dvec3 eye = eye_of(camera), target = target_of(camera);
    std::printf("device        %s\n", r.device.c_str());
    print_grid(r.volume.grid);
    std::printf("camera        %s: (%.5g, %.5g, %.5g) towards (%.5g, %.5g, %.5g), %.4g degrees\n",
                camera.name.c_str(), eye.x, eye.y, eye.z, target.x, target.y, target.z,
                glm::degrees(camera.yfov));
    std::printf("picture       %d x %d pixels, %s each, %s\n", r.view.size.x, r.view.size.y,
                counted(uint64_t(o.samples), "sample").c_str(), o.show.c_str());
    if (o.dry_run) {
        for (const auto* outputs : {&o.outputs, &o.reference_outputs})
            for (const std::string& output : *outputs)
                std::printf("output        %s\n", output.c_str());
        return;
    }
    std::printf("exposure      %.4g EV\n", r.exposure);
    std::printf("mean          %.5g (luminance)\n", mean_luminance(r.rendering.picture));
    if (r.reference)
        std::printf(
            "reference     mean %.5g; RMSE %.4g, %.3g %% of it (noise %.3g %%); FLIP %.4f\n",
            mean_luminance(r.reference->picture), r.error.rmse, 100 * r.error.relative,
            r.error.rmse > 0 ? 100 * r.error.relative * r.reference->noise / r.error.rmse : 0.0,
            r.flip);
    for (const StageTime& stage : r.stages)
        std::printf("%-12s  %7.3f s\n", stage.name, stage.seconds);
    std::printf("%-12s  %7.3f s  peak memory %s\n", "total", r.seconds,
                bytes_text(peak_memory()).c_str());
    for (const Written& output : r.outputs)
        output.print();
}

/// Of --sampler.
readers::Reader sampler_of(const std::string& name) {
    if (name == "facing")
        return *readers::reader_named("lpvbake");
    if (const readers::Reader* reader = readers::reader_named(name))
        return *reader;
    return {.name = "trilinear", .highest_order = sh_max_order, .clamped = true};
}

/// The volume as the sampler's target writes it, where that fills cells; a fitted one is filled.
std::optional<Volume> filled_for(const std::string& sampler, const Volume& volume) {
    const Target* target = target_named(sampler);
    if (!target || target->dilate == 0 || volume.metadata.contains("fit"))
        return {};
    std::optional<Volume> filled = volume;
    dilate(*filled, target->dilate);
    return filled;
}

/// What --sampler takes: our own two, then the programs and formulas that readers know.
std::string sampler_choices() {
    std::vector<const char*> names{"facing", "trilinear"};
    for (const readers::Reader& reader : readers::all_readers())
        if (&reader != readers::reader_named("lpvbake"))
            names.push_back(reader.name);
    return choices_of(names);
}

void run(const RenderOptions& o) {
    const Clock::time_point begin = Clock::now();
    const std::vector<Light> lights = command_line_lights(o);
    probe_outputs(o.outputs);
    probe_outputs(o.reference_outputs);
    probe_scene(o);
    const auto thread_limit = limit_threads(o.threads);
    const ImageModulePreload preload = preload_image_module();

    watch_signals();
    TerminalProgress progress(progress_style(o.progress));
    std::vector<StageTime> stages;
    Clock::time_point lap = begin;
    const auto end_stage = [&](const char* name) {
        stages.push_back({name, seconds_since(lap)});
        lap = Clock::now();
    };

    progress.begin("load", 0);
    auto opening = std::async(std::launch::async, [&o] {
        return std::make_unique<gpu::Device>(gpu::DeviceOptions{o.device, o.validation});
    });
    const Volume volume = read(o.volume);
    const Scene scene = load_scene(o, lights);
    for (const std::string& warning : scene.warnings)
        progress.warn(warning);
    if (triangle_count(scene) == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to draw");
    warn_of_mismatch(o, scene, volume, progress);
    const std::unique_ptr<gpu::Device> device = opening.get();
    end_stage("load");

    progress.begin("prepare", 0);
    const Frame frame = frame_of(volume.grid);
    const Visibility visibility(scene, frame);
    const Paths paths(scene, visibility, frame, rules_of(o, volume));
    ViewSettings view;
    view.camera = choose_camera(o, scene, volume, visibility, view.size);
    view.samples = o.samples;
    view.show = Show(std::ranges::find(show_names, o.show) - std::begin(show_names));
    RenderResult result{o, scene, volume, device->info().name, view, {}, 0, {}, {}, 0, {}, {}, 0};
    if (!o.dry_run) {
        const Raster raster(*device, scene, frame);
        end_stage("prepare");
        const LitScene lit{scene, frame, visibility, paths};
        const std::optional<Volume> filled = filled_for(o.sampler, volume);
        result.rendering =
            render(lit, filled ? *filled : volume, raster, sampler_of(o.sampler), view, progress);
        end_stage("render");
        result.exposure = o.exposure == "auto"
                              ? automatic_exposure(result.rendering.picture, view.show)
                              : *parse_number(o.exposure);
        if (o.reference > 0) {
            view.samples = o.reference;
            result.reference = trace_picture(lit, view, progress);
            const Pixels &drawn = result.rendering.picture, &traced = result.reference->picture;
            result.error = compare_pictures(drawn, traced);
            result.flip = flip(displayed(o, drawn, view.show, result.exposure),
                               displayed(o, traced, view.show, result.exposure));
            end_stage("reference");
        }
        progress.begin("write", 0);
        for (const std::string& output : o.outputs)
            result.outputs.push_back(
                write_picture(o, output, result.rendering.picture, view.show, result.exposure));
        for (const std::string& output : o.reference_outputs)
            result.outputs.push_back(
                write_picture(o, output, result.reference->picture, view.show, result.exposure));
        end_stage("write");
    }
    device->check_validation();
    progress.clear();
    result.stages = stages;
    result.seconds = seconds_since(begin);
    if (o.format == "json")
        print_json_result(result, progress.warnings());
    else
        print_text_result(result);
}

} // namespace

void add_render(CLI::App& root, Action& action) {
    auto options = std::make_shared<RenderOptions>();
    RenderOptions& o = *options;
    CLI::App* app = root.add_subcommand("render", summary);
    app->footer(manual);

    OptionList list(*app);
    list.text("scene", o.scene, "FILE", "glTF 2.0 file, .gltf or .glb");
    list.text("volume", o.volume, "VOLUME",
              ("Volume of bake or reference, " + format_list()).c_str());
    list.list("-o,--output", o.outputs, "FILE", "Picture to write, .png or .exr; may be repeated");
    add_light_options(list, o);

    list.group("View");
    list.text("--camera", o.camera, "CAMERA", "See below");
    list.text("--size", o.size, "WIDTHxHEIGHT",
              "Pixels; default: 960x540, or 540 high in the camera's aspect");
    list.number("--samples", o.samples, 1, 65536, "Samples of each pixel, spread over its square")
        ->capture_default_str();
    list.choice("--show", o.show,
                "final|direct|indirect|albedo|normal|irradiance|occlusion|validity|cells",
                "See below");
    list.choice("--sampler", o.sampler, sampler_choices(),
                "How the volume is read, or by which program");

    list.group("Picture");
    list.text("--exposure", o.exposure, "EV|auto", "Of a .png")->capture_default_str();
    list.choice("--tone-map", o.tone_map, "neutral|none", "Of a .png");
    list.number("--reference", o.reference, 0, 1e6,
                "Paths of each pixel to compare the picture with; 0: none")
        ->capture_default_str();
    list.list("--reference-output", o.reference_outputs, "FILE",
              "Path-traced picture to write, .png or .exr; may be repeated");

    list.group("Run");
    list.text("--device", o.device, "NAME", "Index, UUID or part of the name; default: the first");
    list.flag("--validation", o.validation, "Load Vulkan's validation layer; messages are errors");
    list.flag("--dry-run", o.dry_run, "Print camera and size, and draw nothing")
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
            check_options(*options);
            run(*options);
        };
    });
}

} // namespace lpvbake
