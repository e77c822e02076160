#include "bake/bake.h"

#include "solver/vpl/vpls.h"
#include "scene/sky.h"
#include "solver/occlusion.h"
#include "solver/vpl/emitters.h"
#include "surface/patches.h"
#include "text.h"
#include "visibility/backs.h"
#include "visibility/validity.h"
#include "visibility/visibility.h"
#include "visibility/walls.h"

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

std::string outside_geometry(const std::vector<float>& validity) {
    const auto valid = std::count(validity.begin(), validity.end(), 1.0f);
    return format("%.1f %% of the cells outside geometry",
                  100.0 * double(valid) / double(validity.size()));
}

std::string share_with_walls(const std::vector<std::vector<glm::vec3>>& walls) {
    const auto without = std::ranges::count(walls[0], glm::vec3(0.0f));
    return format("beside %.1f %% of the cells",
                  100.0 * (1.0 - double(without) / double(walls[0].size())));
}

/// As a reference of the same light says it: "punctual lights after one reflection; emitters and
/// sky direct and after one reflection".
std::string content_of(const Scene& scene, const BakePlan& plan, std::optional<int> bounces) {
    std::string content;
    if (!scene.lights.empty() && bounces != 0)
        content = "punctual lights after "
                  + (!bounces       ? "one reflection and more"
                     : bounces == 1 ? "one reflection"
                                    : format("1 to %d reflections", *bounces));
    if (plan.emitters || has_sky(scene)) {
        content += content.empty() ? "" : "; ";
        content += plan.emitters && has_sky(scene) ? "emitters and sky direct"
                   : plan.emitters                 ? "emitters direct"
                                                   : "sky direct";
        if (plan.lit && bounces != 0)
            content += " and after "
                       + (!bounces       ? "any number of reflections"
                          : bounces == 1 ? "one reflection"
                                         : format("up to %d reflections", *bounces));
    }
    return content;
}

/// What every solver works on.
struct Work {
    const Scene& scene;
    const BakeSettings& settings;
    const gpu::Device& device;
    const BakePlan& plan;
    const Visibility& visibility;
    const LitSurfaces* lit; ///< with BakePlan::lit
    Stages& stages;
    Progress& progress;
    Baked& baked;
};

/// Virtual point lights into cells, and from cell to cell until little is left.
void solve_lpv(const Work& work, std::future<LpvProgram> program) {
    const auto& [scene, settings, device, plan, visibility, lit, stages, progress, baked] = work;
    const Grid& grid = plan.grid;
    const Frame& frame = plan.frame;
    const Occlusion mode = settings.lpv.occlusion;

    std::vector<Vpl> vpls;
    if (plan.rsm_maps > 0) {
        stages.begin("rsm", scene.lights.size());
        vpls = render_vpls(device, scene, frame, {plan.rsm_size, settings.rsm_kernel}, progress);
        stages.end(format("%s of %d x %d, %s", counted(plan.rsm_maps, "map").c_str(), plan.rsm_size,
                          plan.rsm_size, counted(vpls.size(), "VPL").c_str()));
    }

    if (lit)
        emit_vpls(*lit, frame, vpls);
    if (has_sky(scene))
        sky_vpls(scene.sky, visibility, frame, vpls);

    GeometryVolume geometry;
    if (mode != Occlusion::none) {
        stages.begin("geometry");
        const std::vector<Patch> patches = make_patches(scene, frame, 1.0f);
        geometry = make_geometry_volume(patches, grid);
        stages.end(counted(patches.size(), "patch", "patches"));
    }

    stages.begin("links");
    Links links = trace_links(visibility, grid);
    std::vector<float> transmittance;
    if (mode == Occlusion::face)
        transmittance = std::move(links.open);
    else if (mode == Occlusion::sh)
        transmittance = face_transmittance(geometry, grid);
    baked.volume.validity = std::move(links.validity);
    stages.end(outside_geometry(baked.volume.validity));

    stages.begin("inject");
    const Injection injection = inject(vpls, visibility, grid);
    const double reflected = injection.power + injection.lost;
    stages.end(format("%zu VPLs, %.6g lm, %.1f %% outside the grid or walled in", vpls.size(),
                      injection.power, reflected > 0.0 ? 100.0 * injection.lost / reflected : 0.0));
    if (injection.power == 0.0)
        baked.warnings.push_back(scene.path
                                 + ": no light reaches a surface inside the grid: the field is 0");

    stages.begin("propagate", 100);
    const LpvField field =
        program.get().propagate(injection, transmittance, settings.lpv, progress);
    stages.end(format("%s, %.3g %% of the power left",
                      counted(field.iterations, "iteration").c_str(), 100.0 * field.residual));
    if (field.residual > 0.1)
        baked.warnings.push_back(
            format("propagation stopped after %s with %.3g %% of the power under way: the field "
                   "is too dark; raise --iterations, or leave it out",
                   counted(field.iterations, "iteration").c_str(), 100.0 * field.residual));

    to_luminance(field, baked.volume);
    if (mode != Occlusion::none)
        baked.volume.occlusion = at_cell_centers(geometry, grid);
    baked.volume.metadata["iterations"] = std::to_string(field.iterations);
    baked.volume.metadata["residual"] = format("%.6g", field.residual);
    baked.volume.metadata["injected_lm"] = format("%.9g", injection.power);
}

void find_validity(const Work& work) {
    work.stages.begin("validity");
    work.baked.volume.validity = trace_validity(work.visibility, work.plan.grid.dims);
    work.stages.end(outside_geometry(work.baked.volume.validity));
}

/// Luminance along fixed directions, from cell to cell, downstream.
void solve_sn(const Work& work, std::future<SnProgram> program) {
    find_validity(work);
    const SnProgram sn = program.get();
    work.stages.begin("gather");
    const float limit = sn.gather_peaks(*work.lit, work.visibility, work.scene.sky, work.progress,
                                        work.baked.volume);
    work.stages.end(format("what is brighter than %.4g nits", double(limit)));
    work.stages.begin("sweep", 100);
    sn.sweep(*work.lit, work.visibility, work.scene.sky, limit, work.progress, work.baked.volume);
    work.stages.end(format("%d directions", work.settings.sn.directions));
    work.baked.volume.metadata["directions"] = std::to_string(work.settings.sn.directions);
}

/// Clusters of patches straight to the cells that need it, the other cells from these; the first
/// reflection from the maps' texels, where that is wanted.
void solve_gather(const Work& work, std::future<GatherProgram> program) {
    find_validity(work);
    work.stages.begin("gather");
    const LitSurfaces none;
    const GatherReport report =
        program.get().gather(work.lit ? *work.lit : none, work.scene.sky, work.visibility,
                             work.baked.volume, work.progress);
    work.stages.end(format(
        "%s solved, %llu interpolated, %s", counted(report.solved, "cell").c_str(),
        (unsigned long long)report.interpolated, counted(report.rays, "visibility ray").c_str()));
    if (work.plan.rsm_maps == 0)
        return;
    work.stages.begin("discs", work.scene.lights.size());
    const DiscReport discs = gather_discs(work.device, work.scene, work.plan.frame, work.visibility,
                                          {work.settings.rsm_samples, work.plan.rsm_size},
                                          work.baked.volume, work.progress);
    work.stages.end(format("%s of %d x %d, %s", counted(discs.maps, "map").c_str(),
                           work.plan.rsm_size, work.plan.rsm_size,
                           counted(discs.rays, "visibility ray").c_str()));
}

} // namespace

Baked bake(const Scene& scene, const BakeSettings& settings, const gpu::Device& device,
           Progress& progress) {
    const BakePlan plan = plan_bake(scene, settings, device.info());
    Baked baked;
    baked.warnings = plan.warnings;
    baked.volume.grid = plan.grid;
    Stages stages(progress, baked.stages);

    // Shaders compile while the CPU traces.
    std::future<LpvProgram> lpv;
    std::future<SnProgram> sn;
    std::future<GatherProgram> gather;
    if (settings.solver == Solver::lpv)
        lpv = std::async(std::launch::async,
                         [&] { return LpvProgram(device, plan.grid, settings.lpv.occlusion); });
    else if (settings.solver == Solver::sn)
        sn = std::async(std::launch::async,
                        [&] { return SnProgram(device, plan.grid, settings.sn); });
    else
        gather =
            std::async(std::launch::async, [&] { return GatherProgram(device, settings.gather); });

    stages.begin("visibility");
    const Visibility visibility(scene, plan.frame);
    for (const Light& light : scene.lights)
        if (const double backs = share_of_backs(visibility, light, plan.frame); backs > 0.25)
            baked.warnings.push_back(format(
                "light '%s': %.0f %% of its first hits are backs of single-sided surfaces, which "
                "are black; --backfaces cull lets light pass them",
                light.name.c_str(), 100.0 * backs));
    stages.end(counted(plan.triangles, "triangle"));

    LitSurfaces lit;
    if (plan.lit) {
        stages.begin("lighting");
        LightingSettings lighting;
        lighting.bounces = settings.bounces;
        lighting.emitters = plan.emitters;
        lighting.maps = plan.rsm_maps > 0;
        lighting.rays = settings.lighting_rays;
        if (settings.solver == Solver::lpv)
            lighting.rays = 1 << 19; // it blurs what more would bring
        lit = light_surfaces(scene, visibility, plan.frame, lighting, progress);
        stages.end(counted(lit.patches.size(), "patch", "patches") + ", "
                   + counted(lit.bounces, "reflection"));
    }

    const Work work{scene,  settings, device, plan, visibility, plan.lit ? &lit : nullptr,
                    stages, progress, baked};
    switch (settings.solver) {
    case Solver::lpv:
        solve_lpv(work, std::move(lpv));
        break;
    case Solver::sn:
        solve_sn(work, std::move(sn));
        break;
    case Solver::gather:
        solve_gather(work, std::move(gather));
        break;
    }
    stages.begin("walls");
    baked.volume.walls =
        find_walls(visibility, plan.grid.dims, baked.volume.validity, most_walls, walls_reach);
    stages.end(share_with_walls(baked.volume.walls));
    baked.volume.metadata["solver"] = name_of(settings.solver);
    baked.volume.metadata["content"] = content_of(scene, plan, settings.bounces);
    baked.volume.metadata["bounces"] = settings.bounces ? std::to_string(*settings.bounces) : "inf";
    baked.volume.metadata["device"] = device.info().name;
    return baked;
}

} // namespace lpvbake
