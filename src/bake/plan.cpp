#include "bake/plan.h"

#include "background.h"
#include "bake/air.h"
#include "bake/direct.h"
#include "bake/surface_fit.h"
#include "gpu/rays.h"
#include "lpvbake/error.h"
#include "machine.h"
#include "scene/light_view.h"
#include "scene/lights.h"
#include "solver/models.h"
#include "solver/vpl/cascades.h"
#include "text.h"
#include "transfer/local.h"
#include "visibility/around.h"
#include "volume/grids.h"
#include "volume/points.h"
#include "volume/sh.h"
#include "volume/volume.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake::bake {
namespace {

namespace seconds = solver::models::seconds;
namespace bytes = solver::models::bytes;

std::string dims_text(glm::ivec3 dims) {
    return format("a grid of %d x %d x %d", dims.x, dims.y, dims.z);
}

/// Warns where a few far triangles set most of the grid's size, as those of a plain around a town.
void warn_of_empty_bounds(const SceneFacts& scene, std::vector<std::string>& warnings) {
    const auto& [lo, hi] = scene.crowd;
    const glm::dvec3 size = scene.bounds.hi - scene.bounds.lo, kept = hi - lo;
    const double longest = std::max({size.x, size.y, size.z});
    for (int axis = 0; axis < 3; ++axis)
        if (size[axis] > 0.5 * longest && kept[axis] < 0.5 * size[axis]) {
            warnings.push_back(
                format("%s: 1 %% of the triangles set over half of the bounds; the others' are "
                       "`bounds` %.6g,%.6g,%.6g,%.6g,%.6g,%.6g",
                       scene.path.c_str(), lo.x, lo.y, lo.z, hi.x, hi.y, hi.z));
            return;
        }
}

/// The largest resolution at which the same box fits the device.
int largest_resolution(const Bounds& box, const BakeSettings& settings, uint64_t memory) {
    const solver::SolverSettings& solver = settings.solver;
    const std::size_t layers = settings.layers_level > 0 ? 0 : settings.layers.size();
    int fits = 0;
    for (int low = 3, high = 2048; low <= high;) {
        const int middle = (low + high) / 2;
        const Grid grid = volume::fit_grid(box.lo, box.hi, {middle, 0.0, settings.grid.margin});
        if (solver.kind().device_bytes(grid, solver, layers) <= memory) {
            fits = middle;
            low = middle + 1;
        } else {
            high = middle - 1;
        }
    }
    return fits;
}

Bounds box_of(const Grid& grid) {
    const volume::GridBox box = volume::box_of(grid);
    return {box.lo, box.hi};
}

/// Warns of lights so far outside of the scene that hardly any of their light arrives, as one has
/// that was placed in centimetres.
void warn_of_far_lights(const SceneFacts& scene, std::vector<std::string>& warnings) {
    const auto& [lo, hi] = scene.bounds;
    const double size = glm::length(hi - lo);
    for (const Light& light : scene.lights) {
        const glm::dvec3 at(light.position);
        const double away = glm::length(at - glm::clamp(at, lo, hi));
        if (light.type != LightType::directional && away > 10 * size)
            warnings.push_back(
                about(scene.path,
                      format("the light \"%s\" is %.3g m outside of the scene, which is %.3g m "
                             "large: hardly any of its light arrives; are these metres?",
                             light.name.c_str(), away, size)));
    }
}

/// What to do where levels, or volumes beside each other, are too many cells.
const char* less_of_levels(const BakeSettings& settings) {
    if (!settings.volumes.empty())
        return "give that `volume` larger cells or a smaller box";
    return settings.levels.front().made
               ? "use a larger `cell_size`, a smaller `focus` or more `levels`"
               : "give a `level` larger cells or a smaller box";
}

/// Of nested levels, or volumes beside each other.
void plan_grids(BakePlan& plan) {
    BakeSettings& settings = plan.settings;
    const std::vector<Grid> grids = settings.volumes.empty()
                                        ? volume::nest_grids(settings.levels)
                                        : volume::place_grids(settings.volumes);
    plan.grid = grids.front();
    plan.frame = scene::frame_of(plan.grid);
    if (plan.grid.is_turned()) { // the scene is lit along the axes
        const Bounds box = box_of(plan.grid);
        plan.frame = {box.lo, plan.grid.cell, (box.hi - box.lo) / plan.grid.cell};
    }
    plan.coarser.assign(grids.begin() + 1, grids.end());
    for (const Grid& grid : plan.coarser) {
        const Bounds box = box_of(grid);
        plan.frame.coarser.push_back({glm::vec3(plan.frame.from_world(box.lo)),
                                      glm::vec3(plan.frame.from_world(box.hi)),
                                      float(grid.cell / plan.grid.cell)});
    }
}

/// Bricks that stand on a unit of their area (a face of 8 x 8 cells), measured: surfaces cross the
/// places of more bricks than their area has, and around them are coarser ones.
constexpr double bricks_a_face = 3.5;

void plan_bricks(const SceneFacts& scene, BakePlan& plan) {
    const AdaptiveSettings& adaptive = *plan.settings.adaptive;
    BrickPlan& bricks = plan.bricks.emplace();
    bricks.box = plan.settings.bounds.value_or(
        Bounds{scene.bounds.lo - adaptive.fine, scene.bounds.hi + adaptive.fine});
    const auto& [lo, hi] = bricks.box;
    bricks.levels = volume::brick_levels(adaptive.fine, adaptive.coarse, lo, hi);
    plan.grid = bricks.levels.finest;
    plan.frame = scene::frame_of(plan.grid);
    // What is beyond the box is not refined.
    plan.frame.extent = glm::min(plan.frame.extent, glm::ceil((hi - lo) / adaptive.fine) + 1.0);
    const double inside = surface::count_patches(scene.surfaces, plan.frame, 1.0f).inside;
    const auto count = [&](int level) {
        const glm::dvec3 places(bricks.levels.places(level));
        return places.x * places.y * places.z;
    };
    const double roots = count(bricks.levels.count - 1);
    bricks.expected = uint64_t(std::min(count(0) * 8 / 7, roots + bricks_a_face * inside / 64) + 1);
    const int order = plan.settings.solver.order();
    const uint64_t bytes = brick_numbers(order) * uint64_t(adaptive.number_bytes);
    bricks.most = adaptive.size ? *adaptive.size / bytes : std::numeric_limits<uint32_t>::max();
    if (double(bricks.most) < roots)
        throw Error(ErrorKind::argument,
                    format("`max_size`: the %.0f coarsest bricks alone are %.1f MiB of numbers; "
                           "use %.0f or more bytes, or larger coarsest cells",
                           roots, roots * double(bytes) / 0x1p20, roots * double(bytes)));
    bricks.expected = std::max(bricks.expected, uint64_t(roots));
}

/// How many places the solver is given; 0: it is a grid.
uint64_t places_of(const BakePlan& plan) {
    return plan.bricks ? plan.bricks->expected * volume::brick_samples : plan.settings.points;
}

bool is_apart(const Bounds& box, const Bounds& scene) {
    return glm::any(glm::greaterThan(box.lo, scene.hi))
           || glm::any(glm::lessThan(box.hi, scene.lo));
}

/// Of volumes beside each other each should meet the scene.
void warn_of_boxes_apart(const SceneFacts& scene, BakePlan& plan) {
    const std::vector<Grid> grids = grids_in(plan);
    for (std::size_t i = 0; i < plan.settings.volumes.size(); ++i)
        if (is_apart(box_of(grids[i]), scene.bounds))
            plan.warnings.push_back(about(scene.path, "`volume` "
                                                          + plan.settings.volumes[i].place.name
                                                          + " does not meet the scene's surfaces"));
}

/// Throws Error (argument) where there is nothing left of the grid.
Grid layers_grid(const Grid& grid, int level) {
    Grid coarse = grid;
    const int times = 1 << level;
    coarse.cell *= times;
    coarse.dims = (grid.dims + times - 1) / times;
    if (std::max({coarse.dims.x, coarse.dims.y, coarse.dims.z}) < 3)
        throw Error(ErrorKind::argument,
                    format("`layers_level` %d: %s leaves the layers one of %d x %d x %d; use a "
                           "lower one",
                           level, dims_text(grid.dims).c_str(), coarse.dims.x, coarse.dims.y,
                           coarse.dims.z));
    return coarse;
}

void fit(const SceneFacts& scene, const gpu::DeviceInfo& device, BakePlan& plan) {
    const BakeSettings& settings = plan.settings;
    const solver::SolverSettings& solver = settings.solver;
    const auto& [lo, hi] = scene.bounds;
    const bool several = !settings.levels.empty() || !settings.volumes.empty();
    if (several)
        plan_grids(plan);
    if (settings.adaptive)
        plan_bricks(scene, plan);
    warn_of_boxes_apart(scene, plan);
    const Bounds box =
        plan.coarser.empty() ? settings.bounds.value_or(scene.bounds) : box_of(plan.coarser.back());
    if (!settings.bounds && settings.points == 0 && !several)
        warn_of_empty_bounds(scene, plan.warnings);
    if (settings.volumes.empty() && is_apart(box, scene.bounds))
        plan.warnings.push_back(
            about(scene.path, format("`bounds` do not meet the scene's, %.6g,%.6g,%.6g to "
                                     "%.6g,%.6g,%.6g",
                                     lo.x, lo.y, lo.z, hi.x, hi.y, hi.z)));
    if (!several && !settings.adaptive) {
        plan.grid = volume::fit_grid(box.lo, box.hi, settings.grid);
        plan.frame = scene::frame_of(plan.grid);
    }
    if (settings.layers_level > 0)
        plan.layers_grid = layers_grid(plan.grid, settings.layers_level);
    for (const auto& [grid, layers] : solved_in(plan)) {
        plan.device_bytes =
            std::max(plan.device_bytes, solver.kind().device_bytes(grid, solver, layers));
        const bool of_layers = layers > 0 && plan.layers_grid;
        if (plan.device_bytes > device.memory && (several || of_layers))
            throw Error(ErrorKind::memory,
                        dims_text(grid.dims)
                            + format(" needs %s of %s's %s; %s",
                                     memory_text(double(plan.device_bytes)).c_str(),
                                     device.name.c_str(),
                                     memory_text(double(device.memory)).c_str(),
                                     of_layers ? "give the layers a higher `layers_level`"
                                               : less_of_levels(settings)));
    }
    if (plan.device_bytes > device.memory)
        throw Error(ErrorKind::memory,
                    dims_text(plan.grid.dims)
                        + format(" needs %s of %s's %s; the largest that fits is "
                                 "`resolution` %d",
                                 memory_text(double(plan.device_bytes)).c_str(),
                                 device.name.c_str(), memory_text(double(device.memory)).c_str(),
                                 largest_resolution(box, settings, device.memory)));
}

void skip(BakePlan& plan, const char* name, const char* why) {
    plan.skipped.push_back({name, why});
}

/// Which kinds of light there are.
void plan_light(const SceneFacts& scene, BakePlan& plan) {
    if (scene.lights.empty())
        skip(plan, "punctual lights", "none");
    if (!plan.emitters)
        skip(plan, "emitters", plan.settings.emitters ? "none in the scene" : "left out");
    if (!scene.sky)
        skip(plan, "sky", "none");
}

constexpr double lit_patch_seconds = 5e-7; ///< of a file; it is read and checked

/// Who traces rays, and what that takes of a device. Throws Error (device, memory).
void plan_rays(const SceneFacts& scene, const gpu::DeviceInfo& device, BakePlan& plan) {
    Rays& rays = plan.settings.rays;
    const bool chosen = rays == Rays::automatic;
    const bool gathers = plan.settings.solver.kind().name == std::string_view("gather");
    rays = available(rays, device, gathers, scene.triangles);
    if (!plan.lit) // nothing sends many
        rays = Rays::embree;
    if (rays == Rays::embree)
        return;
    const auto bytes = gpu::RayTracer::bytes(device, scene.triangles, threads_at_work());
    // Of boxes that are turned there is one more structure, of the scene in their axes.
    const uint64_t structures = std::ranges::any_of(grids_in(plan), &Grid::is_turned) ? 2 : 1;
    const uint64_t taken = structures * bytes.device + std::max(bytes.building, plan.device_bytes);
    if (taken > device.memory && chosen) {
        rays = Rays::embree;
        return;
    }
    if (taken > device.memory)
        throw Error(ErrorKind::memory,
                    format("`rays` device: with %s a bake needs %s of %s's %s; `rays` embree needs "
                           "%s",
                           counted(scene.triangles, "triangle").c_str(),
                           memory_text(double(taken)).c_str(), device.name.c_str(),
                           memory_text(double(device.memory)).c_str(),
                           memory_text(double(plan.device_bytes)).c_str()));
    plan.device_bytes = taken;
    plan.host_bytes += structures * bytes.host;
}

/// How all surfaces are lit.
void plan_lighting(const SceneFacts& scene, const surface::PatchCount& surfaces, BakePlan& plan) {
    if (!plan.lit) {
        skip(plan, "lighting", "maps alone hold one reflection of punctual lights");
        return;
    }
    const std::optional<int> bounces = plan.settings.bounces;
    const bool reflected = bounces != 0, between = reflected && bounces != 1;
    const double wanted = double(plan.settings.solver.lighting_rays()), patches = surfaces.patches;
    // Of each layer: the light of both sides, of lamps, and what elements reflect.
    const double layers = double(plan.settings.layers.size());
    if (const std::string& file = plan.settings.lit; !file.empty()) {
        plan.host_bytes += uint64_t((layers * 2 * 12 + bytes::patch) * patches);
        plan.stages.push_back({"lighting", lit_patch_seconds * patches,
                               format("about %.2g patches, of ", patches) + file});
        return;
    }
    // Patches of large triangles share an element by about five; small ones are no more elements
    // than what they cover.
    const double elements = std::min(patches / 5.0, 3.0 * surfaces.faces);
    const double rays = reflected && (plan.emitters || scene.sky || between)
                            ? std::clamp(wanted, 32.0 * elements, 256.0 * elements)
                            : 0.0;
    if (between) // what they meet is kept
        plan.host_bytes += uint64_t(rays) * (bytes::hit + (scene.tinted ? bytes::tint : 0));
    plan.host_bytes +=
        uint64_t(layers * (4 * patches * 12 + elements * (3 * 12 + 24)))
        + uint64_t(patches * (bytes::patch + (scene.lights.empty() ? 0 : bytes::patch_lamps)));
    std::string light = scene.lights.empty() || !reflected ? "" : "punctual lights";
    for (const auto& [there, what] : {std::pair{plan.emitters, "emitters"}, {scene.sky, "sky"}})
        if (there)
            light += (light.empty() ? "" : ", ") + std::string(what);
    plan.stages.push_back(
        {"lighting",
         seconds::lighting + seconds::lighting_patch * patches
             + seconds::lighting_triangle * double(plan.triangles)
             + seconds::lighting_light * double(scene.lights.size())
             + seconds::lighting_ray * rays * (1 + seconds::lighting_layer * layers),
         format("about %.2g patches; ", patches) + light
             + (!bounces        ? "; all reflections from patch to patch"
                : *bounces == 0 ? "; no reflections"
                : *bounces == 1 ? "; one reflection"
                                : format("; %d reflections from patch to patch", *bounces))});
    if (reflected && !between)
        skip(plan, "light between patches", "one reflection needs none");
}

/// Reflective shadow maps of `size` texels along a side; 0: the solver wants none.
void plan_maps(const SceneFacts& scene, int size, BakePlan& plan) {
    if (size == 0) {
        skip(plan, "rsm", "rays light the patches, not maps");
        return;
    }
    if (scene.lights.empty() || plan.settings.bounces == 0) {
        skip(plan, "rsm", "no punctual light to reflect");
        return;
    }
    plan.maps.size = size;
    const glm::dvec3 lo = plan.frame.from_world(scene.bounds.lo);
    const glm::dvec3 hi = plan.frame.from_world(scene.bounds.hi);
    double texels = 0;
    for (const Light& light : scene.lights)
        for (const scene::RsmView& view : scene::views_of(light, plan.frame, lo, hi)) {
            ++plan.maps.count;
            for (const solver::vpl::Cascade& cascade :
                 solver::vpl::cascades_of(view, plan.frame, size))
                texels += solver::vpl::texels_of(cascade);
        }
    plan.stages.push_back(
        {"rsm",
         seconds::maps + seconds::maps_texel * texels
             + seconds::maps_triangle * double(plan.triangles) * plan.maps.count,
         format("%s, %s of %d x %d", counted(scene.lights.size(), "light").c_str(),
                counted(uint64_t(plan.maps.count), "map").c_str(), size, size)});
}

/// How many beams a grid's lights send.
double count_beams(std::span<const Light> lights, const Grid& grid, int per_cell) {
    const glm::dvec3 dims(grid.dims);
    const double face = (dims.x * dims.y + dims.y * dims.z + dims.z * dims.x) / 3;
    double beams = 0;
    for (const Light& light : lights)
        beams +=
            (light.type == LightType::directional ? 1.5 : 6) * double(per_cell) * per_cell * face;
    return beams;
}

/// Of a sphere that is much larger than the grid, next to no beam would meet that.
void check_lamps(std::span<const Light> lights, const Grid& grid, const DirectSettings& direct) {
    const double most = 2 * grid.cell * glm::length(glm::dvec3(grid.dims));
    for (const Light& light : lights)
        if (const double radius = medium::radius_of(light, direct.lamp_radii); radius > most)
            throw Error(ErrorKind::argument,
                        format("`lamp_radius`: the light \"%s\" would be a sphere of %.4g m, more "
                               "than twice as large as the grid; %.4g m is the most",
                               light.name.c_str(), radius, most));
}

/// Light crosses so many mean free paths of a medium, at most, on the shortest way through the
/// middle of its box.
double depth_of(const medium::Medium& air) {
    const glm::dvec3 middle = 0.5 * (air.box.lo + air.box.hi), extinction = air.extinction();
    double least = HUGE_VAL;
    for (int axis = 0; axis < 3; ++axis) {
        glm::dvec3 from = middle, to = middle;
        from[axis] = air.box.lo[axis];
        to[axis] = air.box.hi[axis];
        least = std::min(least, air.column(from, to));
    }
    return least * std::max({extinction.r, extinction.g, extinction.b});
}

constexpr double most_depth = 10; ///< of light that is scattered until nothing is missing

/// What is scattered more than once.
void check_scattering(bool statics, const BakeSettings& settings) {
    if (!settings.scattering)
        return;
    const auto refuse = [](const std::string& text) { throw Error(ErrorKind::argument, text); };
    if (!settings.medium)
        refuse("`scattering` needs a `medium`");
    if (!settings.solver.kind().in_air)
        refuse("`scattering` is of `solver` sn");
    if (statics)
        refuse("`scattering` is without `static` lights: all light in the field is attenuated");
    if (settings.points > 0 || settings.adaptive || !settings.layers.empty()
        || !settings.levels.empty() || !settings.volumes.empty() || settings.fit
        || settings.local_transfer.wanted)
        refuse("`scattering` is of one grid, without `fit`, `layers` and local transfer");
    if (const double depth = depth_of(*settings.medium);
        !settings.scattering->times && depth > most_depth)
        throw Error(ErrorKind::invalid,
                    format("light crosses %.3g mean free paths of the `medium`, and is scattered "
                           "too often to be followed to the end; give a number by `scattering`, or "
                           "%.2g times the medium",
                           depth, most_depth / depth));
}

/// About how often light is scattered before next to nothing of it is left.
int expected_orders(const BakeSettings& settings) {
    const double depth = depth_of(*settings.medium);
    const int all = int(std::ceil(3 + 2.6 * std::min(depth, most_depth)));
    return settings.scattering->times ? std::min(*settings.scattering->times - 1, all) : all;
}

/// Each order is lit and solved as the field was.
void plan_scattering(const solver::Cost& cost, BakePlan& plan) {
    if (!plan.settings.scattering || plan.settings.scattering->times == 1)
        return;
    double seconds = 0;
    for (const StageReport& stage : plan.stages)
        seconds += stage.name == "lighting" ? stage.seconds : 0;
    for (const StageReport& stage : cost.stages)
        seconds += stage.name == "walls" ? 0 : stage.seconds;
    const int orders = expected_orders(plan.settings);
    plan.stages.push_back({"scattering", orders * seconds, format("about %d orders", orders)});
    plan.host_bytes +=
        plan.grid.size() * (plan.settings.medium->g == 0 ? 12 : 108)
        + 24 * plan.grid.size() * uint64_t(volume::sh_count(plan.settings.solver.order()));
}

/// What air scatters in a grid.
void plan_air(const SceneFacts& scene, const Grid& grid, const std::string& of, BakePlan& plan) {
    if (!plan.settings.medium)
        return;
    const medium::Medium& air = *plan.settings.medium;
    if (grid.is_turned())
        throw Error(ErrorKind::unsupported,
                    "`medium` is of grids along the axes, not of turned volumes");
    const double beams = count_beams(scene.lights, grid, plan.settings.direct.beams);
    check_lamps(scene.lights, grid, plan.settings.direct);
    const glm::dvec3 lost = air.extinction();
    const bool is_plain = air.is_even() && lost.x == lost.y && lost.y == lost.z;
    plan.stages.push_back(
        {"air",
         seconds::beam * beams
             + (is_plain ? seconds::beam_air_cell : seconds::beam_uneven_cell) * beams
                   * std::cbrt(double(grid.size()))
             + seconds::air_cell * double(grid.size()),
         of + format("about %.2g beams of ", beams) + counted(scene.lights.size(), "light")});
    const auto coefficients =
        uint64_t(air.g == 0 ? 1 : volume::sh_count(plan.settings.solver.order()));
    plan.host_bytes += grid.size() * (bytes::beams_cell + 48 * coefficients + 24)
                       + (air.density ? 4 * uint64_t(air.density->values.size()) : 0);
}

/// The map of a directional light that is closed for shafts: a disc's radius, and how many texels
/// it has along an edge.
struct ShaftMap {
    double radius, edge;
};

ShaftMap shaft_map(const Grid& grid, const DirectSettings& direct) {
    const double extent = std::cbrt(double(grid.size())) * direct.beams;
    const double radius = std::min(direct.shaft_closing / grid.cell * direct.beams, 1.7 * extent);
    return {radius, 1.2 * extent + 4 * radius};
}

/// What closing the maps of shafts takes, seconds.
double shaft_seconds(std::span<const Light> lights, const ShaftMap& map) {
    double sum = 0;
    for (const Light& light : lights)
        sum += light.type == LightType::directional
                   ? seconds::shaft_texel * 2 * map.edge * map.edge * map.radius
                   : seconds::shaft_lamp;
    return sum;
}

/// Beams through a grid, and what they sum.
void plan_direct(const SceneFacts& scene, const Grid& grid, const std::string& of, BakePlan& plan) {
    const DirectSettings& direct = plan.settings.direct;
    const uint64_t count = beamed_lights(scene.lights, direct);
    if (count == 0) {
        if (direct.any())
            skip(plan, "beams", "no punctual light");
        return;
    }
    std::vector<Light> sending;
    std::ranges::copy_if(scene.lights, std::back_inserter(sending),
                         [&](const Light& light) { return direct.any() || light.is_static; });
    check_lamps(sending, grid, direct);
    const ShaftMap map = shaft_map(grid, direct);
    const double beams = count_beams(sending, grid, direct.beams) * (direct.shaft ? 3 : 1);
    plan.stages.push_back({"beams",
                           seconds::beam * beams
                               + seconds::beam_cell * beams * std::cbrt(double(grid.size()))
                               + (direct.shaft ? shaft_seconds(sending, map) : 0),
                           of + format("about %.2g beams of ", beams) + counted(count, "light")});
    const auto coefficients =
        uint64_t(direct.sh || !direct.any() ? volume::sh_count(plan.settings.solver.order()) : 1);
    plan.host_bytes += grid.size()
                       * (bytes::beams_cell + 24 * coefficients
                          + 4 * uint64_t(direct.visibility ? scene.lights.size() : 0)
                          + (direct.channels ? 17 : 0) + (direct.shaft ? 40 : 0));
    if (direct.shaft)
        plan.host_bytes += uint64_t(16 * map.edge * map.edge);
}

/// Rays from each cell, and grids.
void plan_local_transfer(const Grid& grid, const std::string& of, BakePlan& plan) {
    const LocalTransferSettings& settings = plan.settings.local_transfer;
    if (!settings.wanted)
        return;
    plan.stages.push_back({"local transfer",
                           seconds::local_ray * transfer::local_rays * double(grid.size()),
                           of
                               + format("%d rays of %.4g m from each cell", transfer::local_rays,
                                        settings.radius_of(grid.cell))});
    // 16 operators in RGB and 9 numbers, and a copy where they are written more than once.
    plan.host_bytes += 2 * 4 * (16 * 3 + 9) * uint64_t(grid.size());
}

/// Points of surfaces, rays from each, and the solution.
void plan_fit(const surface::PatchCount& surfaces, const std::string& of, BakePlan& plan) {
    const readers::Reader* reader = plan.settings.fit;
    if (!reader)
        return;
    const SurfaceFitSettings fit;
    const double points = std::min(fit.density * surfaces.inside, double(fit.most_points));
    plan.stages.push_back(
        {"fit",
         seconds::fit + seconds::fit_ray * points * rays_a_point(fit, points)
             + seconds::fit_point * points,
         of + format("about %.2g points of surfaces, as %s reads them", points, reader->name)});
    plan.host_bytes += uint64_t(bytes::fit_point * points);
}

/// Sets which layers are baked. Throws Error (argument).
void plan_shard(BakePlan& plan) {
    const std::optional<volume::Shard>& shard = plan.settings.shard;
    if (!shard)
        return;
    const solver::SolverKind& kind = plan.settings.solver.kind();
    const int unit = kind.shard_layers ? kind.shard_layers(plan.settings.solver) : 0;
    if (unit == 0 || kind.map_size(plan.grid, plan.settings.solver) > 0)
        throw Error(ErrorKind::argument,
                    kind.shard_layers && kind.map_size(plan.grid, plan.settings.solver) == 0
                        ? format("`shard`: %s is parted into tiles; set `tile` to 64", kind.name)
                        : "`shard` is of gather without `rsm_samples`, and of sn in tiles");
    if (const int most = volume::most_shards(plan.grid, unit); shard->count > most)
        throw Error(ErrorKind::argument,
                    format("`shard` %d/%d: %d layers of cells along z are %d shards at most, of %d "
                           "layers, which are solved together",
                           shard->index, shard->count, plan.grid.dims.z, most, unit));
    plan.slab = volume::slab_of(*shard, plan.grid, unit);
}

void check_host_memory(const BakePlan& plan) {
    const uint64_t memory = machine_memory();
    if (plan.host_bytes <= memory)
        return;
    if (plan.bricks)
        throw Error(ErrorKind::memory,
                    format("`adaptive` %.6g..%.6g: about %llu bricks need about %s of this "
                           "machine's %s of memory; use larger finest cells or a smaller "
                           "`bounds`",
                           plan.settings.adaptive->fine, plan.settings.adaptive->coarse,
                           (unsigned long long)plan.bricks->expected,
                           memory_text(double(plan.host_bytes)).c_str(),
                           memory_text(double(memory)).c_str()));
    if (plan.settings.points > 0)
        throw Error(ErrorKind::memory,
                    counted(plan.settings.points, "point")
                        + format(" need about %s of this machine's %s of memory; bake "
                                 "them in parts",
                                 memory_text(double(plan.host_bytes)).c_str(),
                                 memory_text(double(memory)).c_str()));
    if (const auto& volumes = plan.settings.volumes; !plan.coarser.empty() || !volumes.empty())
        throw Error(ErrorKind::memory,
                    format("%s about %s of this machine's %s of memory; %s",
                           volumes.empty()       ? "these levels need"
                           : volumes.size() == 1 ? "this volume needs"
                                                 : "these volumes need",
                           memory_text(double(plan.host_bytes)).c_str(),
                           memory_text(double(memory)).c_str(), less_of_levels(plan.settings)));
    const glm::ivec3 dims = plan.grid.dims;
    if (const auto& shard = plan.settings.shard)
        throw Error(ErrorKind::memory,
                    format("`shard` %d/%d of ", shard->index, shard->count) + dims_text(dims)
                        + format(" needs about %s of this machine's %s of memory; part "
                                 "it into more of them",
                                 memory_text(double(plan.host_bytes)).c_str(),
                                 memory_text(double(memory)).c_str()));
    const double fits =
        std::max({dims.x, dims.y, dims.z}) * std::cbrt(double(memory) / double(plan.host_bytes));
    throw Error(ErrorKind::memory,
                dims_text(dims)
                    + format(" needs about %s of this machine's %s of memory; lower "
                             "`resolution`, to about %d%s",
                             memory_text(double(plan.host_bytes)).c_str(),
                             memory_text(double(memory)).c_str(), std::max(3, int(fits)),
                             plan.settings.solver.kind().shard_layers
                                 ? ", or bake it in parts by `shard`"
                                 : ""));
}

/// Of a cell.
uint64_t layer_bytes(const BakeSettings& settings) {
    uint64_t bytes = 0;
    for (const Layer& layer : settings.layers)
        bytes +=
            4
            + 12 * uint64_t(volume::sh_count(layer.light.order.value_or(settings.solver.order())));
    return bytes;
}

} // namespace

uint64_t brick_numbers(int order) { // light, validity, walls, and density for viewers
    return volume::brick_samples * (3 * uint64_t(volume::sh_count(order) + most_walls) + 2);
}

uint64_t brick_bytes(int order) {
    return volume::brick_samples * (12 * uint64_t(volume::sh_count(order) + most_walls) + 4) + 4096;
}

uint64_t sample_bytes(int order) {
    return 12 * uint64_t(volume::sh_count(order)) + 64;
}

BakePlan plan_bake(const SceneFacts& scene, const BakeSettings& settings,
                   const gpu::DeviceInfo& device) {
    const solver::SolverSettings& solver = settings.solver;
    BakePlan plan;
    plan.settings = settings;
    plan.settings.isa = visibility::available(settings.isa);
    plan.warnings = scene.warnings;
    plan.triangles = scene.triangles;
    plan.lights = int(scene.lights.size());
    plan.emitters = settings.emitters && scene.emitters;
    if (settings.direct.visibility && scene.lights.size() > std::size_t(volume::most_visibilities))
        throw Error(ErrorKind::invalid,
                    scene.path
                        + format(": %zu lights, but a volume has the visibility of %d at most; "
                                 "keep `direct` sh alone, or fewer lights",
                                 scene.lights.size(), volume::most_visibilities));
    if (beamed_lights(scene.lights, {}) > 0
        && (settings.points > 0 || settings.adaptive || !settings.layers.empty()))
        throw Error(ErrorKind::argument,
                    "`static` is of grids and levels, not of `at`, `adaptive` and `layers`");
    if (settings.medium && (settings.points > 0 || settings.adaptive || !settings.layers.empty()))
        throw Error(ErrorKind::argument,
                    "`medium` is of grids and levels, not of `at`, `adaptive` and `layers`");
    check_scattering(beamed_lights(scene.lights, {}) > 0, plan.settings);
    if (!settings.local_transfer.object)
        scene::check_light_arrives(scene.path, {.punctual = !scene.lights.empty(),
                                                .emitters = plan.emitters,
                                                .sky = scene.sky,
                                                .statics = beamed_lights(scene.lights, {}) > 0,
                                                .bounces = settings.bounces});
    fit(scene, device, plan);
    plan_shard(plan);
    warn_of_far_lights(scene, plan.warnings);
    for (const Light& light : scene.lights) // its square is a float
        if (light.type != LightType::directional
            && glm::length(light.position - plan.grid.origin) > 1e18 * plan.grid.cell)
            throw Error(ErrorKind::invalid,
                        scene.path + ": the light \"" + light.name
                            + "\" is farther than 1e18 cells from the grid; make "
                              "it a directional one");
    const int map_size = solver.kind().map_size(grids_in(plan).back(), solver);
    plan.lit = map_size == 0 || settings.bounces != 1 || plan.emitters || scene.sky;
    plan_rays(scene, device, plan);

    const surface::PatchCount surfaces =
        surface::count_patches(scene.surfaces, plan.frame, 1.0f, scene.cuts.get());
    const double patches = surfaces.patches;
    const std::vector<Solved> grids =
        settings.surfaces_alone ? std::vector<Solved>{} : solved_in(plan);
    plan_light(scene, plan);
    plan.stages.push_back({"visibility", seconds::visibility_triangle * double(plan.triangles),
                           counted(plan.triangles, "triangle")});
    plan_lighting(scene, surfaces, plan);
    plan_maps(scene, map_size, plan);
    if (settings.points > 0)
        plan.stages.push_back(
            {"around", seconds::look_place * double(settings.points),
             format("%d rays from every point, to backs and to the sky", visibility::looks)});
    uint64_t solver_bytes = 0, all_cells = 0, layered_cells = 0;
    for (std::size_t level = 0; level < grids.size(); ++level) {
        const auto& [grid, layers] = grids[level];
        const Grid own = plan.slab ? volume::grid_of(*plan.slab, grid) : grid;
        solver::Cost cost = solver.kind().cost({grid, patches, plan.lit, plan.maps, places_of(plan),
                                                plan.bricks.has_value(), device.type != "cpu",
                                                layers, plan.slab, scene.two_sided},
                                               solver);
        if (plan.bricks)
            cost.stages.push_back(
                {"walls", seconds::brick_place * double(places_of(plan)),
                 format("of about %llu bricks", (unsigned long long)plan.bricks->expected)});
        else if (places_of(plan) == 0)
            cost.stages.push_back({"walls", seconds::walls_cell * double(own.size()),
                                   "what stands between cells and the points around them"});
        for (StageReport& stage : cost.stages)
            stage.detail = of_level(level, plan) + stage.detail;
        plan.stages.insert(plan.stages.end(), cost.stages.begin(), cost.stages.end());
        if (level == 0)
            plan.skipped.insert(plan.skipped.end(), cost.skipped.begin(), cost.skipped.end());
        plan_scattering(cost, plan);
        plan_air(scene, grid, of_level(level, plan), plan);
        plan_direct(scene, grid, of_level(level, plan), plan);
        plan_local_transfer(grid, of_level(level, plan), plan);
        if (places_of(plan) == 0)
            plan_fit(level == 0
                         ? surfaces
                         : surface::count_patches(scene.surfaces, scene::frame_of(grid), 1.0f),
                     of_level(level, plan), plan);
        // Of coupled ones the outer stay, for the inner to ask.
        solver_bytes = solver.kind().nesting == solver::Nesting::coupled
                           ? solver_bytes + cost.host_bytes
                           : std::max(solver_bytes, cost.host_bytes);
        all_cells += own.size();
        layered_cells += layers > 0 ? grid.size() : 0;
    }
    if (!settings.fit && settings.points == 0)
        skip(plan, "fit", "the field is wanted, not a program's picture of it");
    plan.threads = threads_at_work();
    for (StageReport& stage : plan.stages) {
        stage.seconds *= seconds::of_threads(plan.threads);
        plan.seconds += stage.seconds;
    }

    // The volume itself takes 12 bytes a coefficient, later also a wall, and a copy while it is
    // fitted; those of files that store other values are left to what their writing finds free by
    // then.
    plan.host_bytes += bytes::triangle * plan.triangles + bytes::fixed
                       + std::max(solver_bytes, all_cells * 12 * uint64_t(most_walls));
    if (plan.bricks)
        plan.bricks->other_bytes = plan.host_bytes;
    plan.host_bytes +=
        plan.bricks ? plan.bricks->expected
                          * (brick_bytes(solver.order())
                             + volume::brick_samples * sample_bytes(solver.order()))
        : settings.points > 0
            ? settings.points
                  * (volume::point_bytes(solver.order())
                     + settings.layers.size()
                           * (4 + 12 * uint64_t(volume::sh_count(solver.order()))))
            : all_cells
                      * (bytes::cell
                         + (settings.fit ? 24 : 12) * uint64_t(volume::sh_count(solver.order())))
                  + layered_cells * layer_bytes(settings);
    check_host_memory(plan);
    return plan;
}

std::string of_level(std::size_t level, const BakePlan& plan) {
    if (!plan.settings.volumes.empty())
        return "volume " + plan.settings.volumes[level].place.name + ": ";
    if (plan.layers_grid && level > 0)
        return "layers: ";
    return plan.coarser.empty() ? "" : format("level %zu: ", level);
}

std::vector<Grid> grids_in(const BakePlan& plan) {
    std::vector<Grid> grids{plan.grid};
    grids.insert(grids.end(), plan.coarser.begin(), plan.coarser.end());
    return grids;
}

std::vector<Solved> solved_in(const BakePlan& plan) {
    const std::size_t layers = plan.settings.layers.size();
    std::vector<Solved> solved;
    for (const Grid& grid : grids_in(plan))
        solved.push_back({grid, plan.layers_grid ? 0 : layers});
    if (plan.layers_grid)
        solved.push_back({*plan.layers_grid, layers});
    return solved;
}

Volume grids_of(const BakePlan& plan) {
    Volume grids;
    grids.grid.dims = glm::ivec3(1);
    grids.sh_order = plan.settings.solver.order();
    grids.sh.assign(std::size_t(volume::sh_count(grids.sh_order)), {glm::vec3(0)});
    if (solver::find_parameter(plan.settings.solver.kind(), "occlusion")
        && plan.settings.solver["occlusion"] != 0)
        grids.occlusion.assign(4, {0.0f});
    grids.validity = {1.0f};
    grids.walls.assign(most_walls, {glm::vec3(0)});
    if (plan.settings.medium)
        set_air_grids(*plan.settings.medium, grids);
    if (plan.settings.direct.sh && plan.lights > 0)
        volume::set_grids(grids, volume::direct_kind(), volume::sh_count(grids.sh_order));
    if (plan.settings.direct.visibility && plan.lights > 0)
        volume::set_grids(grids, volume::visibility_kind(), plan.lights);
    if (plan.settings.direct.channels && plan.lights > 0)
        volume::set_grids(grids, volume::kind_named("shadow"), 4);
    if (plan.settings.direct.shaft && plan.lights > 0)
        volume::set_grids(grids, volume::kind_named("shaft"), 1);
    if (plan.settings.local_transfer.wanted) {
        volume::set_grids(grids, volume::local_transfer_kind(), 16);
        volume::set_grids(grids, volume::local_visibility_kind(), 9);
    }
    return grids;
}

Volume grids_of(const BakePlan& plan, const Layer& layer) {
    Volume grids = grids_of(plan);
    grids.sh_order = layer.light.order.value_or(grids.sh_order);
    grids.sh.assign(std::size_t(volume::sh_count(grids.sh_order)), {glm::vec3(0)});
    grids.others.clear();
    return grids;
}

} // namespace lpvbake::bake
