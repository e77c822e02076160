#version 450
// Reads bricks at points by examples/shaders/lpvbake.glsl.
#define LPV_ORDER 1
#define LPV_BRICKS
#define LPV_WALLS
layout(set = 0, binding = 0) uniform sampler3D lpv_sh[4];
layout(set = 0, binding = 1) uniform sampler3D lpv_validity;
layout(set = 0, binding = 5) uniform sampler3D lpv_walls[3];
layout(set = 0, binding = 7) uniform sampler3D lpv_brick_places;
#include "../../examples/shaders/lpvbake.glsl"

layout(local_size_x = 64) in;
layout(set = 0, binding = 3) readonly buffer Surfaces { vec4 surfaces[]; }; // point, normal
layout(set = 0, binding = 4) writeonly buffer Irradiances { vec4 irradiances[]; }; // 5 a point
layout(push_constant) uniform Push { LpvBricks bricks; } push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (2 * i >= surfaces.length())
        return;
    vec3 point = surfaces[2 * i].xyz, n = surfaces[2 * i + 1].xyz;
    irradiances[5 * i] = vec4(lpv_irradiance_l1(lpv_bricks_trilinear(push.bricks, point), n), 0.0);
    irradiances[5 * i + 1] = vec4(lpv_irradiance_l1(lpv_bricks_facing(push.bricks, point, n), n), 0.0);
}
