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

// A sixth of the directions, those that go farther along one axis, one way, than along the others,
// is swept at a time: plane by plane of cells across that axis, each from the one before alone. A
// plane has a slot for each (u, v) along the other two axes, and for the places beside the grid,
// and a slot holds the luminance in all directions of the batch: of four quadrants, one direction
// of each after the other. A few planes make a ring in memory.
LPVBAKE_SHARED_CONST uint quadrants = 4u;
// At most: those that are projected at once, and the one before. At least two.
LPVBAKE_SHARED_CONST uint most_ring_planes = 5u;

// Directions are worked on in groups of so many, side by side: a subgroup of a CPU device.
LPVBAKE_SHARED_CONST uint lanes = 8u;

// transport.comp: luminance of a plane's cells from the plane before.
LPVBAKE_SHARED_CONST uint binding_ring_in = 0u;    // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_ring_out = 1u;   // storage buffer, float[], four a texel
LPVBAKE_SHARED_CONST uint binding_directions = 2u; // uniform texel buffer, RGBA32F

// transport_air.comp, beside these.
LPVBAKE_SHARED_CONST uint binding_air = 3u;            // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_air_directions = 4u; // uniform texel buffer, RGBA32F

// given.comp: luminance of places where it is known.
LPVBAKE_SHARED_CONST uint binding_given_ring = 0u;   // storage buffer, vec4[]
LPVBAKE_SHARED_CONST uint binding_given_slots = 1u;  // storage buffer, uint[]: 4 slot + quadrant
LPVBAKE_SHARED_CONST uint binding_given_values = 2u; // uniform texel buffer, RGBA32F

// project.comp: luminance of the cells of some planes into spherical harmonics.
LPVBAKE_SHARED_CONST uint binding_project_ring = 0u;    // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_project_weights = 1u; // uniform buffer, vec4[]: four weights each
LPVBAKE_SHARED_CONST uint binding_sh_in = 2u;           // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_sh_out = 3u;          // storage buffer, vec4[]

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
// A cell takes for each quadrant one, what is taken of light a cell's edge and the density, and its
// source's coefficients, three channels each, without gaps.
LPVBAKE_SHARED_CONST uint air_direction_vec4s = 4u;

// Weights that a dispatch of project.comp reads, at most.
LPVBAKE_SHARED_CONST uint max_project_weights = 288u;

struct TransportPush {
    uint cells;             // of the plane
    uint across;            // of them along u
    uint pitch;             // slots from one v to the next
    uint stride;            // texels a slot: directions of the batch
    uint in_base;           // slot that the plane before starts with
    uint out_base;          // the same of the plane
    uint air_first;         // the plane's first entry of what is told of air
    float red, green, blue; // what air takes, as Air::extinction
};

struct GivenPush {
    uint values; // of the plane's places, in the directions of their quadrants
    uint first;  // place
    uint stride;
    uint out_base;
};

struct ProjectPush {
    uint cells;                      // of all planes
    uint across, rows, first_row;    // of each: cells along u, and along v
    uint pitch, slots;               // of a plane
    uint first_plane, ring_planes;   // in the ring, of so many
    uint stride;                     // texels a slot
    uint ring_base;                  // first direction of those that are added
    uint first_cell;                 // at (0, 0) of the first plane, in the window of coefficients
    uint step_u, step_v, step_plane; // in cells, modulo 2^32
    uint sh_base;                    // where the window's first cell starts, in vec4s
    float red, green, blue;          // as TransportPush
};

#ifdef __cplusplus
static_assert(sizeof(TransportPush) == 40);
static_assert(sizeof(GivenPush) == 16);
static_assert(sizeof(ProjectPush) == 72);

/// vec4s of a cell's coefficients: three channels each, without gaps.
constexpr uint sh_vec4s(uint coefficients) {
    return (3 * coefficients + 3) / 4;
}

/// Planes and slots of a course.
struct SweepLayout {
    glm::ivec3 dims; ///< cells along u, v, and the course's axis

    uint cells() const { return uint(dims.x) * uint(dims.y); }
    uint pitch() const { return uint(dims.x) + 2; }
    uint slots() const { return pitch() * (uint(dims.y) + 2); }
    uint slot(int u, int v) const { return uint(u + 1) + pitch() * uint(v + 1); }
    /// Plane 0 lies before the grid.
    int planes() const { return dims.z + 1; }
};

/// Slots of the largest plane of a grid, across any axis.
inline uint64_t most_slots(glm::ivec3 grid) {
    const glm::u64vec3 wide = glm::u64vec3(grid) + glm::u64vec3(2);
    return std::max({wide.x * wide.y, wide.y * wide.z, wide.x * wide.z});
}

/// How the kernels are cut into work groups; goes into the specialization constants.
struct SweepTiling {
    uint local_size, march, project_march, given_march;
};
/// One subgroup a group, which then reads what is the same for all lanes once.
inline constexpr SweepTiling cpu_tiling{lanes, 16, 4, 16};
inline constexpr SweepTiling gpu_tiling{64, 1, 1, 16};
} // namespace lpvbake::solver::sn
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_SN_SWEEP_H
