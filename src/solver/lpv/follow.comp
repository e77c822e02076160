#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// One propagation step of a light, the guide, and of a layer of it: see propagate.glsl. What is
// decided, which faces receive flux and what budgets are, the guide decides: so that the layer is
// linear. Pairs are (guide, layer).

#define FOLLOW
#define Flux vec2
#define Lobe mat4x2
#include "propagate.glsl"
