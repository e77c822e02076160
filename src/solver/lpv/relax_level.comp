#version 460
#extension GL_GOOGLE_include_directive : require

// A damped Jacobi step of the diffusion on a level, as Diffusion::relax.

#include "levels.h"

layout(local_size_x_id = spec_level_local_size) in;
layout(constant_id = spec_level_march) const uint march = 8u;

layout(push_constant) uniform Push { LevelPush push; };
layout(set = 0, binding = 0) uniform textureBuffer links;
layout(set = 0, binding = 1) uniform textureBuffer light;
layout(set = 0, binding = 2) uniform textureBuffer all;
layout(std430, set = 0, binding = 3) writeonly restrict buffer Next { vec4 next[]; };

void main() {
    const uint x = gl_GlobalInvocationID.x, y = gl_WorkGroupID.y;
    const bool inside = x < push.nx;
    const uint layer = push.nx * push.ny;
    const uint column = y * push.nx + (inside ? x : 0u);
    const uint first = push.begin + gl_WorkGroupID.z * march;
    const uint last = min(first + march, push.end);
    // Towards + of the last cells there are no links; towards - what is read must not be, either.
    const uint west = inside && x > 0u ? 1u : 0u, east = x + 1u < push.nx ? 1u : 0u;
    const uint south = y > 0u ? push.nx : 0u, north = y + 1u < push.ny ? push.nx : 0u;
    for (uint z = first; z < last; ++z) {
        const uint own = z * layer + column, at = push.in_base + own;
        const vec4 link = texelFetch(links, int(at));
        const vec4 given = texelFetch(light, int(at));
        vec4 value = relaxed * link.w * given;
        if (push.dark == 0u) {
            const uint below = z > 0u ? layer : 0u, above = z + 1u < push.nz ? layer : 0u;
            const float link_west = west > 0u ? texelFetch(links, int(at - west)).x : 0.0;
            const float link_south = south > 0u ? texelFetch(links, int(at - south)).y : 0.0;
            const float link_below = below > 0u ? texelFetch(links, int(at - below)).z : 0.0;
            const vec4 sum = link.y * texelFetch(all, int(at + north)) +
                             link_south * texelFetch(all, int(at - south)) +
                             (link.z * texelFetch(all, int(at + above)) +
                              link_below * texelFetch(all, int(at - below))) +
                             link.x * texelFetch(all, int(at + east)) +
                             link_west * texelFetch(all, int(at - west));
            value = (1.0 - relaxed) * texelFetch(all, int(at)) +
                    relaxed * link.w * (given + sum);
        }
        if (inside)
            next[push.out_base + own] = value;
    }
}
