// Discrete ordinates on the grid: luminance along fixed directions, swept downstream once.
//
// Linear, without clamps or iteration; every luminance is a mean of what lies around it, so that a
// closed room of one luminance reads exactly that. What errs is the place of surfaces, by the
// distance of cell centres, and the number of directions.
#pragma once

#include "gpu/gpu.h"
#include "progress.h"
#include "scene/sky.h"
#include "surface/lit_surfaces.h"
#include "volume/volume.h"

namespace lpvbake {

struct SnSettings {
    int directions = 240; ///< over the sphere; rounded up to one of sn_direction_counts()
    int order = 2;        ///< bands of the result, 1 to 4
    /// Traces the exact luminance of cells next to surfaces, in every direction, instead of taking
    /// it from what their neighbours and the surfaces on the axes send: a ray for each of these
    /// cells and directions.
    bool first_flight = false;
};

/// Device memory of a sweep, bytes: the coefficients (12 floats a cell for order 1, 28 for order 2,
/// 48 for 3, 76 for 4), eight fronts of the luminance of up to all directions of an octant, and
/// what is streamed, at most 80 MiB.
uint64_t sn_device_bytes(const Grid& grid, const SnSettings& settings);

/// Host memory, bytes, where all cells lie next to surfaces.
uint64_t sn_host_bytes(const Grid& grid, const SnSettings& settings);

/// Time of a sweep on two threads of a CPU device, s, without shader compilation: what the caches
/// give (the ring of fronts) bounds it, about 55 ns of processor time a cell and direction.
double sn_seconds(const Grid& grid, const SnSettings& settings);

/// The sweep, compiled for a device and a grid.
class SnProgram {
public:
    /// `window` limits the bytes that one binding sees; 0: what the device allows.
    SnProgram(const gpu::Device& device, const Grid& grid, const SnSettings& settings,
              uint64_t window = 0);

    /// Fills `volume.sh` and `volume.sh_order`. The scene's units are the grid's cells, as `frame`
    /// has them; light from beyond the grid is that of the surfaces there and of the sky. Tells
    /// `progress` the share that is done, of 100. Throws Error (memory, device) and whatever
    /// `progress` throws.
    void solve(const LitSurfaces& lit, const Visibility& visibility, const Sky& sky,
               Progress& progress, Volume& volume) const;

private:
    const gpu::Device& device_;
    Grid grid_;
    SnSettings settings_;
    uint64_t largest_; ///< bytes that a binding sees
    uint32_t stride_;  ///< directions of an octant that are swept at once
    gpu::Program interior_, near_, given_, project_;
};

} // namespace lpvbake
