#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// One application of propagation where it is linear, to light that may be negative: see
// propagate.glsl.

#define LINEAR
#define Flux float
#define Lobe vec4
#include "propagate.glsl"
