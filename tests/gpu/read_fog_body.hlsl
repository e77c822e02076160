// What read_fog.hlsl and read_fog_sh.hlsl do with their defines and grids.
[[vk::binding(1)]] Texture3D lpv_validity;
[[vk::binding(2)]] SamplerState lpv_sampler;
[[vk::binding(5)]] Texture3D fog_grids[3];
#define lpv_scatter fog_grids[0]
#define lpv_extinction fog_grids[1]
#include "../../examples/shaders/lpvbake.hlsl"

#include "read_points.hlsl" // surfaces: eye and end, view and steps

[numthreads(64, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
    uint i = thread.x;
    if (i >= push.count)
        return;
    LpvVolume volume;
    volume.origin = push.origin;
    volume.cell = push.cell;
    float4 eye = surfaces[2 * i], view = surfaces[2 * i + 1];
    LpvFog fog = lpv_fog(volume, eye.xyz, view.xyz, eye.w, int(view.w), 0.5);
    irradiances[5 * i] = float4(fog.light, 0.0);
    irradiances[5 * i + 1] = float4(fog.left, 0.0);
}
