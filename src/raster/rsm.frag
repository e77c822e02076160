// What a texel sees: the reflectance (three floats' bits) and the triangle, counted from one.
#version 450
#extension GL_GOOGLE_include_directive : enable
#include "raster/push.h"

layout(constant_id = 0) const bool textured = true;
layout(constant_id = 1) const bool see_through = true;

layout(set = 0, binding = 0) uniform sampler2D base_color;

layout(location = 0) in vec4 in_color;
layout(location = 1) in vec2 in_uv;
layout(location = 2) flat in uint in_triangle;

layout(location = 0) out uvec4 out_texel;

// PCG (O'Neill), one round.
uint scramble(uint v) {
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

void main() {
    vec3 albedo = in_color.rgb;
    float alpha = in_color.a;
    if (textured) {
        albedo *= texture(base_color, in_uv).rgb;
        if (see_through)
            alpha *= textureLod(base_color, in_uv, 0.0).a;
    }
    if (see_through) {
        if ((push.flags & flag_mask) != 0u && alpha < push.cutoff)
            discard;
        // Transparency by chance: a texel is covered with probability alpha, on its own in every
        // layer, so that alpha of the power is reflected and the rest goes on.
        float covered = (push.flags & flag_blend) != 0u ? push.dense * alpha : push.dense;
        uint x = uint(gl_FragCoord.x), y = uint(gl_FragCoord.y);
        uint noise = scramble(x + scramble(y + scramble(in_triangle + scramble(push.seed)))) + push.shift;
        if (float(noise >> 8u) >= covered * 16777216.0)
            discard;
    }
    out_texel = uvec4(floatBitsToUint(clamp(albedo, 0.0, push.max_albedo)), in_triangle + 1u);
}
