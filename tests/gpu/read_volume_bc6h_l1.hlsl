#define LPV_ORDER 1
#define LPV_BC6H
#define LPV_WALLS
#include "read_volume_body.hlsl"
