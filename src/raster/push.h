// What the stages of a map (rsm.vert, rsm.frag) and the host have to agree on of the map and the
// material that is drawn. This file is included by both languages, so it keeps to what C++20 and
// GLSL 4.60 have in common outside of the blocks that test for __cplusplus.
#ifndef LPVBAKE_RASTER_PUSH_H
#define LPVBAKE_RASTER_PUSH_H

#ifdef __cplusplus
#include <cstddef>
#include <cstdint>

#include <glm/glm.hpp>
#define LPVBAKE_SHARED_CONST inline constexpr
namespace lpvbake::raster {
using glm::mat4;
using glm::vec4;
using uint = std::uint32_t;
#else
#define LPVBAKE_SHARED_CONST const
#endif

struct Push {
    mat4 clip;   // clip space from frame units relative to `origin`
    vec4 origin; // xyz
    vec4 light;  // xyz: the position, w = 1; or the direction to the light, w = 0
    float max_albedo;
    float cutoff;
    uint flags;
    uint seed;   // differs from tile to tile
    uint shift;  // of the number that decides what is seen of blended surfaces
    float dense; // share of what is covered that transmits nothing
};

LPVBAKE_SHARED_CONST uint flag_mask = 1u;
LPVBAKE_SHARED_CONST uint flag_blend = 2u;
LPVBAKE_SHARED_CONST uint flag_double_sided = 4u;
LPVBAKE_SHARED_CONST uint flag_cull = 8u;

#ifdef __cplusplus
static_assert(sizeof(Push) == 120);
static_assert(offsetof(Push, origin) == 64);
static_assert(offsetof(Push, light) == 80);
static_assert(offsetof(Push, max_albedo) == 96);
static_assert(offsetof(Push, flags) == 104);
static_assert(offsetof(Push, shift) == 112);
} // namespace lpvbake::raster
#else
layout(push_constant) uniform Pushed {
    Push push;
};
#endif

#undef LPVBAKE_SHARED_CONST
#endif // LPVBAKE_RASTER_PUSH_H
