#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Adds the solution of a coarser level to that of a level, linear between the centres of its
// blocks, as Diffusion::add_coarse.

#include "levels.h"

layout(local_size_x_id = spec_level_local_size) in;
layout(constant_id = spec_level_march) const uint march = 8u;

layout(push_constant) uniform Push { LevelPush push; };
layout(set = 0, binding = 0) uniform textureBuffer links;
layout(set = 0, binding = 1) uniform textureBuffer all;
layout(set = 0, binding = 2) uniform textureBuffer coarse;
layout(std430, set = 0, binding = 3) writeonly restrict buffer Next { vec4 next[]; };

// The block beside that of a cell on the cell's side of its centre; at the level's ends itself.
uint beside(uint cell, uint count) {
    const uint own = cell / 2u;
    return (cell & 1u) != 0u ? min(own + 1u, count - 1u) : own - min(own, 1u);
}

void main() {
    const uint x = gl_GlobalInvocationID.x, y = gl_WorkGroupID.y;
    const bool inside = x < push.nx;
    const uint column = inside ? x : 0u;
    const uint first = push.begin + gl_WorkGroupID.z * march;
    const uint last = min(first + march, push.end);
    const uint x0 = column / 2u, x1 = beside(column, push.near_x);
    const uint y0 = y / 2u * push.near_x, y1 = beside(y, push.near_y) * push.near_x;
    const uint layer = push.near_x * push.near_y;
    for (uint z = first; z < last; ++z) {
        const uint z0 = push.near_base + z / 2u * layer;
        const uint z1 = push.near_base + beside(z, push.near_z) * layer;
        vec4 sum = vec4(0.0);
        [[dont_unroll]] for (uint k = 0u; k < 4u; ++k) {
            const uint row = ((k & 2u) != 0u ? z1 : z0) + ((k & 1u) != 0u ? y1 : y0);
            const float share = k == 0u ? 0.5625 : k == 3u ? 0.0625 : 0.1875;
            sum += share * (0.75 * texelFetch(coarse, int(row + x0)) +
                            0.25 * texelFetch(coarse, int(row + x1)));
        }
        const uint own = (z * push.ny + y) * push.nx + column;
        vec4 value = texelFetch(all, int(push.in_base + own));
        if (texelFetch(links, int(push.in_base + own)).w > 0.0)
            value += sum;
        if (inside)
            next[push.out_base + own] = value;
    }
}
