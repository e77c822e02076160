// Reads a volume at points by everything that examples/shaders/lpvbake.glsl has; LPV_ORDER is given,
// LPV_WALLS, LPV_UNORM8 and LPV_BC6H may be.
#ifdef LPV_UNORM8
#define TEXTURES (1 + 3 * LPV_ORDER)
#else
#define TEXTURES ((LPV_ORDER + 1) * (LPV_ORDER + 1))
#endif
layout(set = 0, binding = 0) uniform sampler3D lpv_sh[TEXTURES];
#if defined(LPV_UNORM8) || defined(LPV_BC6H)
layout(set = 0, binding = 6) uniform Ranges { vec4 lpv_low[TEXTURES], lpv_high[TEXTURES]; };
#endif
#ifdef LPV_BC6H
layout(set = 0, binding = 7) uniform sampler3D lpv_base;
#endif
layout(set = 0, binding = 1) uniform sampler3D lpv_validity;
#ifdef LPV_WALLS
layout(set = 0, binding = 5) uniform sampler3D lpv_walls[3];
#endif
#include "../../examples/shaders/lpvbake.glsl"

#include "read_points.glsl" // surfaces: point, normal

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.count)
        return;
    LpvVolume volume = LpvVolume(push.origin, push.cell);
    vec3 n = surfaces[2 * i + 1].xyz;
    LpvSh plain = lpv_trilinear(volume, surfaces[2 * i].xyz);
    LpvSh facing = lpv_facing(volume, surfaces[2 * i].xyz, n);
    irradiances[5 * i] = vec4(lpv_irradiance_l1(plain, n), 0.0);
    irradiances[5 * i + 1] = vec4(lpv_irradiance_l1(facing, n), 0.0);
    irradiances[5 * i + 2] = vec4(lpv_irradiance_l1_nonlinear(facing, n), 0.0);
    irradiances[5 * i + 3] = vec4(lpv_irradiance_l1_zh3(facing, n), 0.0);
#if LPV_ORDER == 2
    irradiances[5 * i + 4] = vec4(lpv_irradiance_l2(facing, n), 0.0);
#endif
}
