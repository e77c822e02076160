// What PNanoVDB.h reads of a grid at the centres of cells, found by the grid's own transform.
#version 450

#define PNANOVDB_GLSL
layout(set = 0, binding = 0) readonly buffer Grid { uint pnanovdb_buf_data[]; };
#include <nanovdb/PNanoVDB.h>

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const bool is_vec3 = false;

layout(push_constant) uniform Push {
    vec3 origin; // corner of the first cell, metres
    float cell;
    uvec3 dims;
} push;

layout(set = 0, binding = 1) writeonly buffer Target { uvec4 target[]; }; // a cell: bits, the grid's type

uvec3 voxel(uint type, pnanovdb_buf_t buf, pnanovdb_root_handle_t root, ivec3 at) {
    pnanovdb_address_t value = pnanovdb_root_get_value_address(type, buf, root, at);
    uvec3 bits = uvec3(0u);
    for (uint k = 0u; k < (is_vec3 ? 3u : 1u); ++k)
        bits[k] = pnanovdb_read_uint32(buf, pnanovdb_address_offset(value, 4u * k));
    return bits;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.dims.x * push.dims.y * push.dims.z)
        return;
    uvec3 c = uvec3(i, i / push.dims.x, i / (push.dims.x * push.dims.y)) % push.dims;
    pnanovdb_buf_t buf;
    buf.unused = 0u;
    pnanovdb_grid_handle_t grid;
    grid.address = pnanovdb_address_null();
    pnanovdb_root_handle_t root = pnanovdb_tree_get_root(buf, pnanovdb_grid_get_tree(buf, grid));
    vec3 place = pnanovdb_grid_world_to_indexf(buf, grid, push.origin + push.cell * (vec3(c) + 0.5));
    ivec3 at = ivec3(round(place));
    // By constants, or compilers take long over the table of all types.
    uvec3 bits = is_vec3 ? voxel(PNANOVDB_GRID_TYPE_VEC3F, buf, root, at)
                         : voxel(PNANOVDB_GRID_TYPE_FLOAT, buf, root, at);
    target[i] = uvec4(bits, pnanovdb_grid_get_grid_type(buf, grid));
}
