#include "bake/bake.h"
#include "error.h"
#include "raster/view.h"
#include "text.h"
#include "volume/sh.h"

#include <algorithm>
#include <cmath>

#include <unistd.h>

namespace lpvbake {
namespace {

int rsm_size_of(const Grid& grid, const BakeSettings& settings) {
    if (settings.rsm_size > 0)
        return settings.rsm_size;
    return std::max(256, 8 * std::max({grid.dims.x, grid.dims.y, grid.dims.z}));
}

/// Warns where a few far triangles set most of the grid's size, as those of a plain around a town.
void warn_of_empty_bounds(const Scene& scene, const Bounds& bounds,
                          std::vector<std::string>& warnings) {
    const Bounds crowd = trimmed_bounds(scene, 0.01);
    const glm::dvec3 size = bounds.hi - bounds.lo, kept = crowd.hi - crowd.lo;
    const double longest = std::max({size.x, size.y, size.z});
    for (int axis = 0; axis < 3; ++axis)
        if (size[axis] > 0.5 * longest && kept[axis] < 0.5 * size[axis]) {
            warnings.push_back(
                format("%s: 1 %% of the triangles set over half of the bounds; the others' are "
                       "--bounds %.6g,%.6g,%.6g,%.6g,%.6g,%.6g",
                       scene.path.c_str(), crowd.lo.x, crowd.lo.y, crowd.lo.z, crowd.hi.x,
                       crowd.hi.y, crowd.hi.z));
            return;
        }
}

/// Of all placed triangles, m^2.
double surface_area(const Scene& scene) {
    double area = 0.0;
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const glm::dmat3 turn(instance.to_world);
        for (const glm::uvec3& t : mesh.triangles) {
            const glm::dvec3 origin(mesh.positions[t.x]);
            area += 0.5
                    * glm::length(glm::cross(turn * (glm::dvec3(mesh.positions[t.y]) - origin),
                                             turn * (glm::dvec3(mesh.positions[t.z]) - origin)));
        }
    }
    return area;
}

uint64_t device_bytes(const Grid& grid, const BakeSettings& settings) {
    switch (settings.solver) {
    case Solver::lpv:
        return lpv_device_bytes(grid, settings.lpv.occlusion);
    case Solver::sn:
        return sn_device_bytes(grid, settings.sn);
    case Solver::gather:
        return gather_device_bytes(settings.gather);
    }
    return 0;
}

/// The largest resolution at which the same box fits the device.
int largest_resolution(const Bounds& box, const BakeSettings& settings, uint64_t memory) {
    int fits = 0;
    for (int low = 3, high = 2048; low <= high;) {
        const int middle = (low + high) / 2;
        const Grid grid = fit_grid(box.lo, box.hi, {middle, 0.0, settings.grid.margin});
        if (device_bytes(grid, settings) <= memory) {
            fits = middle;
            low = middle + 1;
        } else {
            high = middle - 1;
        }
    }
    return fits;
}

} // namespace

int sh_order_of(const BakeSettings& settings) {
    switch (settings.solver) {
    case Solver::lpv:
        return 1;
    case Solver::sn:
        return settings.sn.order;
    case Solver::gather:
        return settings.gather.order;
    }
    return 0;
}

BakePlan plan_bake(const Scene& scene, const BakeSettings& settings,
                   const gpu::DeviceInfo& device) {
    BakePlan plan;
    plan.warnings = scene.warnings;
    plan.triangles = triangle_count(scene);
    if (plan.triangles == 0)
        throw Error(ExitCode::invalid, scene.path + ": no triangles to light");
    plan.emitters = settings.emitters && has_emitters(scene);
    if (scene.lights.empty() && !plan.emitters && !has_sky(scene))
        throw Error(ExitCode::invalid,
                    scene.path
                        + ": no light and no emissive surface; add one with --sun "
                          "AZIMUTH,ELEVATION,LUX, --point X,Y,Z,CD, --sky COLOUR,NITS or --lights "
                          "FILE");
    if (settings.bounces == 0 && !plan.emitters && !has_sky(scene))
        throw Error(ExitCode::invalid,
                    scene.path
                        + ": without reflections no light of its lights is in the field; set "
                          "--bounces 1 or more");
    const bool by_maps = settings.solver == Solver::lpv
                         || (settings.solver == Solver::gather && settings.rsm_samples > 0);
    plan.lit = !by_maps || settings.bounces != 1 || plan.emitters || has_sky(scene);

    const Bounds scene_bounds = bounds_of(scene);
    const Bounds box = settings.bounds.value_or(scene_bounds);
    if (!settings.bounds)
        warn_of_empty_bounds(scene, scene_bounds, plan.warnings);
    if (glm::any(glm::greaterThan(box.lo, scene_bounds.hi))
        || glm::any(glm::lessThan(box.hi, scene_bounds.lo)))
        plan.warnings.push_back(
            format("--bounds do not meet the scene's, %.6g,%.6g,%.6g to %.6g,%.6g,%.6g",
                   scene_bounds.lo.x, scene_bounds.lo.y, scene_bounds.lo.z, scene_bounds.hi.x,
                   scene_bounds.hi.y, scene_bounds.hi.z));
    plan.grid = fit_grid(box.lo, box.hi, settings.grid);
    plan.frame = {plan.grid.origin, plan.grid.cell, glm::dvec3(plan.grid.dims)};
    const uint64_t cells = plan.grid.size();
    plan.device_bytes = device_bytes(plan.grid, settings);
    if (plan.device_bytes > device.memory)
        throw Error(ExitCode::memory,
                    format("a grid of %d x %d x %d needs %.1f GiB of %s's %.1f GiB; the largest "
                           "that fits is --resolution %d",
                           plan.grid.dims.x, plan.grid.dims.y, plan.grid.dims.z,
                           double(plan.device_bytes) / 0x1p30, device.name.c_str(),
                           double(device.memory) / 0x1p30,
                           largest_resolution(box, settings, device.memory)));
    // The volume itself takes 12 bytes a coefficient and a wall, and a copy while it is written.
    plan.host_bytes = 260 * plan.triangles + (uint64_t(64) << 20)
                      + cells * (150 + 24 * uint64_t(sh_count(sh_order_of(settings)) + most_walls));

    // Seconds a unit, fitted to bakes of the Cornell box and of two rooms with a door at 16, 32 and
    // 64 cells by two threads of a CPU device (lavapipe). Within about a factor of 1.5 there; a GPU
    // is faster than this says where the device has most of the work (propagate, sweep).
    const int longest = std::max({plan.grid.dims.x, plan.grid.dims.y, plan.grid.dims.z});
    const auto stage = [&](const char* name, double seconds, std::string why) {
        plan.stages.push_back({name, seconds, std::move(why)});
        plan.seconds += seconds;
    };
    const auto skip = [&](const char* name, const char* why) {
        plan.skipped.push_back({name, why});
    };
    const bool lpv = settings.solver == Solver::lpv;
    const bool sky = has_sky(scene);
    const bool reflected = settings.bounces != 0;
    if (scene.lights.empty())
        skip("punctual lights", "none");
    if (!plan.emitters)
        skip("emitters", settings.emitters ? "none in the scene" : "left out");
    if (!sky)
        skip("sky", "none");
    // Patches are halves of a cell's square and less.
    const double patches =
        double(plan.triangles) + 6.0 * surface_area(scene) / (plan.grid.cell * plan.grid.cell);
    stage("visibility", 4e-7 * double(plan.triangles), counted(plan.triangles, "triangle"));
    if (plan.lit) {
        const bool between = reflected && settings.bounces != 1;
        const uint64_t wanted = lpv ? uint64_t(1) << 19 : settings.lighting_rays;
        const double rays = reflected && (plan.emitters || sky || between)
                                ? std::clamp(double(wanted), 16.0 * patches, 256.0 * patches)
                                : 0.0;
        std::string light = scene.lights.empty() || !reflected ? "" : "punctual lights";
        for (const auto& [there, what] : {std::pair{plan.emitters, "emitters"}, {sky, "sky"}})
            if (there)
                light += (light.empty() ? "" : ", ") + std::string(what);
        stage("lighting", 0.02 + 8e-6 * patches + 8.5e-7 * rays,
              light
                  + (!settings.bounces        ? "; all reflections from patch to patch"
                     : *settings.bounces == 0 ? "; no reflections"
                     : *settings.bounces == 1
                         ? "; one reflection"
                         : format("; %d reflections from patch to patch", *settings.bounces)));
        if (reflected && !between)
            skip("light between patches", "one reflection needs none");
    } else {
        skip("lighting", "maps alone hold one reflection of punctual lights");
    }
    if (by_maps && !scene.lights.empty() && reflected) {
        plan.rsm_size = rsm_size_of(plan.grid, settings);
        if (!lpv)
            plan.rsm_size = std::min(plan.rsm_size, largest_disc_map);
        const glm::dvec3 lo = plan.frame.from_world(scene_bounds.lo);
        const glm::dvec3 hi = plan.frame.from_world(scene_bounds.hi);
        for (const Light& light : scene.lights)
            plan.rsm_maps += int(views_of(light, plan.frame, lo, hi).size());
        const double texels = double(plan.rsm_maps) * plan.rsm_size * plan.rsm_size;
        stage("rsm", 0.05 + 1.5e-7 * texels + 2e-7 * double(plan.triangles) * plan.rsm_maps,
              format("%s, %s of %d x %d", counted(scene.lights.size(), "light").c_str(),
                     counted(plan.rsm_maps, "map").c_str(), plan.rsm_size, plan.rsm_size));
    } else if (by_maps) {
        skip("rsm", "no punctual light to reflect");
    } else {
        skip("rsm", "rays light the patches, not maps");
    }
    switch (settings.solver) {
    case Solver::lpv: {
        // In a closed room what is left falls like the slowest mode of a diffusion whose
        // coefficient is 0.38 cells^2 a step; an open scene takes fewer steps.
        const glm::dvec3 dims(plan.grid.dims);
        const double decay = 0.38 * 9.87 * glm::dot(1.0 / dims, 1.0 / dims);
        const double steps = settings.lpv.iterations
                                 ? settings.lpv.iterations
                                 : -std::log(double(settings.lpv.tolerance)) / decay;
        if (settings.lpv.occlusion != Occlusion::none)
            stage("geometry", 5e-7 * patches, "geometry volume");
        else
            skip("geometry", "--occlusion none");
        stage("links", 15e-6 * double(cells) / longest,
              settings.lpv.occlusion == Occlusion::face ? "validity and face transmittance"
                                                        : "validity");
        stage("inject", 0.01 + (plan.lit ? 3e-6 * patches : 0.0),
              "virtual point lights into cells");
        stage("propagate", 0.02 + steps * (2e-4 + 7e-8 * double(cells)),
              settings.lpv.iterations ? counted(settings.lpv.iterations, "iteration")
                                      : format("until %.3g %% of the power is left",
                                               100.0 * double(settings.lpv.tolerance)));
        break;
    }
    case Solver::sn:
        stage("validity", 5e-6 * double(cells) / longest, "which cells lie outside geometry");
        stage("gather", gather_seconds(plan.grid, patches / 10, settings.gather),
              "what is brighter than 1.5 times the mean");
        stage("sweep", sn_seconds(plan.grid, settings.sn),
              format("%d directions, order %d", settings.sn.directions, settings.sn.order));
        plan.host_bytes += sn_host_bytes(plan.grid, patches, settings.sn);
        break;
    case Solver::gather:
        stage("validity", 5e-6 * double(cells) / longest, "which cells lie outside geometry");
        stage("gather", gather_seconds(plan.grid, uint64_t(patches), settings.gather),
              format("%d clusters, tolerance %.3g, order %d", settings.gather.vpls,
                     double(settings.gather.tolerance), settings.gather.order));
        plan.host_bytes += gather_host_bytes(plan.grid, uint64_t(patches), settings.gather);
        if (plan.rsm_maps > 0)
            stage("discs", 4e-7 * double(cells) * settings.rsm_samples * plan.rsm_maps,
                  counted(settings.rsm_samples, "texel") + " of each map for each cell");
        break;
    }
    stage("walls", 1e-6 * double(cells), "what stands between cells and the points around them");
    const uint64_t memory = uint64_t(sysconf(_SC_PHYS_PAGES)) * uint64_t(sysconf(_SC_PAGESIZE));
    if (plan.host_bytes > memory)
        throw Error(
            ExitCode::memory,
            format(
                "a grid of %d x %d x %d needs about %.1f GiB of this machine's %.1f GiB "
                "of memory; lower --resolution, to about %d",
                plan.grid.dims.x, plan.grid.dims.y, plan.grid.dims.z,
                double(plan.host_bytes) / 0x1p30, double(memory) / 0x1p30,
                std::max(3, int(longest * std::cbrt(double(memory) / double(plan.host_bytes))))));
    return plan;
}

} // namespace lpvbake
