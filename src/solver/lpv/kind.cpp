#include "solver/lpv/kind.h"

#include "background.h"
#include "scene/scene.h"
#include "solver/lpv/inflow.h"
#include "solver/lpv/lpv.h"
#include "solver/models.h"
#include "solver/occlusion.h"
#include "solver/outside.h"
#include "solver/vpl/entering.h"
#include "solver/vpl/lit_vpls.h"
#include "solver/vpl/vpls.h"
#include "text.h"
#include "volume/adjust.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <memory>

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
     .help = "share of the field's power that may be missing when propagation ends"},
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

/// Cells from which on corrections take less time than the fronts that they stand for.
constexpr std::size_t least_corrected = 20 * 20 * 20;

/// Of a bake of layers, which fronts alone keep linear in every cell, it goes by these.
LpvSettings settings_of(const SolverSettings& settings, const Grid& grid, bool layers) {
    LpvSettings lpv = settings_of(settings);
    lpv.corrections = !layers && grid.size() >= least_corrected;
    return lpv;
}

int map_size(const Grid& grid, const SolverSettings& settings) {
    const int wanted = int(settings["rsm-size"]);
    return wanted > 0 ? wanted : vpl::usual_map_size(grid.dims);
}

double expected_error(const SolverSettings&, const Pilot&) {
    return models::error::lpv;
}

/// Until the tolerance; a correction counts as the fronts that take as long.
double expected_fronts(const LpvSettings& lpv, const Grid& grid) {
    const double to_fall = -std::log(double(lpv.tolerance));
    if (lpv.corrections)
        return models::fronts + models::correction_fronts * (1.0 + models::corrections * to_fall);
    // What is left falls like the slowest mode of a diffusion.
    const glm::dvec3 dims(grid.dims);
    return to_fall / (models::diffusion * 9.87 * glm::dot(1.0 / dims, 1.0 / dims));
}

Cost cost(const Workload& work, const SolverSettings& settings) {
    const LpvSettings lpv = settings_of(settings, work.grid, work.layers > 0);
    namespace seconds = models::seconds;
    const seconds::Device& device = seconds::of_device(work.gpu);
    const double steps =
        lpv.iterations > 0 ? double(lpv.iterations) : expected_fronts(lpv, work.grid);
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
         seconds::propagate + steps * (device.propagate_step + device.propagate_cell * cells),
         lpv.iterations
             ? counted(uint64_t(lpv.iterations), "iteration")
             : format("until %.3g %% of the light is missing", 100.0 * double(lpv.tolerance))});
    if (work.layers > 0)
        cost.stages.push_back(
            {"layers", seconds::propagate_layer * double(work.layers) * cost.stages.back().seconds,
             counted(work.layers, "layer")});
    cost.host_bytes += models::bytes::lpv + models::bytes::lpv_cell * work.grid.size()
                       + uint64_t(models::bytes::lpv_patch * work.patches);
    cost.host_bytes += work.layers * (work.grid.size() * 96 + uint64_t(8 * work.patches) * 12);
    return cost;
}

/// All light that starts in a scene, in the frame of the finest grid.
struct AllVpls {
    scene::Frame frame;
    std::vector<vpl::Vpl> vpls;
};

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
        solve_layers(inputs, stages, volume, {});
    }

    void solve_layers(const Inputs& inputs, Stages& stages, Volume& volume,
                      std::span<Volume> layers) override {
        const Occlusion mode = settings_.occlusion;
        all_ = inputs.around.empty() ? find_vpls(inputs.finest ? *inputs.finest : inputs, stages)
                                     : as_lpv(inputs.around.front()).all_;
        solved_.grid = inputs.grid;
        solved_.occlusion = mode;

        GeometryVolume geometry;
        if (mode != Occlusion::none) {
            stages.begin("geometry");
            const std::vector<surface::Patch> patches =
                surface::make_patches(inputs.scene, inputs.frame, 1.0f);
            geometry = make_geometry_volume(patches, inputs.grid);
            stages.end(counted(patches.size(), "patch", "patches"));
        }

        stages.begin("links");
        Links links = trace_links(inputs.visibility, inputs.grid);
        if (mode == Occlusion::face)
            solved_.transmittance = std::move(links.open);
        else if (mode == Occlusion::sh)
            solved_.transmittance = face_transmittance(geometry, inputs.grid);
        volume.validity = std::move(links.validity);
        volume::adjust_validity(inputs.adjust, volume);
        stages.end(outside_geometry(volume.validity));

        const LpvProgram program = program_.get();
        const Injection injection = inject_all(inputs, stages, volume);
        LpvSettings settings = settings_;
        settings.corrections &= layers.empty();
        LpvField field = propagate(program, injection, settings, stages);
        to_luminance(field, volume);
        follow(program, injection, field.course.fronts, stages, layers);
        if (mode != Occlusion::none)
            volume.occlusion = at_cell_centers(geometry, inputs.grid);
        volume.metadata["iterations"] = std::to_string(field.course.iterations());
        if (settings_.iterations > 0)
            volume.metadata["residual"] = format("%.6g", field.residual);
        else
            volume.metadata["missing"] = format("%.3g", field.missing);
        if (inputs.finest) // finer ones go by it
            solved_.coefficients = std::move(field.coefficients);
    }

private:
    static const LpvSolver& as_lpv(const std::unique_ptr<Solver>& solver) {
        return static_cast<const LpvSolver&>(*solver);
    }

    /// All light as virtual point lights: that of the maps and of lit surfaces.
    std::shared_ptr<const AllVpls> find_vpls(const Inputs& inputs, Stages& stages) const {
        auto all = std::make_shared<AllVpls>();
        all->frame = inputs.frame;
        const auto [count, size] = inputs.maps;
        if (count > 0) {
            stages.begin("rsm", inputs.scene.lights.size());
            all->vpls =
                vpl::render_vpls(inputs.device, inputs.scene, inputs.frame, {size, rsm_kernel_},
                                 stages.progress(), &inputs.visibility, inputs.layers);
            stages.end(format("%s of %d x %d, %s", counted(uint64_t(count), "map").c_str(), size,
                              size, counted(all->vpls.size(), "VPL").c_str()));
        }
        if (inputs.lit)
            vpl::emit_vpls(*inputs.lit, inputs.frame, all->vpls);
        return all;
    }

    /// The nearest level around whose cells go on beyond a side; null: what lies there is outside
    /// of them all.
    const LpvSolver* beyond(int side, const Inputs& inputs) const {
        const auto found = std::ranges::find_if(inputs.around, [&](const auto& solver) {
            return as_lpv(solver).solved_.is_beyond(side, inputs.grid);
        });
        return found == inputs.around.end() ? nullptr : &as_lpv(*found);
    }

    /// The virtual point lights of this grid. Those that lie in it come first: `own` says which of
    /// all they are.
    std::vector<vpl::Vpl> find_own(const Inputs& inputs,
                                   const std::array<const LpvSolver*, 6>& neighbours,
                                   std::vector<std::size_t>& own) const {
        vpl::Sides outer = 0;
        for (int side = 0; side < 6; ++side)
            outer |= neighbours[std::size_t(side)] ? 0u : 1u << side;
        const bool is_same =
            all_->frame.unit == inputs.frame.unit && all_->frame.origin == inputs.frame.origin;
        std::vector<vpl::Vpl> vpls, outside, near;
        for (std::size_t i = 0; i < all_->vpls.size(); ++i) {
            vpl::Vpl vpl = all_->vpls[i];
            if (!is_same)
                vpl.position = glm::vec3(
                    inputs.frame.from_world(all_->frame.to_world(glm::dvec3(vpl.position))));
            if (vpl::is_inside(vpl.position, inputs.frame)) {
                vpls.push_back(vpl);
                own.push_back(i);
                continue;
            }
            // The cells of a level around go on beyond the hull by half: light may start in them
            // that comes over no link.
            bool beside = false, starts_in = false;
            for (int side = 0; side < 6; ++side) {
                const int axis = side / 2;
                if (side % 2 ? double(vpl.position[axis]) <= inputs.frame.extent[axis]
                             : vpl.position[axis] >= 0.0f)
                    continue;
                const LpvSolver* neighbour = neighbours[std::size_t(side)];
                beside |= !neighbour;
                starts_in |= neighbour && neighbour->starts_on_hull(i, inputs.grid);
            }
            if (starts_in)
                near.push_back(vpl);
            else if (beside)
                outside.push_back(vpl);
        }
        if (scene::has_sky(inputs.scene))
            vpl::sky_vpls(inputs.scene.sky, inputs.visibility, inputs.frame, vpls, outer,
                          inputs.layers);
        vpl::let_in(outside, inputs.visibility, inputs.frame, outer);
        vpl::let_in(near, inputs.visibility, inputs.frame);
        vpls.insert(vpls.end(), outside.begin(), outside.end());
        vpls.insert(vpls.end(), near.begin(), near.end());
        return vpls;
    }

    /// Whether one of all virtual point lights starts in a cell whose centre lies in the hull of a
    /// finer grid.
    bool starts_on_hull(std::size_t vpl, const Grid& fine) const {
        if (starts_[vpl] == nowhere)
            return false;
        const glm::ivec3 cell = solved_.grid.cell_at(starts_[vpl]);
        const glm::ivec3 first = solved_.cell_at(fine.center(glm::ivec3(0)));
        const glm::ivec3 last = solved_.cell_at(fine.center(fine.dims - 1));
        return glm::all(glm::greaterThanEqual(cell, first))
               && glm::all(glm::lessThanEqual(cell, last));
    }

    Injection inject_all(const Inputs& inputs, Stages& stages, Volume& volume) {
        stages.begin("inject");
        std::array<const LpvSolver*, 6> neighbours;
        for (int side = 0; side < 6; ++side)
            neighbours[std::size_t(side)] = beyond(side, inputs);
        std::vector<std::size_t> own;
        const std::vector<vpl::Vpl> vpls = find_own(inputs, neighbours, own);
        Injection injection = inject(vpls, inputs.visibility, inputs.grid);
        starts_.assign(all_->vpls.size(), nowhere);
        for (std::size_t i = 0; i < own.size(); ++i)
            starts_[own[i]] = injection.cells[i];

        glm::dvec3 inflow(0.0);
        for (int side = 0; side < 6; ++side)
            if (const LpvSolver* neighbour = neighbours[std::size_t(side)]) {
                const Inflow in =
                    let_flow(neighbour->solved_, inputs.grid, side,
                             settings_.occlusion == Occlusion::none ? nullptr : &inputs.visibility,
                             injection);
                inflow += in.power;
                injection.shut += in.shut.x + in.shut.y + in.shut.z;
            }
        std::string text = format("%zu VPLs, %.6g lm", vpls.size(), injection.power);
        if (!inputs.around.empty()) {
            const double of_levels = inflow.x + inflow.y + inflow.z;
            text += format(", %.6g lm of them from levels around", of_levels);
            volume.metadata["inflow_lm"] = format("%.9g", of_levels);
        }
        volume.metadata["injected_lm"] = format("%.9g", injection.power);
        const double come = injection.power + injection.shut;
        const double shut = come > 0.0 ? 100.0 * injection.shut / come : 0.0;
        stages.end(text + format(", %.1f %% walled in", shut));
        if (injection.power == 0.0)
            stages.warn(inputs.scene.path + ": no light comes into the grid: the field is 0");
        else if (shut > 5.0)
            stages.warn(format("%.3g %% of the light is lost between surfaces so close to each "
                               "other that no cell's centre lies there; a higher `resolution` or "
                               "another solver keeps it",
                               shut));
        return injection;
    }

    LpvField propagate(const LpvProgram& program, const Injection& injection,
                       const LpvSettings& settings, Stages& stages) {
        stages.begin("propagate", 100);
        LpvField field =
            program.propagate(injection, solved_.transmittance, settings, stages.progress());
        const std::string iterations = counted(uint64_t(field.course.iterations()), "iteration");
        if (settings_.iterations > 0)
            stages.end(format("%s, %.3g %% of the power left", iterations.c_str(),
                              100.0 * field.residual));
        else
            stages.end(format("%s, less than %.2g %% of the light missing", iterations.c_str(),
                              100.0 * field.missing));
        if (settings_.iterations > 0 && field.residual > 0.1)
            stages.warn(
                format("propagation stopped after %s with %.3g %% of the power under way: the "
                       "field is too dark; raise `iterations`, or leave it out",
                       iterations.c_str(), 100.0 * field.residual));
        else if (settings_.iterations == 0
                 && !(field.missing <= std::max(1e-6, double(settings_.tolerance))))
            stages.warn(format("propagation stopped after %s with about %.3g %% of the light "
                               "missing, more than `tolerance` says",
                               iterations.c_str(), 100.0 * field.missing));
        return field;
    }

    void follow(const LpvProgram& program, const Injection& injection, int fronts, Stages& stages,
                std::span<Volume> layers) {
        if (layers.empty())
            return;
        stages.begin("layers", 100);
        std::vector<LpvField> fields;
        if (injection.layers.empty()) // no light comes into the grid
            fields.assign(layers.size(), {injection.coefficients, {}});
        else
            fields = program.propagate_layers(injection, solved_.transmittance, fronts,
                                              stages.progress());
        for (std::size_t layer = 0; layer < layers.size(); ++layer)
            to_luminance(fields[layer], layers[layer]);
        stages.end(counted(layers.size(), "layer"));
    }

    LpvSettings settings_;
    int rsm_kernel_;
    std::future<LpvProgram> program_;
    // What finer levels take from this one.
    std::shared_ptr<const AllVpls> all_;
    std::vector<std::size_t> starts_; ///< cells in which all start, as Injection::cells
    SolvedLevel solved_;
};

} // namespace

constinit const SolverKind lpv_kind{
    .name = "lpv",
    .help = "classic propagation",
    .orders = orders,
    .default_bounces = 1,
    .layers = Layering::of_lights,
    .nesting = Nesting::coupled,
    .parameters = parameters,
    .ladder = ladder,
    .map_size = map_size,
    .expected_error = expected_error,
    .device_bytes =
        [](const Grid& grid, const SolverSettings& settings, uint64_t layers) {
            return lpv_device_bytes(grid, settings_of(settings, grid, layers > 0), layers > 0);
        },
    .cost = cost,
    .make = [](const gpu::Device& device, const Grid& grid,
               const SolverSettings& settings) -> std::unique_ptr<Solver> {
        return std::make_unique<LpvSolver>(device, grid, settings_of(settings, grid, false),
                                           int(settings["rsm-kernel"]));
    },
};

} // namespace lpvbake::solver::lpv
