#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Adds to a front what blocks of 2 x 2 x 2 cells hold for the constant parts of its three channels,
// interpolated between the blocks' centres; only in cells whose bit is set in what is reached of
// their block, x + 2 y + 4 z: those that light can reach.

#include "blocks.h"

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint local_size = 8u;

layout(push_constant) uniform Push { BlocksPush push; };
layout(set = 0, binding = 0) uniform textureBuffer front;
layout(set = 0, binding = 1) uniform textureBuffer blocks;
layout(std430, set = 0, binding = 2) writeonly restrict buffer FrontOut { vec4 front_out[]; };
layout(set = 0, binding = 3) uniform textureBuffer reached_cells;

// The block beside that of a cell on the cell's side of its centre; at the grid's ends itself.
uint beside(uint cell, uint count) {
    const uint own = cell / 2u;
    return (cell & 1u) != 0u ? min(own + 1u, count - 1u) : own - min(own, 1u);
}

void main() {
    const uint x = gl_GlobalInvocationID.x, y = gl_WorkGroupID.y;
    const uvec3 count = (uvec3(push.nx, push.ny, push.nz) + 1u) / 2u;
    const bool inside = x < push.nx;
    const uint column = inside ? x : 0u;
    const uint first = push.begin + gl_WorkGroupID.z * blocks_march;
    const uint last = min(first + blocks_march, push.end);
    const uint x0 = column / 2u, x1 = beside(column, count.x);
    const uint y0 = y / 2u * count.x, y1 = beside(y, count.y) * count.x;
    const uint layer = count.x * count.y;
    for (uint z = first; z < last; ++z) {
        const uint z0 = push.blocks_base + z / 2u * layer;
        const uint z1 = push.blocks_base + beside(z, count.z) * layer;
        const vec4 own = texelFetch(blocks, int(z0 + y0 + x0));
        const vec4 near = 0.75 * (0.75 * own + 0.25 * texelFetch(blocks, int(z0 + y0 + x1))) +
                          0.25 * (0.75 * texelFetch(blocks, int(z0 + y1 + x0)) +
                                  0.25 * texelFetch(blocks, int(z0 + y1 + x1)));
        const vec4 far = 0.75 * (0.75 * texelFetch(blocks, int(z1 + y0 + x0)) +
                                 0.25 * texelFetch(blocks, int(z1 + y0 + x1))) +
                         0.25 * (0.75 * texelFetch(blocks, int(z1 + y1 + x0)) +
                                 0.25 * texelFetch(blocks, int(z1 + y1 + x1)));
        const uint bit = (column & 1u) + 2u * (y & 1u) + 4u * (z & 1u);
        const uint block = push.reached_base + z / 2u * layer + y0 + x0;
        const bool reached =
            (uint(texelFetch(reached_cells, int(block)).x) >> bit & 1u) != 0u;
        const vec4 add = reached ? 0.75 * near + 0.25 * far : vec4(0.0);
        const uint cell = 3u * z * push.plane_pitch + (y + 1u) * push.row_pitch + column;
        [[unroll]] for (uint channel = 0u; channel < 3u; ++channel) {
            const uint at = cell + channel * push.plane_pitch;
            vec4 lobe = texelFetch(front, int(push.front_base + at));
            lobe.x += add[channel];
            if (inside)
                front_out[push.out_base + at] = lobe;
        }
    }
}
