// What read_fog.comp and read_fog_sh.comp do with their defines and grids.
layout(set = 0, binding = 1) uniform sampler3D lpv_validity;
layout(set = 0, binding = 5) uniform sampler3D fog_grids[3];
#define lpv_scatter fog_grids[0]
#define lpv_extinction fog_grids[1]
#include "../../examples/shaders/lpvbake.glsl"

#include "read_points.glsl" // surfaces: eye and end, view and steps

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.count)
        return;
    LpvVolume volume = LpvVolume(push.origin, push.cell);
    vec4 eye = surfaces[2 * i], view = surfaces[2 * i + 1];
    LpvFog fog = lpv_fog(volume, eye.xyz, view.xyz, eye.w, int(view.w), 0.5);
    irradiances[5 * i] = vec4(fog.light, 0.0);
    irradiances[5 * i + 1] = vec4(fog.left, 0.0);
}
