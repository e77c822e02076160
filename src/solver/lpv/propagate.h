// What the propagation kernels (propagate.glsl) and the host have to agree on. This file is
// included by both languages, so it keeps to what C++20 and GLSL 4.60 have in common outside of
// the blocks that test for __cplusplus.
#ifndef LPVBAKE_SOLVER_LPV_PROPAGATE_H
#define LPVBAKE_SOLVER_LPV_PROPAGATE_H

#ifdef __cplusplus
#include <cstddef>
#include <cstdint>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::solver::lpv {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

// Descriptor set 0. Everything that is read goes through uniform texel buffers (see the head of
// propagate.glsl for why), everything that is written through storage buffers. The accumulator is
// bound both ways, over the same window of the same buffer. A window is limited by
// maxStorageBufferRange as well as by maxTexelBufferElements; the latter counts single floats for
// the transmittances, which have 30 planes a layer in the per-face variant.
LPVBAKE_SHARED_CONST uint binding_front_in = 0u;        // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_accumulator_in = 1u;  // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_transmittance = 2u;   // uniform texel buffer, R32F
LPVBAKE_SHARED_CONST uint binding_front_out = 3u;       // storage buffer, vec4[]
LPVBAKE_SHARED_CONST uint binding_accumulator_out = 4u; // storage buffer, vec4[]
LPVBAKE_SHARED_CONST uint binding_partial_flux = 5u;    // storage buffer, float[]
// Of a layer that follows: as front_in and front_out; the accumulator is its own.
LPVBAKE_SHARED_CONST uint binding_layer_in = 6u;  // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_layer_out = 7u; // storage buffer, vec4[]
// Of a linear application: what its result is added to, which may be front_out.
LPVBAKE_SHARED_CONST uint binding_old_in = 6u; // uniform texel buffer, RGBA32F

// Specialization constants.
LPVBAKE_SHARED_CONST uint spec_local_size = 0u; // invocations of a work group
LPVBAKE_SHARED_CONST uint spec_lanes_x = 1u;    // of these side by side along x; divides local size
LPVBAKE_SHARED_CONST uint spec_tile_x = 2u;     // cells along x an invocation works on, 1 to 4
LPVBAKE_SHARED_CONST uint spec_march = 3u;      // layers an invocation marches through
LPVBAKE_SHARED_CONST uint spec_occlusion = 4u;  // one of the occlusion_* values below
LPVBAKE_SHARED_CONST uint spec_group_sum = 5u;  // 1: one partial sum a group, 0: one an invocation

LPVBAKE_SHARED_CONST uint occlusion_none = 0u;     // no transmittance is read
LPVBAKE_SHARED_CONST uint occlusion_link = 1u;     // 3 planes a layer: links towards +x, +y, +z
LPVBAKE_SHARED_CONST uint occlusion_per_face = 2u; // 30 planes a layer: direction * 5 + face

LPVBAKE_SHARED_CONST uint channel_count = 3u;
LPVBAKE_SHARED_CONST uint max_tile_x = 4u;

// Push constants. All bases count elements (vec4s, or floats for the transmittance and the partial
// sums) from the start of the bound window, which makes up for the part of a window that exists
// only because descriptor offsets have to be aligned.
struct PropagatePush {
    uint nx;                 // cells of the grid along x
    uint ny;                 // cells of the grid along y
    uint z_begin;            // first layer of the slab to compute
    uint z_end;              // one past its last layer
    uint row_pitch;          // elements from a row of cells to the next one
    uint plane_pitch;        // elements from a plane (one channel of one layer) to the next one
    uint front_in_base;      // where layer z_begin - 1 starts in the source front
    uint front_out_base;     // where layer z_begin starts in the new front
    uint accumulator_base;   // where layer z_begin starts in the accumulator
    uint transmittance_base; // where layer z_begin - 1 starts in the transmittances
    uint partial_base;       // where the partial sums of this dispatch start
};

// Push constants of a linear application, after those. Of what is given, u, and what lies where the
// result goes, m, it makes old m + given u + propagated P u, and adds `added` u to the accumulator.
// Its partial sums are pairs, of what is added there and of its absolute value.
struct LinearWeights {
    float added;
    float given;
    float propagated;
    float old;
};

#ifdef __cplusplus
static_assert(sizeof(PropagatePush) == 44);
static_assert(offsetof(PropagatePush, nx) == 0);
static_assert(offsetof(PropagatePush, ny) == 4);
static_assert(offsetof(PropagatePush, z_begin) == 8);
static_assert(offsetof(PropagatePush, z_end) == 12);
static_assert(offsetof(PropagatePush, row_pitch) == 16);
static_assert(offsetof(PropagatePush, plane_pitch) == 20);
static_assert(offsetof(PropagatePush, front_in_base) == 24);
static_assert(offsetof(PropagatePush, front_out_base) == 28);
static_assert(offsetof(PropagatePush, accumulator_base) == 32);
static_assert(offsetof(PropagatePush, transmittance_base) == 36);
static_assert(offsetof(PropagatePush, partial_base) == 40);

// The layout of fronts, accumulator and transmittances, in elements. A layer is a sequence of
// planes, a plane is a border row of zeros followed by ny rows, and a row ends in at least four
// zeros: the cell left of a row is the end of the row before it, and the row above a plane is the
// border row of the next plane, so no neighbour needs a bounds test. A border layer comes before
// layer 0 and another one after layer nz - 1. Borders are zeroed once and never written again.
struct PropagateLayout {
    uint nx, ny, nz;

    constexpr uint row_pitch() const { return (nx + 3) / 4 * 4 + 4; }
    constexpr uint plane_pitch() const { return row_pitch() * (ny + 1); }

    // Elements of a layer: 3 planes for a front and for link transmittances, 30 for transmittances
    // per face.
    constexpr std::uint64_t layer(uint planes = channel_count) const {
        return std::uint64_t(planes) * plane_pitch();
    }
    // Elements of a whole buffer, both border layers included.
    constexpr std::uint64_t elements(uint planes = channel_count) const {
        return (std::uint64_t(nz) + 2) * layer(planes);
    }
    // Element of a cell; z may be -1 or nz to address the border layers.
    constexpr std::uint64_t index(uint x, uint y, int z, uint plane,
                                  uint planes = channel_count) const {
        return std::uint64_t(z + 1) * layer(planes) + std::uint64_t(plane) * plane_pitch()
               + std::uint64_t(y + 1) * row_pitch() + x;
    }
};

// How the kernel is cut into work groups; the same numbers go into the specialization constants.
struct PropagateTiling {
    uint local_size, lanes_x, tile_x, march, group_sum;

    struct Groups {
        uint x, y, z;
    };
    constexpr Groups groups(uint nx, uint ny, uint layers) const {
        const uint span_x = lanes_x * tile_x, span_y = local_size / lanes_x;
        return {(nx + span_x - 1) / span_x, (ny + span_y - 1) / span_y,
                (layers + march - 1) / march * channel_count};
    }
    // Floats a dispatch writes to the partial sums.
    constexpr uint partials(uint nx, uint ny, uint layers) const {
        const Groups g = groups(nx, ny, layers);
        return g.x * g.y * g.z * (group_sum != 0 ? 1 : local_size);
    }
};

// For devices that run a subgroup as one SIMD vector of a CPU core: one subgroup a group, and of
// the tiles that leave the fewest lanes without a cell the widest. A tile of one cell takes about
// twice the time of the others and is left out.
constexpr PropagateTiling cpu_tiling(uint nx) {
    PropagateTiling best{8, 8, 4, 16, 0};
    for (uint tile = 4; tile >= 2; --tile) {
        const auto padded = [nx](uint t) { return (nx + 8 * t - 1) / (8 * t) * 8 * t; };
        if (padded(tile) < padded(best.tile_x))
            best.tile_x = tile;
    }
    return best;
}

// For everything else: rows of a group coalesce, and short marches leave enough invocations to fill
// a large device even with a grid of 64 cells a side (98304 of them).
inline constexpr PropagateTiling gpu_tiling{64, 32, 1, 8, 1};
} // namespace lpvbake::solver::lpv
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_LPV_PROPAGATE_H
