#include "bake.h"

#include "rsm/vpls.h"
#include "solver/occlusion.h"
#include "surface/emitters.h"
#include "surface/patches.h"
#include "text.h"
#include "visibility/backs.h"
#include "visibility/visibility.h"

#include <algorithm>
#include <chrono>
#include <future>

namespace lpvbake {
namespace {

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

} // namespace

Baked bake(const Scene& scene, const BakeSettings& settings, const gpu::Device& device,
           Progress& progress) {
    const BakePlan plan = plan_bake(scene, settings, device.info());
    Baked baked;
    baked.warnings = plan.warnings;
    Stages stages(progress, baked.stages);
    const Grid& grid = plan.grid;
    const Frame& frame = plan.frame;
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

    GeometryVolume geometry;
    if (plan.emitters || mode != Occlusion::none) {
        stages.begin("surfaces");
        const std::vector<Patch> patches = make_patches(scene, frame, 1.0f);
        if (plan.emitters)
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
    stages.end(format("%.6g lm, %.1f %% outside the grid or walled in", injection.power,
                      reflected > 0.0 ? 100.0 * injection.lost / reflected : 0.0));
    if (injection.power == 0.0)
        baked.warnings.push_back(scene.path
                                 + ": no light reaches a surface inside the grid: the field is 0");

    stages.begin("propagate", 100);
    const LpvField field =
        program.get().propagate(injection, transmittance, settings.lpv, progress);
    stages.end(format("%d iterations, %.3g %% of the power left", field.iterations,
                      100.0 * field.residual));
    if (field.residual > 0.1)
        baked.warnings.push_back(
            format("propagation stopped after %d iterations with %.3g %% of the power under way: "
                   "the field is too dark; raise --iterations, or leave it out",
                   field.iterations, 100.0 * field.residual));

    baked.volume.grid = grid;
    to_luminance(field, baked.volume);
    if (mode != Occlusion::none)
        baked.volume.occlusion = at_cell_centers(geometry, grid);
    baked.volume.metadata = {
        {"solver", "lpv"},
        {"content", plan.emitters ? "punctual lights after one reflection; emitters direct"
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
