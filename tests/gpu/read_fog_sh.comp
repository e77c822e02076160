#version 450
// Marches view rays through air by lpv_fog() of examples/shaders/lpvbake.glsl.
#define LPV_ORDER 2
#define LPV_FOG
#define LPV_FOG_SH
#define lpv_scattered lpv_sh // grids of the same bands
layout(set = 0, binding = 0) uniform sampler3D lpv_sh[9];
#include "read_fog_body.glsl"
