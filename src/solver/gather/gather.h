// Light of clustered virtual point lights and of the sky, gathered at cell centres (Walter et al.
// 2005 for the clusters, Greger et al. 1998 for the adaptive grid).
#pragma once

#include "gpu/gpu.h"
#include "lpvbake/progress.h"
#include "solver/gather/clusters.h"
#include "solver/gather/sky_bins.h"
#include "solver/solver.h"
#include "surface/lit_surfaces.h"
#include "volume/slab.h"
#include "volume/volume.h"

#include <optional>
#include <span>

namespace lpvbake::solver::gather {

struct GatherSettings {
    int order = 2; ///< of the harmonics: 1, 2 or 4
    /// Clusters of patches that a cell tests for visibility, each with one ray, at most. More let
    /// shadows be sharper.
    int vpls = 192;
    /// Directions along which it tests whether it sees the sky, about; 0: four times vpls.
    int sky_bins = 0;
    /// A cluster is opened where it is nearer than this many times its size.
    float kappa = 1.0f;
    /// Cells are interpolated where irradiance at the eight corners around them differs by no more
    /// than this from their mean (root mean square over all normals, as a share of the mean
    /// irradiance over them), and where no surface is between these. 0: every cell is solved.
    float tolerance = 0.3f;
};

/// Device memory of a gather, bytes: whatever the grid and the scene are, and however many layers
/// there are.
uint64_t gather_device_bytes(const GatherSettings& settings, bool layers = false);

/// Host memory that a gather takes beside surfaces and volumes, bytes; an estimate from above.
uint64_t gather_host_bytes(const Grid& grid, uint64_t patches, const GatherSettings& settings,
                           bool gpu, uint64_t layers = 0, bool two_sided = true);

/// How long two threads will take, seconds: an estimate.
double gather_seconds(const Grid& grid, uint64_t patches, const GatherSettings& settings, bool gpu);

/// The same of so many places, by themselves or in blocks.
double gather_seconds_at(uint64_t places, bool blocks, uint64_t patches,
                         const GatherSettings& settings);

/// What a gather did and cost.
struct GatherReport {
    uint64_t solved = 0;       ///< cells
    uint64_t interpolated = 0; ///< cells
    uint64_t rays = 0;         ///< for visibility
    uint64_t sources = 0; ///< pairs of a cell and what it gathered, without those that it masked
    double clusters_seconds = 0, visibility_seconds = 0, lists_seconds = 0, device_seconds = 0,
           interpolation_seconds = 0;
};

/// Layers of cells that no slab parts: a zone's.
inline constexpr int shard_layers = 16;

/// Layers of the light, and the volume of each.
struct Layers {
    std::span<const scene::LightLayer> light = {};
    std::span<Volume> volumes = {};
};

/// What sends light, as cells and places gather it; no grid has a say in it.
struct Senders {
    Clusters clusters;
    std::vector<SkyBin> bins;
    double seconds = 0; ///< that they took

    bool empty() const { return clusters.nodes.empty() && bins.empty(); }
};

/// The gather, compiled for a device and an order.
class GatherProgram {
public:
    /// `window` limits the bytes of a list that the device sees at once; 0: 32 MiB.
    GatherProgram(const gpu::Device& device, const GatherSettings& settings, uint64_t window = 0);

    /// Fills Volume::sh and sh_order from the light that leaves `surfaces` and the sky, in the
    /// cells whose validity (which has to be there) is above 0; in the others it is 0. The same
    /// bits for any number of threads and any window. Throws Error (memory, device), and whatever
    /// `progress` throws. With a limit `above` only luminance_above() it leaves the surfaces.
    ///
    /// The same of each of LitSurfaces::layers, which are of `layers`: what is seen, how clusters
    /// are opened and which cells are interpolated is as the volume's light has it, so that fields
    /// are linear in the layers' weights.
    ///
    /// Of a slab alone, which begins at a multiple of shard_layers, the same bits in its cells, and
    /// Volume::sh has no others; the grid and the validity are the whole grid's all the same.
    GatherReport gather(const surface::LitSurfaces& surfaces, const Sky& sky,
                        const visibility::Visibility& visibility, Volume& volume,
                        Progress& progress, float above = 0.0f, const Layers& layers = {},
                        std::optional<volume::Slab> slab = {}) const;

    /// The same at places (frame units, less than 2^24 from its origin) instead of a grid's cells:
    /// the volume has a cell for each, in a row. Every place with a validity above 0 is solved and
    /// tests all that its cell would; places are put together by where they lie, so that a place's
    /// light depends, within the error, on which others there are, and never on their order.
    GatherReport gather_at(std::span<const glm::vec3> places, const surface::LitSurfaces& surfaces,
                           const Sky& sky, const visibility::Visibility& visibility, Volume& volume,
                           Progress& progress, const Layers& layers = {}) const;

    /// The same of the cells of blocks, which share what they see as a grid's do; the volume has a
    /// cell for each that is solved, in a row. The senders are of the surfaces.
    GatherReport gather_blocks(std::span<const Block> blocks, const surface::LitSurfaces& surfaces,
                               const Senders& senders, const visibility::Visibility& visibility,
                               Volume& volume, Progress& progress) const;

    /// Of the surfaces' light, no more than what luminance_above() leaves, and of the sky's.
    Senders senders(const surface::LitSurfaces& surfaces, const Sky& sky,
                    const visibility::Visibility& visibility, float above = 0.0f,
                    std::span<const scene::LightLayer> layers = {}) const;

private:
    template <class Run>
    GatherReport with_senders(const Senders& senders, const visibility::Visibility& visibility,
                              size_t cells, Volume& volume, const Layers& layers,
                              const Run& run) const;
    template <class Run>
    GatherReport with_packets(const Senders& senders, const visibility::Visibility& visibility,
                              Volume& volume, const Layers& layers, const Run& run) const;

    const gpu::Device& device_;
    GatherSettings settings_;
    uint64_t list_bytes_;
    uint32_t local_size_;
    gpu::Program surfaces_;
};

} // namespace lpvbake::solver::gather
