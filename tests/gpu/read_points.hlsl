// What shaders share that read one volume: two float4s of each point or ray come in, five go out.
[[vk::binding(3)]] StructuredBuffer<float4> surfaces;
[[vk::binding(4)]] RWStructuredBuffer<float4> irradiances;
struct Push {
    float3 origin;
    float cell;
    uint count;
};
[[vk::push_constant]] ConstantBuffer<Push> push;
