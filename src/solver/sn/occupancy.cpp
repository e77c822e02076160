#include "solver/sn/occupancy.h"

#include "lpvbake/volume.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace lpvbake::solver::sn {
namespace {

/// By how much a cube counts as larger than it is (cells): a surface that touches it is not missed,
/// nor is one beyond which a corner's light is taken (visibility/capture.h).
constexpr float reach = surface_margin + 1e-3f;

/// True if the triangle meets the cube around the origin, |x|, |y|, |z| <= half (separating axes:
/// Akenine-Moller 2001).
bool meets_cube(const std::array<glm::vec3, 3>& corner, float half) {
    const auto apart = [&](glm::vec3 axis) {
        float lo = glm::dot(axis, corner[0]), hi = lo;
        for (size_t i = 1; i < 3; ++i) {
            const float at = glm::dot(axis, corner[i]);
            lo = std::min(lo, at);
            hi = std::max(hi, at);
        }
        const float radius = half * (std::abs(axis.x) + std::abs(axis.y) + std::abs(axis.z));
        return lo > radius || hi < -radius;
    };
    const glm::vec3 edges[] = {corner[1] - corner[0], corner[2] - corner[1], corner[0] - corner[2]};
    if (apart(glm::cross(edges[0], edges[1])))
        return false;
    for (int axis = 0; axis < 3; ++axis) {
        glm::vec3 unit{0.0f};
        unit[axis] = 1.0f;
        if (apart(unit))
            return false;
        for (const glm::vec3& edge : edges)
            if (apart(glm::cross(unit, edge)))
                return false;
    }
    return true;
}

void occupy(const std::vector<surface::Patch>& patches, Occupancy& occupancy) {
    const glm::ivec3 cubes = occupancy.dims + 1;
    tbb::parallel_for(size_t(0), patches.size(), [&](size_t index) {
        const surface::Patch& patch = patches[index];
        const std::array<glm::vec3, 3> corner = {patch.at({0, 0}), patch.at({1, 0}),
                                                 patch.at({0, 1})};
        const glm::vec3 lo = glm::min(corner[0], glm::min(corner[1], corner[2]));
        const glm::vec3 hi = glm::max(corner[0], glm::max(corner[1], corner[2]));
        // Cube (i, j, k) is centred on (i, j, k) in grid units.
        const glm::vec3 wide(0.5f + reach);
        const auto within = [&](glm::vec3 v) {
            return glm::ivec3(glm::clamp(v, glm::vec3(-1.0f), glm::vec3(cubes)));
        };
        const glm::ivec3 first = glm::max(within(glm::ceil(lo - wide)), glm::ivec3(0));
        const glm::ivec3 last = glm::min(within(glm::floor(hi + wide)), cubes - 1);
        for (int k = first.z; k <= last.z; ++k)
            for (int j = first.y; j <= last.y; ++j)
                for (int i = first.x; i <= last.x; ++i) {
                    std::atomic_ref<uint8_t> flag(
                        occupancy.occupied[size_t(i)
                                           + size_t(cubes.x)
                                                 * (size_t(j) + size_t(cubes.y) * size_t(k))]);
                    if (flag.load(std::memory_order_relaxed))
                        continue;
                    const glm::vec3 center(i, j, k);
                    if (meets_cube({corner[0] - center, corner[1] - center, corner[2] - center},
                                   wide.x))
                        flag.store(1, std::memory_order_relaxed);
                }
    });
}

/// Calls visit(index) for the cells of the grid at the corners of a cube.
template <class Visit>
void visit_corners(glm::ivec3 dims, glm::ivec3 cube, const Visit& visit) {
    const Grid grid{{}, 1.0, dims};
    for (int i = 0; i < 8; ++i) {
        const glm::ivec3 cell = cube - glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
        if (grid.contains(cell))
            visit(grid.index(cell));
    }
}

/// The cells without a mark that are joined to some with one by a cube.
std::vector<size_t> beside_marked(const Occupancy& occupancy, const std::vector<uint8_t>& marked) {
    std::vector<std::vector<size_t>> layers(size_t(occupancy.dims.z) + 1);
    tbb::parallel_for(0, occupancy.dims.z + 1, [&](int z) {
        for (int y = 0; y <= occupancy.dims.y; ++y)
            for (int x = 0; x <= occupancy.dims.x; ++x) {
                if (occupancy.is_occupied({x, y, z}))
                    continue;
                bool some = false, all = true;
                visit_corners(occupancy.dims, {x, y, z}, [&](size_t cell) {
                    some |= marked[cell] != 0;
                    all &= marked[cell] != 0;
                });
                if (some && !all)
                    visit_corners(occupancy.dims, {x, y, z}, [&](size_t cell) {
                        if (!marked[cell])
                            layers[size_t(z)].push_back(cell);
                    });
            }
    });
    std::vector<size_t> cells;
    for (const std::vector<size_t>& layer : layers)
        cells.insert(cells.end(), layer.begin(), layer.end());
    return cells;
}

} // namespace

Occupancy find_occupied(const std::vector<surface::Patch>& patches, glm::ivec3 dims) {
    Occupancy occupancy;
    occupancy.dims = dims;
    const glm::ivec3 cubes = dims + 1;
    occupancy.occupied.assign(size_t(cubes.x) * size_t(cubes.y) * size_t(cubes.z), 0);
    occupy(patches, occupancy);
    return occupancy;
}

std::vector<uint8_t> find_feeding(const Occupancy& occupancy, std::span<const float> validity) {
    const Grid grid{{}, 1.0, occupancy.dims};
    std::vector<uint8_t> feeding(grid.size(), 1);
    if (validity.empty())
        return feeding;
    std::ranges::transform(validity, feeding.begin(), [](float v) { return v > 0.0f ? 1 : 0; });
    std::vector<size_t> open = beside_marked(occupancy, feeding);
    while (!open.empty()) {
        const size_t cell = open.back();
        open.pop_back();
        if (feeding[cell])
            continue;
        feeding[cell] = 1;
        for (int i = 0; i < 8; ++i) {
            const glm::ivec3 cube = grid.cell_at(cell) + glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
            if (!occupancy.is_occupied(cube))
                visit_corners(occupancy.dims, cube, [&](size_t other) {
                    if (!feeding[other])
                        open.push_back(other);
                });
        }
    }
    return feeding;
}

} // namespace lpvbake::solver::sn
