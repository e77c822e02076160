#include "bake/rooms.h"

#include "scene/frame.h"
#include "scene/roles.h"
#include "scene/scene.h"
#include "text.h"
#include "visibility/visibility.h"
#include "volume/compare.h"

#include <glm/gtc/constants.hpp>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>

namespace lpvbake::bake {
namespace {

constexpr double least_cell = 0.05;
constexpr double most_cells = 1 << 22;
/// Of a cell: so much further than where its surfaces stand a box reaches, so that they lie in it.
constexpr double slack = 2.0;

/// A lattice of bytes over the scene.
struct Lattice {
    Grid grid; ///< of the scene's axes

    template <class Each>
    void for_lines(int axis, const Each& each) const {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        tbb::parallel_for(0, grid.dims[v], [&](int at_v) {
            for (int at_u = 0; at_u < grid.dims[u]; ++at_u) {
                glm::ivec3 first(0);
                first[u] = at_u;
                first[v] = at_v;
                glm::ivec3 step(0);
                step[axis] = 1;
                const std::size_t begin = grid.index(first);
                each(begin, grid.dims[axis] > 1 ? grid.index(first + step) - begin : 1);
            }
        });
    }
};

using Cells = std::vector<uint8_t>;

Lattice lattice_over(const Bounds& box) {
    const glm::dvec3 size = glm::max(box.hi - box.lo, 0.0);
    const auto count = [&](double cell) {
        const glm::dvec3 dims = glm::floor(size / cell) + 3.0;
        return dims.x * dims.y * dims.z;
    };
    double cell = least_cell;
    while (count(cell) > most_cells)
        cell *= 1.1;
    return {{box.lo - cell, cell, glm::ivec3(glm::floor(size / cell)) + 3}};
}

/// Marks the cells that a triangle (grid units) touches, and some beside it: along the axis that it
/// faces most a column of cells has its depth there.
void mark(const std::array<glm::vec3, 3>& corners, const Grid& grid, Cells& solid) {
    const glm::vec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
    const glm::vec3 size = glm::abs(normal);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    if (!(size[axis] > 0))
        return;
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const glm::vec3 lo = glm::min(corners[0], glm::min(corners[1], corners[2])),
                    hi = glm::max(corners[0], glm::max(corners[1], corners[2]));
    if (glm::any(glm::lessThan(hi, glm::vec3(0.0f)))
        || glm::any(glm::greaterThanEqual(lo, glm::vec3(grid.dims))))
        return;
    const glm::ivec3 last = grid.dims - 1,
                     from = glm::clamp(glm::ivec3(glm::floor(lo)), glm::ivec3(0), last),
                     to = glm::clamp(glm::ivec3(glm::floor(hi)), glm::ivec3(0), last);
    const float slope_u = -normal[u] / normal[axis], slope_v = -normal[v] / normal[axis];
    const float reach = 0.5f * (std::abs(slope_u) + std::abs(slope_v));
    const auto edge = [&](int i, float at_u,
                          float at_v) { // how far inside, at the cell's best corner
        const glm::vec3 &a = corners[std::size_t(i)], &b = corners[std::size_t(i + 1) % 3];
        const float n_u = -(b[v] - a[v]), n_v = b[u] - a[u];
        const float sign = normal[axis] > 0 ? 1.0f : -1.0f;
        return sign * (n_u * (at_u - a[u]) + n_v * (at_v - a[v]))
               + 0.5f * (std::abs(n_u) + std::abs(n_v));
    };
    for (int j = from[v]; j <= to[v]; ++j)
        for (int i = from[u]; i <= to[u]; ++i) {
            const float at_u = float(i) + 0.5f, at_v = float(j) + 0.5f;
            if (edge(0, at_u, at_v) < 0 || edge(1, at_u, at_v) < 0 || edge(2, at_u, at_v) < 0)
                continue;
            const float depth = corners[0][axis] + slope_u * (at_u - corners[0][u])
                                + slope_v * (at_v - corners[0][v]);
            const int low =
                          std::max(from[axis], int(std::floor(std::max(depth - reach, lo[axis])))),
                      high = std::min(to[axis], int(std::floor(std::min(depth + reach, hi[axis]))));
            for (int k = low; k <= high; ++k) {
                glm::ivec3 cell;
                cell[u] = i;
                cell[v] = j;
                cell[axis] = k;
                std::atomic_ref(solid[grid.index(cell)]).store(1, std::memory_order_relaxed);
            }
        }
}

/// A wall as far as boxes are turned to it.
struct Wall {
    Bounds box;               ///< of the triangle, metres
    std::complex<double> way; ///< area by four times its direction about the vertical
};

/// What stands in the scene, and its walls.
Cells mark_surfaces(const Scene& scene, const Lattice& lattice, std::vector<Wall>& walls) {
    Cells solid(lattice.grid.size());
    const scene::Frame frame = scene::frame_of(lattice.grid);
    for (const Instance& instance : scene.instances) {
        if (!scene::blocks(instance.role))
            continue;
        const std::vector<glm::vec3> positions = scene::positions_in_frame(scene, instance, frame);
        const std::vector<glm::uvec3>& triangles =
            scene.meshes[std::size_t(instance.mesh)].triangles;
        const auto corners_of = [&](std::size_t i) {
            const glm::uvec3& t = triangles[i];
            return std::array{positions[t.x], positions[t.y], positions[t.z]};
        };
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, triangles.size(), 64),
                          [&](const auto& range) {
                              for (std::size_t i = range.begin(); i < range.end(); ++i)
                                  mark(corners_of(i), lattice.grid, solid);
                          });
        for (std::size_t i = 0; i < triangles.size(); ++i) {
            const auto corners = corners_of(i);
            const glm::dvec3 normal(glm::cross(corners[1] - corners[0], corners[2] - corners[0]));
            const double area = glm::length(normal);
            if (!(area > 0) || std::abs(normal.y) > 0.1 * area)
                continue;
            Bounds box;
            for (const glm::vec3& corner : corners) {
                const glm::dvec3 at = frame.to_world(glm::dvec3(corner));
                box = {glm::min(box.lo, at), glm::max(box.hi, at)};
            }
            walls.push_back({box, std::polar(area, 4 * std::atan2(normal.x, normal.z))});
        }
    }
    return solid;
}

/// The square of each cell's distance, in cells, from the nearest that is set, as far as that is
/// less than `reach`.
std::vector<uint16_t> squares_from(const Cells& set, const Lattice& lattice, double reach) {
    const int cells = int(std::ceil(reach));
    const auto most = uint16_t(cells * cells);
    std::vector<uint16_t> squares(set.size()), before;
    for (std::size_t i = 0; i < set.size(); ++i)
        squares[i] = set[i] ? 0 : most;
    for (int axis = 0; axis < 3; ++axis) { // separable: the square of a distance is a sum
        before = squares;
        const int length = lattice.grid.dims[axis];
        lattice.for_lines(axis, [&](std::size_t begin, std::size_t step) {
            for (int i = 0; i < length; ++i) {
                int least = before[begin + std::size_t(i) * step];
                for (int j = std::max(0, i - cells);
                     least > 0 && j <= std::min(length - 1, i + cells); ++j)
                    least = std::min(least, (j - i) * (j - i)
                                                + int(before[begin + std::size_t(j) * step]));
                squares[begin + std::size_t(i) * step] = uint16_t(least);
            }
        });
    }
    return squares;
}

/// Which cells have something above and below them, and on three of four sides.
Cells enclosed(const Cells& solid, const Lattice& lattice) {
    Cells sides(solid.size()); // bits: how many of x and z (0 to 2), above and below (3, 4)
    for (int axis = 0; axis < 3; ++axis)
        lattice.for_lines(axis, [&](std::size_t begin, std::size_t step) {
            const int length = lattice.grid.dims[axis];
            for (const bool back : {false, true}) {
                bool met = false;
                for (int n = 0; n < length; ++n) {
                    const int i = back ? length - 1 - n : n;
                    const std::size_t cell = begin + std::size_t(i) * step;
                    met = met || solid[cell];
                    if (met)
                        sides[cell] = uint8_t(sides[cell] + (axis != 1 ? 1 : back ? 16 : 8));
                }
            }
        });
    for (uint8_t& cell : sides)
        cell = (cell & 24) == 24 && (cell & 7) >= 3;
    return sides;
}

/// Calls with each cell that touches one by a face.
template <class Call>
void for_neighbours(std::size_t cell, const Grid& grid, const Call& call) {
    for (int side = 0; side < 6; ++side) {
        glm::ivec3 there = grid.cell_at(cell);
        there[side / 2] += side % 2 ? 1 : -1;
        if (grid.contains(there))
            call(grid.index(there));
    }
}

/// Cells that touch each other by their faces.
std::vector<std::vector<std::size_t>> components(const Cells& set, const Grid& grid) {
    std::vector<std::vector<std::size_t>> parts;
    Cells left = set;
    for (std::size_t i = 0; i < left.size(); ++i) {
        if (!left[i])
            continue;
        std::vector<std::size_t>& part = parts.emplace_back(1, i);
        left[i] = 0;
        for (std::size_t next = 0; next < part.size(); ++next) {
            for_neighbours(part[next], grid, [&](std::size_t there) {
                if (left[there])
                    part.push_back(there);
                left[there] = 0;
            });
        }
    }
    return parts;
}

/// Between the centres of the lowest and the highest cell, metres.
double height_of(const std::vector<std::size_t>& part, const Grid& grid) {
    int low = grid.dims.y, high = 0;
    for (const std::size_t cell : part) {
        low = std::min(low, grid.cell_at(cell).y);
        high = std::max(high, grid.cell_at(cell).y);
    }
    return (high - low) * grid.cell;
}

/// Whether more than half of what is seen from some of the cells are backs.
bool is_inside_solid(const std::vector<std::size_t>& part, const Grid& grid,
                     const visibility::Visibility& visibility) {
    constexpr std::size_t most = 16;
    int backs = 0, fronts = 0;
    for (std::size_t i = 0; i < std::min(part.size(), most); ++i) {
        const std::size_t cell = part[i * part.size() / std::min(part.size(), most)];
        for (const glm::dvec3& way : volume::neighbour_normals()) {
            const visibility::Hit hit = visibility.closest(
                {glm::vec3(grid.cell_at(cell)) + 0.5f, glm::vec3(way), 0.0f, HUGE_VALF});
            if (hit.instance == visibility::no_hit)
                continue;
            ++(hit.facing == visibility::Facing::back ? backs : fronts);
        }
    }
    return backs > fronts;
}

/// The turn about the vertical of most walls that meet a box, radians, -45 to 45 degrees; 0 where
/// they have none.
double turn_of(const Bounds& box, const std::vector<Wall>& walls) {
    std::complex<double> sum = 0;
    double all = 0;
    for (const Wall& wall : walls)
        if (glm::all(glm::lessThanEqual(wall.box.lo, box.hi))
            && glm::all(glm::lessThanEqual(box.lo, wall.box.hi))) {
            sum += wall.way;
            all += std::abs(wall.way);
        }
    const double turn = std::arg(sum) / 4;
    return std::abs(sum) < 0.5 * all || std::abs(turn) < glm::radians(0.5) ? 0 : turn;
}

/// The room that each cell belongs to; no_room: none.
using Labels = std::vector<uint32_t>;
constexpr uint32_t no_room = ~0u;

/// Gives rooms the cells of `free` that they touch, over and over, `steps` times at most: to the
/// room that comes first, by the labels' order.
void grow(const Cells& free, const Grid& grid, int steps, Labels& labels) {
    std::vector<std::size_t> front, next;
    for (std::size_t i = 0; i < labels.size(); ++i)
        if (labels[i] != no_room)
            front.push_back(i);
    for (int step = 0; step < steps && !front.empty(); ++step) {
        next.clear();
        for (const std::size_t cell : front) {
            for_neighbours(cell, grid, [&](std::size_t there) {
                if (!free[there] || labels[there] != no_room)
                    return;
                labels[there] = labels[cell];
                next.push_back(there);
            });
        }
        front.swap(next);
    }
}

/// A box around the cells of a room.
volume::VolumeBox box_around(const std::vector<std::size_t>& cells, const Grid& grid,
                             const std::vector<Wall>& walls) {
    const auto extent = [&](const glm::dmat3& axes) {
        Bounds box;
        for (const std::size_t cell : cells) {
            const glm::dvec3 at = glm::transpose(axes) * grid.center(grid.cell_at(cell));
            box = {glm::min(box.lo, at), glm::max(box.hi, at)};
        }
        return Bounds{box.lo - slack * grid.cell, box.hi + slack * grid.cell};
    };
    const double turn = turn_of(extent(glm::dmat3(1.0)), walls);
    const glm::dquat rotation(std::cos(turn / 2), 0.0, std::sin(turn / 2), 0.0);
    const Bounds box = extent(glm::mat3_cast(rotation));
    return volume::box_in_world({"room", 0, -1}, box.lo, box.hi, glm::mat4_cast(rotation));
}

double volume_of(const volume::VolumeBox& box) {
    const glm::dvec3 size = box.hi - box.lo;
    return size.x * size.y * size.z;
}

} // namespace

Rooms find_rooms(const Scene& scene, const RoomSettings& settings) {
    const Bounds bounds = bounds_of(scene);
    if (bounds.empty())
        return {};
    Lattice lattice = lattice_over(bounds);
    if (lattice.grid.cell > settings.radius / 4) { // such as of a house on a plain
        const Bounds crowd = scene::trimmed_bounds(scene, 0.01);
        const glm::dvec3 around = 0.1 * (crowd.hi - crowd.lo);
        lattice = lattice_over(
            {glm::max(bounds.lo, crowd.lo - around), glm::min(bounds.hi, crowd.hi + around)});
    }
    const Grid& grid = lattice.grid;
    std::vector<Wall> walls;
    Cells taken = mark_surfaces(scene, lattice, walls);
    const Cells inside = enclosed(taken, lattice);
    const visibility::Visibility visibility(scene, scene::frame_of(grid));

    // First what is wide, somewhere wider than where a door meets a corridor; then, in what that
    // leaves, corridors and closets wider than most doors.
    Labels labels(grid.size(), no_room);
    uint32_t count = 0;
    Cells air(grid.size());
    for (std::size_t i = 0; i < air.size(); ++i)
        air[i] = !taken[i] && inside[i];
    for (const bool narrow : {false, true}) {
        const double radius = (narrow ? 0.75 : 1.0) * settings.radius, reach = radius / grid.cell;
        const double roomy = (narrow ? 1.0 : 1.3) * reach;
        const std::vector<uint16_t> squares = squares_from(taken, lattice, roomy + 1);
        Cells core(grid.size()), wide(grid.size()), covered(grid.size());
        for (std::size_t i = 0; i < core.size(); ++i)
            core[i] = squares[i] > reach * reach && inside[i];
        for (const std::vector<std::size_t>& part : components(core, grid)) {
            const bool is_roomy = std::ranges::any_of(
                part, [&](std::size_t cell) { return squares[cell] > roomy * roomy; });
            if (!is_roomy || height_of(part, grid) + 2 * radius < settings.least_height
                || is_inside_solid(part, grid, visibility))
                continue;
            for (const std::size_t cell : part) {
                wide[cell] = 1;
                labels[cell] = count;
            }
            ++count;
        }
        // All that the ball covers.
        const std::vector<uint16_t> from_core = squares_from(wide, lattice, reach + 1);
        for (std::size_t i = 0; i < taken.size(); ++i) {
            covered[i] = from_core[i] <= reach * reach;
            taken[i] = taken[i] || covered[i];
        }
        grow(covered, grid, std::numeric_limits<int>::max(), labels);
    }
    // Corners, and what furniture keeps the ball from.
    grow(air, grid, int(2 * settings.radius / grid.cell), labels);

    std::vector<std::vector<std::size_t>> cells(count);
    for (std::size_t i = 0; i < labels.size(); ++i)
        if (labels[i] != no_room)
            cells[labels[i]].push_back(i);
    Rooms rooms;
    for (const std::vector<std::size_t>& part : cells)
        rooms.boxes.push_back(box_around(part, grid, walls));
    std::ranges::stable_sort(rooms.boxes, std::greater<>(), volume_of);
    if (rooms.boxes.size() > settings.most_rooms) {
        rooms.left_out = rooms.boxes.size() - settings.most_rooms;
        rooms.boxes.resize(settings.most_rooms);
    }
    for (std::size_t i = 0; i < rooms.boxes.size(); ++i)
        rooms.boxes[i].place.name = format("room%zu", i + 1);
    rooms.detail = format("%s in %d x %d x %d cells of %.3g m of air",
                          counted(rooms.boxes.size(), "room").c_str(), grid.dims.x, grid.dims.y,
                          grid.dims.z, grid.cell);
    if (rooms.boxes.empty())
        rooms.boxes.push_back({{"all", 0, -1}, bounds.lo, bounds.hi, 0});
    return rooms;
}

} // namespace lpvbake::bake
