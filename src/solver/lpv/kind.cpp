#include "solver/lpv/kind.h"

#include "background.h"
#include "scene/scene.h"
#include "solver/lpv/lpv.h"
#include "solver/models.h"
#include "solver/occlusion.h"
#include "solver/outside.h"
#include "solver/vpl/entering.h"
#include "solver/vpl/lit_vpls.h"
#include "solver/vpl/vpls.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <future>

namespace lpvbake::solver::lpv {
namespace {

constexpr int orders[] = {1};

constexpr const char* occlusions[] = {"none", "sh", "face"}; // as enum Occlusion

constexpr Parameter parameters[] = {
    {.name = "tolerance",
     .kind = ValueKind::real,
     .lo = 1e-7,
     .hi = 1,
     .usual = 0.01,
     .help = "share of the injected power still under way at which propagation ends"},
    {.name = "occlusion",
     .kind = ValueKind::choice,
     .choices = occlusions,
     .usual = double(LpvSettings().occlusion),
     .help = "blocking between cells: none, sh (SH geometry volume), face (a transmittance a face; "
             "does not leak)"},
    {.name = "rsm-size",
     .kind = ValueKind::whole,
     .hi = 16384,
     .unit = "texels",
     .help = "texels along a side of a reflective shadow map; 0: from the grid"},
    {.name = "rsm-kernel",
     .kind = ValueKind::whole,
     .lo = 1,
     .hi = 64,
     .usual = vpl::RsmSettings().kernel,
     .unit = "texels",
     .help = "texels along a side of a block that becomes virtual point lights"},
    {.name = "iterations",
     .kind = ValueKind::whole,
     .hi = 1'000'000,
     .usual = LpvSettings().iterations,
     .unit = "iterations",
     .help = "propagation steps; 0: until the tolerance"},
};

// Propagation blurs what more rays would bring.
constexpr Rung ladder[] = {{Quality::balanced, 1 << 18, {}}};

LpvSettings settings_of(const SolverSettings& settings) {
    return {int(settings["iterations"]), float(settings["tolerance"]),
            Occlusion(int(settings["occlusion"]))};
}

int map_size(const Grid& grid, const SolverSettings& settings) {
    const int wanted = int(settings["rsm-size"]);
    return wanted > 0 ? wanted : vpl::usual_map_size(grid.dims);
}

double expected_error(const SolverSettings&, const Pilot&) {
    return models::error::lpv;
}

Cost cost(const Workload& work, const SolverSettings& settings) {
    const LpvSettings lpv = settings_of(settings);
    namespace seconds = models::seconds;
    // What is left falls like the slowest mode of a diffusion.
    const glm::dvec3 dims(work.grid.dims);
    const double decay = models::diffusion * 9.87 * glm::dot(1.0 / dims, 1.0 / dims);
    const double steps = lpv.iterations ? lpv.iterations : -std::log(double(lpv.tolerance)) / decay;
    const double cells = double(work.grid.size());
    Cost cost;
    if (lpv.occlusion != Occlusion::none)
        cost.stages.push_back(
            {"geometry", seconds::geometry_patch * work.patches, "geometry volume"});
    else
        cost.skipped.push_back({"geometry", "`occlusion` none"});
    const int longest = std::max({work.grid.dims.x, work.grid.dims.y, work.grid.dims.z});
    cost.stages.push_back(
        {"links", seconds::links_cell * cells / longest,
         lpv.occlusion == Occlusion::face ? "validity and face transmittance" : "validity"});
    cost.stages.push_back(
        {"inject", seconds::inject + (work.lit ? seconds::inject_patch * work.patches : 0.0),
         "virtual point lights into cells"});
    cost.stages.push_back(
        {"propagate",
         seconds::propagate + steps * (seconds::propagate_step + seconds::propagate_cell * cells),
         lpv.iterations
             ? counted(uint64_t(lpv.iterations), "iteration")
             : format("until %.3g %% of the power is left", 100.0 * double(lpv.tolerance))});
    return cost;
}

/// Virtual point lights into cells, and from cell to cell until little is left.
class LpvSolver final : public Solver {
public:
    LpvSolver(const gpu::Device& device, const Grid& grid, const LpvSettings& settings,
              int rsm_kernel)
        : settings_(settings),
          rsm_kernel_(rsm_kernel),
          program_(std::async(in_background(), [&device, &grid, settings] {
              return LpvProgram(device, grid, settings.occlusion);
          })) {}

    void solve(const Inputs& inputs, Stages& stages, Volume& volume) override {
        const Grid& grid = inputs.grid;
        const Occlusion mode = settings_.occlusion;
        std::vector<vpl::Vpl> vpls = find_vpls(inputs, stages);

        GeometryVolume geometry;
        if (mode != Occlusion::none) {
            stages.begin("geometry");
            const std::vector<surface::Patch> patches =
                surface::make_patches(inputs.scene, inputs.frame, 1.0f);
            geometry = make_geometry_volume(patches, grid);
            stages.end(counted(patches.size(), "patch", "patches"));
        }

        stages.begin("links");
        Links links = trace_links(inputs.visibility, grid);
        std::vector<float> transmittance;
        if (mode == Occlusion::face)
            transmittance = std::move(links.open);
        else if (mode == Occlusion::sh)
            transmittance = face_transmittance(geometry, grid);
        volume.validity = std::move(links.validity);
        stages.end(outside_geometry(volume.validity));

        stages.begin("inject");
        vpl::let_in(vpls, inputs.visibility, inputs.frame);
        const Injection injection = inject(vpls, inputs.visibility, grid);
        const double come = injection.power + injection.shut;
        const double shut = come > 0.0 ? 100.0 * injection.shut / come : 0.0;
        stages.end(
            format("%zu VPLs, %.6g lm, %.1f %% walled in", vpls.size(), injection.power, shut));
        if (injection.power == 0.0)
            stages.warn(inputs.scene.path + ": no light comes into the grid: the field is 0");
        else if (shut > 5.0)
            stages.warn(format("%.3g %% of the light is lost between surfaces so close to each "
                               "other that no cell's centre lies there; a higher `resolution` or "
                               "another solver keeps it",
                               shut));

        stages.begin("propagate", 100);
        const LpvField field =
            program_.get().propagate(injection, transmittance, settings_, stages.progress());
        const std::string iterations = counted(uint64_t(field.iterations), "iteration");
        stages.end(
            format("%s, %.3g %% of the power left", iterations.c_str(), 100.0 * field.residual));
        if (field.residual > 0.1)
            stages.warn(
                format("propagation stopped after %s with %.3g %% of the power under way: the "
                       "field is too dark; raise `iterations`, or leave it out",
                       iterations.c_str(), 100.0 * field.residual));

        to_luminance(field, volume);
        if (mode != Occlusion::none)
            volume.occlusion = at_cell_centers(geometry, grid);
        volume.metadata["iterations"] = std::to_string(field.iterations);
        volume.metadata["residual"] = format("%.6g", field.residual);
        volume.metadata["injected_lm"] = format("%.9g", injection.power);
    }

private:
    /// All light as virtual point lights: that of the maps, of lit surfaces and of the sky.
    std::vector<vpl::Vpl> find_vpls(const Inputs& inputs, Stages& stages) const {
        std::vector<vpl::Vpl> vpls;
        const auto [count, size] = inputs.maps;
        if (count > 0) {
            stages.begin("rsm", inputs.scene.lights.size());
            vpls = vpl::render_vpls(inputs.device, inputs.scene, inputs.frame, {size, rsm_kernel_},
                                    stages.progress(), &inputs.visibility);
            stages.end(format("%s of %d x %d, %s", counted(uint64_t(count), "map").c_str(), size,
                              size, counted(vpls.size(), "VPL").c_str()));
        }
        if (inputs.lit)
            vpl::emit_vpls(*inputs.lit, inputs.frame, vpls);
        if (scene::has_sky(inputs.scene))
            vpl::sky_vpls(inputs.scene.sky, inputs.visibility, inputs.frame, vpls);
        return vpls;
    }

    LpvSettings settings_;
    int rsm_kernel_;
    std::future<LpvProgram> program_;
};

} // namespace

constinit const SolverKind lpv_kind{
    .name = "lpv",
    .help = "classic propagation",
    .orders = orders,
    .default_bounces = 1,
    .parameters = parameters,
    .ladder = ladder,
    .map_size = map_size,
    .expected_error = expected_error,
    .device_bytes =
        [](const Grid& grid, const SolverSettings& settings) {
            return lpv_device_bytes(grid, settings_of(settings).occlusion);
        },
    .cost = cost,
    .make = [](const gpu::Device& device, const Grid& grid,
               const SolverSettings& settings) -> std::unique_ptr<Solver> {
        return std::make_unique<LpvSolver>(device, grid, settings_of(settings),
                                           int(settings["rsm-kernel"]));
    },
};

} // namespace lpvbake::solver::lpv
