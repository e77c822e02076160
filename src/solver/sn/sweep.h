// What the kernels of the sweep (transport.comp, transport_air.comp, given.comp, project.comp) and
// the host have to agree on. This file is included by both languages, so it keeps to what C++20 and
// GLSL 4.60 have in common outside of the blocks that test for __cplusplus.
#ifndef LPVBAKE_SOLVER_SN_SWEEP_H
#define LPVBAKE_SOLVER_SN_SWEEP_H

#ifdef __cplusplus
#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <glm/glm.hpp>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::solver::sn {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

// An octant of directions is swept alone. Its cells are counted along the way of the light, so that
// all components of its directions are positive and upstream means lower coordinates (p, q, r), r
// along the longest axis of the grid; -1 lies outside the grid. Cells of one front, p + q + r + 3 =
// const, depend on the three fronts before only; a few fronts make a ring in memory. A front has a
// slot for each (p, q), and a slot holds the luminance in all directions of the batch.
LPVBAKE_SHARED_CONST uint ring_fronts = 8u;
// Fronts that are projected at once, while the three before the next one stay.
LPVBAKE_SHARED_CONST uint projected_fronts = 5u;

// Directions are worked on in groups of so many, side by side: a subgroup of a CPU device.
LPVBAKE_SHARED_CONST uint lanes = 8u;

// transport.comp: luminance of a front's cells from the fronts before.
LPVBAKE_SHARED_CONST uint binding_ring_in = 0u;    // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_ring_out = 1u;   // storage buffer, float[], four a texel
LPVBAKE_SHARED_CONST uint binding_slots = 2u;      // uniform texel buffer, R32F: a slot each
LPVBAKE_SHARED_CONST uint binding_directions = 3u; // uniform texel buffer, RGBA32F

// transport_air.comp, beside these.
LPVBAKE_SHARED_CONST uint binding_air = 4u;            // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_air_directions = 5u; // uniform texel buffer, RGBA32F

// given.comp: luminance of places where it is known.
LPVBAKE_SHARED_CONST uint binding_given_ring = 0u;   // storage buffer, vec4[]
LPVBAKE_SHARED_CONST uint binding_given_slots = 1u;  // storage buffer, uint[]
LPVBAKE_SHARED_CONST uint binding_given_values = 2u; // uniform texel buffer, RGBA32F

// project.comp: luminance of a front's cells into spherical harmonics.
LPVBAKE_SHARED_CONST uint binding_project_ring = 0u; // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_project_cells =
    1u; // storage buffer, uvec2[]: slot of the ring, cell
LPVBAKE_SHARED_CONST uint binding_project_weights = 2u; // uniform buffer, vec4[]: four weights each
LPVBAKE_SHARED_CONST uint binding_sh_in = 3u;           // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_sh_out = 4u;          // storage buffer, vec4[]

// Specialization constants.
LPVBAKE_SHARED_CONST uint spec_local_size = 0u;   // invocations of a work group
LPVBAKE_SHARED_CONST uint spec_march = 1u;        // cells that follow each other in an invocation
LPVBAKE_SHARED_CONST uint spec_coefficients = 2u; // project: of a cell; in air: of its source
LPVBAKE_SHARED_CONST uint spec_directions = 3u;   // project: of a dispatch
LPVBAKE_SHARED_CONST uint spec_columns = 4u;      // project: 1 of surfaces in air

// A direction takes two vec4s of the table: the weights of its four taps, and their distance in
// slots.
LPVBAKE_SHARED_CONST uint direction_vec4s = 2u;
// And four more in air: nine harmonics and three zeros, then the way through a cell, cells.
// A cell takes one, what is taken of light a cell's edge and the density, and its source's
// coefficients, three channels each, without gaps.
LPVBAKE_SHARED_CONST uint air_direction_vec4s = 4u;

// Weights that a dispatch of project.comp reads, at most.
LPVBAKE_SHARED_CONST uint max_project_weights = 288u;

struct TransportPush {
    uint first, last;         // entries of the list of cells
    uint stride;              // texels a slot: directions of the batch
    uint out_base;            // slot that the front starts with
    uint base1, base2, base3; // the same of the fronts before
    float red, green, blue;   // what air takes, as Air::extinction
};

struct GivenPush {
    uint first, last; // entries of the list of slots
    uint value_base;  // texel of the first entry's values
    uint stride;
    uint out_base;
};

struct ProjectPush {
    uint first, last; // entries of the list of cells
    uint stride;
    uint ring_base;         // first direction of those that are added
    uint first_cell;        // the cell that the window of coefficients starts with
    uint sh_base;           // where that cell's coefficients start, in vec4s
    float red, green, blue; // as TransportPush
};

#ifdef __cplusplus
static_assert(sizeof(TransportPush) == 40);
static_assert(offsetof(TransportPush, base3) == 24);
static_assert(sizeof(GivenPush) == 20);
static_assert(sizeof(ProjectPush) == 36);

/// vec4s of a cell's coefficients: three channels each, without gaps.
constexpr uint sh_vec4s(uint coefficients) {
    return (3 * coefficients + 3) / 4;
}

/// Fronts and slots of a grid.
struct SweepLayout {
    glm::ivec3 axes; ///< of the grid, in the order p, q, r
    glm::ivec3 dims; ///< cells along p, q, r

    explicit SweepLayout(glm::ivec3 grid) {
        const int longest = grid.z >= std::max(grid.x, grid.y) ? 2 : grid.y >= grid.x ? 1 : 0;
        axes = {longest == 0 ? 1 : 0, longest == 2 ? 1 : 2, longest};
        dims = {grid[axes.x], grid[axes.y], grid[axes.z]};
    }
    uint pitch() const { return uint(dims.x) + 1; }
    uint slots() const { return pitch() * (uint(dims.y) + 1); }
    uint slot(int p, int q) const { return uint(p + 1) + pitch() * uint(q + 1); }
    /// Front 0 is that of (-1, -1, -1), front 3 the first with a cell of the grid.
    int fronts() const { return dims.x + dims.y + dims.z + 1; }
    /// Slot that a front starts with.
    uint base(int front) const { return uint(front % int(ring_fronts)) * slots(); }
    uint64_t ring_texels(uint stride) const { return uint64_t(ring_fronts) * slots() * stride; }
};

/// How the kernels are cut into work groups; goes into the specialization constants.
struct SweepTiling {
    uint local_size, march, project_march;
};
/// One subgroup a group, which then reads what is the same for all lanes once.
inline constexpr SweepTiling cpu_tiling{lanes, 16, 4};
inline constexpr SweepTiling gpu_tiling{64, 1, 1};
} // namespace lpvbake::solver::sn
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_SN_SWEEP_H
