#define LPV_ORDER 2
#include "read_volume_body.hlsl"
