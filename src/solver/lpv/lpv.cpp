#include "solver/lpv/lpv.h"

#include "error.h"
#include "solver/lpv/propagate.comp.h"
#include "solver/lpv/propagate.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lpvbake {
namespace {

constexpr int most_iterations = 100'000;
/// Steps between two looks at what is left: a look costs a round trip to the device.
constexpr int steps_a_batch = 8;

constexpr double far_angle = 0.4006696846;  ///< of the far face, seen from the source's centre, sr
constexpr double side_angle = 0.4234313544; ///< of a side face, sr

lpv::PropagateLayout layout_of(const Grid& grid) {
    return {uint32_t(grid.dims.x), uint32_t(grid.dims.y), uint32_t(grid.dims.z)};
}

/// Floats of transmittance a cell.
uint32_t planes_of(Occlusion occlusion) {
    return occlusion == Occlusion::none ? 0 : occlusion == Occlusion::face ? 3 : 30;
}

lpv::PropagateTiling tiling_for(const gpu::Device& device, const Grid& grid) {
    return device.is_cpu() ? lpv::cpu_tiling(uint32_t(grid.dims.x)) : lpv::gpu_tiling;
}

gpu::Program compile(const gpu::Device& device, const lpv::PropagateTiling& tiling,
                     Occlusion occlusion) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::texels_rgba32,
                                    Binding::texels_r32,    Binding::storage,
                                    Binding::storage,       Binding::storage};
    const uint32_t mode = occlusion == Occlusion::none   ? lpv::occlusion_none
                          : occlusion == Occlusion::face ? lpv::occlusion_link
                                                         : lpv::occlusion_per_face;
    const uint32_t constants[] = {tiling.local_size, tiling.lanes_x, tiling.tile_x,
                                  tiling.march,      mode,           tiling.group_sum};
    return gpu::Program(device, shaders::propagate_comp, bindings, sizeof(lpv::PropagatePush),
                        constants);
}

/// What a lobe is multiplied with so that the flux through its 30 faces is its power.
double budget(const float* lobe) {
    double leaving = 0.0;
    for (const LpvFace& face : lpv_faces()) {
        const glm::dvec3 w{face.toward};
        const double intensity =
            double(sh_y0) * double(lobe[0])
            + double(sh_y1)
                  * (w.y * double(lobe[1]) + w.z * double(lobe[2]) + w.x * double(lobe[3]));
        leaving += std::max(0.0, intensity) * (face.normal == face.toward ? far_angle : side_angle);
    }
    return leaving > 0.0 ? std::sqrt(4.0 * glm::pi<double>()) * double(lobe[0]) / leaving : 0.0;
}

/// Copies cell values (`planes` groups of `width` floats a cell) into a buffer of the kernel's
/// layout, a layer at a time.
template <class Value>
void upload_cells(const gpu::Device& device, const Grid& grid, const gpu::Buffer& target,
                  uint32_t planes, uint32_t width, const Value& value) {
    const lpv::PropagateLayout layout = layout_of(grid);
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

/// A window over elements [first, last) of a buffer, widened to the device's alignment; `base` is
/// where `first` lies in it.
gpu::Window window_over(const gpu::Buffer& buffer, uint64_t first, uint64_t last, uint64_t element,
                        uint64_t alignment, uint32_t& base) {
    const uint64_t offset = first * element / alignment * alignment;
    base = uint32_t((first * element - offset) / element);
    return {&buffer, offset, last * element - offset};
}

} // namespace

uint64_t lpv_device_bytes(const Grid& grid, Occlusion occlusion) {
    const lpv::PropagateLayout layout = layout_of(grid);
    return 3 * layout.elements() * sizeof(glm::vec4)
           + layout.elements(planes_of(occlusion)) * sizeof(float) + (uint64_t(1) << 20);
}

LpvProgram::LpvProgram(const gpu::Device& device, const Grid& grid, Occlusion occlusion,
                       uint64_t window)
    : device_(device),
      grid_(grid),
      occlusion_(occlusion),
      window_(window),
      propagate_(compile(device, tiling_for(device, grid), occlusion)) {
    if (occlusion == Occlusion::sh)
        free_flight_ = compile(device, tiling_for(device, grid), Occlusion::none);
}

LpvField LpvProgram::propagate(const Injection& injection, std::span<const float> transmittance,
                               const LpvSettings& settings, Progress& progress) const {
    const lpv::PropagateLayout layout = layout_of(grid_);
    const lpv::PropagateTiling tiling = tiling_for(device_, grid_);
    const gpu::DeviceInfo& info = device_.info();
    const uint32_t planes = planes_of(occlusion_);
    const uint64_t texel = sizeof(glm::vec4);

    // A slab is as many layers as a binding can see, the two layers beside it included.
    const uint64_t largest = window_ ? window_ : std::numeric_limits<uint64_t>::max();
    const uint64_t lobes = std::min({largest, info.max_storage_range, info.max_texels * texel});
    uint64_t layers = (lobes - info.window_alignment) / (layout.layer() * texel);
    if (planes > 0) {
        const uint64_t taus = std::min(largest, info.max_texels * sizeof(float));
        layers = std::min(layers,
                          (taus - info.window_alignment) / (layout.layer(planes) * sizeof(float)));
    }
    if (layers < 3)
        throw Error(ExitCode::memory, "a layer of " + std::to_string(grid_.dims.x) + " x "
                                          + std::to_string(grid_.dims.y) + " cells exceeds what '"
                                          + info.name + "' can bind; lower --resolution");
    const uint32_t slab = uint32_t(std::min<uint64_t>(layers - 2, layout.nz));

    const gpu::Buffer fronts[2] = {{device_, layout.elements() * texel},
                                   {device_, layout.elements() * texel}};
    const gpu::Buffer sum(device_, layout.elements() * texel);
    const gpu::Buffer tau(device_,
                          std::max<uint64_t>(texel, layout.elements(planes) * sizeof(float)));
    for (const gpu::Buffer* buffer : {&fronts[0], &fronts[1], &sum, &tau})
        gpu::clear(device_, *buffer);
    const auto lobe_of = [&](size_t cell, uint32_t plane) {
        return &injection.coefficients[12 * cell + 4 * plane];
    };
    upload_cells(device_, grid_, sum, 3, 4, [&](size_t cell, uint32_t plane, float* out) {
        std::copy_n(lobe_of(cell, plane), 4, out);
    });
    upload_cells(device_, grid_, fronts[0], 3, 4, [&](size_t cell, uint32_t plane, float* out) {
        const float* lobe = lobe_of(cell, plane);
        const double scale = lobe[0] != 0.0f ? budget(lobe) : 0.0;
        for (int k = 0; k < 4; ++k)
            out[k] = float(scale * double(lobe[k]));
    });
    if (planes > 0)
        upload_cells(device_, grid_, tau, planes, 1, [&](size_t cell, uint32_t plane, float* out) {
            *out = transmittance[planes * cell + plane];
        });

    uint32_t partials = 0; // of one step
    for (uint32_t z = 0; z < layout.nz; z += slab)
        partials += tiling.partials(layout.nx, layout.ny, std::min(slab, layout.nz - z));
    const gpu::Buffer partial(device_, uint64_t(partials) * steps_a_batch * sizeof(float));

    const auto record_step = [&](gpu::Batch& batch, int step, uint32_t partial_base) {
        const bool free = occlusion_ == Occlusion::sh && step == 0;
        const uint32_t tau_planes = free ? 0 : planes;
        const gpu::Buffer& source = fronts[step % 2];
        const gpu::Buffer& target = fronts[(step + 1) % 2];
        for (uint32_t begin = 0; begin < layout.nz; begin += slab) {
            const uint32_t end = std::min(begin + slab, layout.nz);
            const uint64_t layer = layout.layer(), tau_layer = layout.layer(tau_planes);
            lpv::PropagatePush push{
                layout.nx, layout.ny, begin, end, layout.row_pitch(), layout.plane_pitch(),
                0,         0,         0,     0,   partial_base};
            const auto window = [&](const gpu::Buffer& buffer, uint64_t first, uint64_t last,
                                    uint64_t element, uint32_t& base) {
                return window_over(buffer, first, last, element, info.window_alignment, base);
            };
            // In a buffer, layer z comes after the border layer, at z + 1.
            const gpu::Window sums =
                window(sum, (begin + 1) * layer, (end + 1) * layer, texel, push.accumulator_base);
            const gpu::Window windows[] = {
                window(source, begin * layer, (end + 2) * layer, texel, push.front_in_base),
                sums,
                tau_planes ? window(tau, begin * tau_layer, (end + 2) * tau_layer, sizeof(float),
                                    push.transmittance_base)
                           : gpu::Window{&tau, 0, texel},
                window(target, (begin + 1) * layer, (end + 1) * layer, texel, push.front_out_base),
                sums,
                {&partial, 0, partial.bytes()}};
            const auto groups = tiling.groups(layout.nx, layout.ny, end - begin);
            batch.dispatch(free ? free_flight_ : propagate_, windows,
                           std::as_bytes(std::span(&push, 1)), {groups.x, groups.y, groups.z});
            partial_base += tiling.partials(layout.nx, layout.ny, end - begin);
        }
    };

    LpvField field;
    field.residual = injection.power > 0.0 ? 1.0 : 0.0;
    const int most = settings.iterations > 0 ? settings.iterations : most_iterations;
    const double tolerance = settings.iterations > 0 ? 0.0 : double(settings.tolerance);
    gpu::Batch batch(device_);
    std::vector<float> fluxes(partials);
    while (field.iterations < most && field.residual > tolerance) {
        const int steps = std::min(steps_a_batch, most - field.iterations);
        for (int i = 0; i < steps; ++i)
            record_step(batch, field.iterations + i, uint32_t(i) * partials);
        batch.run();
        field.iterations += steps;
        gpu::download(device_, partial, uint64_t(steps - 1) * partials * sizeof(float),
                      std::as_writable_bytes(std::span(fluxes)));
        double flux = 0.0;
        for (const float f : fluxes)
            flux += double(f);
        field.residual = flux / injection.power;
        // What is left falls by about the same factor every step.
        const double way = tolerance > 0.0
                               ? std::log(std::max(field.residual, tolerance)) / std::log(tolerance)
                               : double(field.iterations) / most;
        progress.advance(uint64_t(100.0 * std::clamp(way, 0.0, 1.0)));
    }

    field.coefficients.resize(12 * grid_.size());
    std::vector<glm::vec4> layer(layout.layer());
    for (int z = 0; z < grid_.dims.z; ++z) {
        const uint64_t start = layout.index(0, 0, z, 0) - layout.row_pitch();
        gpu::download(device_, sum, start * texel, std::as_writable_bytes(std::span(layer)));
        tbb::parallel_for(0, grid_.dims.y, [&](int y) {
            for (int x = 0; x < grid_.dims.x; ++x)
                for (uint32_t plane = 0; plane < 3; ++plane) {
                    const glm::vec4 lobe =
                        layer[layout.index(uint32_t(x), uint32_t(y), z, plane) - start];
                    std::copy_n(&lobe.x, 4,
                                &field.coefficients[12 * grid_.index({x, y, z}) + 4 * plane]);
                }
        });
    }
    return field;
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

} // namespace lpvbake
