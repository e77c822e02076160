// Marches view rays through air by lpv_fog() of examples/shaders/lpvbake.hlsl.
#define LPV_ORDER 1
#define LPV_FOG
[[vk::binding(0)]] Texture3D lpv_sh[4];
#include "read_fog_body.hlsl"
