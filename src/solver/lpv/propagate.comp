#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// One propagation step of a light propagation volume: see propagate.glsl.

#define Flux float
#define Lobe vec4
#include "propagate.glsl"
