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
/// Of the ring of planes, where all directions of a course do not fit: so many, or so many a cell
/// of the grid, whose coefficients take five times as much at order 2.
constexpr uint64_t ring_bytes = uint64_t(128) << 20, cell_ring_bytes = 20;

uint32_t course_directions(int directions) {
    return uint32_t(directions / Course::count);
}

/// Into a buffer that is made at least so large, for what its stream records from now on.
template <class T>
void put(const gpu::Device& device, gpu::Batch& batch, gpu::Buffer& buffer,
         std::span<const T> values) {
    if (buffer.bytes() < values.size_bytes())
        buffer = gpu::Buffer(device, values.size_bytes());
    const std::span<std::byte> target = batch.stage(buffer, 0, values.size_bytes());
    const std::span<const std::byte> source = std::as_bytes(values);
    constexpr size_t part = 1 << 20;
    tbb::parallel_for(size_t(0), (source.size() + part - 1) / part, [&](size_t i) {
        const std::span<const std::byte> some =
            source.subspan(i * part, std::min(part, source.size() - i * part));
        std::ranges::copy(some, target.begin() + std::ptrdiff_t(i * part));
    });
}

template <class Push>
std::span<const std::byte> bytes_of(const Push& push) {
    return std::as_bytes(std::span(&push, 1));
}

} // namespace

uint32_t swept_directions(const Grid& grid, int directions, uint64_t most_bytes) {
    const uint64_t group = most_ring_planes * most_slots(grid.dims) * lanes * texel;
    const uint64_t most = std::max(ring_bytes, cell_ring_bytes * grid.size());
    const uint32_t all = (course_directions(directions) + lanes - 1) / lanes; // groups
    const uint32_t fit = uint32_t(std::clamp<uint64_t>(std::min(most_bytes, most) / group, 1, all));
    const uint32_t batches = (all + fit - 1) / fit;
    return (all + batches - 1) / batches * lanes;
}

/// As many planes of the ring as fit: fewer where the grid is flat, so that its planes are large.
uint32_t planes_of_ring(const Grid& grid, uint32_t stride, uint64_t most_bytes) {
    return uint32_t(std::clamp<uint64_t>(most_bytes / (most_slots(grid.dims) * stride * texel), 2,
                                         most_ring_planes));
}

uint32_t projected_directions(uint32_t stride, int order) {
    const uint32_t most = max_project_weights / uint32_t(volume::sh_count(order));
    for (uint32_t parts = 1;; ++parts)
        if (stride % parts == 0 && stride / parts <= most)
            return stride / parts;
}

SweepTiling tiling_for(const gpu::Device& device, uint64_t slots) {
    SweepTiling tiling = device.is_cpu() ? cpu_tiling : gpu_tiling;
    // Every device takes so many groups, of what is in a plane, or in those that are projected.
    constexpr uint64_t groups = 65535;
    const auto raise = [&](uint32_t& march, uint64_t lanes_at_work) {
        const uint64_t most = groups * tiling.local_size;
        march = std::max(march, uint32_t((lanes_at_work + most - 1) / most));
    };
    raise(tiling.march, slots * lanes);
    raise(tiling.project_march, slots * (most_ring_planes - 1));
    raise(tiling.given_march, slots * most_directions / Course::count);
    return tiling;
}

uint64_t sweep_bytes(const Grid& grid, int directions, int order) {
    const uint32_t stride =
        swept_directions(grid, directions, std::numeric_limits<uint64_t>::max());
    const uint64_t plane = most_slots(grid.dims) * stride * texel;
    return grid.size() * sh_vec4s(uint32_t(volume::sh_count(order))) * texel
           + most_ring_planes * plane
           + 2 * std::max(chunk_bytes, plane); // all that is given in one may be a chunk
}

SweepPlan plan_sweep(const gpu::Device& device, const Grid& grid, int order, uint32_t stride,
                     uint64_t largest) {
    const gpu::DeviceInfo& info = device.info();
    const uint64_t slots = most_slots(grid.dims);
    const uint64_t cell_bytes = sh_vec4s(uint32_t(volume::sh_count(order))) * texel;
    const uint64_t layer_cells = uint64_t(grid.dims.x) * uint64_t(grid.dims.y);
    const uint32_t planes = planes_of_ring(grid, stride, largest);
    // All that is given in a plane takes less than the ring.
    if (layer_cells * cell_bytes > largest || planes * slots * stride * texel > largest)
        throw Error(ErrorKind::memory, "a layer of " + std::to_string(grid.dims.x) + " x "
                                           + std::to_string(grid.dims.y) + " cells exceeds what '"
                                           + info.name + "' can bind; lower `resolution`");
    const uint64_t weights = max_project_weights * sizeof(float);
    return {slots,
            tiling_for(device, slots),
            order,
            stride,
            planes,
            projected_directions(stride, order),
            cell_bytes,
            layer_cells,
            std::min(chunk_bytes, largest),
            int(std::min(largest / (layer_cells * cell_bytes), uint64_t(grid.dims.z))),
            info.window_alignment,
            (weights + info.window_alignment - 1) / info.window_alignment * info.window_alignment};
}

namespace {

gpu::Program compile_project(const gpu::Device& device, const SweepTiling& tiling, uint32_t stride,
                             int order, bool columns) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::uniform,
                                    Binding::texels_rgba32, Binding::storage};
    const uint32_t constants[] = {tiling.local_size, tiling.project_march,
                                  uint32_t(volume::sh_count(order)),
                                  projected_directions(stride, order), columns ? 1u : 0u};
    return gpu::Program(device, shaders::project_comp, bindings, sizeof(ProjectPush), constants);
}

gpu::Program compile_transport_in_air(const gpu::Device& device, const SweepTiling& tiling,
                                      uint32_t coefficients) {
    using gpu::Binding;
    constexpr Binding bindings[] = {Binding::texels_rgba32, Binding::storage,
                                    Binding::texels_rgba32, Binding::texels_rgba32,
                                    Binding::texels_rgba32};
    const uint32_t constants[] = {tiling.local_size, tiling.march, coefficients};
    return gpu::Program(device, shaders::transport_air_comp, bindings, sizeof(TransportPush),
                        constants);
}

} // namespace

SweepPrograms compile_sweep(const gpu::Device& device, const Grid& grid, uint32_t stride,
                            int order) {
    using gpu::Binding;
    const SweepTiling tiling = tiling_for(device, most_slots(grid.dims));
    constexpr Binding transport[] = {Binding::texels_rgba32, Binding::storage,
                                     Binding::texels_rgba32};
    constexpr Binding given[] = {Binding::storage, Binding::storage, Binding::texels_rgba32};
    const uint32_t constants[] = {tiling.local_size, tiling.march};
    const uint32_t given_constants[] = {tiling.local_size, tiling.given_march};
    return {
        gpu::Program(device, shaders::transport_comp, transport, sizeof(TransportPush), constants),
        gpu::Program(device, shaders::given_comp, given, sizeof(GivenPush), given_constants),
        compile_project(device, tiling, stride, order, false)};
}

SweptAir::SweptAir(const gpu::Device& device, const visibility::Air& of, LightPart part,
                   const Grid& grid, uint32_t stride, int order)
    : air(of),
      coefficients(part == LightPart::air ? uint32_t(of.coefficients()) : 0),
      transport(compile_transport_in_air(device, tiling_for(device, most_slots(grid.dims)),
                                         coefficients)),
      project(compile_project(device, tiling_for(device, most_slots(grid.dims)), stride, order,
                              part == LightPart::surfaces)) {}

DeviceSweeper::DeviceSweeper(const gpu::Device& device, const Grid& grid, const SweepPlan& plan,
                             const SweepPrograms& programs, const SweptAir* in_air)
    : device_(device),
      grid_(grid),
      plan_(plan),
      programs_(programs),
      in_air_(in_air),
      sh_(device, grid.size() * plan.cell_bytes),
      ring_(device, plan.ring_texels() * texel),
      streams_{make_stream(), make_stream()} {
    gpu::clear(device, sh_);
}

DeviceSweeper::Stream DeviceSweeper::make_stream() const {
    const auto empty = [&] { return gpu::Buffer(device_, texel); };
    return {empty(),
            empty(),
            empty(),
            gpu::Buffer(device_, plan_.stride * texel),
            gpu::Buffer(device_, plan_.stride * direction_vec4s * texel),
            gpu::Buffer(device_, plan_.stride / plan_.at_once * plan_.weight_bytes),
            gpu::Buffer(device_, plan_.stride * air_direction_vec4s * texel),
            gpu::Batch(device_)};
}

void DeviceSweeper::begin(const Course& course, const Directions& directions,
                          std::span<const glm::vec4> beyond) {
    course_ = &course;
    directions_ = &directions;
    beyond_.assign(beyond.begin(), beyond.end());
}

void DeviceSweeper::run(const PlaneOrder& order, const Chunk& chunk) {
    stream().batch.wait(); // for the chunk before the last
    upload(chunk);
    if (!beyond_.empty())
        record_beyond();
    const int first = chunk.first_of_cells();
    int projected = first; // up to there they are in the coefficients
    for (int plane = chunk.begin; plane < chunk.end; ++plane) {
        if (plane >= first)
            record_transport(plane, uint32_t(plane - first) * course_->layout.cells());
        record_given(order.given_of(chunk.begin, plane), order.given_of(chunk.begin, plane + 1),
                     plane);
        if (plane + 2 - projected == int(plan_.planes) || plane + 1 == chunk.end) {
            record_project(projected, plane + 1);
            projected = plane + 1;
        }
    }
    stream().batch.submit();
    at_ = 1 - at_;
}

void DeviceSweeper::upload(const Chunk& chunk) {
    Stream& to = stream();
    const auto fill = [&]<class T>(gpu::Buffer& buffer, std::span<const T> values) {
        put(device_, to.batch, buffer, values);
    };
    const size_t coefficients = size_t(volume::sh_count(plan_.order));
    fill(to.table, std::span<const glm::vec4>(directions_->table));
    for (uint32_t d = 0; d < plan_.stride; d += plan_.at_once) {
        const auto some =
            std::as_bytes(std::span(directions_->weights)
                              .subspan(d * coefficients, plan_.at_once * coefficients));
        std::ranges::copy(
            some,
            to.batch.stage(to.weights, d / plan_.at_once * plan_.weight_bytes, some.size_bytes())
                .begin());
    }
    if (!chunk.given_slots.empty()) {
        fill(to.given_slots, std::span<const uint32_t>(chunk.given_slots));
        fill(to.given, std::span<const glm::vec4>(chunk.given));
    }
    if (in_air_) {
        fill(to.air_table, std::span<const glm::vec4>(directions_->air));
        fill(to.air, std::span<const glm::vec4>(chunk.air));
    }
}

/// All slots of the ring, by copies of twice as many each time.
void DeviceSweeper::record_beyond() {
    Stream& from = stream();
    put(device_, from.batch, from.beyond, std::span<const glm::vec4>(beyond_));
    uint64_t filled = from.beyond.bytes();
    from.batch.copy(gpu::whole(from.beyond), {&ring_, 0, filled});
    while (filled < ring_.bytes()) {
        const uint64_t more = std::min(filled, ring_.bytes() - filled);
        from.batch.copy({&ring_, 0, more}, {&ring_, filled, more});
        filled += more;
    }
    beyond_.clear();
}

void DeviceSweeper::record_given(uint32_t first, uint32_t last, int plane) {
    const gpu::Window windows[] = {gpu::whole(ring_), gpu::whole(stream().given_slots),
                                   gpu::whole(stream().given)};
    const GivenPush push{(last - first) * (plan_.stride / quadrants), first, plan_.stride,
                         plan_.base(course_->layout, plane)};
    const uint32_t a_group = plan_.tiling.local_size * plan_.tiling.given_march;
    stream().batch.dispatch(programs_.given, windows, bytes_of(push),
                            {(push.values + a_group - 1) / a_group, 1, 1});
}

void DeviceSweeper::record_transport(int plane, uint32_t air_first) {
    const SweepLayout& layout = course_->layout;
    const gpu::Window windows[] = {gpu::whole(ring_), gpu::whole(ring_), gpu::whole(stream().table),
                                   gpu::whole(stream().air), gpu::whole(stream().air_table)};
    const glm::vec3 taken = in_air_ ? in_air_->air.extinction() : glm::vec3(0.0f);
    const TransportPush push{layout.cells(),
                             uint32_t(layout.dims.x),
                             layout.pitch(),
                             plan_.stride,
                             plan_.base(layout, plane - 1),
                             plan_.base(layout, plane),
                             air_first,
                             taken.x,
                             taken.y,
                             taken.z};
    const uint32_t a_group = plan_.tiling.local_size / lanes * plan_.tiling.march;
    stream().batch.dispatch(in_air_ ? in_air_->transport : programs_.transport,
                            std::span(windows).first(in_air_ ? 5 : 3), bytes_of(push),
                            {(layout.cells() + a_group - 1) / a_group, plan_.stride / lanes, 1});
}

/// Of the planes [begin, end), slab by slab of coefficients that a binding sees.
void DeviceSweeper::record_project(int begin, int end) {
    const int slabs = (grid_.dims.z + plan_.slab - 1) / plan_.slab;
    const auto slab_of = [&](int plane) { return course_->cell(0, 0, plane).z / plan_.slab; };
    if (course_->axis < 2) {
        for (int slab = 0; slab < slabs && begin < end; ++slab)
            record_project(begin, end, slab);
        return;
    }
    for (int until = begin; begin < end; begin = until) {
        while (until < end && slab_of(until) == slab_of(begin))
            ++until;
        record_project(begin, until, slab_of(begin));
    }
}

/// What of them lies in a slab.
void DeviceSweeper::record_project(int begin, int end, int slab) {
    const SweepLayout& layout = course_->layout;
    const int first_layer = slab * plan_.slab;
    const int last_layer = std::min(first_layer + plan_.slab, grid_.dims.z);
    const uint64_t start = uint64_t(first_layer) * plan_.layer_cells;
    const uint64_t stop = uint64_t(last_layer) * plan_.layer_cells;
    const uint64_t quads = sh_vec4s(uint32_t(volume::sh_count(plan_.order)));
    const glm::uvec3 steps(1, uint32_t(grid_.dims.x), uint32_t(plan_.layer_cells));
    const bool rows_are_layers = course_->axis < 2; // then v is z
    const glm::vec3 taken = in_air_ ? in_air_->air.extinction() : glm::vec3(0.0f);
    ProjectPush push{};
    push.across = uint32_t(layout.dims.x);
    push.rows = uint32_t(rows_are_layers ? last_layer - first_layer : layout.dims.y);
    push.first_row = uint32_t(rows_are_layers ? first_layer : 0);
    push.cells = uint32_t(end - begin) * push.rows * push.across;
    push.pitch = layout.pitch();
    push.slots = layout.slots();
    push.first_plane = uint32_t(begin) % plan_.planes;
    push.ring_planes = plan_.planes;
    push.stride = plan_.stride;
    push.first_cell = uint32_t(grid_.index(course_->cell(0, 0, begin)) - start);
    push.step_u = steps[course_->u];
    push.step_v = steps[course_->v];
    push.step_plane = course_->sign > 0 ? steps[course_->axis] : 0u - steps[course_->axis];
    push.red = taken.x;
    push.green = taken.y;
    push.blue = taken.z;
    const gpu::Window coefficients =
        gpu::window_over(sh_, start * quads, stop * quads, texel, plan_.alignment, push.sh_base);
    const uint32_t a_group = plan_.tiling.local_size * plan_.tiling.project_march;
    for (uint32_t d = 0; d < plan_.stride; d += plan_.at_once) {
        push.ring_base = d;
        const gpu::Window windows[] = {
            gpu::whole(ring_),
            {&stream().weights, d / plan_.at_once * plan_.weight_bytes, plan_.weight_bytes},
            coefficients,
            coefficients};
        stream().batch.dispatch(in_air_ ? in_air_->project : programs_.project, windows,
                                bytes_of(push), {(push.cells + a_group - 1) / a_group, 1, 1});
    }
}

void DeviceSweeper::add_to(const Grid& grid, glm::ivec3 at,
                           std::vector<std::vector<glm::vec3>>& sh) {
    for (Stream& each : streams_)
        each.batch.wait();
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
