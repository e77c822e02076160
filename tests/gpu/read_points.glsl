// What shaders share that read one volume: two vec4s of each point or ray come in, five go out.
layout(local_size_x = 64) in;
layout(set = 0, binding = 3) readonly buffer Surfaces { vec4 surfaces[]; };
layout(set = 0, binding = 4) writeonly buffer Irradiances { vec4 irradiances[]; };
layout(push_constant) uniform Push {
    vec3 origin;
    float cell;
    uint count;
} push;
