#include "solver/sn/planes.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::sn {
namespace {

/// Calls visit(plane, u, v) for the places beside the tile that the directions of a quadrant read.
template <class Visit>
void visit_boundary(const Course& course, int quadrant, const Visit& visit) {
    const glm::ivec3 n = course.layout.dims, signs = course.signs(quadrant);
    // Upstream of the first cell.
    const int u0 = signs[course.u] > 0 ? -1 : n.x, v0 = signs[course.v] > 0 ? -1 : n.y;
    const int first_u = std::min(u0, 0), last_u = std::max(u0 + 1, n.x);
    for (int plane = 0; plane < n.z; ++plane)
        for (int v = std::min(v0, 0); v < std::max(v0 + 1, n.y); ++v)
            if (plane == 0 || v == v0)
                for (int u = first_u; u < last_u; ++u)
                    visit(plane, u, v);
            else
                visit(plane, u0, v);
}

/// Calls visit(plane, u, v, near) for the cells that are given in a quadrant.
template <class Visit>
void visit_near(const Course& course, int quadrant, std::span<const NearCell> near,
                const Visit& visit) {
    const glm::ivec3 signs = course.signs(quadrant);
    const int octant = (signs.x < 0 ? 1 : 0) + (signs.y < 0 ? 2 : 0) + (signs.z < 0 ? 4 : 0);
    for (const NearCell& each : near)
        if (each.octants >> octant & 1)
            visit(course.plane_of(each.cell), each.cell[course.u], each.cell[course.v], each);
}

} // namespace

Course::Course(const Tile& t, int number)
    : tile(t),
      axis(number / 2),
      sign(number % 2 ? -1 : 1),
      u(axis == 0 ? 1 : 0),
      v(axis == 2 ? 1 : 2),
      layout{{t.cells.dims[u], t.cells.dims[v], t.cells.dims[axis]}} {}

glm::ivec3 Course::signs(int quadrant) const {
    glm::ivec3 signs;
    signs[axis] = sign;
    signs[u] = quadrant & 1 ? -1 : 1;
    signs[v] = quadrant & 2 ? -1 : 1;
    return signs;
}

glm::ivec3 Course::cell(int at_u, int at_v, int plane) const {
    glm::ivec3 c;
    c[axis] = sign > 0 ? plane - 1 : layout.dims.z - plane;
    c[u] = at_u;
    c[v] = at_v;
    return c;
}

int Course::plane_of(glm::ivec3 c) const {
    return sign > 0 ? c[axis] + 1 : layout.dims.z - c[axis];
}

std::vector<NearCell> find_near(const Tile& tile, const Occupancy& surfaces,
                                const std::vector<uint8_t>& feeding,
                                const visibility::Visibility& visibility) {
    const glm::ivec3 dims = tile.cells.dims;
    const Grid grid{{}, 1.0, surfaces.dims};
    std::vector<std::vector<NearCell>> layers(static_cast<size_t>(dims.z));
    tbb::parallel_for(0, dims.z, [&](int z) {
        for (int y = 0; y < dims.y; ++y)
            for (int x = 0; x < dims.x; ++x) {
                const glm::ivec3 cell(x, y, z), in_grid = tile.in_grid(cell);
                if (!feeding[grid.index(in_grid)])
                    continue;
                uint32_t octants = 0;
                for (int i = 0; i < 8; ++i)
                    if (surfaces.is_occupied(in_grid + glm::ivec3(i & 1, i >> 1 & 1, i >> 2)))
                        octants |= 1u << i;
                if (octants != 0)
                    layers[size_t(z)].push_back(
                        {cell, visibility.capture(in_grid).point, uint8_t(octants)});
            }
    });
    size_t count = 0;
    for (const std::vector<NearCell>& layer : layers)
        count += layer.size();
    std::vector<NearCell> near;
    near.reserve(count);
    for (const std::vector<NearCell>& layer : layers)
        near.insert(near.end(), layer.begin(), layer.end());
    return near;
}

PlaneOrder order_planes(const Course& course, std::span<const NearCell> near, bool boundary,
                        const visibility::Visibility& visibility) {
    PlaneOrder order;
    order.first.assign(quadrants * size_t(course.layout.planes()) + 1, 0);
    const auto group = [](int plane, int quadrant) {
        return quadrants * size_t(plane) + size_t(quadrant);
    };
    tbb::parallel_for(0, int(quadrants), [&](int quadrant) {
        const auto count = [&](int plane) { ++order.first[group(plane, quadrant) + 1]; };
        visit_near(course, quadrant, near,
                   [&](int plane, int, int, const NearCell&) { count(plane); });
        if (boundary)
            visit_boundary(course, quadrant, [&](int plane, int, int) { count(plane); });
    });
    for (size_t i = 1; i < order.first.size(); ++i)
        order.first[i] += order.first[i - 1];
    order.given.resize(order.first.back());
    tbb::parallel_for(0, int(quadrants), [&](int quadrant) {
        std::vector<uint32_t> next(size_t(course.layout.planes()));
        for (size_t plane = 0; plane < next.size(); ++plane)
            next[plane] = order.first[group(int(plane), quadrant)];
        const auto put = [&](int plane, int u, int v, glm::vec3 point) {
            order.given[next[size_t(plane)]++] = {
                quadrants * course.layout.slot(u, v) + uint32_t(quadrant), point};
        };
        visit_near(course, quadrant, near, [&](int plane, int u, int v, const NearCell& each) {
            put(plane, u, v, each.point);
        });
        if (boundary)
            visit_boundary(course, quadrant, [&](int plane, int u, int v) {
                const glm::ivec3 cell = course.tile.in_grid(course.cell(u, v, plane));
                put(plane, u, v, visibility.capture(cell).point);
            });
    });
    if (boundary) // else they are in the order of the tile's cells, which is that of slots
        tbb::parallel_for(size_t(1), order.first.size(), [&](size_t i) {
            std::sort(order.given.begin() + order.first[i - 1],
                      order.given.begin() + order.first[i],
                      [](const SnPlace& a, const SnPlace& b) { return a.entry < b.entry; });
        });
    return order;
}

} // namespace lpvbake::solver::sn
