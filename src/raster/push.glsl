// What both stages know of the map and the material that they draw. Mirrors Push in raster.cpp.
layout(push_constant) uniform Push {
    mat4 clip;   // clip space from frame units relative to `origin`
    vec4 origin; // xyz
    vec4 light;  // xyz: the position, w = 1; or the direction to the light, w = 0
    float max_albedo;
    float cutoff;
    uint flags;
    uint seed;  // differs from tile to tile
    uint shift; // of the number that decides what is seen of blended surfaces
} push;

const uint flag_mask = 1u;
const uint flag_blend = 2u;
const uint flag_double_sided = 4u;
const uint flag_cull = 8u;
