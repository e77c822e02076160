// What the gathering kernel (gather.comp) and the host have to agree on. This file is included by
// both languages, so it keeps to what C++20 and GLSL 4.60 have in common outside of the blocks that
// test for __cplusplus.
#ifndef LPVBAKE_SOLVER_GATHER_LAYOUT_H
#define LPVBAKE_SOLVER_GATHER_LAYOUT_H

#ifdef __cplusplus
#include <cstdint>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::solver::gather {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

// A job is what eight cells gather from one list of sources; a cell may take several jobs, whose
// results are added in their order.
LPVBAKE_SHARED_CONST uint lanes = 8u;

// Descriptor set 0.
LPVBAKE_SHARED_CONST uint binding_centers = 0u; // uniform texel buffer: cell centres, eight a job
LPVBAKE_SHARED_CONST uint binding_jobs = 1u;    // storage buffer, Job[]
LPVBAKE_SHARED_CONST uint binding_list = 2u;    // uniform texel buffer, RGBA32F
LPVBAKE_SHARED_CONST uint binding_result =
    3u; // storage buffer, float[]: [job][k][layer][colour][lane]

// Specialization constants.
LPVBAKE_SHARED_CONST uint spec_local_size = 0u; // a multiple of `lanes`
LPVBAKE_SHARED_CONST uint spec_order = 1u;      // of the harmonics: 1, 2 or 4
LPVBAKE_SHARED_CONST uint spec_part = 2u;       // what a job's list holds

LPVBAKE_SHARED_CONST uint part_surfaces = 0u; // points, then triangles
LPVBAKE_SHARED_CONST uint part_sky = 1u;      // bins
LPVBAKE_SHARED_CONST uint part_layers = 2u; // as part_surfaces, each with the light of some layers

// A list is made of words of four floats. `guard`: the least r^2; `variance`: of a point's area
// along each axis; a mask is a whole number whose bit i is set if lane i sees the source.
LPVBAKE_SHARED_CONST uint point_words = 3u;    // x y z mask | normal guard | intensity variance
LPVBAKE_SHARED_CONST uint triangle_words = 4u; // a 0 | b 0 | c 0 | luminance mask

// Of part_layers: x y z mask | normal guard | variance 0 0 0, or a mask | b 0 | c 0, and the RGB of
// each layer, one after the other.
LPVBAKE_SHARED_CONST uint pass_layers = 4u; // a multiple of 4
LPVBAKE_SHARED_CONST uint pass_words = 3u * pass_layers / 4u;
LPVBAKE_SHARED_CONST uint layered_words = 3u + pass_words;

struct Job {
    uint first; // word of the list
    uint points;
    uint triangles;
    uint bins;
};

struct Push {
    uint jobs;
};

#ifdef __cplusplus
constexpr uint terms(int order) {
    return uint((order + 1) * (order + 1));
}
// A bin of sky: 3 floats a term, and the mask.
constexpr uint bin_words(int order) {
    return (3 * terms(order) + 1 + 3) / 4;
}
// Of a job, for so many layers at a time.
constexpr uint result_floats(int order, uint layers = 1) {
    return 3 * layers * terms(order) * lanes;
}
static_assert(sizeof(Job) == 16);
} // namespace lpvbake::solver::gather
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_SOLVER_GATHER_LAYOUT_H
