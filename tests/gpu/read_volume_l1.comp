#version 450
#define LPV_ORDER 1
#include "read_volume_body.glsl"
