// The propagation on the device: how it is cut to what the device can bind, its buffers and
// dispatches.
#pragma once

#include "gpu/gpu.h"
#include "solver/lpv/inject.h"
#include "solver/lpv/propagate.h"
#include "solver/occlusion.h"

#include <array>
#include <span>
#include <vector>

namespace lpvbake::solver::lpv {

/// How geometry stands in the light's way.
enum class Occlusion {
    none, ///< light passes through everything
    sh,   ///< geometry volume in SH L1: soft, leaks a quarter through a full wall
    face, ///< scalar transmittance of the links between cells: no leaks
};

/// What a lobe (SH L1 of intensity, cd, in the order 1, y, z, x) sends through a face, lm.
double flux_through(const LpvFace& face, const float* lobe);

/// What a lobe is multiplied with so that the flux through its 30 faces is its power.
double budget(const float* lobe);

/// Floats of transmittance a cell.
uint32_t planes_of(Occlusion occlusion);

PropagateLayout layout_of(const Grid& grid);

/// The specialization constants of programs of propagate.glsl.
std::array<uint32_t, 6> propagate_constants(const PropagateTiling& tiling, Occlusion occlusion);
PropagateTiling tiling_for(const gpu::Device& device, const Grid& grid);

/// How a propagation is cut: by what a binding can see.
struct PropagatePlan {
    Occlusion occlusion;
    PropagateLayout layout;
    PropagateTiling tiling;
    uint32_t planes;    ///< of transmittance
    uint32_t slab;      ///< layers of a dispatch
    uint32_t partials;  ///< partial sums of the flux that a step writes
    uint64_t alignment; ///< of windows, bytes
    uint64_t window;    ///< bytes of texels that one binding sees at most
};

/// `window` limits the bytes that one binding sees. Throws Error (memory) where that is not a layer
/// and the two beside it.
PropagatePlan plan_propagate(const gpu::Device& device, const Grid& grid, Occlusion occlusion,
                             uint64_t window);

struct PropagatePrograms {
    gpu::Program usual;
    gpu::Program free_flight; ///< without occlusion: the first step of Occlusion::sh
};

/// `follow`: of a layer beside the light that it is of.
PropagatePrograms compile_propagate(const gpu::Device& device, const Grid& grid,
                                    Occlusion occlusion, bool follow = false);

/// Buffers of a propagation, as its layout has them.
struct PropagatedBuffers {
    const gpu::Buffer &front, &other; ///< the last front, and room for another
    const gpu::Buffer& sum;
    const gpu::Buffer& transmittance;
    const gpu::Buffer& partial; ///< plan.partials floats for each of most_steps
};

/// The buffers of a propagation, and the steps on them. The arguments outlive it.
class Propagator {
public:
    /// Starts from an injection, as LpvProgram::propagate has it. With a `layer`, one of
    /// Injection::layers, and programs that follow, what is summed is the layer's, whose faces and
    /// budgets are those of all light.
    Propagator(const gpu::Device& device, const Grid& grid, const PropagatePlan& plan,
               const PropagatePrograms& programs, const Injection& injection,
               std::span<const float> transmittance, std::span<const float> layer = {});

    /// Steps that may be run at once: each return costs a round trip to the device.
    static constexpr int most_steps = 8;
    /// Runs so many steps more; returns the power of the last front, lm.
    double run(int steps);
    /// Power of all fronts of the last run, lm.
    double run_power() const { return run_power_; }
    /// What a Corrector goes on with: the last front comes first.
    PropagatedBuffers buffers() const;
    /// Injected light and all fronts together, as LpvField::coefficients.
    std::vector<float> download() const;

private:
    void upload(const Injection& injection, std::span<const float> transmittance,
                std::span<const float> layer);
    void record_step(int step, uint32_t partial_base);

    const gpu::Device& device_;
    const Grid& grid_;
    const PropagatePlan& plan_;
    const PropagatePrograms& programs_;
    gpu::Buffer fronts_[2], sum_, transmittance_, partial_;
    bool follows_;
    gpu::Buffer layer_fronts_[2]; ///< as small as can be where none follows
    gpu::Batch batch_;
    int done_ = 0; ///< steps
    double run_power_ = 0.0;
};

} // namespace lpvbake::solver::lpv
