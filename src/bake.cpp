#include "bake.h"

#include "error.h"
#include "rsm/view.h"
#include "rsm/vpls.h"
#include "solver/occlusion.h"
#include "surface/emitters.h"
#include "surface/patches.h"
#include "visibility/backs.h"
#include "visibility/visibility.h"

#include <algorithm>
#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <future>

namespace lpvbake {
namespace {

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, pattern);
    std::vsnprintf(text, sizeof text, pattern, arguments);
    va_end(arguments);
    return text;
}

/// Names and times the stages of one bake.
class Stages {
public:
    Stages(Progress& progress, std::vector<StageReport>& reports)
        : progress_(progress),
          reports_(reports) {}
    void begin(const char* name, uint64_t steps = 0) {
        name_ = name;
        start_ = std::chrono::steady_clock::now();
        progress_.begin(name, steps);
    }
    void end(std::string detail) {
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start_;
        reports_.push_back({name_, seconds.count(), std::move(detail)});
    }

private:
    Progress& progress_;
    std::vector<StageReport>& reports_;
    const char* name_ = "";
    std::chrono::steady_clock::time_point start_;
};

Frame frame_of(const Grid& grid) {
    return {grid.origin, grid.cell, glm::dvec3(grid.dims)};
}

int rsm_size_of(const Grid& grid, const BakeSettings& settings) {
    if (settings.rsm_size > 0)
        return settings.rsm_size;
    return std::max(256, 8 * std::max({grid.dims.x, grid.dims.y, grid.dims.z}));
}

bool lit_by_emitters(const Scene& scene, const BakeSettings& settings) {
    return settings.emitters && has_emitters(scene);
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
                format("%s: 1 %% of the triangles set over half of the bounds; the rest lies "
                       "within --bounds %.6g,%.6g,%.6g,%.6g,%.6g,%.6g",
                       scene.path.c_str(), crowd.lo.x, crowd.lo.y, crowd.lo.z, crowd.hi.x,
                       crowd.hi.y, crowd.hi.z));
            return;
        }
}

/// The largest resolution at which the same box fits the device.
int largest_resolution(const Bounds& box, const BakeSettings& settings, uint64_t memory) {
    int fits = 0;
    for (int low = 3, high = 2048; low <= high;) {
        const int middle = (low + high) / 2;
        const Grid grid = fit_grid(box.lo, box.hi, {middle, 0.0, settings.grid.margin});
        if (lpv_device_bytes(grid, settings.lpv.occlusion) <= memory) {
            fits = middle;
            low = middle + 1;
        } else {
            high = middle - 1;
        }
    }
    return fits;
}

} // namespace

BakePlan plan_bake(const Scene& scene, const BakeSettings& settings,
                   const gpu::DeviceInfo& device) {
    BakePlan plan;
    plan.warnings = scene.warnings;
    plan.triangles = triangle_count(scene);
    if (plan.triangles == 0)
        throw Error(ExitCode::invalid, scene.path + ": no triangles to light");
    const bool emitters = lit_by_emitters(scene, settings);
    if (scene.lights.empty() && !emitters)
        throw Error(ExitCode::invalid,
                    scene.path
                        + ": no light and no emissive surface; add one with --sun "
                          "AZIMUTH,ELEVATION,LUX, --point X,Y,Z,CD or --lights FILE");

    const Bounds scene_bounds = bounds_of(scene);
    const Bounds box = settings.bounds.value_or(scene_bounds);
    if (!settings.bounds)
        warn_of_empty_bounds(scene, scene_bounds, plan.warnings);
    plan.grid = fit_grid(box.lo, box.hi, settings.grid);
    const uint64_t cells = plan.grid.size();
    plan.device_bytes = lpv_device_bytes(plan.grid, settings.lpv.occlusion);
    if (plan.device_bytes > device.memory)
        throw Error(ExitCode::memory,
                    format("a grid of %d x %d x %d needs %.1f GiB of %s's %.1f GiB; the largest "
                           "that fits is --resolution %d",
                           plan.grid.dims.x, plan.grid.dims.y, plan.grid.dims.z,
                           double(plan.device_bytes) / 0x1p30, device.name.c_str(),
                           double(device.memory) / 0x1p30,
                           largest_resolution(box, settings, device.memory)));
    plan.host_bytes = 260 * plan.triangles + 180 * cells + (uint64_t(64) << 20);

    // Costs a unit, measured on two threads of a CPU device; a GPU is faster than this says.
    const int longest = std::max({plan.grid.dims.x, plan.grid.dims.y, plan.grid.dims.z});
    const double steps = settings.lpv.iterations ? settings.lpv.iterations : 2.0 * longest;
    const auto stage = [&](const char* name, double seconds, std::string why) {
        plan.stages.push_back({name, seconds, std::move(why)});
        plan.seconds += seconds;
    };
    stage("visibility", 4e-7 * double(plan.triangles),
          format("%llu triangles", (unsigned long long)plan.triangles));
    if (!scene.lights.empty()) {
        plan.rsm_size = rsm_size_of(plan.grid, settings);
        const Frame frame = frame_of(plan.grid);
        for (const Light& light : scene.lights)
            plan.rsm_maps += int(views_of(light, frame, frame.from_world(scene_bounds.lo),
                                          frame.from_world(scene_bounds.hi))
                                     .size());
        const double texels = double(plan.rsm_maps) * plan.rsm_size * plan.rsm_size;
        stage("rsm", 0.2 + 1e-7 * texels + 2e-7 * double(plan.triangles) * plan.rsm_maps,
              format("%zu lights, %d maps of %d x %d", scene.lights.size(), plan.rsm_maps,
                     plan.rsm_size, plan.rsm_size));
    }
    if (emitters || settings.lpv.occlusion != Occlusion::none)
        stage("surfaces", 1e-6 * double(plan.triangles),
              emitters ? "emission and geometry volume" : "geometry volume");
    stage("links", 15e-6 * double(cells) / longest,
          settings.lpv.occlusion == Occlusion::face ? "validity and face transmittance"
                                                    : "validity");
    stage("inject", 0.01, "virtual point lights into cells");
    stage("propagate", 0.2 + 3e-8 * double(cells) * steps,
          settings.lpv.iterations
              ? format("%d iterations", settings.lpv.iterations)
              : format("until %.3g of the power is left", double(settings.lpv.tolerance)));
    return plan;
}

Baked bake(const Scene& scene, const BakeSettings& settings, const gpu::Device& device,
           Progress& progress) {
    const BakePlan plan = plan_bake(scene, settings, device.info());
    Baked baked;
    baked.warnings = plan.warnings;
    Stages stages(progress, baked.stages);
    const Grid& grid = plan.grid;
    const Frame frame = frame_of(grid);
    const Occlusion mode = settings.lpv.occlusion;

    // Shaders compile while the CPU traces.
    std::future<LpvProgram> program =
        std::async(std::launch::async, [&] { return LpvProgram(device, grid, mode); });

    stages.begin("visibility");
    const Visibility visibility(scene, frame);
    for (const Light& light : scene.lights)
        if (const double backs = share_of_backs(visibility, light, frame); backs > 0.25)
            baked.warnings.push_back(format(
                "light '%s': %.0f %% of its first hits are backs of single-sided surfaces, which "
                "are black; --backfaces cull lets light pass them",
                light.name.c_str(), 100.0 * backs));
    stages.end(format("%llu triangles", (unsigned long long)plan.triangles));

    std::vector<Vpl> vpls;
    if (!scene.lights.empty()) {
        stages.begin("rsm", scene.lights.size());
        vpls = render_vpls(device, scene, frame, {plan.rsm_size, settings.rsm_kernel}, progress);
        stages.end(format("%d maps of %d x %d, %zu VPLs", plan.rsm_maps, plan.rsm_size,
                          plan.rsm_size, vpls.size()));
    }

    const bool emitters = lit_by_emitters(scene, settings);
    GeometryVolume geometry;
    if (emitters || mode != Occlusion::none) {
        stages.begin("surfaces");
        const std::vector<Patch> patches = make_patches(scene, frame, 1.0f);
        if (emitters)
            emit_vpls(patches, grid.cell, vpls);
        if (mode != Occlusion::none)
            geometry = make_geometry_volume(patches, grid);
        stages.end(format("%zu patches, %zu VPLs in all", patches.size(), vpls.size()));
    }

    stages.begin("links");
    Links links = trace_links(visibility, grid);
    std::vector<float> transmittance;
    if (mode == Occlusion::face)
        transmittance = std::move(links.open);
    else if (mode == Occlusion::sh)
        transmittance = face_transmittance(geometry, grid);
    baked.volume.validity = std::move(links.validity);
    stages.end(format(
        "%.1f %% of the cells outside geometry",
        100.0 * double(std::count(baked.volume.validity.begin(), baked.volume.validity.end(), 1.0f))
            / double(grid.size())));

    stages.begin("inject");
    const Injection injection = inject(vpls, visibility, grid);
    const double reflected = injection.power + injection.lost;
    stages.end(format("%.6g lm, %.2g %% outside the grid or walled in", injection.power,
                      reflected > 0.0 ? 100.0 * injection.lost / reflected : 0.0));
    if (injection.power == 0.0)
        baked.warnings.push_back(scene.path
                                 + ": no light reaches a surface inside the grid: the field is 0");

    stages.begin("propagate", 100);
    const LpvField field =
        program.get().propagate(injection, transmittance, settings.lpv, progress);
    stages.end(format("%d iterations, %.3g of the power left", field.iterations, field.residual));

    baked.volume.grid = grid;
    to_luminance(field, baked.volume);
    if (mode != Occlusion::none)
        baked.volume.occlusion = at_cell_centers(geometry, grid);
    baked.volume.metadata = {
        {"solver", "lpv"},
        {"content", emitters ? "punctual lights after one reflection; emitters direct"
                             : "punctual lights after one reflection"},
        {"bounces", "1"},
        {"iterations", std::to_string(field.iterations)},
        {"residual", format("%.6g", field.residual)},
        {"injected_lm", format("%.9g", injection.power)},
        {"device", device.info().name},
    };
    return baked;
}

} // namespace lpvbake
