// Reads a volume at points by everything that examples/shaders/lpvbake.hlsl has; LPV_ORDER is given,
// LPV_WALLS, LPV_UNORM8 and LPV_BC6H may be.
#ifdef LPV_UNORM8
#define TEXTURES (1 + 3 * LPV_ORDER)
#else
#define TEXTURES ((LPV_ORDER + 1) * (LPV_ORDER + 1))
#endif
[[vk::binding(0)]] Texture3D lpv_sh[TEXTURES];
#if defined(LPV_UNORM8) || defined(LPV_BC6H)
[[vk::binding(6)]] cbuffer Ranges { float4 lpv_low[TEXTURES], lpv_high[TEXTURES]; };
#endif
#ifdef LPV_BC6H
[[vk::binding(7)]] Texture3D lpv_base;
#endif
[[vk::binding(1)]] Texture3D lpv_validity;
[[vk::binding(2)]] SamplerState lpv_sampler;
#ifdef LPV_WALLS
[[vk::binding(5)]] Texture3D lpv_walls[3];
#endif
#include "../../examples/shaders/lpvbake.hlsl"

#include "read_points.hlsl" // surfaces: point, normal

[numthreads(64, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
    uint i = thread.x;
    if (i >= push.count)
        return;
    LpvVolume volume;
    volume.origin = push.origin;
    volume.cell = push.cell;
    float3 n = surfaces[2 * i + 1].xyz;
    LpvSh plain = lpv_trilinear(volume, surfaces[2 * i].xyz);
    LpvSh facing = lpv_facing(volume, surfaces[2 * i].xyz, n);
    irradiances[5 * i] = float4(lpv_irradiance_l1(plain, n), 0.0);
    irradiances[5 * i + 1] = float4(lpv_irradiance_l1(facing, n), 0.0);
    irradiances[5 * i + 2] = float4(lpv_irradiance_l1_nonlinear(facing, n), 0.0);
    irradiances[5 * i + 3] = float4(lpv_irradiance_l1_zh3(facing, n), 0.0);
#if LPV_ORDER == 2
    irradiances[5 * i + 4] = float4(lpv_irradiance_l2(facing, n), 0.0);
#endif
}
