#version 460
#extension GL_GOOGLE_include_directive : require

// Luminance of places of a front where it is known: copied to their slots. Lanes are directions.

#include "sweep.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_march) const uint march = 16u;

layout(push_constant) uniform Push { GivenPush push; };

layout(std430, set = 0, binding = binding_given_ring) writeonly buffer Ring { vec4 ring[]; };
layout(std430, set = 0, binding = binding_given_slots) readonly buffer Slots { uint slots[]; };
layout(set = 0, binding = binding_given_values) uniform textureBuffer values;

void main() {
    const uint in_group = local_size == lanes ? 0u : gl_LocalInvocationIndex / lanes;
    const uint direction = gl_WorkGroupID.y * lanes + gl_LocalInvocationIndex % lanes;
    const uint first = push.first + (gl_WorkGroupID.x * (local_size / lanes) + in_group) * march;
    const uint last = min(first + march, push.last);
    for (uint entry = first; entry < last; ++entry)
        ring[(push.out_base + slots[entry]) * push.stride + direction] = texelFetch(
            values, int(push.value_base + (entry - push.first) * push.stride + direction));
}
