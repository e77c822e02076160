#include "bake/lighting.h"

#include "bake/cached.h"
#include "lpvbake/error.h"
#include "scene/lights.h"
#include "scene/sky.h"
#include "text.h"
#include "visibility/backs.h"
#include "volume/light_content.h"
#include "volume/volume.h"

#include <algorithm>

namespace lpvbake::bake {
namespace {

void warn_of_backs(const Scene& scene, const visibility::Visibility& visibility,
                   const scene::Frame& frame, solver::Stages& stages) {
    for (const Light& light : scene.lights)
        if (const double backs = visibility::share_of_backs(visibility, light, frame); backs > 0.25)
            stages.warn(format(
                "light '%s': %.0f %% of its first hits are backs of single-sided surfaces, which "
                "are black; `cull_backfaces` lets light pass them",
                light.name.c_str(), 100.0 * backs));
}

} // namespace

std::vector<scene::LightLayer> layers_in(const BakePlan& plan) {
    std::vector<scene::LightLayer> layers;
    for (const Layer& layer : plan.settings.layers)
        layers.push_back(layer.light);
    return layers;
}

surface::LightingSettings lighting_of(const BakePlan& plan) {
    surface::LightingSettings lighting;
    lighting.bounces = plan.settings.bounces;
    lighting.emitters = plan.emitters;
    lighting.maps = plan.maps.count > 0;
    lighting.rays = plan.settings.solver.lighting_rays();
    lighting.cache = plan.settings.scattering ? nullptr : plan.settings.cache; // it knows no air
    return lighting;
}

LitOrigin lit_origin(const BakePlan& plan, const visibility::Visibility& visibility) {
    LitOrigin origin = plan.settings.lit_origin;
    origin.tracer = visibility.tracer();
    return origin;
}

visibility::Visibility open_visibility(const Scene& scene, const BakePlan& plan,
                                       const gpu::Device& device) {
    visibility::Visibility visibility(scene, plan.frame, plan.settings.isa);
    return plan.settings.rays == Rays::device ? on_device(visibility, device)
                                              : std::move(visibility);
}

visibility::Visibility open_scene(const Scene& scene, const BakePlan& plan,
                                  const gpu::Device& device, solver::Stages& stages) {
    stages.begin("visibility");
    visibility::Visibility visibility = open_visibility(scene, plan, device);
    if (plan.settings.cache)
        plan.settings.cache->set_world(world_key(scene, plan.frame, visibility));
    warn_of_backs(scene, visibility, plan.frame, stages);
    stages.end(counted(plan.triangles, "triangle")
               + (visibility.batch() > 0 ? ", rays by the device" : ""));
    return visibility;
}

surface::LitSurfaces light_scene(const Scene& scene, const BakePlan& plan,
                                 const visibility::Visibility& visibility, solver::Stages& stages,
                                 std::span<const scene::LightLayer> layers) {
    surface::LitSurfaces lit;
    if (plan.lit) {
        const std::string& file = plan.settings.lit;
        stages.begin("lighting");
        lit = file.empty() ? surface::light_surfaces(scene, visibility, plan.frame,
                                                     lighting_of(plan), stages.progress(), layers)
                           : read_lit(file, lit_origin(plan, visibility), scene, visibility);
        if (lit.layer_count != layers.size())
            throw Error(ErrorKind::invalid,
                        file
                            + ": has the light of other layers; light the scene "
                              "again");
        stages.end(counted(lit.patches.size(), "patch", "patches") + ", "
                   + counted(uint64_t(lit.bounces), "reflection")
                   + (file.empty() ? "" : ", of " + file));
        if (lit.narrow > 0.05)
            stages.warn(
                format("%.3g %% of the light of lamps and suns falls on spots smaller than a "
                       "quarter of a cell: cells show where its reflection comes from, but not "
                       "the spots; a higher `resolution` does",
                       100.0 * lit.narrow));
        if (lit.lost > 0.001)
            stages.warn(
                format("%.2g %% of the light of lamps and suns is lost where surfaces lie on "
                       "each other",
                       100.0 * lit.lost));
        if (lit.residual > 0.01)
            stages.warn(format("%s: %.2g %% of the light is missing after %d reflections; set "
                               "`max_albedo` lower",
                               scene.path.c_str(), 100.0 * lit.residual, lit.bounces));
    }
    return lit;
}

surface::LitPart light_part(const Scene& scene, const BakePlan& plan,
                            const visibility::Visibility& visibility, volume::Shard shard,
                            solver::Stages& stages) {
    stages.begin("lighting");
    surface::LitPart part = surface::light_part(scene, visibility, plan.frame, lighting_of(plan),
                                                shard.index, shard.count, stages.progress());
    stages.end(counted(part.rays.lux.size(), "element") + " of "
               + counted(part.elements.size(), "element"));
    return part;
}

void describe_light(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                    const visibility::Visibility& visibility, Volume& volume) {
    volume.metadata["solver"] = plan.settings.solver.kind().name;
    volume::LightContent content = volume::content_of(!scene.lights.empty(), plan.emitters,
                                                      scene::has_sky(scene), plan.settings.bounces);
    const std::vector<std::string> statics = scene::static_names(scene);
    volume::add_statics(statics, statics.size() == scene.lights.size(), plan.settings.bounces,
                        content);
    volume::set_content(content, volume.metadata);
    volume.metadata["bounces"] =
        plan.settings.bounces ? std::to_string(*plan.settings.bounces) : "inf";
    volume.metadata["device"] = recorded_name(device.info());
    volume.metadata["tracer"] = visibility.tracer();
}

void describe_layer(const BakePlan& plan, const Layer& layer, const Volume& whole, Volume& volume) {
    volume.metadata = whole.metadata;
    for (const char* of_whole : {"local_transfer", "local_radius", "local_surfaces"})
        volume.metadata.erase(of_whole);
    const auto any = [](const std::vector<glm::vec3>& weights) {
        return std::ranges::any_of(weights, [](glm::vec3 w) { return w != glm::vec3(0.0f); });
    };
    volume::LightContent content = volume::content_of(
        any(layer.light.lights), any(layer.light.emissions),
        layer.light.sky != glm::vec3(0.0f) || layer.light.beyond, plan.settings.bounces);
    if (layer.light.part == scene::LightLayer::Part::direct)
        content.sky->last = 0;
    if (layer.light.part == scene::LightLayer::Part::reflected)
        content.sky = plan.settings.bounces == 0
                          ? std::nullopt
                          : std::optional(volume::Reflections{1, plan.settings.bounces});
    volume::set_content(content, volume.metadata);
    volume.metadata["layer"] = layer.name;
}

void warn_of_dark(const Scene& scene, std::span<const Volume> volumes, solver::Stages& stages) {
    const auto is_dark = [](const Volume& volume) { return volume::total_energy(volume) == 0.0; };
    if (std::ranges::all_of(volumes, is_dark))
        stages.warn(scene::why_dark(scene));
}

void warn_of_empty(std::span<const volume::Adjustment> boxes, std::span<const Grid> grids,
                   solver::Stages& stages) {
    for (std::size_t i = 0; i < boxes.size(); ++i)
        if (std::ranges::none_of(
                grids, [&](const Grid& grid) { return volume::holds_cells(boxes[i], grid); }))
            stages.warn(format("`adjust`: no cell lies in boxes[%zu], %s; it changes nothing", i,
                               volume::text_of({&boxes[i], 1}).c_str()));
}

} // namespace lpvbake::bake
