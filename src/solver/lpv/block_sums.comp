#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Sums a front over blocks of 2 x 2 x 2 cells: the constant parts of the three channels, and by how
// much lobes of the block are too steep for their flux to be positive on every side, which is where
// propagation is not linear.

#include "blocks.h"

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint local_size = 8u;

layout(push_constant) uniform Push { BlocksPush push; };
layout(set = 0, binding = 0) uniform textureBuffer front;
layout(std430, set = 0, binding = 1) writeonly restrict buffer Blocks { vec4 blocks[]; };

// Of the flux through a face, see propagate.glsl: factors of the linear parts over those of the
// constant one. A side face looks 2 to 1 along two axes, the far face along one.
const float side = 0.4472135955 * 1.7320508076;
const float far = 1.7320508076;

float excess(vec4 lobe) {
    const vec3 l = abs(lobe.yzw);
    const float most = max(l.x, max(l.y, l.z));
    const float next = max(min(l.x, l.y), min(max(l.x, l.y), l.z));
    return max(0.0, max(side * (2.0 * most + next), far * most) - lobe.x);
}

void main() {
    const uint x = gl_GlobalInvocationID.x, y = gl_WorkGroupID.y;
    const uint blocks_x = (push.nx + 1u) / 2u, blocks_y = (push.ny + 1u) / 2u;
    const bool inside = x < blocks_x;
    const uint first = push.begin + gl_WorkGroupID.z * blocks_march;
    const uint last = min(first + blocks_march, push.end);
    for (uint z = first; z < last; ++z) {
        vec4 sum = vec4(0.0);
        [[unroll]] for (uint k = 0u; k < 8u; ++k) {
            const uvec3 cell = uvec3(inside ? 2u * x + (k & 1u) : 0u, 2u * y + (k >> 1 & 1u),
                                     2u * z + (k >> 2));
            // Cells beyond the grid's sides are borders in x and y, which are dark.
            if (cell.z < push.nz && cell.y < push.ny) {
                const uint at = push.front_base + 3u * cell.z * push.plane_pitch +
                                (cell.y + 1u) * push.row_pitch + cell.x;
                const vec4 r = texelFetch(front, int(at));
                const vec4 g = texelFetch(front, int(at + push.plane_pitch));
                const vec4 b = texelFetch(front, int(at + 2u * push.plane_pitch));
                sum += vec4(r.x, g.x, b.x, excess(r) + excess(g) + excess(b));
            }
        }
        if (inside)
            blocks[push.out_base + (z * blocks_y + y) * blocks_x + x] = sum;
    }
}
