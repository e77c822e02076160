#version 450
#define LPV_ORDER 2
#define LPV_BC6H
#define LPV_WALLS
#include "read_volume_body.glsl"
