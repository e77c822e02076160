#version 460
#extension GL_GOOGLE_include_directive : require

// Luminance of a plane's cells in the directions of a batch: that of the point where the ray against
// the direction meets the plane of cell centres before, interpolated from four of them (a short
// characteristic: Kunasz and Auer 1988). What is known of cells beside surfaces is put in after that.
//
// Lanes are directions, and the cell is the same for all: the luminances that the lanes read and
// write lie side by side.

#include "sweep.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_march) const uint march = 16u;

layout(push_constant) uniform Push { TransportPush push; };

layout(set = 0, binding = binding_ring_in) uniform textureBuffer ring_in;
layout(std430, set = 0, binding = binding_ring_out) writeonly buffer RingOut { float ring_out[]; };
layout(set = 0, binding = binding_directions) uniform textureBuffer directions;

vec3 tap(uint texel) {
    return texelFetch(ring_in, int(texel)).xyz;
}

void main() {
    const uint in_group = local_size == lanes ? 0u : gl_LocalInvocationIndex / lanes;
    const uint direction = gl_WorkGroupID.y * lanes + gl_LocalInvocationIndex % lanes;
    const uint first = (gl_WorkGroupID.x * (local_size / lanes) + in_group) * march;
    const uint last = min(first + march, push.cells);

    const vec4 weights = texelFetch(directions, int(direction_vec4s * direction));
    const ivec4 back = ivec4(texelFetch(directions, int(direction_vec4s * direction + 1u)));
    const uvec4 taps = (uvec4(push.in_base) - uvec4(back)) * push.stride + direction;
    const uint target = push.out_base * push.stride + direction;

    for (uint cell = first; cell < last; ++cell) {
        const uint v = cell / push.across, u = cell - v * push.across;
        const uint slot = ((v + 1u) * push.pitch + u + 1u) * push.stride;
        precise const vec3 luminance =
            (weights.x * tap(slot + taps.x) + weights.y * tap(slot + taps.y)) +
            (weights.z * tap(slot + taps.z) + weights.w * tap(slot + taps.w));
        const uint texel = 4u * (slot + target);
        ring_out[texel] = luminance.x;
        ring_out[texel + 1u] = luminance.y;
        ring_out[texel + 2u] = luminance.z;
    }
}
