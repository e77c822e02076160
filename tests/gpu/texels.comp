// target[i] = 1000 * single[i] + the sum of quad[i]
#version 450

layout(local_size_x = 16) in;

layout(set = 0, binding = 0) uniform textureBuffer single;
layout(set = 0, binding = 1) uniform textureBuffer quad;
layout(set = 0, binding = 2) writeonly buffer Target { float target[]; };

void main() {
    int i = int(gl_GlobalInvocationID.x);
    target[i] = 1000.0 * texelFetch(single, i).r + dot(texelFetch(quad, i), vec4(1.0));
}
