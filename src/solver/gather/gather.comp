#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Luminance that arrives at cell centres from lists of sources, projected to spherical harmonics:
//
//   c_lm += V Y_lm(w) F max(0, -n.w) / r^2        a point (a cluster of patches) in direction w
//   c_lm += V L integral of Y_lm over the solid angle     a triangle
//   c_lm += V c_lm(bin)                                   a bin of the sky
//
// F is luminance times area. The integrals over a triangle are exact up to band 2: its solid angle
// (Van Oosterom and Strackee 1983) and the axial moments of a spherical polygon (Arvo 1995), with
// u_i the directions of the corners, theta_i the arcs between them and sums over the edges:
//
//   integral of w      = -1/2 sum theta_i (u_i x u_j) / |u_i x u_j|
//   integral of w w^T  = 1/3 (solid angle - sum (u_i + u_j) (u_i x u_j)^T / (1 + u_i.u_j))
//
// Bands 3 and 4 are those of a lobe of the same solid angle and mean direction.
//
// A cluster is no point but spreads over its plane. With q = variance / r^2 the integrals of a flat
// one are, to the first order in q (half the variance times the Laplacian along the plane),
//
//   of 1       1 + q (9 - 15 m) / 2,  m = (n.w)^2
//   of w       w (1 + q (4 - 12 m)) + 4 q (n.w) n
//   of w w^T   w w^T (1 + q (5 - 35 m) / 2) + 5 q (n.w) (n w^T + w n^T) + q (1 - n n^T)
//
// times F max(0, -n.w) / r^2.
//
// A job's eight cells are the lanes of one subgroup on a device that runs subgroups as vectors of a
// CPU: addresses into the list are the same for all of them, so a source is loaded once. There is
// no branch on what a lane sees; its bit of the mask multiplies. Bins of sky, whose many words a
// source make code of that length, have a program of their own: together with the others they took
// ten times as long to compile there, and the loops over surfaces more than twice as long to run.

#include "layout.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_order) const uint order = 2u;
layout(constant_id = spec_part) const uint part = part_surfaces;

layout(push_constant) uniform PushBlock { Push push; };

layout(set = 0, binding = binding_centers) uniform textureBuffer centers;
layout(std430, set = 0, binding = binding_jobs) readonly restrict buffer Jobs { Job jobs[]; };
layout(set = 0, binding = binding_list) uniform textureBuffer list;
layout(std430, set = 0, binding = binding_result) writeonly restrict buffer Result {
    float result[];
};

const uint terms = (order + 1u) * (order + 1u);
const uint bin_words = (3u * terms + 4u) / 4u;

const float y0 = 0.28209479177387814;
const float y1 = 0.48860251190291992;
const float y2a = 1.0925484305920792;
const float y2b = 0.31539156525252005;
const float y2c = 0.54627421529603959;
const float y30 = 0.37317633259011546;
const float y31 = 0.45704579946446577;
const float y32 = 1.4453057213202769;
const float y33 = 0.59004358992664352;
const float y40 = 0.10578554691520431;
const float y41 = 0.66904654355728921;
const float y42 = 0.47308734787878004;
const float y43 = 1.7701307697799304;
const float y44 = 0.62583573544917614;

const uint layers = part == part_layers ? pass_layers : 1u;

vec3 sum[25 * pass_layers]; // [k * layers + layer]; those beyond are never touched
vec3 of_layer[pass_layers]; // light of a source

// Adds to term k of all layers, or of the one there is; of layers, `light` is what theirs counts.
void add(uint k, vec3 light, float y) {
    if (part == part_layers) {
        const vec3 share = light * y;
        [[unroll]] for (uint i = 0u; i < pass_layers; ++i)
            sum[k * pass_layers + i] += share * of_layer[i];
    } else {
        sum[k] += light * y;
    }
}

vec4 source(uint word) {
    return texelFetch(list, int(word));
}

float seen(float mask, uint lane) {
    return float((uint(mask) >> lane) & 1u);
}

// Bands 3 and 4 of a source of direction w; `f3` and `f4` scale them.
void add_high(vec3 light, vec3 w, float f3, float f4) {
    if (order < 4u)
        return;
    const float xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
    const float sin2 = 2.0 * w.x * w.y, cos2 = xx - yy;
    const float sin3 = w.y * (3.0 * xx - yy), cos3 = w.x * (xx - 3.0 * yy);
    const vec3 a = light * f3, b = light * f4;
    add(9u, a, y33 * sin3);
    add(10u, a, y32 * w.z * sin2);
    add(11u, a, y31 * (5.0 * zz - 1.0) * w.y);
    add(12u, a, y30 * (5.0 * zz - 3.0) * w.z);
    add(13u, a, y31 * (5.0 * zz - 1.0) * w.x);
    add(14u, a, y32 * w.z * cos2);
    add(15u, a, y33 * cos3);
    add(16u, b, y44 * 4.0 * w.x * w.y * cos2);
    add(17u, b, y43 * w.z * sin3);
    add(18u, b, y42 * (7.0 * zz - 1.0) * sin2);
    add(19u, b, y41 * (7.0 * zz - 3.0) * w.z * w.y);
    add(20u, b, y40 * ((35.0 * zz - 30.0) * zz + 3.0));
    add(21u, b, y41 * (7.0 * zz - 3.0) * w.z * w.x);
    add(22u, b, y42 * (7.0 * zz - 1.0) * cos2);
    add(23u, b, y43 * w.z * cos3);
    add(24u, b, y44 * (cos2 * cos2 - sin2 * sin2));
}

// Bands 0 to 2 of a source of moments: solid angle, vector, and the tensor's entries.
void add_low(vec3 light, float angle, vec3 v, float xy, float yz, float xz, float zz, float xx_yy) {
    add(0u, light, y0 * angle);
    add(1u, light, y1 * v.y);
    add(2u, light, y1 * v.z);
    add(3u, light, y1 * v.x);
    if (order < 2u)
        return;
    add(4u, light, y2a * xy);
    add(5u, light, y2a * yz);
    add(6u, light, y2b * (3.0 * zz - angle));
    add(7u, light, y2a * xz);
    add(8u, light, y2c * xx_yy);
}

void add_point(vec3 x, vec4 place, vec4 front, vec3 light, float variance, uint lane) {
    const vec3 d = place.xyz - x;
    const float inverse = inversesqrt(max(dot(d, d), front.w));
    const vec3 w = d * inverse;
    const float cosine = max(0.0, -dot(front.xyz, w));
    const float per_square = inverse * inverse;
    const vec3 f = light * (seen(place.w, lane) * cosine * per_square);
    // Moments of a patch of that variance along each of its axes, to the first order in q.
    const vec3 n = front.xyz;
    const float q = min(variance * per_square, 0.12), m = cosine * cosine;
    const float angle = 1.0 + q * (4.5 - 7.5 * m);
    const vec3 v = w * (1.0 + q * (4.0 - 12.0 * m)) - n * (4.0 * q * cosine);
    const vec3 s = w * (0.5 + q * (1.25 - 8.75 * m)) - n * (5.0 * q * cosine);
    const vec3 mixed = s.xyx * w.yzz + w.xyx * s.yzz - q * n.xyx * n.yzz;
    const vec3 diagonal = 2.0 * s * w - q * n * n; // less q
    add_low(f, angle, v, mixed.x, mixed.y, mixed.z, diagonal.z + q, diagonal.x - diagonal.y);
    add_high(f, w, 1.0, 1.0);
}

// arccos(c) / sqrt(1 - c^2), from a polynomial for c >= 0 (relative error 5e-7).
float arc_over_sine(float cosine) {
    const float c = min(abs(cosine), 1.0);
    float p = -0.02663715143759555;
    p = p * c + 0.13595128323515804;
    p = p * c - 0.32393201735587485;
    p = p * c + 0.5090545958898256;
    p = p * c - 0.6486269933246978;
    p = p * c + 0.7832978804814472;
    p = p * c - 0.9999035646042245;
    p = p * c + 1.5707955788318908;
    return cosine < 0.0 ? 3.1415926535897932 * inversesqrt(max(1.0 - c * c, 1e-12)) - p : p;
}

vec3 direction(vec4 corner, vec3 x) {
    const vec3 d = corner.xyz - x;
    return d * inversesqrt(max(dot(d, d), 1e-20));
}

void add_triangle(vec3 x, vec4 a, vec4 b, vec4 c, vec3 light, float mask, uint lane) {
    const vec3 u0 = direction(a, x), u1 = direction(b, x), u2 = direction(c, x);
    const float d01 = dot(u0, u1), d12 = dot(u1, u2), d20 = dot(u2, u0);
    const vec3 x01 = cross(u0, u1), x12 = cross(u1, u2), x20 = cross(u2, u0);
    const float angle = 2.0 * atan(-dot(x01, u2), 1.0 + d01 + d12 + d20);
    const vec3 f = light * (angle > 0.0 ? seen(mask, lane) : 0.0);
    const vec3 v = -0.5
                   * (x01 * arc_over_sine(d01) + x12 * arc_over_sine(d12)
                      + x20 * arc_over_sine(d20));
    const vec3 e01 = (u0 + u1) / max(1.0 + d01, 1e-6);
    const vec3 e12 = (u1 + u2) / max(1.0 + d12, 1e-6);
    const vec3 e20 = (u2 + u0) / max(1.0 + d20, 1e-6);
    const vec3 diagonal =
        (vec3(angle) - e01 * x01 - e12 * x12 - e20 * x20) / 3.0;
    const vec3 mixed = (e01.xyx * x01.yzz + e12.xyx * x12.yzz + e20.xyx * x20.yzz) / -3.0;
    add_low(f, angle, v, mixed.x, mixed.y, mixed.z, diagonal.z, diagonal.x - diagonal.y);
    if (order >= 4u) {
        const float l = max(length(v), 1e-20), rho = clamp(l / max(angle, 1e-20), 0.0, 1.0);
        const float rho3 = rho * rho * rho, rho6 = rho3 * rho3;
        add_high(f * angle, v / l, rho6, rho6 * rho3 * rho);
    }
}

void load_layers(uint at) {
    [[unroll]] for (uint word = 0u; word < pass_words; ++word) {
        const vec4 value = source(at + word);
        [[unroll]] for (uint i = 0u; i < 4u; ++i)
            of_layer[(4u * word + i) / 3u][(4u * word + i) % 3u] = value[i];
    }
}

void main() {
    const uint lane = gl_LocalInvocationIndex % lanes;
    const uint job = gl_WorkGroupID.x * (local_size / lanes)
                     + (local_size == lanes ? 0u : gl_LocalInvocationIndex / lanes);
    if (job >= push.jobs)
        return;
    const vec3 x = texelFetch(centers, int(job * lanes + lane)).xyz;
    [[unroll]] for (uint k = 0u; k < terms * layers; ++k)
        sum[k] = vec3(0.0);

    uint at = jobs[job].first;
    if (part == part_surfaces) {
        const uint points_end = at + jobs[job].points * point_words;
        const uint triangles_end = points_end + jobs[job].triangles * triangle_words;
        for (; at < points_end; at += point_words)
            add_point(x, source(at), source(at + 1u), source(at + 2u).xyz, source(at + 2u).w, lane);
        for (; at < triangles_end; at += triangle_words) {
            const vec4 light = source(at + 3u);
            add_triangle(x, source(at), source(at + 1u), source(at + 2u), light.xyz, light.w, lane);
        }
    } else if (part == part_layers) {
        const uint points_end = at + jobs[job].points * layered_words;
        const uint triangles_end = points_end + jobs[job].triangles * layered_words;
        for (; at < points_end; at += layered_words) {
            load_layers(at + 3u);
            add_point(x, source(at), source(at + 1u), vec3(1.0), source(at + 2u).x, lane);
        }
        for (; at < triangles_end; at += layered_words) {
            load_layers(at + 3u);
            const vec4 a = source(at);
            add_triangle(x, a, source(at + 1u), source(at + 2u), vec3(1.0), a.w, lane);
        }
    } else {
        for (const uint end = at + jobs[job].bins * bin_words; at < end; at += bin_words) {
            const float visible = seen(source(at + bin_words - 1u).w, lane);
            [[unroll]] for (uint word = 0u; word < bin_words; ++word) {
                const vec4 value = visible * source(at + word);
                [[unroll]] for (uint i = 4u * word; i < min(4u * word + 4u, 3u * terms); ++i)
                    sum[i / 3u][i % 3u] += value[i % 4u];
            }
        }
    }

    [[unroll]] for (uint k = 0u; k < terms * layers; ++k)
        [[unroll]] for (uint c = 0u; c < 3u; ++c)
            result[((job * terms * layers + k) * 3u + c) * lanes + lane] = sum[k][c];
}
