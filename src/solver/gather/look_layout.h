// What the program that looks from places (look.rgen) and the host have to agree on. This file is
// included by both languages, so it keeps to what C++20 and GLSL 4.60 have in common outside of the
// blocks that test for __cplusplus.
#ifndef LPVBAKE_SOLVER_GATHER_LOOK_LAYOUT_H
#define LPVBAKE_SOLVER_GATHER_LOOK_LAYOUT_H

#ifdef __cplusplus
#include <cstdint>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::solver::gather {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

LPVBAKE_SHARED_CONST uint strata = 16u; // points of a cluster that places may test

// What is given, in words of four numbers: the head, a word a place (x y z pattern), the points of
// each cluster, a word a bin of sky (low high from to), and the tests, a number each: place *
// sources + source, where bins are sources after the clusters. An answer is a number a test.
LPVBAKE_SHARED_CONST uint head_words = 2u; // clusters sources places 0 | from the frame to that of
                                           // the structure: offset, scale
LPVBAKE_SHARED_CONST uint axis_words = strata / 4u;
LPVBAKE_SHARED_CONST uint target_words =
    6u * axis_words; // x, y and z of the points, then of normals

LPVBAKE_SHARED_CONST uint answer_hidden = 0u;
LPVBAKE_SHARED_CONST uint answer_seen = 1u;
LPVBAKE_SHARED_CONST uint answer_unsure = 2u;  // of a ray that is to be asked again
LPVBAKE_SHARED_CONST uint answer_untried = 3u; // a cluster that has its back to the place

#ifdef __cplusplus
} // namespace lpvbake::solver::gather
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_GATHER_LOOK_LAYOUT_H
