// What carries the light of a sweep from plane to plane; on the device: how it is cut to what the
// device can bind, its buffers and dispatches.
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

    SweptAir(const gpu::Device& device, const visibility::Air& air, LightPart part,
             const Grid& grid, uint32_t stride, int order);
};

/// How a sweep is cut: by what a binding can see.
struct SweepPlan {
    uint64_t slots; ///< of the largest plane
    SweepTiling tiling;
    int order;              ///< of the harmonics
    uint32_t stride;        ///< directions of a course that are swept at once
    uint32_t planes;        ///< of the ring
    uint32_t at_once;       ///< of them, that a dispatch of project.comp adds
    uint64_t cell_bytes;    ///< of a cell's coefficients
    uint64_t layer_cells;   ///< of the grid
    uint64_t chunk;         ///< bytes of each list that is streamed, at most
    int slab;               ///< layers of coefficients that a binding sees
    uint64_t alignment = 0; ///< of windows, bytes
    /// Each dispatch of project.comp sees the weights of its directions at the start of a window of
    /// so many bytes.
    uint64_t weight_bytes;

    uint64_t ring_texels() const { return planes * slots * stride; }
    /// Slot that a plane starts with.
    uint32_t base(const SweepLayout& layout, int plane) const {
        return uint32_t(plane) % planes * layout.slots();
    }
};

/// Directions of a course, of `directions` over the sphere, that can be swept at once where the
/// ring of planes has at most so many bytes; a multiple of `lanes`.
uint32_t swept_directions(const Grid& grid, int directions, uint64_t most_bytes);

/// Directions that a dispatch of project.comp adds: a divisor of the stride, so few that the
/// unrolled code stays small.
uint32_t projected_directions(uint32_t stride, int order);

/// `largest` bytes are what a binding sees. Throws Error (memory) where that is not a layer.
SweepPlan plan_sweep(const gpu::Device& device, const Grid& grid, int order, uint32_t stride,
                     uint64_t largest);

/// For planes of at most so many slots.
SweepTiling tiling_for(const gpu::Device& device, uint64_t slots);

SweepPrograms compile_sweep(const gpu::Device& device, const Grid& grid, uint32_t stride,
                            int order);

/// Device memory of a sweep, bytes, where all directions are swept at once if they may be.
uint64_t sweep_bytes(const Grid& grid, int directions, int order);

/// Of each list that is streamed, bytes at most.
inline constexpr uint64_t chunk_bytes = uint64_t(8) << 20;

/// Carries light through a grid, course by course, and sums what arrives in its cells: the same
/// bits on any device that rounds each product and sum by itself.
class Sweeper {
public:
    virtual ~Sweeper() = default;
    /// Begins a course with some directions, which outlive what is swept along them, and with what
    /// each slot starts with, a texel a direction.
    virtual void begin(const Course& course, const Directions& directions,
                       std::span<const glm::vec4> beyond) = 0;
    /// Sweeps the planes of a chunk, which follow those of the one before; takes what is in it.
    virtual void run(const PlaneOrder& order, const Chunk& chunk) = 0;
    /// Adds the coefficients to those of cells of a grid, whose cell `at` is the first.
    virtual void add_to(const Grid& grid, glm::ivec3 at,
                        std::vector<std::vector<glm::vec3>>& sh) = 0;
};

/// The buffers of a sweep, and what runs on them: while the device sweeps a chunk, the next one may
/// be made. The arguments outlive it.
class DeviceSweeper final : public Sweeper {
public:
    /// `air`: null where there is none.
    DeviceSweeper(const gpu::Device& device, const Grid& grid, const SweepPlan& plan,
                  const SweepPrograms& programs, const SweptAir* air = nullptr);

    void begin(const Course& course, const Directions& directions,
               std::span<const glm::vec4> beyond) override;
    void run(const PlaneOrder& order, const Chunk& chunk) override;
    void add_to(const Grid& grid, glm::ivec3 at, std::vector<std::vector<glm::vec3>>& sh) override;

private:
    /// What the device reads of a chunk, as large as that of the largest, and what it does by it.
    struct Stream {
        gpu::Buffer given_slots, given, air;
        gpu::Buffer beyond, table, weights, air_table; ///< of its directions
        gpu::Batch batch;
    };
    Stream make_stream() const;
    void upload(const Chunk& chunk);
    void record_beyond();
    void record_given(uint32_t first, uint32_t last, int plane);
    void record_transport(int plane, uint32_t air_first);
    void record_project(int begin, int end);
    void record_project(int begin, int end, int slab);
    Stream& stream() { return streams_[at_]; }

    const gpu::Device& device_;
    const Grid& grid_;
    const SweepPlan& plan_;
    const SweepPrograms& programs_;
    const SweptAir* in_air_;
    gpu::Buffer sh_, ring_;
    const Course* course_ = nullptr;
    const Directions* directions_ = nullptr;
    std::vector<glm::vec4> beyond_; ///< the ring is still to start with
    std::array<Stream, 2> streams_; ///< one runs while the other is filled
    size_t at_ = 0;                 ///< the one that is filled
};

} // namespace lpvbake::solver::sn
