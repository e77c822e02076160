// A ray that meets nothing: its payload says so from the start.
#version 460
#extension GL_EXT_ray_tracing : require

void main() {}
