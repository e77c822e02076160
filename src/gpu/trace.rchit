// The nearest that a ray meets.
#version 460
#extension GL_EXT_ray_tracing : require
#extension GL_GOOGLE_include_directive : require
#include "gpu/rays_layout.h"

layout(push_constant) uniform Pushed { RaysPush push; };
layout(location = 0) rayPayloadInEXT Payload payload;
hitAttributeEXT vec2 weights;

void main() {
    payload.t = gl_HitTEXT;
    payload.triangle = uint(gl_PrimitiveID) + (gl_GeometryIndexEXT == 1 ? push.opaque : 0u);
    payload.barycentric = weights;
}
