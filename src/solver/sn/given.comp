#version 460
#extension GL_GOOGLE_include_directive : require

// Luminance of places of a plane where it is known: copied to their slots, a lane a value.

#include "sweep.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_march) const uint march = 16u;

layout(push_constant) uniform Push { GivenPush push; };

layout(std430, set = 0, binding = binding_given_ring) writeonly buffer Ring { vec4 ring[]; };
layout(std430, set = 0, binding = binding_given_slots) readonly buffer Slots { uint slots[]; };
layout(set = 0, binding = binding_given_values) uniform textureBuffer values;

void main() {
    const uint of_each = push.stride / quadrants;
    for (uint step = 0u; step < march; ++step) {
        const uint value =
            (gl_WorkGroupID.x * march + step) * local_size + gl_LocalInvocationIndex;
        if (value >= push.values)
            break;
        const uint place = value / of_each, direction = value - place * of_each;
        const uint entry = slots[push.first + place];
        ring[(push.out_base + entry / quadrants) * push.stride + quadrants * direction +
             entry % quadrants] = texelFetch(values, int(push.first * of_each + value));
    }
}
