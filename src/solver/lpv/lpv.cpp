#include "solver/lpv/lpv.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::solver::lpv {
namespace {

constexpr int most_iterations = 100'000;

} // namespace

uint64_t lpv_device_bytes(const Grid& grid, Occlusion occlusion, bool layers) {
    const PropagateLayout layout = layout_of(grid);
    return (layers ? 5 : 3) * layout.elements() * sizeof(glm::vec4)
           + layout.elements(planes_of(occlusion)) * sizeof(float) + (uint64_t(1) << 20);
}

LpvProgram::LpvProgram(const gpu::Device& device, const Grid& grid, Occlusion occlusion,
                       uint64_t window)
    : device_(device),
      grid_(grid),
      occlusion_(occlusion),
      window_(window),
      programs_(compile_propagate(device, grid, occlusion)) {}

LpvField LpvProgram::propagate(const Injection& injection, std::span<const float> transmittance,
                               const LpvSettings& settings, Progress& progress) const {
    const PropagatePlan plan = plan_propagate(device_, grid_, occlusion_, window_);
    Propagator propagator(device_, grid_, plan, programs_, injection, transmittance);
    LpvField field;
    field.residual = injection.power > 0.0 ? 1.0 : 0.0;
    const int most = settings.iterations > 0 ? settings.iterations : most_iterations;
    const double tolerance = settings.iterations > 0 ? 0.0 : double(settings.tolerance);
    while (field.iterations < most && field.residual > tolerance) {
        const int steps = std::min(Propagator::most_steps, most - field.iterations);
        field.residual = propagator.run(steps) / injection.power;
        field.iterations += steps;
        // What is left falls by about the same factor every step.
        const double way = tolerance > 0.0
                               ? std::log(std::max(field.residual, tolerance)) / std::log(tolerance)
                               : double(field.iterations) / most;
        progress.advance(uint64_t(100.0 * std::clamp(way, 0.0, 1.0)));
    }
    field.coefficients = propagator.download();
    return field;
}

std::vector<LpvField> LpvProgram::propagate_layers(const Injection& injection,
                                                   std::span<const float> transmittance,
                                                   int iterations, Progress& progress) const {
    const PropagatePlan plan = plan_propagate(device_, grid_, occlusion_, window_);
    const PropagatePrograms programs = compile_propagate(device_, grid_, occlusion_, true);
    std::vector<LpvField> fields;
    for (const std::vector<float>& layer : injection.layers) {
        Propagator propagator(device_, grid_, plan, programs, injection, transmittance, layer);
        LpvField& field = fields.emplace_back();
        while (field.iterations < iterations) {
            const int steps = std::min(Propagator::most_steps, iterations - field.iterations);
            propagator.run(steps);
            field.iterations += steps;
            const double way = double(field.iterations) / iterations;
            progress.advance(uint64_t(100.0 * (double(fields.size() - 1) + way)
                                      / double(injection.layers.size())));
        }
        field.coefficients = propagator.download();
    }
    return fields;
}

void to_luminance(const LpvField& field, Volume& volume) {
    const size_t n = volume.grid.size();
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(n));
    const double scale = 1.0 / (1.5 * volume.grid.cell * volume.grid.cell);
    tbb::parallel_for(size_t(0), n, [&](size_t cell) {
        for (size_t k = 0; k < 4; ++k) {
            // The light that travels along w arrives from -w: band l changes by (-1)^l.
            const double sign = k == 0 ? scale : -scale;
            for (size_t channel = 0; channel < 3; ++channel)
                volume.sh[k][cell][int(channel)] =
                    float(sign * double(field.coefficients[12 * cell + 4 * channel + k]));
        }
    });
}

} // namespace lpvbake::solver::lpv
