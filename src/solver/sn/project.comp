#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Adds the luminance of the cells of some planes, times its directions' weights, to their coefficients.
// Lanes are cells, the direction is the same for all. Directions are added one by one, so that the
// sum does not depend on how they were dealt into batches; their loop is unrolled because a CPU
// device loads a weight for all lanes at once only where its address is constant.

#include "sweep.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_march) const uint march = 4u;
layout(constant_id = spec_coefficients) const uint coefficients = 9u;
layout(constant_id = spec_directions) const uint directions = 8u;
layout(constant_id = spec_columns) const uint columns = 0u; // 1: texels hold the air passed, too

layout(push_constant) uniform Push { ProjectPush push; };

layout(set = 0, binding = binding_project_ring) uniform textureBuffer ring;
layout(std140, set = 0, binding = binding_project_weights) uniform Weights {
    vec4 weights[max_project_weights / 4u];
};
layout(set = 0, binding = binding_sh_in) uniform textureBuffer sh_in;
layout(std430, set = 0, binding = binding_sh_out) writeonly buffer ShOut { vec4 sh_out[]; };

const uint quads = (3u * coefficients + 3u) / 4u;

void main() {
    for (uint step = 0u; step < march; ++step) {
        const uint index =
            (gl_WorkGroupID.x * march + step) * local_size + gl_LocalInvocationIndex;
        const bool inside = index < push.cells;
        const uint row = min(index, push.cells - 1u) / push.across;
        const uint u = min(index, push.cells - 1u) - row * push.across;
        const uint plane = row / push.rows, v = push.first_row + row % push.rows;
        const uint slot = (push.first_plane + plane) % push.ring_planes * push.slots +
                          (v + 1u) * push.pitch + u + 1u;
        const uint texel = push.ring_base + slot * push.stride;
        const uint cell =
            push.first_cell + u * push.step_u + v * push.step_v + plane * push.step_plane;
        const uint sh = push.sh_base + cell * quads;
        precise float sum[4u * quads];
        [[unroll]] for (uint i = 0u; i < quads; ++i) {
            const vec4 before = texelFetch(sh_in, int(sh + i));
            sum[4u * i] = before.x;
            sum[4u * i + 1u] = before.y;
            sum[4u * i + 2u] = before.z;
            sum[4u * i + 3u] = before.w;
        }
        [[unroll]] for (uint direction = 0u; direction < directions; ++direction) {
            const vec4 in_ring = texelFetch(ring, int(texel + direction));
            vec3 luminance = in_ring.xyz;
            if (columns > 0u)
                luminance *= exp(-in_ring.w * vec3(push.red, push.green, push.blue));
            [[unroll]] for (uint k = 0u; k < coefficients; ++k) {
                const uint i = direction * coefficients + k;
                const float weight = weights[i / 4u][i % 4u];
                sum[3u * k] += weight * luminance.x;
                sum[3u * k + 1u] += weight * luminance.y;
                sum[3u * k + 2u] += weight * luminance.z;
            }
        }
        if (inside)
            [[unroll]] for (uint i = 0u; i < quads; ++i)
                sh_out[sh + i] =
                    vec4(sum[4u * i], sum[4u * i + 1u], sum[4u * i + 2u], sum[4u * i + 3u]);
    }
}
