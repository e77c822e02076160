#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Luminance of the cells of a front, in the directions of a batch.
//
// Far from surfaces a cell takes the luminance of the point where the ray against the direction
// meets the plane of cell centres before, interpolated from four of them (a short characteristic:
// Kunasz and Auer 1988).
//
// Where a surface lies between the centres upstream, d . grad L = 0 is solved with differences
// along the axes, each to the neighbour's centre, or to the surface if that comes first:
//
//   L = sum w_a L_a / sum w_a,   w_a = d_a (open link),   w_a = d_a f / t_a (surface at distance t_a)
//
// f corrects for surfaces that lie askew: for a plane of normal n at distance D, with all links
// along which d_b n_b > 0 blocked by it (t_b = D / n_b), the weights of these add up to d.n / D, as
// the ray along d demands, if f = max(0, d.n) / sum max(0, d_b n_b). It vanishes for a surface that
// faces away from the light's way, whose luminance d cannot carry.
//
// Lanes are directions, and the cell is the same for all: its entry and its links are read once a
// subgroup, and the luminances that the lanes read and write lie side by side.

#include "sweep.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_march) const uint march = 16u;
layout(constant_id = spec_variant) const uint near = 0u;

layout(push_constant) uniform Push { TransportPush push; };

layout(set = 0, binding = binding_ring_in) uniform textureBuffer ring_in;
layout(std430, set = 0, binding = binding_ring_out) writeonly buffer RingOut { float ring_out[]; };
layout(set = 0, binding = binding_slots) uniform textureBuffer slots;
layout(set = 0, binding = binding_directions) uniform textureBuffer directions;
layout(set = 0, binding = binding_links) uniform textureBuffer links;

vec3 tap(uint texel) {
    return texelFetch(ring_in, int(texel)).xyz;
}

void main() {
    const uint in_group = local_size == lanes ? 0u : gl_LocalInvocationIndex / lanes;
    const uint direction = gl_WorkGroupID.y * lanes + gl_LocalInvocationIndex % lanes;
    const uint first = push.first + (gl_WorkGroupID.x * (local_size / lanes) + in_group) * march;
    const uint last = min(first + march, push.last);

    const vec4 weights = texelFetch(directions, int(direction_vec4s * direction));
    const uvec4 back = uvec4(texelFetch(directions, int(direction_vec4s * direction + 1u)));
    const vec3 d = texelFetch(directions, int(direction_vec4s * direction + 2u)).xyz;
    const uvec4 taps = (uvec4(push.base1, push.base2, push.base2, push.base3) - back) * push.stride +
                       direction;
    const uvec3 neighbours =
        (push.base1 - uvec3(1u, push.pitch, 0u)) * push.stride + direction;
    const uint target = push.out_base * push.stride + direction;

    for (uint entry = first; entry < last; ++entry) {
        const uint slot = uint(texelFetch(slots, int(entry)).x) * push.stride;
        vec3 luminance;
        if (near == 0u) {
            luminance = (weights.x * tap(slot + taps.x) + weights.y * tap(slot + taps.y)) +
                        (weights.z * tap(slot + taps.z) + weights.w * tap(slot + taps.w));
        } else {
            const uint link = push.link_base + (entry - push.first_link) * cell_link_vec4s;
            vec3 sum = vec3(0.0);
            float total = 0.0;
            [[unroll]] for (uint a = 0u; a < 3u; ++a) {
                const vec4 end = texelFetch(links, int(link + 2u * a));
                const vec3 n = texelFetch(links, int(link + 2u * a + 1u)).xyz;
                const float along = dot(d, max(n, vec3(0.0)));
                const float facing = max(least_facing, dot(d, n) / max(along, 1e-12));
                const vec3 upstream = tap(slot + neighbours[a]);
                const float w = d[a] * (end.w > 0.0 ? end.w * facing : 1.0);
                sum += w * (end.w > 0.0 ? end.xyz : upstream);
                total += w;
            }
            luminance = sum / max(total, 1e-30);
        }
        const uint texel = 4u * (slot + target);
        ring_out[texel] = luminance.x;
        ring_out[texel + 1u] = luminance.y;
        ring_out[texel + 2u] = luminance.z;
    }
}
