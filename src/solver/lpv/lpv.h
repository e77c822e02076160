// Classic light propagation volumes (Kaplanyan and Dachsbacher 2010) with the physics put right:
// power is conserved to rounding, transmittance does not leak, and every front is counted once.
#pragma once

#include "gpu/gpu.h"
#include "lpvbake/progress.h"
#include "solver/lpv/corrector.h"
#include "solver/lpv/inject.h"
#include "solver/lpv/propagator.h"
#include "volume/volume.h"

#include <span>

namespace lpvbake::solver::lpv {

struct LpvSettings {
    int iterations = 0; ///< fronts, one after the other; 0: until the tolerance
    /// Share of the field's power that may be missing of all fronts. It is estimated, from above,
    /// by how what is added falls.
    float tolerance = 1e-2f;
    Occlusion occlusion = Occlusion::face;
    /// Whether all fronts to come may be found together, where there is a tolerance. Then what is
    /// missing is bounded of the whole field, and in cells a thousand times darker than others near
    /// by values are off by more of their own than by fronts alone.
    bool corrections = true;
};

/// Device memory of a propagation, bytes; `layers`: of one that is followed by layers.
uint64_t lpv_device_bytes(const Grid& grid, const LpvSettings& settings, bool layers = false);

/// What has been done to a field.
struct LpvCourse {
    int fronts = 0;      ///< one after the other, of light that is never negative
    bool linear = false; ///< propagation was found to be linear then
    int corrections = 0; ///< of the rest, all fronts together
    int more = 0;        ///< fronts of what corrections left

    /// Propagations of the field.
    int iterations() const;
};

struct LpvField {
    /// SH L1 of intensity (cd) in travel direction, injected light and all fronts together:
    /// [12 * cell + 4 * colour + k], k in the order 1, y, z, x. Where corrections have left less
    /// than no light in a cell, as they may where there is hardly any, it is 0.
    std::vector<float> coefficients;
    LpvCourse course = {};
    double residual =
        0;              ///< power of the last of the course.fronts as a share of the injected power
    double missing = 0; ///< share of the field's power, about; of settings.iterations unknown: 0
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
    /// The fields of Injection::layers, after as many fronts as that of all light: linear in the
    /// layers, and summing to that, since it decides at which faces flux arrives.
    std::vector<LpvField> propagate_layers(const Injection& injection,
                                           std::span<const float> transmittance, int fronts,
                                           Progress& progress) const;

private:
    void correct(Propagator& propagator, const PropagatePlan& plan, const Injection& injection,
                 std::span<const float> transmittance, double tolerance, double power,
                 LpvField& field, Progress& progress) const;
    Diffusion diffusion(const Injection& injection, std::span<const float> transmittance) const;

    const gpu::Device& device_;
    Grid grid_;
    Occlusion occlusion_;
    uint64_t window_;
    PropagatePrograms programs_;
    CorrectPrograms correct_programs_;
};

/// Intensity to incident luminance: L(w) = I(-w) / (1.5 h^2), 1.5 h^2 being the mean projected area
/// of a cell. Fills Volume::sh.
void to_luminance(const LpvField& field, Volume& volume);

} // namespace lpvbake::solver::lpv
