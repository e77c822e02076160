#include "solver/sn/sweeper.h"

#include "lpvbake/error.h"
#include "solver/sn/directions.h"
#include "solver/sn/given.comp.h"
#include "solver/sn/project.comp.h"
#include "solver/sn/transport.comp.h"
#include "solver/sn/transport_air.comp.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

namespace lpvbake::solver::sn {
namespace {

constexpr uint64_t texel = sizeof(glm::vec4);
/// Of the ring of fronts, where all directions of an octant do not fit.
constexpr uint64_t ring_bytes = uint64_t(64) << 20;
/// The same on a CPU device, whose caches should hold them.
constexpr uint64_t cpu_ring_bytes = uint64_t(6) << 20;

uint32_t padded_directions(int directions) {
    return (uint32_t(directions) / 8 + lanes - 1) / lanes * lanes;
}

template <class T>
void put(const gpu::Device& device, const gpu::Buffer& buffer, std::span<const T> values) {
    gpu::upload(device, buffer, 0, std::as_bytes(values));
}

/// The same into a buffer that is made at least so large.
template <class T>
void replace(const gpu::Device& device, gpu::Buffer& buffer, std::span<const T> values) {
    if (buffer.bytes() < values.size_bytes())
        buffer = gpu::Buffer(device, values.size_bytes());
    put(device, buffer, values);
}

template <class Push>
std::span<const std::byte> bytes_of(const Push& push) {
    return std::as_bytes(std::span(&push, 1));
}

} // namespace

uint32_t swept_directions(const SweepLayout& layout, int directions, uint64_t most_bytes,
                          bool cpu) {
    const uint64_t group = layout.ring_texels(lanes) * texel;
    const uint64_t groups = std::min(most_bytes, cpu ? cpu_ring_bytes : ring_bytes) / group;
    return uint32_t(std::clamp<uint64_t>(groups, 1, padded_directions(directions) / lanes)) * lanes;
}

uint32_t projected_directions(uint32_t stride, int order) {
    const uint32_t most = max_project_weights / uint32_t(volume::sh_count(order));
    for (uint32_t parts = 1;; ++parts)
        if (stride % (parts * lanes) == 0 && stride / parts <= most)
            return stride / parts;
}

SweepTiling tiling_for(const gpu::Device& device) {
    return device.is_cpu() ? cpu_tiling : gpu_tiling;
}

uint64_t sweep_bytes(const Grid& grid, int directions, int order) {
    const SweepLayout layout(grid.dims);
    const uint32_t stride =
        swept_directions(layout, directions, std::numeric_limits<uint64_t>::max(), false);
    return grid.size() * sh_vec4s(uint32_t(volume::sh_count(order))) * texel
           + layout.ring_texels(stride) * texel + 3 * chunk_bytes;
}

SweepPlan plan_sweep(const gpu::Device& device, const Grid& grid, int order, uint32_t stride,
                     uint64_t largest) {
    const gpu::DeviceInfo& info = device.info();
    const SweepLayout layout(grid.dims);
    const uint64_t cell_bytes = sh_vec4s(uint32_t(volume::sh_count(order))) * texel;
    const uint64_t layer_cells = uint64_t(grid.dims.x) * uint64_t(grid.dims.y);
    const uint64_t front_cells = layout.slots(); // the largest front has at most so many
    if (layer_cells * cell_bytes > largest || layout.ring_texels(stride) * texel > largest
        || front_cells * stride * texel > largest)
        throw Error(ErrorKind::memory, "a layer of " + std::to_string(grid.dims.x) + " x "
                                           + std::to_string(grid.dims.y) + " cells exceeds what '"
                                           + info.name + "' can bind; lower `resolution`");
    const uint64_t weights = max_project_weights * sizeof(float);
    return {layout,
            tiling_for(device),
            order,
            stride,
            projected_directions(stride, order),
            cell_bytes,
            layer_cells,
            std::min(chunk_bytes, largest),
            int(std::min(largest / (layer_cells * cell_bytes), uint64_t(grid.dims.z))),
            info.window_alignment,
            (weights + info.window_alignment - 1) / info.window_alignment * info.window_alignment};
}

namespace {

gpu::Program compile_project(const gpu::Device& device, uint32_t stride, int order, bool columns) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::storage, Binding::uniform,
                                    Binding::texels_rgba32, Binding::storage};
    const SweepTiling tiling = tiling_for(device);
    const uint32_t constants[] = {tiling.local_size, tiling.project_march,
                                  uint32_t(volume::sh_count(order)),
                                  projected_directions(stride, order), columns ? 1u : 0u};
    return gpu::Program(device, shaders::project_comp, bindings, sizeof(ProjectPush), constants);
}

gpu::Program compile_transport_in_air(const gpu::Device& device, uint32_t coefficients) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::storage,
                                    Binding::texels_r32,    Binding::texels_rgba32,
                                    Binding::texels_rgba32, Binding::texels_rgba32};
    const SweepTiling tiling = tiling_for(device);
    const uint32_t constants[] = {tiling.local_size, tiling.march, coefficients};
    return gpu::Program(device, shaders::transport_air_comp, bindings, sizeof(TransportPush),
                        constants);
}

} // namespace

SweepPrograms compile_sweep(const gpu::Device& device, uint32_t stride, int order) {
    using gpu::Binding;
    const SweepTiling tiling = tiling_for(device);
    constexpr Binding transport[] = {Binding::texels_rgba32, Binding::storage, Binding::texels_r32,
                                     Binding::texels_rgba32};
    constexpr Binding given[] = {Binding::storage, Binding::storage, Binding::texels_rgba32};
    const uint32_t constants[] = {tiling.local_size, tiling.march};
    return {
        gpu::Program(device, shaders::transport_comp, transport, sizeof(TransportPush), constants),
        gpu::Program(device, shaders::given_comp, given, sizeof(GivenPush), constants),
        compile_project(device, stride, order, false)};
}

SweptAir::SweptAir(const gpu::Device& device, const visibility::Air& of, LightPart part,
                   uint32_t stride, int order)
    : air(of),
      coefficients(part == LightPart::air ? uint32_t(of.coefficients()) : 0),
      transport(compile_transport_in_air(device, coefficients)),
      project(compile_project(device, stride, order, part == LightPart::surfaces)) {}

Sweeper::Sweeper(const gpu::Device& device, const Grid& grid, const SweepPlan& plan,
                 const SweepPrograms& programs, const SweptAir* in_air)
    : device_(device),
      grid_(grid),
      plan_(plan),
      programs_(programs),
      in_air_(in_air),
      sh_(device, grid.size() * plan.cell_bytes),
      ring_(device, plan.ring_texels() * texel),
      table_(device, plan.stride * direction_vec4s * texel),
      weights_(device, plan.stride / plan.at_once * plan.weight_bytes),
      air_table_(device, plan.stride * air_direction_vec4s * texel),
      cells_(device, texel),
      cell_slots_(device, texel),
      given_slots_(device, texel),
      given_(device, texel),
      air_(device, texel),
      batch_(device) {
    gpu::clear(device, sh_);
}

void Sweeper::begin(const Directions& directions, std::span<const glm::vec4> ring) {
    const size_t coefficients = size_t(volume::sh_count(plan_.order));
    put(device_, table_, std::span(directions.table));
    if (in_air_)
        put(device_, air_table_, std::span(directions.air));
    for (uint32_t d = 0; d < plan_.stride; d += plan_.at_once)
        gpu::upload(device_, weights_, d / plan_.at_once * plan_.weight_bytes,
                    std::as_bytes(std::span(directions.weights)
                                      .subspan(d * coefficients, plan_.at_once * coefficients)));
    put(device_, ring_, ring);
}

void Sweeper::run(const FrontOrder& order, const Chunk& chunk) {
    upload(order, chunk);
    const uint32_t first_cell = order.first[size_t(chunk.begin)];
    const uint32_t first_given = order.first_given[size_t(chunk.begin)];
    const auto cells = std::span(order.cells).subspan(first_cell);
    uint32_t projected = 0; // entries that are in the coefficients
    for (int f = chunk.begin; f < chunk.end; ++f) {
        const uint32_t last = order.first[size_t(f + 1)] - first_cell;
        record_given(order.first_given[size_t(f)] - first_given,
                     order.first_given[size_t(f + 1)] - first_given,
                     plan_.layout.base(f + int(ring_fronts)));
        record_transport(order.middle[size_t(f)] - first_cell, last, f);
        if (f + 1 == chunk.end || (f + 1 - chunk.begin) % int(projected_fronts) == 0) {
            record_project(cells, projected, last);
            projected = last;
        }
    }
    batch_.run();
}

void Sweeper::upload(const FrontOrder& order, const Chunk& chunk) {
    replace(device_, cells_,
            std::span(order.cells)
                .subspan(order.first[size_t(chunk.begin)], order.cells_of(chunk.begin, chunk.end)));
    replace(device_, cell_slots_, std::span(chunk.cell_slots));
    if (!chunk.given_slots.empty()) {
        replace(device_, given_slots_, std::span(chunk.given_slots));
        replace(device_, given_, std::span(chunk.given));
    }
    if (in_air_)
        replace(device_, air_, std::span(chunk.air));
}

gpu::Groups Sweeper::groups_of(uint32_t entries) const {
    const uint32_t a_group = plan_.tiling.local_size / lanes * plan_.tiling.march;
    return {(entries + a_group - 1) / a_group, plan_.stride / lanes, 1};
}

void Sweeper::record_given(uint32_t first, uint32_t last, uint32_t out_base) {
    if (last == first)
        return;
    const gpu::Window windows[] = {gpu::whole(ring_), gpu::whole(given_slots_), gpu::whole(given_)};
    const GivenPush push{first, last, first * plan_.stride, plan_.stride, out_base};
    batch_.dispatch(programs_.given, windows, bytes_of(push), groups_of(last - first));
}

void Sweeper::record_transport(uint32_t first, uint32_t last, int front) {
    if (last == first)
        return;
    const auto base = [&](int lag) { return plan_.layout.base(front + int(ring_fronts) - lag); };
    const gpu::Window windows[] = {gpu::whole(ring_),  gpu::whole(ring_), gpu::whole(cell_slots_),
                                   gpu::whole(table_), gpu::whole(air_),  gpu::whole(air_table_)};
    const glm::vec3 taken = in_air_ ? in_air_->air.extinction() : glm::vec3(0.0f);
    const TransportPush push{first,   last,    plan_.stride, base(0), base(1),
                             base(2), base(3), taken.x,      taken.y, taken.z};
    batch_.dispatch(in_air_ ? in_air_->transport : programs_.transport,
                    std::span(windows).first(in_air_ ? 6 : 4), bytes_of(push),
                    groups_of(last - first));
}

void Sweeper::record_project(std::span<const Entry> cells, uint32_t first, uint32_t last) {
    const uint64_t slab_cells = uint64_t(plan_.slab) * plan_.layer_cells;
    const auto slab_of = [&](uint32_t entry) { return cells[entry].cell / slab_cells; };
    const uint64_t quads = sh_vec4s(uint32_t(volume::sh_count(plan_.order)));
    const uint32_t a_group = plan_.tiling.local_size * plan_.tiling.project_march;
    for (uint32_t until; first < last; first = until) {
        until = last;
        if (plan_.slab < grid_.dims.z)
            for (until = first; until < last && slab_of(until) == slab_of(first);)
                ++until;
        const uint64_t start = slab_of(first) * slab_cells;
        const uint64_t stop = std::min(start + slab_cells, uint64_t(grid_.size()));
        const glm::vec3 taken = in_air_ ? in_air_->air.extinction() : glm::vec3(0.0f);
        ProjectPush push{first, until,   plan_.stride, 0,      uint32_t(start),
                         0,     taken.x, taken.y,      taken.z};
        const gpu::Window coefficients = gpu::window_over(sh_, start * quads, stop * quads, texel,
                                                          plan_.alignment, push.sh_base);
        for (uint32_t d = 0; d < plan_.stride; d += plan_.at_once) {
            push.ring_base = d;
            const gpu::Window windows[] = {
                gpu::whole(ring_),
                gpu::whole(cells_),
                {&weights_, d / plan_.at_once * plan_.weight_bytes, plan_.weight_bytes},
                coefficients,
                coefficients};
            batch_.dispatch(in_air_ ? in_air_->project : programs_.project, windows, bytes_of(push),
                            {(until - first + a_group - 1) / a_group, 1, 1});
        }
    }
}

void Sweeper::add_to(const Grid& grid, glm::ivec3 at,
                     std::vector<std::vector<glm::vec3>>& sh) const {
    const size_t coefficients = size_t(volume::sh_count(plan_.order));
    const uint64_t floats = plan_.cell_bytes / sizeof(float);
    std::vector<float> layer(plan_.layer_cells * floats);
    for (int z = 0; z < grid_.dims.z; ++z) {
        const uint64_t start = uint64_t(z) * plan_.layer_cells;
        gpu::download(device_, sh_, start * plan_.cell_bytes,
                      std::as_writable_bytes(std::span(layer)));
        tbb::parallel_for(0, grid_.dims.y, [&](int y) {
            const float* c = &layer[floats * grid_.index({0, y, 0})];
            const size_t row = grid.index(at + glm::ivec3(0, y, z));
            for (size_t x = 0; x < size_t(grid_.dims.x); ++x, c += floats)
                for (size_t k = 0; k < coefficients; ++k)
                    sh[k][row + x] += glm::vec3(c[3 * k], c[3 * k + 1], c[3 * k + 2]);
        });
    }
}

} // namespace lpvbake::solver::sn
