// Takes a triangle's vertices to the clip space of a light's map.
#version 450
#extension GL_GOOGLE_include_directive : enable
#include "raster/push.h"

layout(location = 0) in vec3 in_position; // frame units
layout(location = 1) in vec4 in_plane;    // n.p = w, the same at all three vertices
layout(location = 2) in vec2 in_uv;
layout(location = 3) in vec4 in_color;

layout(location = 0) out vec4 out_color;
layout(location = 1) out vec2 out_uv;
layout(location = 2) flat out uint out_triangle;

invariant gl_Position;

void main() {
    // The plane decides, not the sense of rotation on the map: all vertices agree to the bit.
    bool front = dot(in_plane, vec4(push.light.xyz, -push.light.w)) > 0.0;
    bool black = !front && (push.flags & flag_double_sided) == 0u;
    gl_Position = push.clip * vec4(in_position - push.origin.xyz, 1.0);
    // Where a front and a black back coincide (sheets modelled twice), the front is what is seen.
    if (black)
        gl_Position.z *= 1.0 - 5e-6;
    if (black && (push.flags & flag_cull) != 0u)
        gl_Position = vec4(0.0, 0.0, -1.0, 1.0); // all three in front of the near plane: nothing is left
    out_color = black ? vec4(0.0, 0.0, 0.0, in_color.a) : in_color;
    out_uv = in_uv;
    out_triangle = uint(gl_InstanceIndex) + uint(gl_VertexIndex) / 3u;
}
