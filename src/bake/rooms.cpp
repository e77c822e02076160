#include "bake/rooms.h"

#include "mix_word.h"
#include "scene/frame.h"
#include "scene/roles.h"
#include "scene/scene.h"
#include "surface/hemisphere.h"
#include "surface/patches.h"
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

/// An upright triangle, grid units.
struct Wall {
    std::array<glm::vec3, 3> corners;
    glm::vec3 normal; ///< of length 1
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
            const glm::vec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
            const float area = glm::length(normal);
            if (area > 0 && std::abs(normal.y) <= 0.1f * area)
                walls.push_back({corners, normal / area});
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

/// At most 16 of the cells.
std::vector<std::size_t> some_of(const std::vector<std::size_t>& part) {
    const std::size_t count = std::min<std::size_t>(part.size(), 16);
    std::vector<std::size_t> some;
    for (std::size_t i = 0; i < count; ++i)
        some.push_back(part[i * part.size() / count]);
    return some;
}

/// Whether more than half of what is seen from some of the cells are backs.
bool is_inside_solid(const std::vector<std::size_t>& part, const Grid& grid,
                     const visibility::Visibility& visibility) {
    int backs = 0, fronts = 0;
    for (const std::size_t cell : some_of(part))
        for (const glm::dvec3& way : volume::neighbour_normals()) {
            const visibility::Hit hit = visibility.closest(
                {glm::vec3(grid.cell_at(cell)) + 0.5f, glm::vec3(way), 0.0f, HUGE_VALF});
            if (hit.instance == visibility::no_hit)
                continue;
            ++(hit.facing == visibility::Facing::back ? backs : fronts);
        }
    return backs > fronts;
}

/// Where a scene's light comes from, as far as the air of a room has to be reached by some.
class LightSources {
public:
    LightSources(const Scene& scene, const scene::Frame& frame,
                 const visibility::Visibility& visibility)
        : scene_(scene),
          visibility_(visibility),
          emissive_(scene::emissive_materials(scene)),
          sky_(scene::has_sky(scene)) {
        for (const Light& light : scene.lights)
            if (light.type == LightType::directional)
                suns_.push_back(glm::vec3(light.direction));
            else
                lamps_.push_back(glm::vec3(frame.from_world(light.position)));
        for (const Instance& instance : scene.instances)
            if (instance.role == Role::lights_only && shines(instance)) { // rays do not meet it
                const auto positions = scene::positions_in_frame(scene, instance, frame);
                for (const glm::uvec3& t : scene.meshes[std::size_t(instance.mesh)].triangles)
                    lamps_.push_back((positions[t.x] + positions[t.y] + positions[t.z]) / 3.0f);
            }
    }

    bool any() const {
        return sky_ || !suns_.empty() || !lamps_.empty() || std::ranges::count(emissive_, true) > 0;
    }

    /// Whether light gets to some of the cells, by whatever reflections: followed backwards.
    bool reach(const std::vector<std::size_t>& part, const Grid& grid) const {
        for (const std::size_t cell : some_of(part)) {
            const glm::vec3 point = glm::vec3(grid.cell_at(cell)) + 0.5f;
            for (std::size_t i = 0; i < suns_.size() + lamps_.size(); ++i)
                if (is_seen(i, point))
                    return true;
            uint32_t path = 0;
            for (const glm::dvec3& way : volume::neighbour_normals())
                if (follow(point, glm::vec3(way), mix_word(uint32_t(cell)) + path++))
                    return true;
        }
        return false;
    }

private:
    static constexpr int most_reflections = 64;
    static constexpr float back = 1e-2f; ///< cells: off an edge that is hit, on its own side

    bool shines(const Instance& instance) const {
        return emissive_[std::size_t(scene_.meshes[std::size_t(instance.mesh)].material)];
    }

    bool is_seen(std::size_t light, glm::vec3 from) const {
        if (light < suns_.size())
            return visibility_.transmittance({from, -suns_[light], 0.0f, HUGE_VALF}) > 0.0f;
        return visibility_.transmittance({from, lamps_[light - suns_.size()] - from}) > 0.0f;
    }

    bool follow(glm::vec3 point, glm::vec3 way, uint32_t path) const {
        const std::size_t lights = suns_.size() + lamps_.size();
        const auto unit = [](uint32_t bits) { return float(bits >> 8) * 0x1p-24f; };
        for (int i = 0; i < most_reflections; ++i) {
            const visibility::Hit hit = visibility_.closest({point, way, 0.0f, HUGE_VALF});
            if (hit.instance == visibility::no_hit)
                return sky_;
            if (hit.facing == visibility::Facing::back)
                return false;
            if (shines(scene_.instances[hit.instance]))
                return true;
            point += std::max(0.0f, hit.t - back) * way;
            const glm::vec3 normal = glm::dot(hit.normal, way) > 0 ? -hit.normal : hit.normal;
            point += surface::ray_offset(point) * normal;
            path = mix_word(path + 1);
            if (lights > 0 && is_seen(path % lights, point))
                return true;
            way = surface::sample_cosine(normal, {unit(path), unit(mix_word(path ^ 1u))});
        }
        return false;
    }

    const Scene& scene_;
    const visibility::Visibility& visibility_;
    std::vector<bool> emissive_; ///< materials
    bool sky_;
    std::vector<glm::vec3> suns_, lamps_; ///< how they travel; where they are
};

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

/// How much wall there is of each direction about the vertical, which is one with those a quarter
/// turn from it.
class Directions {
public:
    void add(glm::vec3 normal, double area) {
        const double angle = 4 * std::atan2(double(normal.x), double(normal.z));
        at(int(std::lround(angle / (2 * glm::pi<double>()) * bins))) += std::polar(area, angle);
        all_ += area;
    }

    /// Of the direction that most walls have, the mean of what is about the same; radians, -45 to
    /// 45 degrees. 0 where none stands out, as in a round room.
    double strongest() {
        int peak = 0;
        double most = 0;
        for (int i = 0; i < bins; ++i) { // of equal ones that of the least turn
            const int bin = i % 2 == 0 ? i / 2 : -(i + 1) / 2;
            double weight = 0;
            for (int off = -reach; off <= reach; ++off)
                weight += std::abs(at(bin + off)) * (reach + 1 - std::abs(off));
            if (weight > most * (1 + 1e-6)) {
                most = weight;
                peak = bin;
            }
        }
        std::complex<double> sum = 0;
        for (int off = -reach; off <= reach; ++off)
            sum += at(peak + off);
        const double turn = std::arg(sum) / 4;
        return std::abs(sum) < 0.25 * all_ || std::abs(turn) < glm::radians(0.5) ? 0 : turn;
    }

private:
    static constexpr int bins = 360, reach = 8; ///< a quarter of a degree each

    std::complex<double>& at(int bin) { return sums_[std::size_t((bin % bins + bins) % bins)]; }

    std::array<std::complex<double>, bins> sums_{}; ///< area by four times its direction
    double all_ = 0;
};

/// Of the walls before which each room's air lies.
std::vector<Directions> directions_of(const std::vector<Wall>& walls, const Labels& labels,
                                      uint32_t rooms, const Grid& grid) {
    constexpr float step = 2; // cells: between points that are looked at, and what is before them
    constexpr float most_steps = 1024;
    std::vector<Directions> directions(rooms);
    for (const auto& [corners, normal] : walls) {
        const glm::vec3 u = corners[1] - corners[0], v = corners[2] - corners[0];
        const float longest = std::max({glm::length(u), glm::length(v), glm::length(u - v)});
        const int steps = int(std::clamp(std::ceil(longest / step), 1.0f, most_steps));
        const double area = 0.5 * double(glm::length(glm::cross(u, v))) / (steps * steps);
        for (int i = 0; i < steps; ++i)
            for (int j = 0; j < 2 * (steps - i) - 1; ++j) { // of a row's parts each other is turned
                const float third = j % 2 == 0 ? 1 / 3.0f : 2 / 3.0f;
                const glm::vec3 point = corners[0] + (float(i) + third) / float(steps) * u
                                        + (float(j / 2) + third) / float(steps) * v;
                for (const float side : {-step, step}) {
                    const glm::ivec3 cell(glm::floor(point + side * normal));
                    if (const uint32_t room =
                            grid.contains(cell) ? labels[grid.index(cell)] : no_room;
                        room != no_room)
                        directions[room].add(normal, area);
                }
            }
    }
    return directions;
}

/// The cells of a room: those that its ball covers, and what is left beside them.
struct RoomCells {
    std::vector<std::size_t> covered, beside;
};

/// Cells of a room between two planes a cell apart.
struct Section {
    std::size_t count = 0;
    double farthest = -HUGE_VAL; ///< of their centres
};

/// How far outward a room goes on, of sections from inside of it: not where it is but an opening in
/// a wall, or the ball's side in one.
double end_of(const std::vector<Section>& sections) {
    constexpr double wide = 1 / 3.0; // of the first
    double end = sections[0].farthest;
    for (const Section& section : sections) {
        if (double(section.count) < wide * double(sections[0].count))
            break;
        end = std::max(end, section.farthest);
    }
    return end;
}

/// A box around the cells of a room. `radius` is that of its ball.
volume::VolumeBox box_around(const RoomCells& cells, const Grid& grid, double radius, double turn) {
    const glm::dquat rotation(std::cos(turn / 2), 0.0, std::sin(turn / 2), 0.0);
    const glm::dmat3 to_box = glm::mat3_cast(glm::conjugate(rotation));
    const auto place_of = [&](std::size_t cell) {
        return to_box * grid.center(grid.cell_at(cell));
    };
    Bounds covered;
    for (const std::size_t cell : cells.covered) {
        const glm::dvec3 at = place_of(cell);
        covered = {glm::min(covered.lo, at), glm::max(covered.hi, at)};
    }
    // From so far inside of where the ball comes to, the wall that it comes through lies outward.
    const double inside = (std::ceil(radius / grid.cell) + 1.5) * grid.cell;
    std::array<std::vector<Section>, 6> sections;
    sections.fill(std::vector<Section>(1));
    for (const std::vector<std::size_t>* some : {&cells.covered, &cells.beside})
        for (const std::size_t cell : *some) {
            const glm::dvec3 at = place_of(cell);
            for (std::size_t side = 0; side < 6; ++side) {
                const int axis = int(side / 2);
                const double outward = side % 2 == 0 ? -at[axis] : at[axis];
                const double end = side % 2 == 0 ? -covered.lo[axis] : covered.hi[axis];
                const double from = (outward - end + inside) / grid.cell;
                if (from < 0)
                    continue;
                if (sections[side].size() <= std::size_t(from))
                    sections[side].resize(std::size_t(from) + 1);
                Section& section = sections[side][std::size_t(from)];
                ++section.count;
                section.farthest = std::max(section.farthest, outward);
            }
        }
    Bounds box;
    for (int axis = 0; axis < 3; ++axis) {
        box.lo[axis] = -end_of(sections[std::size_t(2 * axis)]) - slack * grid.cell;
        box.hi[axis] = end_of(sections[std::size_t(2 * axis + 1)]) + slack * grid.cell;
    }
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
    const scene::Frame frame = scene::frame_of(grid);
    const visibility::Visibility visibility(scene, frame);
    const LightSources sources(scene, frame, visibility);

    // First what is wide, somewhere wider than where a door meets a corridor; then, in what that
    // leaves, corridors and closets wider than most doors.
    Labels labels(grid.size(), no_room);
    uint32_t count = 0;
    std::vector<bool> is_lit; // a room each
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
            is_lit.push_back(!sources.any() || sources.reach(part, grid));
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
    const Labels covered = labels;
    // Corners, and what furniture keeps the ball from.
    grow(air, grid, int(2 * settings.radius / grid.cell), labels);

    std::vector<RoomCells> cells(count);
    for (std::size_t i = 0; i < labels.size(); ++i)
        if (labels[i] != no_room)
            (covered[i] != no_room ? cells[labels[i]].covered : cells[labels[i]].beside)
                .push_back(i);
    std::vector<Directions> directions = directions_of(walls, labels, count, grid);
    Rooms rooms;
    for (uint32_t room = 0; room < count; ++room)
        if (is_lit[room])
            rooms.boxes.push_back(
                box_around(cells[room], grid, settings.radius, directions[room].strongest()));
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
    if (const auto dark = std::ranges::count(is_lit, false))
        rooms.detail += format("; no light gets into %td more", dark);
    if (rooms.boxes.empty())
        rooms.boxes.push_back({{"all", 0, -1}, bounds.lo, bounds.hi, 0});
    return rooms;
}

} // namespace lpvbake::bake
