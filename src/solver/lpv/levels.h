// Levels of the diffusion that says what light is missing (diffusion.h), and what the kernels of a
// cycle over them (*_level.comp) and the host have to agree on. Included by both languages, as
// propagate.h.
#ifndef LPVBAKE_SOLVER_LPV_LEVELS_H
#define LPVBAKE_SOLVER_LPV_LEVELS_H

#ifdef __cplusplus
#include <cstdint>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::solver::lpv {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

// Specialization constants.
LPVBAKE_SHARED_CONST uint spec_level_local_size = 0u; // invocations of a work group
LPVBAKE_SHARED_CONST uint spec_level_march = 1u;      // layers an invocation works on

LPVBAKE_SHARED_CONST float relaxed = 0.85f; // share of a Jacobi step

// Push constants. Levels lie x fastest, z slowest, without borders. Bases say where the first layer
// of a level would lie in the bound window: modulo 2^32, as the kernels add.
struct LevelPush {
    uint nx, ny, nz;     // of the level that is computed
    uint near_x, near_y; // of the one it is computed from, where that is another
    uint near_z;
    uint begin;     // first layer to compute
    uint end;       // one past the last
    uint in_base;   // of what is read of the level itself
    uint near_base; // of what is read of the other
    uint out_base;  // of what is written
    uint dark;      // 1: what is read as solution counts as 0
};

#ifdef __cplusplus
} // namespace lpvbake::solver::lpv
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_LPV_LEVELS_H
