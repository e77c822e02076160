// The rest of a propagation that has become linear: all fronts that are still to come together, by
// an iteration that corrects what is missing by a diffusion. Its number of steps does not grow with
// the grid, where fronts one after the other take about the square of its width.
#pragma once

#include "gpu/gpu.h"
#include "solver/lpv/diffusion.h"
#include "solver/lpv/multigrid.h"
#include "solver/lpv/propagator.h"

#include <span>
#include <vector>

namespace lpvbake::solver::lpv {

struct CorrectPrograms {
    gpu::Program linear, block_sums, spread_blocks;
    MultigridPrograms multigrid;
};

CorrectPrograms compile_correct(const gpu::Device& device, const Grid& grid, Occlusion occlusion);

/// Device memory that a Corrector takes beside that of the propagation, bytes.
uint64_t corrector_bytes(const Grid& grid);

/// What a number of applications have added to the sum.
struct Added {
    double power = 0.0;    ///< lm
    double absolute = 0.0; ///< the same of absolute values, cell by cell and one after the other
};

/// Of a propagation P, with the last front f in its sum already, adds P f + P P f + ... The state
/// is the sum and a rest m, light that may be negative, such that what is missing of the sum is
/// m + P m + P P m + ...: so whatever is taken for what is missing, no error of it remains. The
/// arguments outlive it.
class Corrector {
public:
    Corrector(const gpu::Device& device, const Grid& grid, const PropagatePlan& plan,
              const CorrectPrograms& programs, const PropagatedBuffers& buffers,
              Diffusion& diffusion);

    /// By how much lobes of the last front are too steep for propagation to be linear, over its
    /// power: 0 where no flux out of them is negative. Then none of later ones is, without
    /// occlusion or with that of links.
    double excess();
    /// Takes the last front; before all that follows.
    Added start();
    /// Applications of P in a correction.
    static constexpr int applications = 3;
    /// Adds what diffusion says to be missing, and two fronts.
    Added correct();
    /// Fronts that are run at once, as Propagator::most_steps.
    static constexpr int most_steps = Propagator::most_steps / 2;
    /// Adds so many fronts.
    Added step(int steps);

private:
    void record_sums(const gpu::Buffer& front);
    void record_spread(const gpu::Buffer& front, const gpu::Buffer& target);
    void record_apply(const gpu::Buffer& given, const gpu::Buffer& target,
                      const LinearWeights& weights);
    Added run();

    const gpu::Device& device_;
    const PropagatePlan& plan_;
    const CorrectPrograms& programs_;
    PropagatedBuffers buffers_;
    Multigrid missing_; ///< of blocks
    glm::ivec3 blocks_;
    gpu::Batch batch_;
    bool swapped_ = false; ///< the rest is in buffers_.other
    int applied_ = 0;      ///< applications of the batch
};

} // namespace lpvbake::solver::lpv
