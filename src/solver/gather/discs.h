// The cheap way to the first reflection of punctual lights: a few texels of the reflective shadow
// maps a cell (Dachsbacher and Stamminger 2005).
#pragma once

#include "lpvbake/progress.h"
#include "solver/vpl/rsm.h"
#include "visibility/visibility.h"
#include "volume/volume.h"

namespace lpvbake::solver::gather {

/// Most texels along a side of a map that discs are laid in.
inline constexpr int largest_disc_map = 1024;

struct DiscSettings {
    int samples = 64;   ///< texels that a cell takes of each map, with a ray each
    int map_size = 256; ///< texels along each side, at most largest_disc_map
};

/// What gathering from discs did.
struct DiscReport {
    int maps = 0;
    uint64_t rays = 0; ///< for visibility
};

/// Adds to Volume::sh (of Volume::sh_order, there already) what punctual lights send after one
/// reflection, in cells whose validity is above 0.
///
/// A cell's texels lie in a disc around its own place in the map, which just covers the map:
/// radius r xi_1, angle 2 pi xi_2. Their density is 1 / (2 pi r^2 xi_1) a texel, so a sample of n
/// weighs 2 pi r^2 xi_1 / n texels (not the square of xi_1), and the sum's mean is exact. A sample
/// that is nearer than what it stands for counts as half a sphere at most. Each cell turns the
/// points by numbers of its own: what is left is noise from cell to cell, which falls with the
/// number of samples. The same bits for any number of threads. Throws Error (memory, device), and
/// whatever `progress` throws.
DiscReport gather_discs(const gpu::Device& device, const Scene& scene, const scene::Frame& frame,
                        const visibility::Visibility& visibility, const DiscSettings& settings,
                        Volume& volume, Progress& progress);

} // namespace lpvbake::solver::gather
