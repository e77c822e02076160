// Marches view rays through air by lpv_fog() of examples/shaders/lpvbake.hlsl.
#define LPV_ORDER 2
#define LPV_FOG
#define LPV_FOG_SH
#define lpv_scattered lpv_sh // grids of the same bands
[[vk::binding(0)]] Texture3D lpv_sh[9];
#include "read_fog_body.hlsl"
