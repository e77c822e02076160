#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// The light of a level: what the solution of the finer one leaves, summed over blocks of 2 x 2 x 2
// cells, as Diffusion::restrict_rest.

#include "levels.h"

layout(local_size_x_id = spec_level_local_size) in;
layout(constant_id = spec_level_march) const uint march = 8u;

layout(push_constant) uniform Push { LevelPush push; };
layout(set = 0, binding = 0) uniform textureBuffer links;
layout(set = 0, binding = 1) uniform textureBuffer light;
layout(set = 0, binding = 2) uniform textureBuffer all;
layout(std430, set = 0, binding = 3) writeonly restrict buffer Coarse { vec4 coarse[]; };

void main() {
    const uint x = gl_GlobalInvocationID.x, y = gl_WorkGroupID.y;
    const bool inside = x < push.nx;
    const uint column = inside ? x : 0u;
    const uint layer = push.near_x * push.near_y;
    const uint first = push.begin + gl_WorkGroupID.z * march;
    const uint last = min(first + march, push.end);
    for (uint z = first; z < last; ++z) {
        vec4 rest = vec4(0.0);
        [[dont_unroll]] for (uint k = 0u; k < 8u; ++k) {
            const uvec3 cell = 2u * uvec3(column, y, z) + uvec3(k & 1u, k >> 1 & 1u, k >> 2);
            if (cell.x >= push.near_x || cell.y >= push.near_y || cell.z >= push.near_z)
                continue;
            const uint at = push.near_base + cell.z * layer + cell.y * push.near_x + cell.x;
            const uint west = cell.x > 0u ? 1u : 0u, east = cell.x + 1u < push.near_x ? 1u : 0u;
            const uint south = cell.y > 0u ? push.near_x : 0u;
            const uint north = cell.y + 1u < push.near_y ? push.near_x : 0u;
            const uint below = cell.z > 0u ? layer : 0u;
            const uint above = cell.z + 1u < push.near_z ? layer : 0u;
            const vec4 link = texelFetch(links, int(at));
            const float link_west = west > 0u ? texelFetch(links, int(at - west)).x : 0.0;
            const float link_south = south > 0u ? texelFetch(links, int(at - south)).y : 0.0;
            const float link_below = below > 0u ? texelFetch(links, int(at - below)).z : 0.0;
            const vec4 sum = link.x * texelFetch(all, int(at + east)) +
                             link_west * texelFetch(all, int(at - west)) +
                             link.y * texelFetch(all, int(at + north)) +
                             link_south * texelFetch(all, int(at - south)) +
                             link.z * texelFetch(all, int(at + above)) +
                             link_below * texelFetch(all, int(at - below));
            if (link.w > 0.0)
                rest += texelFetch(light, int(at)) - texelFetch(all, int(at)) / link.w + sum;
        }
        if (inside)
            coarse[push.out_base + (z * push.ny + y) * push.nx + x] = rest;
    }
}
