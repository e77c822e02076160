// Classic light propagation volumes (Kaplanyan and Dachsbacher 2010) with the physics put right:
// power is conserved to rounding, transmittance does not leak, and every front is counted once.
#pragma once

#include "gpu/gpu.h"
#include "lpvbake/progress.h"
#include "solver/lpv/inject.h"
#include "solver/lpv/propagator.h"
#include "volume/volume.h"

#include <span>

namespace lpvbake::solver::lpv {

struct LpvSettings {
    int iterations = 0; ///< 0: until the front holds less than `tolerance`, at most 100,000
    /// Share of the injected power that the last front may hold; the field misses about that share.
    float tolerance = 1e-2f;
    Occlusion occlusion = Occlusion::face;
};

/// Device memory of a propagation, bytes; `layers`: of one that is followed by layers.
uint64_t lpv_device_bytes(const Grid& grid, Occlusion occlusion, bool layers = false);

struct LpvField {
    /// SH L1 of intensity (cd) in travel direction, injected light and all fronts together:
    /// [12 * cell + 4 * colour + k], k in the order 1, y, z, x.
    std::vector<float> coefficients;
    int iterations = 0;
    double residual = 0; ///< power of the last front as a share of the injected power
};

/// The propagation, compiled for a device and a grid.
class LpvProgram {
public:
    /// `window` limits the bytes that one binding sees; 0: what the device allows.
    LpvProgram(const gpu::Device& device, const Grid& grid, Occlusion occlusion,
               uint64_t window = 0);

    /// Propagates on the device. `transmittance` holds 3 floats a cell for Occlusion::face
    /// (Links::open), 30 for sh (face_transmittance), none for none. Throws Error (memory, device).
    LpvField propagate(const Injection& injection, std::span<const float> transmittance,
                       const LpvSettings& settings, Progress& progress) const;
    /// The fields of Injection::layers, after as many iterations as that of all light: linear in
    /// the layers, and summing to that, since it decides at which faces flux arrives.
    std::vector<LpvField> propagate_layers(const Injection& injection,
                                           std::span<const float> transmittance, int iterations,
                                           Progress& progress) const;

private:
    const gpu::Device& device_;
    Grid grid_;
    Occlusion occlusion_;
    uint64_t window_;
    PropagatePrograms programs_;
};

/// Intensity to incident luminance: L(w) = I(-w) / (1.5 h^2), 1.5 h^2 being the mean projected area
/// of a cell. Fills Volume::sh.
void to_luminance(const LpvField& field, Volume& volume);

} // namespace lpvbake::solver::lpv
