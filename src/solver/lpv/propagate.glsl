// One propagation step of a light propagation volume, of the light of a scene (propagate.comp) or
// of it and a layer of it at once (follow.comp): they say what Flux and Lobe are; or the same where
// no flux is negative, so that it is linear, P, of what is given to it (linear.comp).
//
// The scheme is that of A. Kaplanyan and C. Dachsbacher, "Cascaded Light Propagation Volumes for
// Real-Time Indirect Illumination", I3D 2010: every cell holds an intensity as four spherical
// harmonics coefficients a channel, a step carries the flux that leaves a cell through the faces of
// its six neighbours over to those neighbours, and every face that receives flux is replaced by a
// clamped cosine lobe in the middle of the cell.
//
// For a destination cell c and one of the six axis directions d the source is the cell s = c - d.
// Seen from the middle of s, the destination shows five faces (all but the shared one):
//
//   far face     towards w = d                   solid angle 0.40067 sr   normal n = d
//   four sides   towards w = (n + 2 d) / sqrt 5  solid angle 0.42343 sr   normals n orthogonal to d
//
//   flux through a face     Phi = max(0, F_s . Y(w)) * solid angle * transmittance
//   what it adds to c       F'_c += Phi / pi * K(n),
//                           K(n) = (sqrt(pi) / 2, sqrt(pi / 3) (n_y, n_z, n_x))
//
// with Y the real orthonormal basis in the order 1, y, z, x. Since K depends on the normal only,
// the flux of all sources is summed up over the six normals first. Intensities are in W / sr (or
// any unit proportional to it), fluxes in W, transmittances are factors from 0 to 1.
//
// The 30 solid angles add up to the sphere, but a clamped lobe sampled in 30 directions does not
// add up to its flux, so a cell would pass on more or less than it has received. The accumulator
// takes F' as it is; what the next step reads is s F', where s, per channel, makes the flux of s F'
// through its 30 faces equal to sqrt(4 pi) F'_0, the flux that has come in.
//
// Memory. One texel of a front or of the accumulator is one channel of one cell. Layers are
// slowest, then channels, then rows with a border of zeros that spares all neighbour tests
// (PropagateLayout in propagate.h has the details); any run of layers is a contiguous piece of the
// buffer, and a dispatch sees just the pieces it needs: layers z_begin - 1 to z_end of the source
// front and of the transmittances, layers z_begin to z_end - 1 of the new front and of the
// accumulator.
//
// Access pattern. An invocation works on one channel of tile_x neighbouring columns and marches
// along z for at most `march` layers, so that the cells behind, at and ahead of it stay in
// registers: with a tile of two cells that makes four fetches a cell rather than six, with four
// cells three and a half. Neighbouring lanes read neighbouring texels, which coalesces on a GPU.
// Reads use texel buffers since both kinds of device like them: a GPU has a cached path with free
// address arithmetic for them, and a device that runs subgroups as SIMD vectors on a CPU turns a
// fetch into eight plain vector loads and a transposition, whereas a read from a storage buffer is
// a loop over lanes there and several times slower. Stores cannot be had that way, so there are
// just the two a cell and channel that have to be. Channels are separate invocations to keep the
// code (and with it the time to compile it) small.

#include "propagate.h"

layout(local_size_x_id = spec_local_size) in;
layout(constant_id = spec_local_size) const uint local_size = 8u;
layout(constant_id = spec_lanes_x) const uint lanes_x = 8u;
layout(constant_id = spec_tile_x) const uint tile_x = 2u;
layout(constant_id = spec_march) const uint march = 16u;
layout(constant_id = spec_occlusion) const uint occlusion = occlusion_none;
layout(constant_id = spec_group_sum) const uint group_sum = 0u;

#ifdef LINEAR
layout(push_constant) uniform Push {
    PropagatePush push;
    LinearWeights weights;
};
layout(set = 0, binding = binding_old_in) uniform textureBuffer old_in;
#else
layout(push_constant) uniform Push { PropagatePush push; };
#endif

layout(set = 0, binding = binding_front_in) uniform textureBuffer front_in;
layout(set = 0, binding = binding_accumulator_in) uniform textureBuffer accumulator_in;
layout(set = 0, binding = binding_transmittance) uniform textureBuffer transmittance;
layout(std430, set = 0, binding = binding_front_out) writeonly restrict buffer FrontOut {
    vec4 front_out[];
};
layout(std430, set = 0, binding = binding_accumulator_out) writeonly buffer AccumulatorOut {
    vec4 accumulator_out[];
};
#ifdef FOLLOW
layout(set = 0, binding = binding_layer_in) uniform textureBuffer layer_in;
layout(std430, set = 0, binding = binding_layer_out) writeonly restrict buffer LayerOut {
    vec4 layer_out[];
};
#endif
#ifdef LINEAR
#define Sum vec2 // signed and absolute
#else
#define Sum float
#endif
layout(std430, set = 0, binding = binding_partial_flux) writeonly restrict buffer PartialFlux {
    Sum partial_flux[];
};

shared Sum group_flux[local_size];

const float sqrt_4pi = 3.5449077018110321;
const float inv_sqrt_5 = 0.44721359549995794;
const float sh_0 = 0.28209479177387814; // the constant basis function
const float sh_1 = 0.48860251190291992; // factor of the linear ones
const float far_solid_angle = 0.4006696846;
const float side_solid_angle = 0.4234313544;

// Flux through a face is far_0 c0 + far_1 c_d, or side_0 c0 + side_1 (c_n + 2 c_d).
const float far_0 = far_solid_angle * sh_0;
const float far_1 = far_solid_angle * sh_1;
const float side_0 = side_solid_angle * sh_0;
const float side_1 = side_solid_angle * sh_1 * inv_sqrt_5;

// K(n) / pi: sqrt(pi) / 2 / pi and sqrt(pi / 3) / pi.
const float lobe_0 = 0.28209479177387814;
const float lobe_1 = 0.32573500793527993;

const uint transmittance_planes = occlusion == occlusion_per_face ? 30u : 3u;

#ifdef FOLLOW
Lobe fetch(uint texel) {
    const vec4 guide = texelFetch(front_in, int(texel));
    const vec4 own = texelFetch(layer_in, int(texel));
    return Lobe(guide.x, own.x, guide.y, own.y, guide.z, own.z, guide.w, own.w);
}

Flux positive(Flux flux) {
    return flux.x > 0.0 ? flux : Flux(0.0);
}
#else
Lobe fetch(uint texel) {
    return texelFetch(front_in, int(texel));
}

Flux positive(Flux flux) {
#ifdef LINEAR
    return flux;
#else
    return max(0.0, flux);
#endif
}
#endif

// Received flux by face normal, in units of side_0.
struct Faces {
    Flux px, nx, py, ny, pz, nz;
};

// Flux out of one source. Coefficients: c0 the constant one, cd the one along the direction of
// travel, cu and cv those along the other two axes. far, pu, nu, pv, nv: totals to add to. t_side:
// +u -u +v -v.
void receive(Flux c0, Flux cd, Flux cu, Flux cv, float t_far, vec4 t_side, inout Flux far,
             inout Flux pu, inout Flux nu, inout Flux pv, inout Flux nv) {
    const Flux middle = c0 + (2.0 * side_1 / side_0) * cd;
    const Flux u = (side_1 / side_0) * cu;
    const Flux v = (side_1 / side_0) * cv;
    far += t_far * positive((far_0 / side_0) * c0 + (far_1 / side_0) * cd);
    pu += t_side.x * positive(middle + u);
    nu += t_side.y * positive(middle - u);
    pv += t_side.z * positive(middle + v);
    nv += t_side.w * positive(middle - v);
}

// The five transmittances of one link where every face has its own: cell is the element of the
// source cell, direction counts +x, -x, +y, -y, +z, -z.
float face_far(uint cell, uint direction) {
    if (occlusion != occlusion_per_face)
        return 1.0;
    return texelFetch(transmittance, int(cell + direction * 5u * push.plane_pitch)).x;
}

vec4 face_sides(uint cell, uint direction) {
    if (occlusion != occlusion_per_face)
        return vec4(1.0);
    const uint first = cell + (direction * 5u + 1u) * push.plane_pitch;
    return vec4(texelFetch(transmittance, int(first)).x,
                texelFetch(transmittance, int(first + push.plane_pitch)).x,
                texelFetch(transmittance, int(first + 2u * push.plane_pitch)).x,
                texelFetch(transmittance, int(first + 3u * push.plane_pitch)).x);
}

// The new intensity of a cell from its six neighbours, named by where they are. The coefficients of
// a lobe are 1, y, z, x. link is the element of the cell itself in the transmittances. Sides come
// in the order of the axes that follow the direction of travel: y z for x, z x for y, x y for z.
Lobe gather(Lobe west, Lobe east, Lobe south, Lobe north, Lobe below, Lobe above, uint link) {
    const Flux none = Flux(0.0);
    Faces g = Faces(none, none, none, none, none, none);
    const uint row = push.row_pitch;
    const uint layer = transmittance_planes * push.plane_pitch;
    receive(west[0], west[3], west[1], west[2], face_far(link - 1u, 0u), face_sides(link - 1u, 0u),
            g.px, g.py, g.ny, g.pz, g.nz);
    receive(east[0], -east[3], east[1], east[2], face_far(link + 1u, 1u),
            face_sides(link + 1u, 1u), g.nx, g.py, g.ny, g.pz, g.nz);
    receive(south[0], south[1], south[2], south[3], face_far(link - row, 2u),
            face_sides(link - row, 2u), g.py, g.pz, g.nz, g.px, g.nx);
    receive(north[0], -north[1], north[2], north[3], face_far(link + row, 3u),
            face_sides(link + row, 3u), g.ny, g.pz, g.nz, g.px, g.nx);
    receive(below[0], below[2], below[3], below[1], face_far(link - layer, 4u),
            face_sides(link - layer, 4u), g.pz, g.px, g.nx, g.py, g.ny);
    receive(above[0], -above[2], above[3], above[1], face_far(link + layer, 5u),
            face_sides(link + layer, 5u), g.nz, g.px, g.nx, g.py, g.ny);
    const Flux sum = (g.px + g.nx) + (g.py + g.ny) + (g.pz + g.nz);
    return Lobe((side_0 * lobe_0) * sum, (side_0 * lobe_1) * (g.py - g.ny),
                (side_0 * lobe_1) * (g.pz - g.nz), (side_0 * lobe_1) * (g.px - g.nx));
}

// Flux through the eight side faces of the two directions along one axis. A pair of opposite faces
// lets max(0, b + t) + max(0, b - t) = b + max(|b|, |t|) through; the b themselves add up to
// four times the constant part over both directions and are left to the caller.
float side_pairs(float constant, float along, float abs_u, float abs_v) {
    const float b0 = abs(constant + 2.0 * along);
    const float b1 = abs(constant - 2.0 * along);
    return (max(b0, abs_u) + max(b0, abs_v)) + (max(b1, abs_u) + max(b1, abs_v));
}

// What a new front has to be multiplied with to pass on the flux that came in. Written with the
// above identity; it takes less than half of the operations of thirty clamped products.
float budget(vec4 f) {
    const float constant = side_0 * f.x;
    const float far_constant = far_0 * f.x;
    const vec3 t = abs(side_1 * f.yzw);
    const vec3 far = max(vec3(abs(far_constant)), abs(far_1 * f.yzw));
    const float sides = side_pairs(constant, t.x, t.y, t.z) + side_pairs(constant, t.y, t.x, t.z) +
                        side_pairs(constant, t.z, t.x, t.y);
    const float outgoing =
        (12.0 * constant + 3.0 * far_constant) + ((far.x + far.y) + far.z) + sides;
    return outgoing > 0.0 ? sqrt_4pi * f.x / outgoing : 0.0;
}

void main() {
    const uint lane = gl_LocalInvocationIndex;
    const uint channel = gl_WorkGroupID.z % channel_count;
    const uint first = gl_WorkGroupID.z / channel_count * march; // layers of the slab
    const uint last = min(first + march, push.z_end - push.z_begin);
    const uint x = (gl_WorkGroupID.x * lanes_x + lane % lanes_x) * tile_x;
    const uint y = gl_WorkGroupID.y * (local_size / lanes_x) + lane / lanes_x;

    // Lanes outside of the grid compute its first cell once more and store nothing.
    const bool inside = x < push.nx && y < push.ny;
    const uint column = inside ? (y + 1u) * push.row_pitch + x : push.row_pitch;

    const uint layer = channel_count * push.plane_pitch;
    const uint link_layer = transmittance_planes * push.plane_pitch;
    const uint cell = first * layer + channel * push.plane_pitch + column;
    uint source = push.front_in_base + layer + cell;
    uint target = push.front_out_base + cell;
    uint total = push.accumulator_base + cell;
    uint link = push.transmittance_base + (first + 1u) * link_layer + column;

    Lobe behind[tile_x], here[tile_x];
    float link_behind[tile_x];
    [[unroll]] for (uint i = 0u; i < tile_x; ++i) {
        behind[i] = fetch(source - layer + i);
        here[i] = fetch(source + i);
        if (occlusion == occlusion_link)
            link_behind[i] =
                texelFetch(transmittance, int(link - link_layer + 2u * push.plane_pitch + i)).x;
    }

    Sum flux = Sum(0.0);
    for (uint z = first; z < last; ++z) {
        Lobe west = fetch(source - 1u);
        const Lobe tile_east = fetch(source + tile_x);
        float link_west = 0.0;
        if (occlusion == occlusion_link)
            link_west = texelFetch(transmittance, int(link - 1u)).x;

        [[unroll]] for (uint i = 0u; i < tile_x; ++i) {
            const Lobe ahead = fetch(source + layer + i);
            const Lobe east = i + 1u < tile_x ? here[min(i + 1u, tile_x - 1u)] : tile_east;
            const Lobe south = fetch(source - push.row_pitch + i);
            const Lobe north = fetch(source + push.row_pitch + i);
            Lobe f;
            if (occlusion == occlusion_link) {
                // All five faces share the factor, and it is not negative, so it may just as
                // well scale the source.
                const uint link_y = link + push.plane_pitch + i;
                const float link_east = texelFetch(transmittance, int(link + i)).x;
                const float link_south = texelFetch(transmittance, int(link_y - push.row_pitch)).x;
                const float link_north = texelFetch(transmittance, int(link_y)).x;
                const float link_ahead =
                    texelFetch(transmittance, int(link_y + push.plane_pitch)).x;
                f = gather(link_west * west, link_east * east, link_south * south,
                           link_north * north, link_behind[i] * behind[i], link_ahead * ahead, 0u);
                link_west = link_east;
                link_behind[i] = link_ahead;
            } else {
                f = gather(west, east, south, north, behind[i], ahead, link + i);
            }
            west = here[i];
            behind[i] = here[i];
            here[i] = ahead;
            if (inside && x + i < push.nx) {
#ifdef LINEAR
                const vec4 given = behind[i];
                vec4 next = weights.given * given + weights.propagated * f;
                if (weights.old != 0.0)
                    next += weights.old * texelFetch(old_in, int(target + i));
                const vec4 own = weights.added * given;
                flux += vec2(own.x, abs(own.x));
                front_out[target + i] = next;
                accumulator_out[total + i] = texelFetch(accumulator_in, int(total + i)) + own;
#else
#ifdef FOLLOW
                const vec4 guide = vec4(f[0].x, f[1].x, f[2].x, f[3].x);
                const vec4 own = vec4(f[0].y, f[1].y, f[2].y, f[3].y);
                const float scale = budget(guide);
                layer_out[target + i] = scale * own;
#else
                const vec4 guide = f, own = f;
                const float scale = budget(f);
#endif
                flux += guide.x;
                front_out[target + i] = scale * guide;
                accumulator_out[total + i] = texelFetch(accumulator_in, int(total + i)) + own;
#endif
            }
        }
        source += layer;
        target += layer;
        total += layer;
        link += link_layer;
    }
    flux *= sqrt_4pi;

    // Partial sums of the flux that has arrived, in an order that only depends on the tiling.
    const uint group_row = gl_WorkGroupID.z * gl_NumWorkGroups.y + gl_WorkGroupID.y;
    const uint group = group_row * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (group_sum != 0u) {
        group_flux[lane] = flux;
        barrier();
        if (lane == 0u) {
            Sum sum = Sum(0.0);
            for (uint i = 0u; i < local_size; ++i)
                sum += group_flux[i];
            partial_flux[push.partial_base + group] = sum;
        }
    } else {
        partial_flux[push.partial_base + group * local_size + lane] = flux;
    }
}
