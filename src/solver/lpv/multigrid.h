// The diffusion (diffusion.h) on the device: the same cycle, as dispatches.
#pragma once

#include "gpu/gpu.h"
#include "solver/lpv/diffusion.h"
#include "solver/lpv/levels.h"
#include "solver/lpv/propagator.h"

#include <vector>

namespace lpvbake::solver::lpv {

struct MultigridPrograms {
    gpu::Program relax, restrict_rest, prolong, coarsest;
};

MultigridPrograms compile_multigrid(const gpu::Device& device);

/// Device memory that a Multigrid takes, bytes.
uint64_t multigrid_bytes(const Grid& grid);

/// The arguments outlive it.
class Multigrid {
public:
    /// `window` limits the bytes that one binding sees. `on_host`: the host solves instead, and the
    /// programs are not used; so where the device is the host's CPU, whose memory it shares and
    /// where dispatches on small levels cost more than the work in them.
    Multigrid(const gpu::Device& device, const MultigridPrograms& programs, Diffusion& diffusion,
              uint64_t window, bool on_host);

    /// Light of blocks, x fastest, z slowest, a vec4 each: what is to be solved for.
    const gpu::Buffer& light() const { return levels_.front().light; }
    /// What Diffusion::solve says to it, once what solve() records has run.
    const gpu::Buffer& all() const { return levels_.front().all[0]; }
    /// Cells of blocks that light reaches, as Diffusion::reached, a float each.
    const gpu::Buffer& reached() const { return reached_; }

    /// Records the cycle, or does it at once on the host; what is recorded before has not run then.
    void solve(gpu::Batch& batch);

private:
    struct Level {
        glm::uvec3 dims;
        gpu::Buffer links, light, all[2]; ///< as Diffusion's; the solution, and its next
        int now = 0;                      ///< which of `all` holds it

        uint64_t layer() const { return uint64_t(dims.x) * dims.y; }
        uint64_t size() const { return layer() * dims.z; }
    };

    void cycle(gpu::Batch& batch, std::size_t level);
    void relax(gpu::Batch& batch, Level& level, bool dark);
    void restrict_rest(gpu::Batch& batch, const Level& fine, const Level& coarse);
    void prolong(gpu::Batch& batch, const Level& coarse, Level& fine);
    void solve_coarsest(gpu::Batch& batch);
    uint32_t slab_of(const Level& level) const;
    /// Dispatches for the layers [push.begin, push.end).
    void dispatch(gpu::Batch& batch, const gpu::Program& program,
                  std::span<const gpu::Window> windows, const LevelPush& push) const;

    const gpu::Device& device_;
    const MultigridPrograms& programs_;
    Diffusion& diffusion_;
    bool on_host_;
    uint64_t window_, alignment_;
    uint32_t local_size_, march_;
    std::vector<Level> levels_; ///< down to the one that `matrix_` solves
    gpu::Buffer matrix_, reached_;
};

} // namespace lpvbake::solver::lpv
