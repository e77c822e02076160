#version 460
#extension GL_GOOGLE_include_directive : require

// The solution of the coarsest level, all of it a product of a matrix with its light; push.nx is
// the number of its cells, and columns of the matrix follow each other.

#include "levels.h"

layout(local_size_x_id = spec_level_local_size) in;

layout(push_constant) uniform Push { LevelPush push; };
layout(set = 0, binding = 0) uniform textureBuffer matrix;
layout(set = 0, binding = 1) uniform textureBuffer light;
layout(std430, set = 0, binding = 2) writeonly restrict buffer All { vec4 all[]; };

void main() {
    const uint i = gl_GlobalInvocationID.x;
    const uint row = min(i, push.nx - 1u);
    vec4 sum = vec4(0.0);
    for (uint j = 0u; j < push.nx; ++j)
        sum += texelFetch(matrix, int(j * push.nx + row)).x * texelFetch(light, int(j));
    if (i < push.nx)
        all[i] = sum;
}
