#include "solver/lpv/corrector.h"

#include "solver/lpv/block_sums.comp.h"
#include "solver/lpv/blocks.h"
#include "solver/lpv/linear.comp.h"
#include "solver/lpv/spread_blocks.comp.h"

#include <algorithm>

namespace lpvbake::solver::lpv {
namespace {

constexpr uint64_t texel = sizeof(glm::vec4);

/// The share of a front that is added at once, so that what goes to and fro between even and odd
/// cells ends, too.
constexpr float damped = 0.6f;

struct LinearPush {
    PropagatePush push;
    LinearWeights weights;
};

uint64_t blocks_of(const PropagateLayout& layout) {
    return uint64_t((layout.nx + 1) / 2) * ((layout.ny + 1) / 2) * ((layout.nz + 1) / 2);
}

uint32_t groups_of(uint32_t count, uint32_t size) {
    return (count + size - 1) / size;
}

} // namespace

CorrectPrograms compile_correct(const gpu::Device& device, const Grid& grid, Occlusion occlusion) {
    using gpu::Binding;
    const PropagateTiling tiling = tiling_for(device, grid);
    const auto constants = propagate_constants(tiling, occlusion);
    constexpr Binding linear[] = {
        Binding::texels_rgba32, Binding::texels_rgba32, Binding::texels_r32,   Binding::storage,
        Binding::storage,       Binding::storage,       Binding::texels_rgba32};
    constexpr Binding sums[] = {Binding::texels_rgba32, Binding::storage};
    constexpr Binding spread[] = {Binding::texels_rgba32, Binding::texels_rgba32, Binding::storage,
                                  Binding::texels_r32};
    const uint32_t local[] = {tiling.local_size};
    return {gpu::Program(device, shaders::linear_comp, linear, sizeof(LinearPush), constants),
            gpu::Program(device, shaders::block_sums_comp, sums, sizeof(BlocksPush), local),
            gpu::Program(device, shaders::spread_blocks_comp, spread, sizeof(BlocksPush), local),
            device.is_cpu() ? MultigridPrograms() : compile_multigrid(device)};
}

uint64_t corrector_bytes(const Grid& grid) {
    return multigrid_bytes(grid);
}

Corrector::Corrector(const gpu::Device& device, const Grid& grid, const PropagatePlan& plan,
                     const CorrectPrograms& programs, const PropagatedBuffers& buffers,
                     Diffusion& diffusion)
    : device_(device),
      plan_(plan),
      programs_(programs),
      buffers_(buffers),
      missing_(device, programs.multigrid, diffusion, plan.window, device.is_cpu()),
      blocks_((grid.dims + 1) / 2),
      batch_(device) {}

double Corrector::excess() {
    record_sums(buffers_.front);
    batch_.run();
    std::vector<glm::vec4> blocks(blocks_of(plan_.layout));
    gpu::download(device_, missing_.light(), 0, std::as_writable_bytes(std::span(blocks)));
    glm::dvec4 sum(0.0);
    for (const glm::vec4& block : blocks)
        sum += glm::dvec4(block);
    const double light = sum.x + sum.y + sum.z;
    return light > 0.0 ? sum.w / light : 0.0;
}

Added Corrector::start() {
    record_apply(buffers_.front, buffers_.other, {0.0f, 0.0f, 1.0f, 0.0f});
    swapped_ = true;
    record_sums(buffers_.other);
    return run();
}

Added Corrector::correct() {
    const gpu::Buffer& rest = swapped_ ? buffers_.other : buffers_.front;
    const gpu::Buffer& room = swapped_ ? buffers_.front : buffers_.other;
    missing_.solve(batch_);
    // With what is missing, e, and u = m + e: the sum becomes that and u, the rest P u - e.
    record_spread(rest, room);
    record_apply(room, rest, {1.0f, -1.0f, 1.0f, 1.0f});
    record_apply(rest, room, {damped, 1.0f - damped, damped, 0.0f});
    record_apply(room, rest, {1.0f, 0.0f, 1.0f, 0.0f});
    record_sums(rest);
    return run();
}

Added Corrector::step(int steps) {
    for (int i = 0; i < steps; ++i) {
        record_apply(swapped_ ? buffers_.other : buffers_.front,
                     swapped_ ? buffers_.front : buffers_.other, {1.0f, 0.0f, 1.0f, 0.0f});
        swapped_ = !swapped_;
    }
    return run();
}

void Corrector::record_sums(const gpu::Buffer& front) {
    const PropagateLayout& layout = plan_.layout;
    const uint64_t block_layer = uint64_t(blocks_.x) * uint64_t(blocks_.y);
    const uint32_t slab = std::max(1u, plan_.slab / 2);
    for (uint32_t begin = 0; begin < uint32_t(blocks_.z); begin += slab) {
        const uint32_t end = std::min(begin + slab, uint32_t(blocks_.z));
        const uint32_t last = std::min(2 * end, layout.nz);
        BlocksPush push{layout.nx,
                        layout.ny,
                        layout.nz,
                        layout.row_pitch(),
                        layout.plane_pitch(),
                        begin,
                        end,
                        0,
                        0,
                        0,
                        0};
        const gpu::Window windows[] = {
            gpu::window_over(front, (2 * begin + 1) * layout.layer(), (last + 1) * layout.layer(),
                             texel, plan_.alignment, push.front_base),
            gpu::window_over(missing_.light(), begin * block_layer, end * block_layer, texel,
                             plan_.alignment, push.out_base)};
        // Where the first layers would lie: modulo 2^32, as the kernel adds.
        push.front_base -= uint32_t(2 * begin * layout.layer());
        push.out_base -= uint32_t(begin * block_layer);
        batch_.dispatch(programs_.block_sums, windows, std::as_bytes(std::span(&push, 1)),
                        {groups_of(uint32_t(blocks_.x), plan_.tiling.local_size),
                         uint32_t(blocks_.y), groups_of(end - begin, blocks_march)});
    }
}

void Corrector::record_spread(const gpu::Buffer& front, const gpu::Buffer& target) {
    const PropagateLayout& layout = plan_.layout;
    const uint64_t layer = layout.layer();
    const uint64_t block_layer = uint64_t(blocks_.x) * uint64_t(blocks_.y);
    for (uint32_t begin = 0; begin < layout.nz; begin += plan_.slab) {
        const uint32_t end = std::min(begin + plan_.slab, layout.nz);
        const uint32_t first_block = begin / 2 - std::min(begin / 2, 1u);
        const uint32_t last_block = std::min((end - 1) / 2 + 2, uint32_t(blocks_.z));
        BlocksPush push{layout.nx,
                        layout.ny,
                        layout.nz,
                        layout.row_pitch(),
                        layout.plane_pitch(),
                        begin,
                        end,
                        0,
                        0,
                        0,
                        0};
        const gpu::Window windows[] = {
            gpu::window_over(front, (begin + 1) * layer, (end + 1) * layer, texel, plan_.alignment,
                             push.front_base),
            gpu::window_over(missing_.all(), first_block * block_layer, last_block * block_layer,
                             texel, plan_.alignment, push.blocks_base),
            gpu::window_over(target, (begin + 1) * layer, (end + 1) * layer, texel, plan_.alignment,
                             push.out_base),
            gpu::window_over(missing_.reached(), first_block * block_layer,
                             last_block * block_layer, sizeof(float), plan_.alignment,
                             push.reached_base)};
        push.front_base -= uint32_t(begin * layer);
        push.out_base -= uint32_t(begin * layer);
        push.blocks_base -= uint32_t(first_block * block_layer);
        push.reached_base -= uint32_t(first_block * block_layer);
        batch_.dispatch(programs_.spread_blocks, windows, std::as_bytes(std::span(&push, 1)),
                        {groups_of(layout.nx, plan_.tiling.local_size), layout.ny,
                         groups_of(end - begin, blocks_march)});
    }
}

void Corrector::record_apply(const gpu::Buffer& given, const gpu::Buffer& target,
                             const LinearWeights& weights) {
    const PropagateLayout& layout = plan_.layout;
    const uint64_t layer = layout.layer(), tau_layer = layout.layer(plan_.planes);
    const auto window = [&](const gpu::Buffer& buffer, uint64_t first, uint64_t last,
                            uint64_t element, uint32_t& base) {
        return gpu::window_over(buffer, first, last, element, plan_.alignment, base);
    };
    uint32_t partial_base = uint32_t(applied_++) * plan_.partials;
    for (uint32_t begin = 0; begin < layout.nz; begin += plan_.slab) {
        const uint32_t end = std::min(begin + plan_.slab, layout.nz);
        LinearPush push{{layout.nx, layout.ny, begin, end, layout.row_pitch(), layout.plane_pitch(),
                         0, 0, 0, 0, partial_base},
                        weights};
        PropagatePush& bases = push.push;
        const gpu::Window sums = window(buffers_.sum, (begin + 1) * layer, (end + 1) * layer, texel,
                                        bases.accumulator_base);
        const gpu::Window out =
            window(target, (begin + 1) * layer, (end + 1) * layer, texel, bases.front_out_base);
        const gpu::Window windows[] = {
            window(given, begin * layer, (end + 2) * layer, texel, bases.front_in_base),
            sums,
            plan_.planes ? window(buffers_.transmittance, begin * tau_layer, (end + 2) * tau_layer,
                                  sizeof(float), bases.transmittance_base)
                         : gpu::Window{&buffers_.transmittance, 0, texel},
            out,
            sums,
            gpu::whole(buffers_.partial),
            out};
        const auto groups = plan_.tiling.groups(layout.nx, layout.ny, end - begin);
        batch_.dispatch(programs_.linear, windows, std::as_bytes(std::span(&push, 1)),
                        {groups.x, groups.y, groups.z});
        partial_base += plan_.tiling.partials(layout.nx, layout.ny, end - begin);
    }
}

Added Corrector::run() {
    batch_.run();
    std::vector<glm::vec2> partials(std::size_t(applied_) * plan_.partials);
    gpu::download(device_, buffers_.partial, 0, std::as_writable_bytes(std::span(partials)));
    applied_ = 0;
    Added added;
    for (const glm::vec2 partial : partials) {
        added.power += double(partial.x);
        added.absolute += double(partial.y);
    }
    return added;
}

} // namespace lpvbake::solver::lpv
