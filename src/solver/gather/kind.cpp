#include "solver/gather/kind.h"

#include "background.h"
#include "scene/scene.h"
#include "solver/gather/discs.h"
#include "solver/gather/gather.h"
#include "solver/models.h"
#include "solver/outside.h"
#include "text.h"

#include <algorithm>
#include <cmath>
#include <future>

namespace lpvbake::solver::gather {
namespace {

constexpr int orders[] = {1, 2, 4};

constexpr Parameter parameters[] = {
    {.name = "vpls",
     .kind = ValueKind::whole,
     .lo = 16,
     .hi = 1'000'000,
     .usual = GatherSettings().vpls,
     .unit = "clusters",
     .help = "clusters of patches whose visibility a cell tests"},
    {.name = "rsm-samples",
     .kind = ValueKind::whole,
     .hi = 65536,
     .unit = "texels",
     .help = "texels of each map from which a cell takes the first reflection of punctual lights, "
             "noisily; 0: from clusters"},
    {.name = "tolerance",
     .kind = ValueKind::real,
     .hi = 1,
     .usual = 0.3,
     .help = "difference of irradiance below which cells are interpolated; 0: none"},
    {.name = "rsm-size",
     .kind = ValueKind::whole,
     .hi = 16384,
     .unit = "texels",
     .help = "texels along a side of a reflective shadow map; 0: from the grid",
     .needs = "rsm-samples"},
};

constexpr Rung ladder[] = {
    {{}, 1 << 18, {{{"vpls", 48}, {"tolerance", 0.5}}}},
    {Quality::fast, 1 << 18, {{{"vpls", 96}, {"tolerance", 0.5}}}},
    {Quality::balanced, 1 << 20, {{{"vpls", GatherSettings().vpls}, {"tolerance", 0.3}}}},
    {{}, 1 << 21, {{{"vpls", 384}, {"tolerance", 0.2}}}},
    {Quality::accurate, 1 << 22, {{{"vpls", 768}, {"tolerance", 0.1}}}},
};

/// What the solver is told of its settings.
struct Own {
    GatherSettings gather;
    int rsm_samples; ///< 0: clusters of patches bring the first reflection of punctual lights too
};

Own settings_of(const SolverSettings& settings) {
    Own own{{}, int(settings["rsm-samples"])};
    own.gather.order = settings.order();
    own.gather.vpls = int(settings["vpls"]);
    own.gather.tolerance = float(settings["tolerance"]);
    return own;
}

int map_size(const Grid& grid, const SolverSettings& settings) {
    if (settings["rsm-samples"] == 0)
        return 0;
    const int wanted = int(settings["rsm-size"]);
    return std::min(wanted > 0 ? wanted : vpl::usual_map_size(grid.dims), largest_disc_map);
}

double expected_error(const SolverSettings& settings, const Pilot& pilot) {
    const GatherSettings gather = settings_of(settings).gather;
    namespace error = models::error;
    return std::hypot(error::surfaces,
                      std::hypot(lost_clusters(pilot, gather.vpls),
                                 error::gather_tolerance
                                     * std::pow(double(gather.tolerance), error::gather_power)));
}

Cost cost(const Workload& work, const SolverSettings& settings) {
    const auto [gather, samples] = settings_of(settings);
    const uint64_t patches = uint64_t(work.patches);
    if (work.places > 0)
        return {{{"gather", gather_seconds_at(work.places, work.blocks, patches, gather),
                  format("%d clusters, order %d, every %s", gather.vpls, gather.order,
                         work.blocks ? "sample" : "point by itself")}},
                {},
                gather_host_bytes({}, patches, gather, work.gpu, 0, work.two_sided)
                    + models::bytes::gather_lists};
    const Grid solved = solved_grid(work, shard_layers);
    const double share = double(solved.size()) / double(std::max<uint64_t>(work.grid.size(), 1));
    const double passes = share * (1 + models::seconds::gather_layer * double(work.layers));
    Cost cost{{{"validity", validity_seconds(work.grid), "which cells lie outside geometry"},
               {"gather", passes * gather_seconds(work.grid, patches, gather, work.gpu),
                format("%d clusters, tolerance %.3g, order %d", gather.vpls,
                       double(gather.tolerance), gather.order)
                    + (work.layers > 0 ? ", " + counted(work.layers, "layer") : "")}},
              {},
              gather_host_bytes(solved, patches, gather, work.gpu, work.layers, work.two_sided)
                  + beside_slab_bytes(work, shard_layers, gather.order)};
    if (work.maps.count > 0)
        cost.stages.push_back(
            {"discs",
             models::seconds::discs_texel * double(work.grid.size()) * samples * work.maps.count,
             counted(uint64_t(samples), "texel") + " of each map for each cell"});
    return cost;
}

/// Clusters of patches straight to the cells that need it, the other cells from these; the first
/// reflection from the maps' texels, where that is wanted.
class GatherSolver final : public Solver {
public:
    GatherSolver(const gpu::Device& device, const Own& own)
        : rsm_samples_(own.rsm_samples),
          program_(std::async(in_background(), [&device, settings = own.gather] {
              return GatherProgram(device, settings);
          })) {}

    void solve(const Inputs& inputs, Stages& stages, Volume& volume) override {
        solve_layers(inputs, stages, volume, {});
    }

    void solve_layers(const Inputs& inputs, Stages& stages, Volume& volume,
                      std::span<Volume> layers) override {
        find_validity(inputs, stages, volume);
        stages.begin("gather");
        const surface::LitSurfaces none;
        end(program_.get().gather(inputs.lit ? *inputs.lit : none, inputs.scene.sky,
                                  inputs.visibility, volume, stages.progress(), 0.0f,
                                  {inputs.layers, layers}, inputs.slab),
            "cell", stages);
        keep_slab(inputs, volume);
        const auto [count, size] = inputs.maps;
        if (count == 0)
            return;
        stages.begin("discs", inputs.scene.lights.size());
        const DiscReport discs =
            gather_discs(inputs.device, inputs.scene, inputs.frame, inputs.visibility,
                         {rsm_samples_, size}, volume, stages.progress());
        stages.end(format("%s of %d x %d, %s", counted(uint64_t(discs.maps), "map").c_str(), size,
                          size, counted(discs.rays, "visibility ray").c_str()));
    }

    void solve_at(std::span<const glm::vec3> places, const Inputs& inputs, Stages& stages,
                  Volume& volume, std::span<Volume> layers) override {
        stages.begin("gather");
        end(program_.get().gather_at(places, *inputs.lit, inputs.scene.sky, inputs.visibility,
                                     volume, stages.progress(), {inputs.layers, layers}),
            "point", stages);
    }

    void solve_blocks(std::span<const Block> blocks, const Inputs& inputs, Stages& stages,
                      Volume& volume) override {
        stages.begin("gather");
        const GatherProgram& program = program_.get();
        if (senders_of_ != inputs.lit) {
            senders_ = program.senders(*inputs.lit, inputs.scene.sky, inputs.visibility);
            senders_of_ = inputs.lit;
        }
        end(program.gather_blocks(blocks, *inputs.lit, senders_, inputs.visibility, volume,
                                  stages.progress()),
            "sample", stages);
    }

private:
    static void end(const GatherReport& report, const char* what, Stages& stages) {
        stages.end(
            counted(report.solved, what) + " solved, "
            + (report.interpolated ? std::to_string(report.interpolated) + " interpolated, " : "")
            + counted(report.rays, "visibility ray"));
    }

    int rsm_samples_;
    std::shared_future<GatherProgram> program_; ///< asked for again by bricks
    Senders senders_;                           ///< of bricks, whatever their level
    const surface::LitSurfaces* senders_of_ = nullptr;
};

} // namespace

constinit const SolverKind gather_kind{
    .name = "gather",
    .help = "from clusters of patches straight to the cells",
    .orders = orders,
    .default_bounces = std::nullopt,
    .at_places = true,
    .layers = Layering::of_parts,
    .nesting = Nesting::independent,
    .parameters = parameters,
    .ladder = ladder,
    .map_size = map_size,
    .expected_error = expected_error,
    .shard_layers =
        [](const SolverSettings& settings) {
            return settings["rsm-samples"] > 0 ? 0 : shard_layers; // of discs there is no part
        },
    .device_bytes =
        [](const Grid&, const SolverSettings& settings, uint64_t layers) {
            return gather_device_bytes(settings_of(settings).gather, layers > 0);
        },
    .cost = cost,
    .make = [](const gpu::Device& device, const Grid&,
               const SolverSettings& settings) -> std::unique_ptr<Solver> {
        return std::make_unique<GatherSolver>(device, settings_of(settings));
    },
};

} // namespace lpvbake::solver::gather
