// lpvbake render: pictures of a scene that a volume lights.

#include "render/render.h"

#include "background.h"
#include "commands.h"
#include "io/atomic_file.h"
#include "io/glb.h"
#include "io/levels.h"
#include "io/slice.h"
#include "lpvbake/error.h"
#include "medium/lit_air.h"
#include "medium_options.h"
#include "read_light.h"
#include "render/camera.h"
#include "render/display.h"
#include "render/flip.h"
#include "scene_options.h"
#include "text.h"
#include "transfer/relight.h"
#include "volume/grid.h"
#include "world_volume.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <future>
#include <iterator>
#include <memory>
#include <optional>
#include <variant>

namespace lpvbake::cmd {
namespace {

namespace fs = std::filesystem;

const char manual[] =
#include "manual/render.txt.h"
    ;

constexpr const char* show_names[] = {"final",      "direct",    "indirect", "albedo", "normal",
                                      "irradiance", "occlusion", "validity", "cells"};
constexpr int most_pixels_a_side = 16384;
const char camera_forms[] = "; it takes NAME, INDEX, X,Y,Z:TX,TY,TZ[:FOV], "
                            "orbit[:AZIMUTH,ELEVATION[,DISTANCE]] or inside";

/// How light in air is found.
struct FogMethod {
    enum class Kind { exact, march, nvidia } kind = Kind::exact;
    int steps = 0;    ///< of march
    double boost = 0; ///< of nvidia
};

struct RenderOptions : SceneOptions, RunOptions {
    std::string volume;
    WorldOptions world; ///< with the scene's bound of memory
    std::vector<std::string> outputs;
    render::CameraChoice camera;
    std::optional<glm::ivec2> size;
    int samples = 16;
    render::Show show = render::Show::final;
    const readers::Reader* sampler = nullptr; ///< null: whom the volume is fitted to, or facing
    std::optional<double> exposure;           ///< EV; none: automatic
    render::ToneMap tone_map = render::ToneMap::neutral;
    int reference = 0;
    std::vector<std::string> reference_outputs;
    MediumOptions medium;
    FogMethod fog;
    std::optional<int> rsm;               ///< texels of each map a point takes; none: the field
    render::RsmLightSettings rsm_visible; ///< of its texels
    bool compare_rays = false;
    bool relight = false;          ///< by the volume's operators, instead of its field
    std::optional<int> iterations; ///< of that
};

std::string name_of(render::Show show) {
    return show_names[int(show)];
}

std::vector<std::string> all_outputs(const RenderOptions& o) {
    std::vector<std::string> all = o.outputs;
    all.insert(all.end(), o.reference_outputs.begin(), o.reference_outputs.end());
    return all;
}

// ---------------------------------------------------------------- reading the command line

glm::ivec2 parse_size(const std::string& text) {
    const std::vector<std::string> parts = options::split(text, 'x');
    glm::ivec2 size(0);
    try {
        for (int axis = 0; axis < 2; ++axis)
            size[axis] = int(
                options::number_within(parts.at(std::size_t(axis)), 1, most_pixels_a_side, true));
        if (parts.size() == 2)
            return size;
    } catch (const std::exception&) { // told of below
    }
    options::refuse(text, "is not WIDTHxHEIGHT, such as 1280x720, each from 1 to "
                              + std::to_string(most_pixels_a_side));
}

std::optional<double> parse_exposure(const std::string& text) {
    if (text == "auto")
        return {};
    const std::optional<double> ev = options::parse_number(text);
    if (!ev || std::abs(*ev) > 64)
        options::refuse(text, "is neither an EV from -64 to 64 nor auto");
    return ev;
}

[[noreturn]] void reject_camera(const std::string& text, const std::string& why) {
    options::refuse(text, why + camera_forms);
}

/// X,Y,Z:TX,TY,TZ[:FOV]; none for another form.
std::optional<Camera> parse_eye(const std::string& text) {
    const std::vector<std::string> parts = options::split(text, ':');
    if (parts.size() < 2 || parts.size() > 3)
        return std::nullopt;
    const auto eye = options::parse_numbers(parts[0]), target = options::parse_numbers(parts[1]);
    const double fov = parts.size() == 3 ? options::parse_number(parts[2]).value_or(0) : 45;
    if (!eye || !target || eye->size() != 3 || target->size() != 3)
        return std::nullopt;
    const glm::dvec3 from((*eye)[0], (*eye)[1], (*eye)[2]);
    const glm::dvec3 to((*target)[0], (*target)[1], (*target)[2]);
    if (!(fov >= 0.01 && fov <= 175))
        reject_camera(text, "has no FOV from 0.01 to 175 degrees");
    if (const double way = glm::length(to - from); !(way > 0 && std::isfinite(way)))
        reject_camera(text, "looks at the eye's own place");
    return render::look_at(from, to, glm::radians(fov));
}

render::Orbit parse_orbit(const std::string& text) {
    render::Orbit orbit;
    if (text == "orbit")
        return orbit;
    const auto numbers = options::parse_numbers(text.substr(6));
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

render::CameraChoice parse_camera(const std::string& text) {
    render::CameraChoice camera{text, {}};
    if (text == "inside")
        camera.own = render::Inside();
    else if (text == "orbit" || text.starts_with("orbit:"))
        camera.own = parse_orbit(text);
    else if (const std::optional<Camera> eye = parse_eye(text))
        camera.own = *eye;
    else if (const auto place = options::parse_numbers(text); place && place->size() == 3)
        reject_camera(text, "has a place and no target: it would be " + text + ":TX,TY,TZ");
    return camera;
}

/// "exact", "march:N", "nvidia" or "nvidia:BOOST".
FogMethod parse_fog_method(const std::string& text) {
    using Kind = FogMethod::Kind;
    if (text == "exact")
        return {};
    if (text.starts_with("march:"))
        return {Kind::march, int(options::number_within(text.substr(6), 1, 1e6, true)), 0};
    if (text == "nvidia")
        return {Kind::nvidia, 0, 0};
    if (text.starts_with("nvidia:"))
        return {Kind::nvidia, 0, options::number_within(text.substr(7), 0, 1e6, false)};
    options::refuse(text, "is none of exact, march:N, nvidia and nvidia:BOOST");
}

/// "volume", or "rsm:N".
std::optional<int> parse_indirect(const std::string& text) {
    if (text == "volume")
        return std::nullopt;
    if (text.starts_with("rsm:"))
        return int(options::number_within(text.substr(4), 1, 65536, true));
    options::refuse(text, "is neither volume nor rsm:N");
}

/// "none", "rays" or "ssdo:SAMPLES,RADIUS,THICKNESS".
render::RsmLightSettings parse_visibility(const std::string& text) {
    using Seen = render::RsmLightSettings::Seen;
    render::RsmLightSettings settings;
    if (text == "none" || text == "rays") {
        settings.seen = text == "none" ? Seen::none : Seen::rays;
        return settings;
    }
    settings.seen = Seen::ssdo;
    const auto numbers =
        text.starts_with("ssdo:") ? options::parse_numbers(text.substr(5)) : std::nullopt;
    if (!numbers || numbers->size() != 3 || !((*numbers)[0] >= 1 && (*numbers)[0] <= 1024)
        || (*numbers)[0] != std::floor((*numbers)[0]) || !((*numbers)[1] >= 0)
        || !((*numbers)[2] >= 0))
        options::refuse(text, "is none of none, rays and ssdo:SAMPLES,RADIUS,THICKNESS, 1 to 1024 "
                              "samples and metres from 0");
    settings.samples = int((*numbers)[0]);
    settings.radius = (*numbers)[1];
    settings.thickness = (*numbers)[2];
    return settings;
}

std::string name_of_visibility(const render::RsmLightSettings& settings) {
    using Seen = render::RsmLightSettings::Seen;
    return settings.seen == Seen::none ? "none"
           : settings.seen == Seen::rays
               ? "rays"
               : format("ssdo:%d,%.9g,%.9g", settings.samples, settings.radius, settings.thickness);
}

std::string name_of(const FogMethod& method) {
    using Kind = FogMethod::Kind;
    return method.kind == Kind::exact   ? "exact"
           : method.kind == Kind::march ? "march:" + std::to_string(method.steps)
           : method.boost > 0           ? format("nvidia:%.9g", method.boost)
                                        : "nvidia";
}

/// All that has cells: of nested levels the outermost.
Bounds box_of(const volume::VolumeSet& set) {
    const volume::GridBox outermost = volume::box_of(set.outermost());
    Bounds box{outermost.lo, outermost.hi};
    for (std::size_t i = 0; i < set.places.size(); ++i) {
        const volume::GridBox own = volume::box_of(set.levels[i].grid);
        box = {glm::min(box.lo, own.lo), glm::max(box.hi, own.hi)};
    }
    return box;
}

/// The camera, and the picture's size: of a camera that has an aspect, as high as usual.
Camera choose_camera(const RenderOptions& o, const Scene& scene, const Bounds& box,
                     const visibility::Visibility& visibility, const scene::Frame& frame,
                     glm::ivec2& size) {
    size = o.size.value_or(glm::ivec2(960, 540));
    const Camera camera = render::choose_camera(o.camera, scene, box, visibility, frame,
                                                double(size.x) / double(size.y));
    if (!o.size && camera.aspect > 0)
        size.x =
            int(std::clamp(std::round(size.y * camera.aspect), 1.0, double(most_pixels_a_side)));
    return camera;
}

/// All that can be known to be wrong before any work is done.
void check_options(const RenderOptions& o) {
    if (o.scene.empty() || o.volume.empty())
        throw Error(ErrorKind::argument, "no scene or no volume: lpvbake render SCENE VOLUME -o "
                                         "OUTPUT (see lpvbake render --help)");
    check_order(o.scene, o.volume,
                "lpvbake render SCENE VOLUME -o OUTPUT (see lpvbake render --help)");
    if (o.outputs.empty() && !o.dry_run)
        throw Error(ErrorKind::argument, "no output: add -o FILE.png or -o FILE.exr");
    if (o.reference > 0
        && (o.show == render::Show::occlusion || o.show == render::Show::validity
            || o.show == render::Show::cells))
        throw Error(ErrorKind::argument,
                    "--reference: paths know nothing of --show " + name_of(o.show));
    if (o.relight && o.rsm)
        throw Error(ErrorKind::argument, "--relight lrt and --indirect rsm:N exclude each other");
    if (o.compare_rays && !o.rsm)
        throw Error(ErrorKind::argument, "--compare rays is of --indirect rsm:N");
    for (const std::string& output : all_outputs(o))
        if (!options::has_extension(output, ".png") && !options::has_extension(output, ".exr"))
            throw Error(ErrorKind::argument,
                        output + ": the name of a picture ends in .png or .exr");
    std::vector<std::string> volumes{o.volume};
    if (io::is_manifest(o.volume))
        std::ranges::copy(io::level_files(o.volume), std::back_inserter(volumes));
    check_scenario(o.world, {o.volume});
    if (io::is_world(o.volume))
        std::ranges::copy(files_of(open_world(o.volume, o.world)), std::back_inserter(volumes));
    if (io::is_world(o.volume) && o.relight)
        throw Error(ErrorKind::unsupported,
                    o.volume
                        + ": --relight lrt is of one volume; first make one by lpvbake "
                          "convert");
    check_files(inputs_of(o, o), volumes, all_outputs(o), true);
}

// ---------------------------------------------------------------- what is drawn

/// What makes the volume one of another scene or other lights, if it is looked at.
void warn_of_mismatch(const RenderOptions& o, const Scene& scene, const volume::VolumeSet& set,
                      TerminalProgress& progress) {
    const Volume& volume = set.levels.back();
    if (o.show == render::Show::direct || o.show == render::Show::albedo
        || o.show == render::Show::normal)
        return;
    if (const auto other =
            o.relight ? other_surfaces(o.volume, volume, scene) : mismatch(o.volume, volume, scene))
        progress.warn(*other);
    const Bounds bounds = bounds_of(scene);
    const double slack = 0.5 * volume.grid.cell;
    const Bounds box = box_of(set);
    if (glm::any(glm::lessThan(bounds.lo, box.lo - slack))
        || glm::any(glm::greaterThan(bounds.hi, box.hi + slack)))
        progress.warn(o.volume
                      + ": ends inside the scene, beyond it its outermost cells are read; bake "
                        "with larger --bounds");
    if (o.relight)
        return;
    const auto miss = [&](bool present,
                          std::optional<volume::Reflections> volume::LightContent::*source,
                          const char* name) {
        if (present && !holds(volume, source))
            progress.warn(o.volume + ": holds no light of " + name
                          + ", which the picture lacks; bake with it");
    };
    miss(!o.no_emitters && scene::has_emitters(scene), &volume::LightContent::emitters, "emitters");
    miss(scene::has_sky(scene), &volume::LightContent::sky, "the sky");
    miss(!scene.lights.empty(), &volume::LightContent::punctual, "punctual lights");
}

/// The chain is one of directional lights; others are shown all the same.
void warn_of_lamps(const RenderOptions& o, const Scene& scene, TerminalProgress& progress) {
    const auto lamps = std::ranges::count_if(scene.lights, [](const Light& light) {
        return light.type != LightType::directional && !light.is_static;
    });
    if (o.fog.kind == FogMethod::Kind::nvidia && lamps > 0)
        progress.warn("--fog-method " + name_of(o.fog) + ": is of directional lights; "
                      + counted(uint64_t(lamps), "point or spot light")
                      + " in air shown as by exact");
}

image::Pixels displayed(const RenderOptions& o, const image::Pixels& picture, double ev) {
    return render::to_display(picture, o.show, ev, o.tone_map);
}

Written write_picture(const RenderOptions& o, const std::string& path, const image::Pixels& picture,
                      double ev) {
    if (options::has_extension(path, ".png")) {
        io::write_png(path, displayed(o, picture, ev));
        return {path, {{path, fs::file_size(path)}}};
    }
    const bool light = o.show == render::Show::final || o.show == render::Show::direct
                       || o.show == render::Show::indirect || o.show == render::Show::cells;
    const auto bytes =
        image::encode_exr(picture, false,
                          {{"lpv:tool", "lpvbake " LPVBAKE_VERSION},
                           {"lpv:quantity", name_of(o.show)},
                           {"lpv:units", light                                ? "cd/m^2"
                                         : o.show == render::Show::irradiance ? "lux"
                                                                              : "1"}},
                          path);
    io::AtomicFile file(path);
    file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    const uint64_t size = file.seal();
    file.publish();
    return {path, {{path, size}}};
}

// ---------------------------------------------------------------- the result

/// How far a picture is from another of the same.
struct Comparison {
    double energy = 0; ///< the mean over the other's
    double l1 = 0;     ///< the sum of differences over the other's sum
    double flip = 0;
};

struct TilesRead {
    std::size_t count = 0, of = 0;
};

/// Everything that the two forms of the result say.
struct RenderResult {
    const RenderOptions& options;
    const Scene& scene;
    const Volume& volume;
    std::string device;
    std::string sampler;
    render::ViewSettings view;
    render::Rendering rendering = {};
    double exposure = 0;
    std::optional<render::Rendering> reference = {};
    render::PictureError error = {};
    double flip = 0;
    std::vector<Written> outputs = {};
    std::optional<render::Rendering> by_rays = {}; ///< with RenderOptions::compare_rays
    Comparison beside_rays = {};
    std::optional<render::Rendering> by_exact = {}; ///< with FogMethod::Kind::nvidia
    Comparison beside_exact = {};
    std::optional<transfer::Propagated> relit = {};
    std::optional<TilesRead> tiles = {}; ///< of a world
};

glm::dvec3 eye_of(const Camera& camera) {
    return glm::dvec3(camera.to_world[3]);
}

glm::dvec3 target_of(const Camera& camera) {
    return eye_of(camera) - glm::normalize(glm::dvec3(camera.to_world[2]));
}

/// The sum of differences over the sum of the second.
double relative_l1(const image::Pixels& a, const image::Pixels& b) {
    double difference = 0, sum = 0;
    for (std::size_t i = 0; i < a.samples.size(); ++i) {
        difference += std::abs(double(a.samples[i]) - double(b.samples[i]));
        sum += std::abs(double(b.samples[i]));
    }
    return sum > 0 ? difference / sum : 0;
}

report::Json indirect_json(const RenderResult& r) {
    const RenderOptions& o = r.options;
    if (!o.rsm)
        return nullptr;
    report::Json json{{"texels", *o.rsm},
                      {"visibility", name_of_visibility(o.rsm_visible)},
                      {"compared", nullptr}};
    if (!r.by_rays)
        return json;
    const render::PairCount& pairs = r.rendering.pairs;
    const double all = double(std::max<uint64_t>(pairs.pairs, 1));
    json["compared"] = {{"pairs", pairs.pairs},
                        {"hidden", double(pairs.hidden) / all},
                        {"falsely_lit", double(pairs.falsely_lit) / all},
                        {"falsely_dark", double(pairs.falsely_dark) / all},
                        {"energy", r.beside_rays.energy},
                        {"l1", r.beside_rays.l1},
                        {"flip", r.beside_rays.flip}};
    return json;
}

report::Json fog_json(const RenderResult& r) {
    const MediumOptions& o = r.options.medium;
    if (!o.medium)
        return nullptr;
    report::Json json = medium_json(*o.medium, o.density);
    json["method"] = name_of(r.options.fog);
    json["beside_exact"] = nullptr;
    if (r.by_exact)
        json["beside_exact"] = {{"energy", r.beside_exact.energy},
                                {"l1", r.beside_exact.l1},
                                {"flip", r.beside_exact.flip},
                                {"steps", r.rendering.steps.all},
                                {"long_steps", r.rendering.steps.coarse}};
    return json;
}

void print_json_result(const RenderResult& r, const Run& run) {
    const RenderOptions& o = r.options;
    report::Json document{{"command", "render"},
                          {"version", LPVBAKE_VERSION},
                          {"scene", o.scene},
                          {"volume", o.volume},
                          {"triangles", scene::triangle_count(r.scene)},
                          {"device", r.device},
                          {"grid", report::grid_json(r.volume.grid)},
                          {"size", {r.view.size.x, r.view.size.y}},
                          {"samples", o.samples},
                          {"show", name_of(o.show)},
                          {"sampler", r.sampler},
                          {"camera",
                           {{"name", r.view.camera.name},
                            {"eye", report::vector_json(eye_of(r.view.camera))},
                            {"target", report::vector_json(target_of(r.view.camera))},
                            {"fov", glm::degrees(r.view.camera.yfov)}}},
                          {"dry_run", o.dry_run}};
    document["medium"] = fog_json(r);
    document["indirect"] = indirect_json(r);
    if (!o.dry_run) {
        document["tiles"] = nullptr;
        if (r.tiles)
            document["tiles"] = {{"read", r.tiles->count}, {"of", r.tiles->of}};
        document["relight"] = nullptr;
        if (r.relit)
            document["relight"] = {{"iterations", r.relit->iterations},
                                   {"missing", r.relit->missing}};
        document["exposure"] = r.exposure;
        document["mean_luminance"] = render::mean_luminance(r.rendering.picture);
        document["rays"] = r.rendering.rays;
        document["reference"] = nullptr;
        if (r.reference)
            document["reference"] = {
                {"paths", o.reference},
                {"mean_luminance", render::mean_luminance(r.reference->picture)},
                {"rmse", r.error.rmse},
                {"relative_rmse", r.error.relative},
                {"ratio", r.error.ratio},
                {"flip", r.flip},
                {"noise", r.reference->noise},
                {"rays", r.reference->rays}};
    }
    document["outputs"] = outputs_json(r.outputs);
    if (o.dry_run) {
        std::vector<Written> planned;
        for (const std::string& path : all_outputs(o))
            planned.push_back({path, {{path, 0}}});
        document["outputs"] = planned_json(planned);
    }
    document["stages"] = stages_json(run.stages);
    document["seconds"] = run.seconds();
    document["peak_memory"] = peak_memory();
    document["warnings"] = run.progress.warnings();
    print_json(document);
}

void print_text_result(const RenderResult& r, const Run& run) {
    const RenderOptions& o = r.options;
    const Camera& camera = r.view.camera;
    const glm::dvec3 eye = eye_of(camera), target = target_of(camera);
    std::printf("device        %s\n", r.device.c_str());
    print_grid(r.volume.grid);
    std::printf("camera        %s: (%.5g, %.5g, %.5g) towards (%.5g, %.5g, %.5g), %.4g degrees\n",
                camera.name.c_str(), eye.x, eye.y, eye.z, target.x, target.y, target.z,
                glm::degrees(camera.yfov));
    std::printf("picture       %d x %d pixels, %s each, %s\n", r.view.size.x, r.view.size.y,
                counted(uint64_t(o.samples), "sample").c_str(), name_of(o.show).c_str());
    if (const auto& air = o.medium.medium)
        std::printf("medium        scatters %.4g, absorbs %.4g a metre (green), g %.3g; %s\n",
                    air->scatter.g, air->absorb.g, air->g, name_of(o.fog).c_str());
    if (o.dry_run) {
        for (const std::string& output : all_outputs(o))
            std::printf("output        %s\n", output.c_str());
        return;
    }
    if (r.tiles)
        std::printf("tiles         %zu of %zu in sight\n", r.tiles->count, r.tiles->of);
    if (r.relit)
        std::printf("relight       %s, more would add about %s %% of the light\n",
                    counted(uint64_t(r.relit->iterations), "hop").c_str(),
                    two_digits(100 * r.relit->missing).c_str());
    std::printf("exposure      %.4g EV\n", r.exposure);
    std::printf("mean          %.5g (luminance)\n", render::mean_luminance(r.rendering.picture));
    if (r.reference)
        std::printf(
            "reference     mean %.5g; RMSE %.4g, %.3g %% of it (noise %.3g %%); FLIP %.4f\n",
            render::mean_luminance(r.reference->picture), r.error.rmse, 100 * r.error.relative,
            r.error.rmse > 0 ? 100 * r.error.relative * r.reference->noise / r.error.rmse : 0.0,
            r.flip);
    if (r.by_rays) {
        const render::PairCount& pairs = r.rendering.pairs;
        const double all = 0.01 * double(std::max<uint64_t>(pairs.pairs, 1));
        std::printf("beside rays   %.3g %% of the pairs falsely lit, %.3g %% falsely dark (%.3g %% "
                    "hidden); energy %.3f, L1 %.3g %%, FLIP %.4f\n",
                    double(pairs.falsely_lit) / all, double(pairs.falsely_dark) / all,
                    double(pairs.hidden) / all, r.beside_rays.energy, 100 * r.beside_rays.l1,
                    r.beside_rays.flip);
    }
    if (r.by_exact)
        std::printf("beside exact  energy %.3f, L1 %.3g %%, FLIP %.4f; %s, %.3g %% of them long\n",
                    r.beside_exact.energy, 100 * r.beside_exact.l1, r.beside_exact.flip,
                    counted(r.rendering.steps.all, "step").c_str(),
                    100 * double(r.rendering.steps.coarse)
                        / double(std::max<uint64_t>(r.rendering.steps.all, 1)));
    print_stages(run.stages);
    print_total(run.seconds());
    print_outputs(r.outputs);
}

using Draw = std::function<render::Rendering(const render::ViewSettings&)>;

/// The picture, and what it is a model of if it is to be compared with that. `view` has no light
/// but the field's, and no fog.
void draw_pictures(const RenderOptions& o, const render::LitScene& lit,
                   const visibility::Visibility& visibility, const volume::Levels& field,
                   const Draw& draw, render::ViewSettings view, Run& run, RenderResult& result) {
    const bool is_chain = o.fog.kind == FogMethod::Kind::nvidia;
    std::optional<medium::Fog> fog;
    std::optional<medium::VolumeLight> volume_light;
    if (view.air) {
        fog.emplace(lit.scene, visibility, lit.frame, &field, *view.air,
                    medium::FogSettings{.steps = o.fog.steps, .suns = !is_chain});
        view.fog = &*fog;
        if (is_chain) {
            volume_light.emplace(lit.scene, visibility, lit.frame, false, *view.air,
                                 medium::VolumeLightSettings{.boost = o.fog.boost});
            view.volume_light = &*volume_light;
        }
        run.end_stage("medium");
    }
    std::optional<render::RsmLight> rsm;
    render::RsmLightSettings settings = o.rsm_visible;
    if (o.rsm) {
        settings.texels = *o.rsm;
        settings.compare = o.compare_rays;
        rsm.emplace(lit.scene, lit.frame, visibility, settings);
        view.rsm = &*rsm;
    }
    result.rendering = draw(view);
    run.end_stage("render");
    if (o.compare_rays) {
        settings.seen = render::RsmLightSettings::Seen::rays;
        settings.compare = false;
        const render::RsmLight truth(lit.scene, lit.frame, visibility, settings);
        render::ViewSettings by_rays = view;
        by_rays.rsm = &truth;
        result.by_rays = draw(by_rays);
        run.end_stage("rays");
    }
    if (view.volume_light) {
        const medium::Fog exact(lit.scene, visibility, lit.frame, &field, *view.air, {});
        view.fog = &exact;
        view.volume_light = nullptr;
        result.by_exact = draw(view);
        run.end_stage("exact");
    }
}

Comparison compare(const RenderOptions& o, const image::Pixels& drawn, const image::Pixels& truth,
                   double exposure) {
    return {render::compare_pictures(drawn, truth).ratio, relative_l1(drawn, truth),
            render::flip(displayed(o, drawn, exposure), displayed(o, truth, exposure))};
}

/// With what the picture is a model of, if it is one.
void compare_models(const RenderOptions& o, RenderResult& result) {
    const image::Pixels& drawn = result.rendering.picture;
    if (result.by_rays)
        result.beside_rays = compare(o, drawn, result.by_rays->picture, result.exposure);
    if (result.by_exact)
        result.beside_exact = compare(o, drawn, result.by_exact->picture, result.exposure);
}

void write_pictures(const RenderOptions& o, Run& run, RenderResult& result) {
    run.progress.begin("write", 0);
    for (const std::string& output : o.outputs)
        result.outputs.push_back(
            write_picture(o, output, result.rendering.picture, result.exposure));
    for (const std::string& output : o.reference_outputs)
        result.outputs.push_back(
            write_picture(o, output, result.reference->picture, result.exposure));
    run.end_stage("write");
}

/// Makes the scene's light the field of the volume.
transfer::Propagated relight(const RenderOptions& o, const Scene& scene,
                             const visibility::Visibility& visibility, const scene::Frame& frame,
                             volume::VolumeSet& set, Run& run) {
    if (set.levels.size() > 1)
        throw Error(ErrorKind::unsupported,
                    o.volume
                        + ": --relight lrt is of one volume, not of several; give the file of one");
    if (!transfer::has_operators(set.levels.front()))
        throw Error(ErrorKind::invalid,
                    o.volume
                        + ": the volume has no operators of light; bake it with "
                          "--local-transfer");
    run.progress.begin("relight", 0);
    transfer::RelightSettings settings;
    settings.emitters = !o.no_emitters;
    settings.propagation.iterations = o.iterations;
    transfer::Propagated relit =
        transfer::relight(scene, visibility, frame, settings, set.levels.front(), run.progress);
    run.end_stage("relight");
    return relit;
}

/// Of a field that is that in a medium, where it is shown in this one.
void check_air(const RenderOptions& o, const std::optional<medium::Medium>& air,
               const Volume& volume, TerminalProgress& progress) {
    if (!is_in_air(volume))
        return;
    const auto own = volume.metadata.find("medium");
    if (air && own != volume.metadata.end() && own->second != medium::text_of(*air))
        progress.warn(o.volume + ": the field is that in another medium, --medium " + own->second);
    if (o.reference > 0)
        throw Error(ErrorKind::unsupported,
                    o.volume
                        + ": --reference: paths know light that is scattered once, and the field "
                          "is that in a medium (--scattering); bake it without");
    if (!air)
        progress.warn(o.volume
                      + ": the field is that in a medium, of which the picture shows no more; give "
                        "the bake's --medium");
}

/// Whether a camera may see something of a box.
bool may_see(const Camera& camera, double aspect, const Bounds& box) {
    const glm::dvec3 eye = eye_of(camera);
    const glm::dvec3 right = glm::normalize(glm::dvec3(camera.to_world[0])),
                     up = glm::normalize(glm::dvec3(camera.to_world[1])),
                     ahead = -glm::normalize(glm::dvec3(camera.to_world[2]));
    const double high = std::tan(0.5 * camera.yfov), wide = high * aspect;
    // Of the planes through the eye that bound the picture, and of the one across it.
    for (const glm::dvec3 inwards : {ahead, wide * ahead - right, wide * ahead + right,
                                     high * ahead - up, high * ahead + up}) {
        bool is_outside = true;
        for (int corner = 0; corner < 8; ++corner) {
            const glm::dvec3 p(corner & 1 ? box.hi.x : box.lo.x, corner & 2 ? box.hi.y : box.lo.y,
                               corner & 4 ? box.hi.z : box.lo.z);
            is_outside = is_outside && glm::dot(inwards, p - eye) < 0;
        }
        if (is_outside)
            return false;
    }
    return true;
}

/// The cells of a world that the picture may show, with those around that readers look at; what
/// else stands in their box is read with them. Throws Error (invalid) where it shows no tile.
Volume cells_in_sight(const RenderOptions& o, const io::WorldVolume& world,
                      const render::ViewSettings& view, TilesRead& tiles) {
    constexpr int around = 8; // cells
    glm::ivec3 begin(world.grid.dims), end(0);
    for (const io::WorldVolume::Tile& tile : world.tiles) {
        const glm::ivec3 lo = tile.begin - around, hi = tile.end + around;
        if (!may_see(view.camera, double(view.size.x) / double(view.size.y),
                     {world.grid.to_world(lo), world.grid.to_world(hi)}))
            continue;
        for (int axis = 0; axis < 3; ++axis) { // with the outermost layer of the world
            const int lowest = tile.begin[axis] == 1 ? 0 : tile.begin[axis];
            const int dims = world.grid.dims[axis];
            const int highest = tile.end[axis] == dims - 1 ? dims : tile.end[axis];
            begin[axis] = std::min(begin[axis], lowest);
            end[axis] = std::max(end[axis], highest);
        }
    }
    if (glm::any(glm::greaterThanEqual(begin, end)))
        throw Error(ErrorKind::invalid,
                    o.volume + ": the picture shows no tile of it; choose another --camera");
    tiles = {io::TileShares(world).tiles_in(begin, end).size(), world.tiles.size()};
    return io::read_cells(world, begin, end, o.load.max_memory);
}

volume::VolumeSet read_field(const RenderOptions& o, const std::optional<io::WorldVolume>& world) {
    return world ? volume::VolumeSet{{header_of(*world)}} : read_levels(o.volume);
}

void run(const RenderOptions& o) {
    check_options(o);
    Run run(o, o, all_outputs(o));
    const image::ImageModulePreload preload = image::preload_image_module();
    auto opening = std::async(in_background(), [&o] {
        return std::make_unique<gpu::Device>(gpu::DeviceOptions{
            o.device, o.validation, [](const gpu::DeviceInfo&) { return false; }});
    });
    std::optional<io::WorldVolume> world;
    if (io::is_world(o.volume))
        world.emplace(open_world(o.volume, o.world));
    volume::VolumeSet levels = read_field(o, world);
    Volume& volume = levels.levels.front();
    const readers::Reader sampler = sampler_for(o.sampler, volume);
    Scene scene = run.load();
    if (!o.rsm && !o.relight) // which hold reflected light alone
        make_static(o.volume, volume, scene);
    if (scene::triangle_count(scene) == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to draw");
    std::vector<std::string> warnings;
    const std::optional<medium::Medium> air = medium_of(o.medium, scene, warnings);
    check_air(o, air, volume, run.progress);
    run.warn(warnings);
    warn_of_mismatch(o, scene, levels, run.progress);
    warn_of_lamps(o, scene, run.progress);
    const std::unique_ptr<gpu::Device> device = opening.get();
    run.end_stage("load");

    run.progress.begin("prepare", 0);
    const scene::Frame frame = scene::frame_of(levels.finest());
    const visibility::Visibility visibility(scene, frame);
    std::optional<transfer::Propagated> relit;
    if (o.relight && !o.dry_run) {
        run.end_stage("prepare");
        relit = relight(o, scene, visibility, frame, levels, run);
    }
    reference::PathRules rules = rules_of(volume);
    rules.emitters = rules.emitters && !o.no_emitters;
    const reference::Paths paths(scene, visibility, frame, rules);
    std::optional<visibility::Visibility> hazy; // where surfaces are lit through the air
    std::optional<reference::Paths> dimmed;
    if (air && is_in_air(volume)) {
        hazy.emplace(visibility.in_air(std::make_shared<medium::DarkAir>(*air, frame)));
        dimmed.emplace(scene, *hazy, frame, rules);
    }
    render::ViewSettings view;
    const std::optional<visibility::Visibility> eye = render::eye_of(scene, frame);
    const visibility::Visibility& seen = eye ? *eye : visibility;
    view.camera = choose_camera(o, scene, box_of(levels), seen, frame, view.size);
    view.samples = o.samples;
    view.show = o.show;
    RenderResult result{o, scene, volume, device->info().name, sampler_name(sampler), view};
    result.relit = std::move(relit);
    if (world && !o.dry_run)
        volume = cells_in_sight(o, *world, view, result.tiles.emplace());
    if (!o.dry_run) {
        const raster::Raster raster(*device, scene, frame, scene::is_asked);
        run.end_stage("prepare");
        const render::LitScene lit{scene, frame, seen, dimmed ? *dimmed : paths};
        const std::optional<volume::VolumeSet> filled = filled_for(sampler, levels);
        const volume::Levels field(levels);
        view.air = air ? &*air : nullptr;
        draw_pictures(
            o, lit, visibility, field,
            [&](const render::ViewSettings& settings) {
                return render::render(lit, filled ? *filled : levels, raster, sampler, settings,
                                      run.progress);
            },
            view, run, result);
        const image::Pixels& drawn = result.rendering.picture;
        result.exposure = o.exposure ? *o.exposure : render::automatic_exposure(drawn, view.show);
        compare_models(o, result);
        if (o.reference > 0) {
            view.samples = o.reference;
            result.reference = render::trace_picture(lit, view, run.progress);
            const image::Pixels& traced = result.reference->picture;
            result.error = render::compare_pictures(drawn, traced);
            result.flip = render::flip(displayed(o, drawn, result.exposure),
                                       displayed(o, traced, result.exposure));
            run.end_stage("reference");
        }
        write_pictures(o, run, result);
    }
    device->check_validation();
    run.progress.end();
    if (o.format == Format::json)
        print_json_result(result, run);
    else
        print_text_result(result, run);
}

options::Action declare(options::Options& options) {
    const auto fields = std::make_shared<RenderOptions>();
    RenderOptions& o = *fields;
    add_scene_option(options, o);
    options.text(
        "volume", o.volume, "VOLUME",
        "Volume of bake or reference, " + io::format_list()
            + ", or the .levels.json of nested ones, the .volumes.json of ones beside each "
              "other, the .world.json of tiles; default: that of the scene's .glb");
    options
        .texts("-o,--output", o.outputs, "FILE", "Picture to write, .png or .exr; may be repeated")
        .keep_to_one_run();
    add_scenario_option(options, o.world);
    add_light_options(options, o);

    options.group("View");
    options.value("--camera", o.camera, "CAMERA", parse_camera, "See below");
    options.value("--size", o.size, "WIDTHxHEIGHT", parse_size,
                  "Pixels; default: 960x540, or 540 high in the camera's aspect");
    options.number("--samples", o.samples, 1, 65536,
                   "Samples of each pixel, spread over its square");
    options.choice("--show", o.show, options::choices_named<render::Show>(show_names), "See below");
    add_sampler_option(options, o.sampler);

    options.group("Relight");
    options.choice(
        "--relight", o.relight, options::Choices<bool>{{"off", false}, {"lrt", true}},
        "lrt: instead of the volume's field what its operators (bake --local-transfer) make "
        "of the scene's lights, sky and emission; see below");
    options
        .number("--iterations", o.iterations, 1, 1e5,
                "Hops of light from cell to cell; default: until 0.1 % of it is to come")
        .need("relight");

    add_medium_options(options, o.medium, "Fog before what is seen");
    options
        .value("--fog-method", o.fog, "exact|march:N|nvidia[:BOOST]", parse_fog_method,
               "exact: lit parts of each ray in closed form; march:N: N steps with shadow rays, as "
               "programs do; nvidia: directional lights by the passes of NVIDIA's VolumeLight, and "
               "how wrong that is beside exact",
               "exact")
        .need("medium");

    options.group("Indirect light");
    options.value(
        "--indirect", o.rsm, "volume|rsm:N", parse_indirect,
        "volume: the field; rsm:N: instead of it the first reflection of punctual lights, "
        "by N texels of each reflective shadow map a pixel, as programs without a bake do; "
        "see below",
        "volume");
    options
        .value("--vpl-visibility", o.rsm_visible, "none|ssdo:SAMPLES,RADIUS,THICKNESS|rays",
               parse_visibility,
               "Which texels light a pixel: all; those that the picture's depths hide in none of "
               "SAMPLES places up to RADIUS metres on the way, where what is seen is THICKNESS "
               "thick; or those that rays reach",
               "rays")
        .need("indirect");
    options
        .choice("--compare", o.compare_rays,
                options::Choices<bool>{{"none", false}, {"rays", true}},
                "rays: tell how wrong --vpl-visibility is beside rays")
        .need("indirect");

    options.group("Picture");
    options.value("--exposure", o.exposure, "EV|auto", parse_exposure, "Of a .png", "auto");
    options.choice("--tone-map", o.tone_map,
                   options::Choices<render::ToneMap>{{"neutral", render::ToneMap::neutral},
                                                     {"none", render::ToneMap::none}},
                   "Of a .png");
    options.number("--reference", o.reference, 0, 1e6,
                   "Paths of each pixel to compare the picture with; 0: none");
    options
        .texts("--reference-output", o.reference_outputs, "FILE",
               "Path-traced picture to write, .png or .exr; may be repeated")
        .need("reference")
        .keep_to_one_run();
    add_device_option(options, o);
    options.flag("--validation", o.validation,
                 "Load Vulkan's validation layer; messages are errors");
    add_dry_run_option(options, o, "Print camera and size, and draw nothing");
    add_run_options(options, o);
    return [fields] {
        if (fields->volume.empty() && io::volume_format(fields->scene)
            && io::has_light_volume(fields->scene))
            fields->volume = fields->scene;
        run(*fields);
    };
}

} // namespace

options::Command render_command() {
    return {"render", "Draws a scene lit by a volume, as an engine shows it.", manual, declare};
}

} // namespace lpvbake::cmd
