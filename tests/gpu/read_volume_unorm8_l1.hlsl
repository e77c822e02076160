#define LPV_ORDER 1
#define LPV_UNORM8
#define LPV_WALLS
#include "read_volume_body.hlsl"
