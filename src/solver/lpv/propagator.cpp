#include "solver/lpv/propagator.h"

#include "lpvbake/error.h"
#include "solver/lpv/follow.comp.h"
#include "solver/lpv/propagate.comp.h"
#include "solver/occlusion.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake::solver::lpv {
namespace {

constexpr uint64_t texel = sizeof(glm::vec4);

constexpr double far_angle = 0.4006696846;  ///< of the far face, seen from the source's centre, sr
constexpr double side_angle = 0.4234313544; ///< of a side face, sr

gpu::Program compile(const gpu::Device& device, const PropagateTiling& tiling, Occlusion occlusion,
                     bool follow) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::texels_rgba32,
                                    Binding::texels_r32,    Binding::storage,
                                    Binding::storage,       Binding::storage,
                                    Binding::texels_rgba32, Binding::storage}; // of a layer
    const auto constants = propagate_constants(tiling, occlusion);
    if (follow)
        return gpu::Program(device, shaders::follow_comp, bindings, sizeof(PropagatePush),
                            constants);
    return gpu::Program(device, shaders::propagate_comp,
                        std::span(bindings).first(binding_layer_in), sizeof(PropagatePush),
                        constants);
}

/// Copies cell values (`planes` groups of `width` floats a cell) into a buffer of the kernel's
/// layout, a layer at a time.
template <class Value>
void upload_cells(const gpu::Device& device, const Grid& grid, const gpu::Buffer& target,
                  uint32_t planes, uint32_t width, const Value& value) {
    const PropagateLayout layout = layout_of(grid);
    std::vector<float> layer(layout.layer(planes) * width);
    for (int z = 0; z < grid.dims.z; ++z) {
        const uint64_t start = layout.index(0, 0, z, 0, planes) - layout.row_pitch();
        tbb::parallel_for(0, grid.dims.y, [&](int y) {
            for (int x = 0; x < grid.dims.x; ++x)
                for (uint32_t plane = 0; plane < planes; ++plane)
                    value(grid.index({x, y, z}), plane,
                          &layer[(layout.index(uint32_t(x), uint32_t(y), z, plane, planes) - start)
                                 * width]);
        });
        gpu::upload(device, target, start * width * sizeof(float), std::as_bytes(std::span(layer)));
    }
}

} // namespace

double flux_through(const LpvFace& face, const float* lobe) {
    const glm::dvec3 w{face.toward};
    const double intensity =
        double(volume::sh_y0) * double(lobe[0])
        + double(volume::sh_y1)
              * (w.y * double(lobe[1]) + w.z * double(lobe[2]) + w.x * double(lobe[3]));
    return std::max(0.0, intensity) * (face.normal == face.toward ? far_angle : side_angle);
}

double budget(const float* lobe) {
    double leaving = 0.0;
    for (const LpvFace& face : lpv_faces())
        leaving += flux_through(face, lobe);
    return leaving > 0.0 ? std::sqrt(4.0 * glm::pi<double>()) * double(lobe[0]) / leaving : 0.0;
}

uint32_t planes_of(Occlusion occlusion) {
    return occlusion == Occlusion::none ? 0 : occlusion == Occlusion::face ? 3 : 30;
}

PropagateTiling tiling_for(const gpu::Device& device, const Grid& grid) {
    return device.is_cpu() ? cpu_tiling(uint32_t(grid.dims.x)) : gpu_tiling;
}

std::array<uint32_t, 6> propagate_constants(const PropagateTiling& tiling, Occlusion occlusion) {
    const uint32_t mode = occlusion == Occlusion::none   ? occlusion_none
                          : occlusion == Occlusion::face ? occlusion_link
                                                         : occlusion_per_face;
    return {tiling.local_size, tiling.lanes_x, tiling.tile_x, tiling.march, mode, tiling.group_sum};
}

PropagateLayout layout_of(const Grid& grid) {
    return {uint32_t(grid.dims.x), uint32_t(grid.dims.y), uint32_t(grid.dims.z)};
}

PropagatePlan plan_propagate(const gpu::Device& device, const Grid& grid, Occlusion occlusion,
                             uint64_t window) {
    const gpu::DeviceInfo& info = device.info();
    PropagatePlan plan{occlusion,
                       layout_of(grid),
                       tiling_for(device, grid),
                       planes_of(occlusion),
                       0,
                       0,
                       info.window_alignment,
                       0};
    const PropagateLayout& layout = plan.layout;
    // A slab is as many layers as a binding can see, the two layers beside it included.
    const uint64_t largest = window ? window : std::numeric_limits<uint64_t>::max();
    const uint64_t lobes = std::min({largest, info.max_storage_range, info.max_texels * texel});
    plan.window = lobes;
    uint64_t layers = (lobes - plan.alignment) / (layout.layer() * texel);
    if (plan.planes > 0) {
        const uint64_t taus = std::min(largest, info.max_texels * sizeof(float));
        layers =
            std::min(layers, (taus - plan.alignment) / (layout.layer(plan.planes) * sizeof(float)));
    }
    if (layers < 3)
        throw Error(ErrorKind::memory, "a layer of " + std::to_string(grid.dims.x) + " x "
                                           + std::to_string(grid.dims.y) + " cells exceeds what '"
                                           + info.name + "' can bind; lower `resolution`");
    plan.slab = uint32_t(std::min<uint64_t>(layers - 2, layout.nz));
    for (uint32_t z = 0; z < layout.nz; z += plan.slab)
        plan.partials +=
            plan.tiling.partials(layout.nx, layout.ny, std::min(plan.slab, layout.nz - z));
    return plan;
}

PropagatePrograms compile_propagate(const gpu::Device& device, const Grid& grid,
                                    Occlusion occlusion, bool follow) {
    const PropagateTiling tiling = tiling_for(device, grid);
    PropagatePrograms programs{compile(device, tiling, occlusion, follow), {}};
    if (occlusion == Occlusion::sh)
        programs.free_flight = compile(device, tiling, Occlusion::none, follow);
    return programs;
}

Propagator::Propagator(const gpu::Device& device, const Grid& grid, const PropagatePlan& plan,
                       const PropagatePrograms& programs, const Injection& injection,
                       std::span<const float> transmittance, std::span<const float> layer)
    : device_(device),
      grid_(grid),
      plan_(plan),
      programs_(programs),
      fronts_{{device, plan.layout.elements() * texel}, {device, plan.layout.elements() * texel}},
      sum_(device, plan.layout.elements() * texel),
      transmittance_(device,
                     std::max<uint64_t>(texel, plan.layout.elements(plan.planes) * sizeof(float))),
      partial_(device, uint64_t(plan.partials) * most_steps * sizeof(float)),
      follows_(!layer.empty()),
      layer_fronts_{{device, follows_ ? fronts_[0].bytes() : texel},
                    {device, follows_ ? fronts_[0].bytes() : texel}},
      batch_(device) {
    for (const gpu::Buffer* buffer :
         {&fronts_[0], &fronts_[1], &sum_, &transmittance_, &layer_fronts_[0], &layer_fronts_[1]})
        gpu::clear(device, *buffer);
    upload(injection, transmittance, layer);
}

void Propagator::upload(const Injection& injection, std::span<const float> transmittance,
                        std::span<const float> layer) {
    const std::span<const float> all(injection.coefficients);
    const auto upload_lobes = [&](const gpu::Buffer& to, std::span<const float> lobes,
                                  bool as_front) {
        upload_cells(device_, grid_, to, 3, 4, [&](size_t cell, uint32_t plane, float* out) {
            const size_t first = 12 * cell + 4 * plane;
            const double scale = !as_front ? 1.0 : all[first] != 0.0f ? budget(&all[first]) : 0.0;
            for (size_t k = 0; k < 4; ++k)
                out[k] = float(scale * double(lobes[first + k]));
        });
    };
    upload_lobes(sum_, follows_ ? layer : all, false);
    upload_lobes(fronts_[0], all, true);
    if (follows_)
        upload_lobes(layer_fronts_[0], layer, true);
    if (plan_.planes > 0)
        upload_cells(device_, grid_, transmittance_, plan_.planes, 1,
                     [&](size_t cell, uint32_t plane, float* out) {
                         *out = transmittance[plan_.planes * cell + plane];
                     });
}

double Propagator::run(int steps) {
    for (int i = 0; i < steps; ++i)
        record_step(done_ + i, uint32_t(i) * plan_.partials);
    batch_.run();
    done_ += steps;
    std::vector<float> fluxes(std::size_t(steps) * plan_.partials);
    gpu::download(device_, partial_, 0, std::as_writable_bytes(std::span(fluxes)));
    run_power_ = 0.0;
    double flux = 0.0;
    for (std::size_t step = 0; step < std::size_t(steps); ++step) {
        flux = 0.0;
        for (const float f : std::span(fluxes).subspan(step * plan_.partials, plan_.partials))
            flux += double(f);
        run_power_ += flux;
    }
    return flux;
}

PropagatedBuffers Propagator::buffers() const {
    return {fronts_[done_ % 2], fronts_[(done_ + 1) % 2], sum_, transmittance_, partial_};
}

void Propagator::record_step(int step, uint32_t partial_base) {
    const PropagateLayout& layout = plan_.layout;
    const bool free = plan_.occlusion == Occlusion::sh && step == 0;
    const uint32_t tau_planes = free ? 0 : plan_.planes;
    const gpu::Buffer& source = fronts_[step % 2];
    const gpu::Buffer& target = fronts_[(step + 1) % 2];
    const gpu::Buffer& layer_source = layer_fronts_[step % 2];
    const gpu::Buffer& layer_target = layer_fronts_[(step + 1) % 2];
    const uint64_t layer = layout.layer(), tau_layer = layout.layer(tau_planes);
    const auto window = [&](const gpu::Buffer& buffer, uint64_t first, uint64_t last,
                            uint64_t element, uint32_t& base) {
        return gpu::window_over(buffer, first, last, element, plan_.alignment, base);
    };
    for (uint32_t begin = 0; begin < layout.nz; begin += plan_.slab) {
        const uint32_t end = std::min(begin + plan_.slab, layout.nz);
        PropagatePush push{
            layout.nx, layout.ny, begin, end, layout.row_pitch(), layout.plane_pitch(),
            0,         0,         0,     0,   partial_base};
        // In a buffer, layer z comes after the border layer, at z + 1.
        const gpu::Window sums =
            window(sum_, (begin + 1) * layer, (end + 1) * layer, texel, push.accumulator_base);
        const gpu::Window windows[] = {
            window(source, begin * layer, (end + 2) * layer, texel, push.front_in_base),
            sums,
            tau_planes ? window(transmittance_, begin * tau_layer, (end + 2) * tau_layer,
                                sizeof(float), push.transmittance_base)
                       : gpu::Window{&transmittance_, 0, texel},
            window(target, (begin + 1) * layer, (end + 1) * layer, texel, push.front_out_base),
            sums,
            gpu::whole(partial_),
            follows_
                ? window(layer_source, begin * layer, (end + 2) * layer, texel, push.front_in_base)
                : gpu::whole(layer_source),
            follows_ ? window(layer_target, (begin + 1) * layer, (end + 1) * layer, texel,
                              push.front_out_base)
                     : gpu::whole(layer_target)};
        const auto groups = plan_.tiling.groups(layout.nx, layout.ny, end - begin);
        batch_.dispatch(free ? programs_.free_flight : programs_.usual,
                        std::span(windows).first(follows_ ? std::size(windows) : binding_layer_in),
                        std::as_bytes(std::span(&push, 1)), {groups.x, groups.y, groups.z});
        partial_base += plan_.tiling.partials(layout.nx, layout.ny, end - begin);
    }
}

std::vector<float> Propagator::download() const {
    const PropagateLayout& layout = plan_.layout;
    std::vector<float> coefficients(12 * grid_.size());
    std::vector<glm::vec4> layer(layout.layer());
    for (int z = 0; z < grid_.dims.z; ++z) {
        const uint64_t start = layout.index(0, 0, z, 0) - layout.row_pitch();
        gpu::download(device_, sum_, start * texel, std::as_writable_bytes(std::span(layer)));
        tbb::parallel_for(0, grid_.dims.y, [&](int y) {
            for (int x = 0; x < grid_.dims.x; ++x)
                for (uint32_t plane = 0; plane < 3; ++plane) {
                    const glm::vec4 lobe =
                        layer[layout.index(uint32_t(x), uint32_t(y), z, plane) - start];
                    std::copy_n(&lobe.x, 4, &coefficients[12 * grid_.index({x, y, z}) + 4 * plane]);
                }
        });
    }
    return coefficients;
}

} // namespace lpvbake::solver::lpv
