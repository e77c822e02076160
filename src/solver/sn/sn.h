// Discrete ordinates on the grid: luminance along fixed directions, swept downstream once.
//
// Linear, without clamps or iteration; every luminance is a mean of what lies around it, so that a
// closed room of one luminance reads exactly that. Cells beside surfaces look for themselves, along
// a ray a direction; the others take the luminance of the cells upstream. What few directions would
// show as beams, surfaces much brighter than the mean, is taken out first and gathered instead: the
// first-collision source of neutron transport (Lathrop 1971: remedies for ray effects).
#pragma once

#include "cache/cache.h"
#include "gpu/gpu.h"
#include "lpvbake/progress.h"
#include "scene/sky.h"
#include "solver/gather/gather.h"
#include "solver/sn/sweeper.h"
#include "surface/lit_surfaces.h"
#include "volume/volume.h"

namespace lpvbake::solver::sn {

struct SnSettings {
    int directions = 240; ///< over the sphere; rounded up to one of sn_direction_counts()
    int order = 2;        ///< bands of the result, 1 to 4
    /// Cells along an edge of tiles that are swept by themselves, a multiple of
    /// gather::shard_layers: the light that enters one is looked up by rays; 0: all of the grid is
    /// swept at once.
    int tile = 0;
};

/// What is swept at once, at most.
Grid tile_of(const Grid& grid, const SnSettings& settings);

/// How what is brighter than the mean is gathered.
gather::GatherSettings peak_settings(const SnSettings& settings);

/// Device memory of a bake, bytes: the coefficients (12 floats a cell for order 1, 28 for order 2,
/// 48 for 3, 76 for 4), five planes of the luminance of up to all directions of a course, and what
/// is streamed; or what the gather takes.
uint64_t sn_device_bytes(const Grid& grid, const SnSettings& settings, bool layers = false);

/// Host memory, bytes, beside what is said of the device's, where a cell lies beside each patch and
/// some patches are bright; with layers, what rays meet is kept, which takes four times as much
/// where something tints.
uint64_t sn_host_bytes(const Grid& grid, uint64_t patches, uint64_t bright,
                       const SnSettings& settings, bool gpu, uint64_t layers = 0,
                       bool two_sided = true);

/// Time of the sweep on two threads, s, without shader compilation.
double sn_seconds(const Grid& grid, const SnSettings& settings, bool gpu);

/// Where what rays meet is kept: in a cache, if there is one, by the frame.
struct KeptSights {
    cache::Cache* cache = nullptr;
    scene::Frame frame = {};
};

/// The solver, compiled for a device and a grid: first gather_peaks, then sweep.
class SnProgram {
public:
    /// `window` limits the bytes that one binding of the device's kernels sees. 0: what the device
    /// allows; where it is the host's CPU, the host sweeps then by itself, to the same bits.
    SnProgram(const gpu::Device& device, const Grid& grid, const SnSettings& settings,
              uint64_t window = 0);

    /// Fills `volume.sh` and `volume.sh_order` with the light that surfaces and the sky send above
    /// a limit, 1.5 times the mean luminance in the valid cells (Volume::validity has to be there;
    /// other cells get none), and returns the limit, nits. The scene's units are the grid's cells,
    /// as `frame` has them. Throws as GatherProgram::gather.
    /// The same of layers: of each side's light the share that is taken of all. Of a slab alone, as
    /// GatherProgram::gather.
    float gather_peaks(const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
                       const Sky& sky, Progress& progress, Volume& volume,
                       const gather::Layers& layers = {},
                       std::optional<volume::Slab> slab = {}) const;

    /// Adds the light below the limit, that of surfaces and the sky beyond the grid as well. Tells
    /// `progress` the share that is done, of 100. Throws Error (memory, device) and whatever
    /// `progress` throws. Of layers it adds the rest, swept one after the other by what the rays
    /// of the first sweep met. What those met is kept, where there is a cache, for bakes in other
    /// light. Of a slab alone, which begins at a multiple of SnSettings::tile, as gather_peaks
    /// leaves it.
    void sweep(const surface::LitSurfaces& lit, const visibility::Visibility& visibility,
               const Sky& sky, float limit, Progress& progress, Volume& volume,
               const gather::Layers& layers = {}, const KeptSights& kept = {},
               std::optional<volume::Slab> slab = {}) const;

private:
    struct Done;
    struct Way;
    class Sweeping;
    const gpu::Device& device_;
    Grid grid_;
    SnSettings settings_;
    gather::GatherProgram gather_;
    uint64_t largest_; ///< bytes that a binding sees
    uint32_t stride_;  ///< directions of a course that are swept at once on the device
    bool on_host_;     ///< the host sweeps, but in air
    std::optional<SweepPrograms> sweep_; ///< where it does not
};

} // namespace lpvbake::solver::sn
