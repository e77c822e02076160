// How programs that form rays trace them: of trace.rgen, and of what other rooms have.
#ifndef LPVBAKE_GPU_TRACE_GLSL
#define LPVBAKE_GPU_TRACE_GLSL
#extension GL_EXT_ray_tracing : require
#include "gpu/rays_layout.h"

layout(set = 0, binding = binding_tree) uniform accelerationStructureEXT tree;
layout(location = 0) rayPayloadEXT Payload payload;

const float endless = 3e38;

void trace(uint flags, vec3 origin, vec3 direction, float t_min, float t_max) {
    payload.t = endless;
    payload.triangle = met_none;
    payload.barycentric = vec2(0.0);
    payload.unsure = endless;
    // One that goes nowhere meets nothing, nor one that is empty.
    if (dot(direction, direction) > 0.0 && t_min <= t_max)
        traceRayEXT(tree, flags, 0xffu, 0u, 0u, 0u, origin, t_min, direction, min(t_max, endless),
                    0);
}

// Whether there is anything: met_none, met_unsure, or another number.
uint meets_any(vec3 origin, vec3 direction, float t_min, float t_max) {
    trace(gl_RayFlagsTerminateOnFirstHitEXT, origin, direction, t_min, t_max);
    return payload.triangle == met_none && payload.unsure < endless ? met_unsure
                                                                    : payload.triangle;
}

#endif // LPVBAKE_GPU_TRACE_GLSL
