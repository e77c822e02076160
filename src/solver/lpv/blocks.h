// Blocks of 2 x 2 x 2 cells, on which what light is missing is found (diffusion.h), and what the
// kernels that sum and spread over them (block_sums.comp, spread_blocks.comp) and the host have to
// agree on. Included by both languages, as propagate.h.
#ifndef LPVBAKE_SOLVER_LPV_BLOCKS_H
#define LPVBAKE_SOLVER_LPV_BLOCKS_H

#ifdef __cplusplus
#include <cstdint>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::solver::lpv {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

LPVBAKE_SHARED_CONST uint blocks_march = 8u; // layers an invocation works on

// Push constants of both. Fronts are laid out as in propagate.h; blocks lie x fastest, z slowest,
// without borders. Bases count elements from the start of the bound window.
struct BlocksPush {
    uint nx, ny, nz;   // cells of the grid
    uint row_pitch;    // as in PropagatePush
    uint plane_pitch;  // as in PropagatePush
    uint begin;        // first layer to compute: of blocks to sum, of cells to spread to
    uint end;          // one past the last
    uint front_base;   // where the first layer of the grid would start in the front
    uint out_base;     // the same of the blocks (sums) or of the front that is written
    uint blocks_base;  // the same of the blocks that are spread
    uint reached_base; // the same of the cells of these that light reaches
};

#ifdef __cplusplus
} // namespace lpvbake::solver::lpv
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_LPV_BLOCKS_H
