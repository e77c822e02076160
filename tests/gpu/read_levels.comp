#version 450
// Reads two nested levels at points by lpv_levels() of examples/shaders/lpvbake.glsl.
#define LPV_ORDER 1
#define LPV_LEVELS 2
#define LPV_WALLS
layout(set = 0, binding = 0) uniform sampler3D lpv_sh[4];
layout(set = 0, binding = 1) uniform sampler3D lpv_validity;
layout(set = 0, binding = 5) uniform sampler3D lpv_walls[3];
#include "../../examples/shaders/lpvbake.glsl"

layout(local_size_x = 64) in;
layout(set = 0, binding = 3) readonly buffer Surfaces { vec4 surfaces[]; }; // point, normal
layout(set = 0, binding = 4) writeonly buffer Irradiances { vec4 irradiances[]; }; // 5 a point
layout(push_constant) uniform Push { LpvLevel levels[2]; } push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (2 * i >= surfaces.length())
        return;
    vec3 n = surfaces[2 * i + 1].xyz;
    LpvSh sh = lpv_levels(push.levels, surfaces[2 * i].xyz, n);
    irradiances[5 * i + 1] = vec4(lpv_irradiance_l1(sh, n), 0.0);
}
