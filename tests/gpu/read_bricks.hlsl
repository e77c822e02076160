// Reads bricks at points by examples/shaders/lpvbake.hlsl.
#define LPV_ORDER 1
#define LPV_BRICKS
#define LPV_WALLS
[[vk::binding(0)]] Texture3D lpv_sh[4];
[[vk::binding(1)]] Texture3D lpv_validity;
[[vk::binding(2)]] SamplerState lpv_sampler;
[[vk::binding(5)]] Texture3D lpv_walls[3];
[[vk::binding(7)]] Texture3D lpv_brick_places;
#include "../../examples/shaders/lpvbake.hlsl"

[[vk::binding(3)]] StructuredBuffer<float4> surfaces;      // point, normal
[[vk::binding(4)]] RWStructuredBuffer<float4> irradiances; // 5 a point
struct Push {
    LpvBricks bricks;
};
[[vk::push_constant]] ConstantBuffer<Push> push;

[numthreads(64, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
    uint i = thread.x, count, stride;
    surfaces.GetDimensions(count, stride);
    if (2 * i >= count)
        return;
    float3 position = surfaces[2 * i].xyz, n = surfaces[2 * i + 1].xyz;
    irradiances[5 * i] = float4(lpv_irradiance_l1(lpv_bricks_trilinear(push.bricks, position), n), 0.0);
    irradiances[5 * i + 1] = float4(lpv_irradiance_l1(lpv_bricks_facing(push.bricks, position, n), n), 0.0);
}
