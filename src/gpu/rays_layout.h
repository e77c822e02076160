// What the programs that trace rays (trace.rgen, ...) and the host have to agree on. This file is
// included by both languages, so it keeps to what C++20 and GLSL 4.60 have in common outside of the
// blocks that test for __cplusplus.
#ifndef LPVBAKE_GPU_RAYS_LAYOUT_H
#define LPVBAKE_GPU_RAYS_LAYOUT_H

#ifdef __cplusplus
#include <cstdint>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::gpu {
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

// Descriptor set 0.
LPVBAKE_SHARED_CONST uint binding_tree = 0u; // acceleration structure
LPVBAKE_SHARED_CONST uint binding_given =
    1u; // storage buffer; of trace.rgen two vec4 a ray: origin, direction, t_min, t_max
LPVBAKE_SHARED_CONST uint binding_answers =
    2u; // storage buffer; of trace.rgen uint[4] a ray, as DeviceHit
LPVBAKE_SHARED_CONST uint binding_facts = 3u; // storage buffer, vec4 of the second geometry's
                                              // triangles: normal, and which facts are so

// The first geometry of the structure is opaque, the second has facts.
LPVBAKE_SHARED_CONST uint fact_unsure = 1u;
LPVBAKE_SHARED_CONST uint fact_culled = 2u;

LPVBAKE_SHARED_CONST uint met_none = 0xffffffffu;
LPVBAKE_SHARED_CONST uint met_unsure = 0xfffffffeu;

struct RaysPush {
    uint opaque; // triangles of the first geometry
};

#ifdef __cplusplus
} // namespace lpvbake::gpu
#else
// Of a ray under way.
struct Payload {
    float t;
    uint triangle;
    vec2 barycentric;
    float unsure; // where the first triangle was that may be passed
};
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_GPU_RAYS_LAYOUT_H
