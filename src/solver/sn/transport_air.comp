#version 460
#extension GL_GOOGLE_include_directive : require

// As transport.comp, through air, of which w holds how much is upstream. Luminance of surfaces stays
// as it left them: it varies less from cell to cell than what is left of it. Of luminance that air
// sends the air of the cell leaves some, and sends its own in its place; what is upstream is
// interpolated as 1 - exp(-w) of what air would send from there all by itself, which has no error
// where its source is even. Lanes are directions; what is told of a cell is the same for all.

#include "sweep.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_march) const uint march = 16u;
layout(constant_id = spec_coefficients) const uint coefficients = 9u;

layout(push_constant) uniform Push { TransportPush push; };

layout(set = 0, binding = binding_ring_in) uniform textureBuffer ring_in;
layout(std430, set = 0, binding = binding_ring_out) writeonly buffer RingOut { float ring_out[]; };
layout(set = 0, binding = binding_directions) uniform textureBuffer directions;
layout(set = 0, binding = binding_air) uniform textureBuffer air;
layout(set = 0, binding = binding_air_directions) uniform textureBuffer air_directions;

vec4 tap(uint texel) {
    return texelFetch(ring_in, int(texel));
}

/// Of a unit source, air of this column.
vec3 sends(float column) {
    const vec3 depth = column * vec3(push.red, push.green, push.blue);
    return mix(1.0 - exp(-depth), depth - 0.5 * depth * depth, lessThan(depth, vec3(1e-3)));
}

const uint source_vec4s = (3u * coefficients + 3u) / 4u;

/// Of the entry's cell, along a direction of these harmonics.
vec3 source_of(uint entry, float basis[12]) {
    vec3 sum = vec3(0.0);
    float row[4u * source_vec4s + 1u];
    const uint first = entry * (1u + source_vec4s) + 1u;
    for (uint i = 0u; i < source_vec4s; ++i) {
        const vec4 quad = texelFetch(air, int(first + i));
        row[4u * i] = quad.x;
        row[4u * i + 1u] = quad.y;
        row[4u * i + 2u] = quad.z;
        row[4u * i + 3u] = quad.w;
    }
    for (uint k = 0u; k < coefficients; ++k)
        sum += basis[k] * vec3(row[3u * k], row[3u * k + 1u], row[3u * k + 2u]);
    return sum;
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
    float basis[12];
    for (uint i = 0u; i < 3u; ++i) {
        const vec4 quad = texelFetch(air_directions, int(air_direction_vec4s * direction + i));
        basis[4u * i] = quad.x;
        basis[4u * i + 1u] = quad.y;
        basis[4u * i + 2u] = quad.z;
        basis[4u * i + 3u] = quad.w;
    }
    const float way = texelFetch(air_directions, int(air_direction_vec4s * direction + 3u)).x;

    for (uint at = first; at < last; ++at) {
        const uint entry = (push.air_first + at) * quadrants + direction % quadrants;
        const uint v = at / push.across, u = at - v * push.across;
        const uint slot = ((v + 1u) * push.pitch + u + 1u) * push.stride;
        const vec4 a = tap(slot + taps.x), b = tap(slot + taps.y), c = tap(slot + taps.z),
                   d = tap(slot + taps.w);
        const vec4 upstream = (weights.x * a + weights.y * b) + (weights.z * c + weights.w * d);
        const vec4 cell = texelFetch(air, int(entry * (1u + source_vec4s)));
        vec4 luminance = vec4(upstream.xyz, upstream.w + way * cell.w);
        if (coefficients > 0u) {
            const vec3 sent = (weights.x * sends(a.w) + weights.y * sends(b.w)) +
                              (weights.z * sends(c.w) + weights.w * sends(d.w));
            const vec3 even = sends(upstream.w) / max(sent, vec3(1e-30));
            luminance.xyz =
                mix(source_of(entry, basis), even * upstream.xyz, exp(-way * cell.xyz));
        }
        const uint texel = 4u * (slot + target);
        ring_out[texel] = luminance.x;
        ring_out[texel + 1u] = luminance.y;
        ring_out[texel + 2u] = luminance.z;
        ring_out[texel + 3u] = luminance.w;
    }
}
