#version 450
// Marches view rays through air by lpv_fog() of examples/shaders/lpvbake.glsl.
#define LPV_ORDER 1
#define LPV_FOG
layout(set = 0, binding = 0) uniform sampler3D lpv_sh[4];
#include "read_fog_body.glsl"
