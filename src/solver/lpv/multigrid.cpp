#include "solver/lpv/multigrid.h"

#include "solver/lpv/prolong_level.comp.h"
#include "solver/lpv/relax_level.comp.h"
#include "solver/lpv/restrict_level.comp.h"
#include "solver/lpv/solve_level.comp.h"

#include <algorithm>

namespace lpvbake::solver::lpv {
namespace {

constexpr uint64_t texel = sizeof(glm::vec4);

/// Cells of a level below which all of the rest of a cycle is one matrix: it is linear.
constexpr uint64_t most_dense = 64;

struct Shape {
    uint32_t local_size, march;
};

/// A subgroup a group where it is one vector of a CPU core; else as many groups as there are.
Shape shape_for(const gpu::Device& device) {
    return device.is_cpu() ? Shape{8, 8} : Shape{64, 1};
}

uint32_t groups_of(uint32_t count, uint32_t size) {
    return (count + size - 1) / size;
}

uint64_t cells_of(glm::ivec3 dims) {
    return uint64_t(dims.x) * uint64_t(dims.y) * uint64_t(dims.z);
}

void upload(const gpu::Device& device, const gpu::Buffer& target, std::span<const glm::vec4> data) {
    gpu::upload(device, target, 0, std::as_bytes(data));
}

} // namespace

MultigridPrograms compile_multigrid(const gpu::Device& device) {
    using enum gpu::Binding;
    const Shape shape = shape_for(device);
    const uint32_t constants[] = {shape.local_size, shape.march};
    constexpr gpu::Binding stencil[] = {texels_rgba32, texels_rgba32, texels_rgba32, storage};
    constexpr gpu::Binding product[] = {texels_r32, texels_rgba32, storage};
    const auto make = [&](std::span<const uint32_t> code, std::span<const gpu::Binding> bindings) {
        return gpu::Program(device, code, bindings, sizeof(LevelPush), constants);
    };
    return {make(shaders::relax_level_comp, stencil), make(shaders::restrict_level_comp, stencil),
            make(shaders::prolong_level_comp, stencil), make(shaders::solve_level_comp, product)};
}

uint64_t multigrid_bytes(const Grid& grid) {
    glm::ivec3 dims = (grid.dims + 1) / 2;
    uint64_t bytes = cells_of(dims) * sizeof(float) + most_dense * most_dense * sizeof(float);
    for (; cells_of(dims) > most_dense; dims = (dims + 1) / 2)
        bytes += 4 * cells_of(dims) * texel;
    return bytes + 4 * cells_of(dims) * texel;
}

Multigrid::Multigrid(const gpu::Device& device, const MultigridPrograms& programs,
                     Diffusion& diffusion, uint64_t window, bool on_host)
    : device_(device),
      programs_(programs),
      diffusion_(diffusion),
      on_host_(on_host),
      window_(window),
      alignment_(device.info().window_alignment),
      local_size_(shape_for(device).local_size),
      march_(shape_for(device).march),
      reached_(device, diffusion.reached().size() * sizeof(float)) {
    const std::vector<float> reached(diffusion.reached().begin(), diffusion.reached().end());
    gpu::upload(device, reached_, 0, std::as_bytes(std::span(reached)));
    if (on_host) {
        const uint64_t bytes = diffusion.size() * texel;
        levels_.push_back(
            {glm::uvec3(diffusion.dims()), {}, {device, bytes}, {{device, bytes}, {}}});
        return;
    }
    for (std::size_t l = 0; l < diffusion.levels(); ++l) {
        const uint64_t bytes = cells_of(diffusion.dims(l)) * texel;
        levels_.push_back({glm::uvec3(diffusion.dims(l)),
                           {device, bytes},
                           {device, bytes},
                           {{device, bytes}, {device, bytes}}});
        upload(device, levels_.back().links, diffusion.links(l));
        if (levels_.back().size() <= most_dense)
            break;
    }
    const std::vector<float> matrix = diffusion.matrix(levels_.size() - 1);
    matrix_ = {device, matrix.size() * sizeof(float)};
    gpu::upload(device, matrix_, 0, std::as_bytes(std::span(matrix)));
}

uint32_t Multigrid::slab_of(const Level& level) const {
    // So many layers that a binding sees those beside them, too.
    const uint64_t seen = (window_ - alignment_) / (level.layer() * texel);
    return uint32_t(std::clamp<uint64_t>(seen - std::min<uint64_t>(seen, 2), 2, level.dims.z + 2));
}

void Multigrid::dispatch(gpu::Batch& batch, const gpu::Program& program,
                         std::span<const gpu::Window> windows, const LevelPush& push) const {
    batch.dispatch(
        program, windows, std::as_bytes(std::span(&push, 1)),
        {groups_of(push.nx, local_size_), push.ny, groups_of(push.end - push.begin, march_)});
}

void Multigrid::relax(gpu::Batch& batch, Level& level, bool dark) {
    const uint64_t layer = level.layer();
    const uint32_t slab = slab_of(level);
    for (uint32_t begin = 0; begin < level.dims.z; begin += slab) {
        const uint32_t end = std::min(begin + slab, level.dims.z);
        const uint32_t first = begin - std::min(begin, 1u), last = std::min(end + 1, level.dims.z);
        LevelPush push{level.dims.x,  level.dims.y, level.dims.z, 0, 0, 0, begin, end, 0, 0, 0,
                       dark ? 1u : 0u};
        const auto seen = [&](const gpu::Buffer& buffer) {
            return gpu::window_over(buffer, first * layer, last * layer, texel, alignment_,
                                    push.in_base);
        };
        const gpu::Window windows[] = {
            seen(level.links), seen(level.light), seen(level.all[level.now]),
            gpu::window_over(level.all[1 - level.now], begin * layer, end * layer, texel,
                             alignment_, push.out_base)};
        push.in_base -= uint32_t(first * layer);
        push.out_base -= uint32_t(begin * layer);
        dispatch(batch, programs_.relax, windows, push);
    }
    level.now = 1 - level.now;
}

void Multigrid::restrict_rest(gpu::Batch& batch, const Level& fine, const Level& coarse) {
    const uint64_t layer = fine.layer();
    const uint32_t slab = slab_of(fine) / 2;
    for (uint32_t begin = 0; begin < coarse.dims.z; begin += slab) {
        const uint32_t end = std::min(begin + slab, coarse.dims.z);
        const uint32_t first = 2 * begin - std::min(begin, 1u);
        const uint32_t last = std::min(2 * end + 1, fine.dims.z);
        LevelPush push{coarse.dims.x,
                       coarse.dims.y,
                       coarse.dims.z,
                       fine.dims.x,
                       fine.dims.y,
                       fine.dims.z,
                       begin,
                       end,
                       0,
                       0,
                       0,
                       0};
        const auto seen = [&](const gpu::Buffer& buffer) {
            return gpu::window_over(buffer, first * layer, last * layer, texel, alignment_,
                                    push.near_base);
        };
        const gpu::Window windows[] = {seen(fine.links), seen(fine.light), seen(fine.all[fine.now]),
                                       gpu::window_over(coarse.light, begin * coarse.layer(),
                                                        end * coarse.layer(), texel, alignment_,
                                                        push.out_base)};
        push.near_base -= uint32_t(first * layer);
        push.out_base -= uint32_t(begin * coarse.layer());
        dispatch(batch, programs_.restrict_rest, windows, push);
    }
}

void Multigrid::prolong(gpu::Batch& batch, const Level& coarse, Level& fine) {
    const uint64_t layer = fine.layer();
    const uint32_t slab = slab_of(fine);
    for (uint32_t begin = 0; begin < fine.dims.z; begin += slab) {
        const uint32_t end = std::min(begin + slab, fine.dims.z);
        const uint32_t first = begin / 2 - std::min(begin / 2, 1u);
        const uint32_t last = std::min((end - 1) / 2 + 2, coarse.dims.z);
        LevelPush push{fine.dims.x,
                       fine.dims.y,
                       fine.dims.z,
                       coarse.dims.x,
                       coarse.dims.y,
                       coarse.dims.z,
                       begin,
                       end,
                       0,
                       0,
                       0,
                       0};
        const auto own = [&](const gpu::Buffer& buffer, uint32_t& base) {
            return gpu::window_over(buffer, begin * layer, end * layer, texel, alignment_, base);
        };
        const gpu::Window windows[] = {
            own(fine.links, push.in_base), own(fine.all[fine.now], push.in_base),
            gpu::window_over(coarse.all[coarse.now], first * coarse.layer(), last * coarse.layer(),
                             texel, alignment_, push.near_base),
            own(fine.all[1 - fine.now], push.out_base)};
        push.in_base -= uint32_t(begin * layer);
        push.near_base -= uint32_t(first * coarse.layer());
        push.out_base -= uint32_t(begin * layer);
        dispatch(batch, programs_.prolong, windows, push);
    }
    fine.now = 1 - fine.now;
}

void Multigrid::solve_coarsest(gpu::Batch& batch) {
    const Level& level = levels_.back();
    const auto size = uint32_t(level.size());
    const gpu::Window windows[] = {gpu::whole(matrix_), gpu::whole(level.light),
                                   gpu::whole(level.all[0])};
    dispatch(batch, programs_.coarsest, windows, {size, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0});
}

void Multigrid::cycle(gpu::Batch& batch, std::size_t l) {
    if (l + 1 == levels_.size())
        return solve_coarsest(batch);
    Level& level = levels_[l];
    for (int i = 0; i < Diffusion::relaxations; ++i)
        relax(batch, level, i == 0);
    for (int twice = 0; twice < 2; ++twice) {
        restrict_rest(batch, level, levels_[l + 1]);
        cycle(batch, l + 1);
        prolong(batch, levels_[l + 1], level);
    }
    for (int i = 0; i < Diffusion::relaxations; ++i)
        relax(batch, level, false);
}

void Multigrid::solve(gpu::Batch& batch) {
    if (!on_host_)
        return cycle(batch, 0); // steps of every level are even in number: all() is where it was
    std::vector<glm::vec4> values(diffusion_.size());
    gpu::download(device_, light(), 0, std::as_writable_bytes(std::span(values)));
    diffusion_.solve(values, values);
    upload(device_, all(), values);
}

} // namespace lpvbake::solver::lpv
