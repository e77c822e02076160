// target[i] = factor * source[i] + summand
#version 450

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint factor = 1u;

layout(push_constant) uniform Push {
    uint count;
    uint summand;
} push;

layout(set = 0, binding = 0) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 1) writeonly buffer Target { uint target[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < push.count)
        target[i] = factor * source[i] + push.summand;
}
