// Reads a volume at points by examples/unity/Lpvbake.hlsl, as LpvbakeVolume.Apply sets it up.
[[vk::binding(0)]] Texture3D textures[7]; // r, g, b, r2, g2, b2, x2y2
[[vk::binding(2)]] SamplerState lpvbake_linear_clamp_sampler;
#define LPVBAKE_DECLARED
#define _LpvbakeR textures[0]
#define _LpvbakeG textures[1]
#define _LpvbakeB textures[2]
#define _LpvbakeR2 textures[3]
#define _LpvbakeG2 textures[4]
#define _LpvbakeB2 textures[5]
#define _LpvbakeX2Y2 textures[6]
static float4 _LpvbakeScale, _LpvbakeOffset;
#include "../../examples/unity/Lpvbake.hlsl"

#include "read_points.hlsl" // surfaces: point, normal; out: of order 1, of order 2

[numthreads(64, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
    uint i = thread.x;
    if (i >= push.count)
        return;
    uint3 dims;
    _LpvbakeR.GetDimensions(dims.x, dims.y, dims.z);
    float3 scale = 1.0 / (push.cell * float3(dims));
    for (uint order = 1; order <= 2; ++order) {
        _LpvbakeScale = float4(scale, order);
        _LpvbakeOffset = float4(-push.origin * scale, 0.5);
        float3 light;
        Lpvbake_float(surfaces[2 * i].xyz, surfaces[2 * i + 1].xyz, light);
        irradiances[5 * i + order - 1] = float4(light, 0.0);
    }
}
