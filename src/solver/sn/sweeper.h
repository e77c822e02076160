// The sweep on the device: how it is cut to what the device can bind, its buffers and dispatches.
#pragma once

#include "gpu/gpu.h"
#include "solver/sn/packing.h"
#include "volume/volume.h"

#include <array>
#include <span>
#include <vector>

namespace lpvbake::solver::sn {

/// The kernels.
struct SweepPrograms {
    gpu::Program transport, given, project;
};

/// Air that is swept through, with the kernels for the light of surfaces or for its own.
struct SweptAir {
    const visibility::Air& air;
    uint32_t coefficients; ///< of a cell's source; 0: of surfaces
    gpu::Program transport, project;

    SweptAir(const gpu::Device& device, const visibility::Air& air, LightPart part, uint32_t stride,
             int order);
};

/// How a sweep is cut: by what a binding can see.
struct SweepPlan {
    SweepLayout layout;
    SweepTiling tiling;
    int order;              ///< of the harmonics
    uint32_t stride;        ///< directions of an octant that are swept at once
    uint32_t at_once;       ///< of them, that a dispatch of project.comp adds
    uint64_t cell_bytes;    ///< of a cell's coefficients
    uint64_t layer_cells;   ///< of the grid
    uint64_t chunk;         ///< bytes of each list that is streamed, at most
    int slab;               ///< layers of coefficients that a binding sees
    uint64_t alignment = 0; ///< of windows, bytes
    /// Each dispatch of project.comp sees the weights of its directions at the start of a window of
    /// so many bytes.
    uint64_t weight_bytes;

    uint64_t ring_texels() const { return layout.ring_texels(stride); }
};

/// Directions of an octant, of `directions` over the sphere, that can be swept at once where the
/// ring of fronts has at most so many bytes; a multiple of `lanes`.
uint32_t swept_directions(const SweepLayout& layout, int directions, uint64_t most_bytes, bool cpu);

/// Directions that a dispatch of project.comp adds: a divisor of the stride, so few that the
/// unrolled code stays small.
uint32_t projected_directions(uint32_t stride, int order);

/// `largest` bytes are what a binding sees. Throws Error (memory) where that is not a layer.
SweepPlan plan_sweep(const gpu::Device& device, const Grid& grid, int order, uint32_t stride,
                     uint64_t largest);

SweepTiling tiling_for(const gpu::Device& device);

SweepPrograms compile_sweep(const gpu::Device& device, uint32_t stride, int order);

/// Device memory of a sweep, bytes, where all directions are swept at once if they may be.
uint64_t sweep_bytes(const Grid& grid, int directions, int order);

/// Of each list that is streamed, bytes at most.
inline constexpr uint64_t chunk_bytes = uint64_t(20) << 20;

/// The buffers of a sweep, and what runs on them: while the device sweeps a chunk, the next one may
/// be made. The arguments outlive it.
class Sweeper {
public:
    /// `air`: null where there is none.
    Sweeper(const gpu::Device& device, const Grid& grid, const SweepPlan& plan,
            const SweepPrograms& programs, const SweptAir* air = nullptr);

    /// Begins with other directions, which outlive what is swept along them, and with what each
    /// slot of the ring starts with, a texel a direction.
    void begin(const Directions& directions, std::span<const glm::vec4> beyond);
    /// Sweeps the fronts of a chunk, which follow those of the one before; takes what is in it.
    void run(const FrontOrder& order, const Chunk& chunk);
    /// Adds the coefficients to those of cells of a grid, whose cell `at` is the first.
    void add_to(const Grid& grid, glm::ivec3 at, std::vector<std::vector<glm::vec3>>& sh);

private:
    /// What the device reads of a chunk, as large as that of the largest, and what it does by it.
    struct Stream {
        gpu::Buffer cells, cell_slots, given_slots, given, air;
        gpu::Buffer beyond, table, weights, air_table; ///< of its directions
        gpu::Batch batch;
    };
    Stream make_stream() const;
    void upload(const FrontOrder& order, const Chunk& chunk);
    void record_beyond();
    void record_given(uint32_t first, uint32_t last, uint32_t out_base);
    void record_transport(uint32_t first, uint32_t last, int front);
    void record_project(std::span<const Entry> cells, uint32_t first, uint32_t last);
    gpu::Groups groups_of(uint32_t entries) const;
    Stream& stream() { return streams_[at_]; }

    const gpu::Device& device_;
    const Grid& grid_;
    const SweepPlan& plan_;
    const SweepPrograms& programs_;
    const SweptAir* in_air_;
    gpu::Buffer sh_, ring_;
    const Directions* directions_ = nullptr;
    std::vector<glm::vec4> beyond_; ///< the ring is still to start with
    std::array<Stream, 2> streams_; ///< one runs while the other is filled
    size_t at_ = 0;                 ///< the one that is filled
};

} // namespace lpvbake::solver::sn
