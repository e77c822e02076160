#include "solver/sn/kind.h"

#include "background.h"
#include "scene/scene.h"
#include "solver/models.h"
#include "solver/outside.h"
#include "solver/sn/directions.h"
#include "solver/sn/sn.h"
#include "text.h"

#include <cmath>
#include <future>

namespace lpvbake::solver::sn {
namespace {

constexpr int orders[] = {1, 2, 3, 4};

constexpr Parameter parameters[] = {
    {.name = "directions",
     .kind = ValueKind::whole,
     .lo = 48,
     .hi = 384,
     .usual = SnSettings().directions,
     .unit = "directions",
     .help = "directions over the sphere",
     .round = [](double value) { return double(sn_direction_count(int(value))); }},
    {.name = "tile",
     .kind = ValueKind::whole,
     .hi = 4096,
     .unit = "cells",
     .help = "cells along an edge of tiles that are swept by themselves, up to a multiple of 16, "
             "so that "
             "the device holds one; 0: all at once",
     .round =
         [](double value) {
             return std::ceil(value / gather::shard_layers) * gather::shard_layers;
         }},
};

constexpr Rung ladder[] = {
    {{}, 1 << 18, {{{"directions", 48}}}},
    {Quality::fast, 1 << 18, {{{"directions", 144}}}},
    {Quality::balanced, 1 << 20, {{{"directions", SnSettings().directions}}}},
    {Quality::accurate, 1 << 22, {{{"directions", 384}}}},
};

SnSettings settings_of(const SolverSettings& settings) {
    return {int(settings["directions"]), settings.order(), int(settings["tile"])};
}

double expected_error(const SolverSettings& settings, const Pilot& pilot) {
    namespace error = models::error;
    return std::hypot(error::surfaces,
                      error::sn_peaks
                          * lost_clusters(pilot, peak_settings(settings_of(settings)).vpls),
                      error::sn_directions / std::sqrt(settings["directions"]));
}

Cost cost(const Workload& work, const SolverSettings& settings) {
    const SnSettings sn = settings_of(settings);
    const Grid solved = solved_grid(work, gather::shard_layers);
    const Grid own = solved_grid(work, 0);
    const double all = double(std::max<uint64_t>(work.grid.size(), 1));
    const double gathers =
        double(solved.size()) / all * (1 + models::seconds::gather_layer * double(work.layers));
    const double sweeps = 1 + models::seconds::sweep_layer * double(work.layers);
    return {
        {{"validity", validity_seconds(work.grid), "which cells lie outside geometry"},
         {"gather",
          gathers
              * gather::gather_seconds(work.grid, uint64_t(work.patches / models::patches_a_peak),
                                       peak_settings(sn), work.gpu),
          "what is brighter than 1.5 times the mean"},
         {"sweep", sweeps * sn_seconds(own, sn, work.gpu),
          format("%d directions, order %d", sn.directions, sn.order)
              + (work.layers > 0 ? ", " + counted(work.layers, "layer") : "")}},
        {},
        sn_host_bytes(solved, uint64_t(work.patches),
                      uint64_t(work.patches / models::patches_a_peak), sn, work.gpu, work.layers,
                      work.two_sided)
            + beside_slab_bytes(work, gather::shard_layers, sn.order)};
}

/// Luminance along fixed directions, from cell to cell, downstream.
class SnSolver final : public Solver {
public:
    SnSolver(const gpu::Device& device, const Grid& grid, const SnSettings& settings)
        : settings_(settings),
          program_(std::async(in_background(), [&device, &grid, settings] {
                       return SnProgram(device, grid, settings);
                   }).share()) {}

    void solve(const Inputs& inputs, Stages& stages, Volume& volume) override {
        solve_layers(inputs, stages, volume, {});
    }

    void solve_layers(const Inputs& inputs, Stages& stages, Volume& volume,
                      std::span<Volume> volumes) override {
        const gather::Layers layers{inputs.layers, volumes};
        find_validity(inputs, stages, volume);
        const SnProgram& sn = program_.get();
        const visibility::Air* const air = inputs.visibility.air();
        const Sky none, &sky = air && air->is_lit() ? none : inputs.scene.sky;
        stages.begin("gather");
        const float limit = sn.gather_peaks(*inputs.lit, inputs.visibility, sky, stages.progress(),
                                            volume, layers, inputs.slab);
        stages.end(air ? "nothing: in air all light is swept"
                       : format("what is brighter than %.4g nits", double(limit)));
        stages.begin("sweep", 100);
        sn.sweep(*inputs.lit, inputs.visibility, sky, limit, stages.progress(), volume, layers,
                 {air ? nullptr : inputs.cache, inputs.frame}, inputs.slab);
        stages.end(format("%d directions", settings_.directions)
                   + (settings_.tile > 0 ? format(", tiles of %d cells", settings_.tile) : ""));
        volume.metadata["directions"] = std::to_string(settings_.directions);
        if (settings_.tile > 0)
            volume.metadata["tile"] = std::to_string(settings_.tile);
        keep_slab(inputs, volume);
    }

private:
    SnSettings settings_;
    std::shared_future<SnProgram> program_;
};

} // namespace

constinit const SolverKind sn_kind{
    .name = "sn",
    .help = "discrete ordinates",
    .orders = orders,
    .default_bounces = std::nullopt,
    .layers = Layering::any,
    .nesting = Nesting::independent,
    .in_air = true,
    .parameters = parameters,
    .ladder = ladder,
    .map_size = [](const Grid&, const SolverSettings&) { return 0; },
    .expected_error = expected_error,
    .shard_layers = [](const SolverSettings& settings) { return int(settings["tile"]); },
    .device_bytes =
        [](const Grid& grid, const SolverSettings& settings, uint64_t layers) {
            return sn_device_bytes(grid, settings_of(settings), layers > 0);
        },
    .cost = cost,
    .make = [](const gpu::Device& device, const Grid& grid,
               const SolverSettings& settings) -> std::unique_ptr<Solver> {
        return std::make_unique<SnSolver>(device, grid, settings_of(settings));
    },
};

} // namespace lpvbake::solver::sn
