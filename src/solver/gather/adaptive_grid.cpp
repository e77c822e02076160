#include "solver/gather/adaptive_grid.h"

#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

namespace lpvbake::solver::gather {

AdaptiveGrid::AdaptiveGrid(const Volume& volume, volume::Slab slab, const Occupied& occupied,
                           float tolerance)
    : state(volume::grid_of(slab, volume.grid).size(), CellState::open),
      volume_(volume),
      grid_(volume.grid),
      slab_(slab),
      first_(volume::first_of(slab, volume.grid)),
      occupied_(occupied),
      tolerance_(tolerance) {}

/// Trilinear, from the corners of a box.
glm::vec3 AdaptiveGrid::between(const std::vector<glm::vec3>& values, const CellBox& box,
                                glm::ivec3 cell) const {
    const glm::vec3 f =
        glm::vec3(cell - box.lo) / glm::max(glm::vec3(box.hi - box.lo), glm::vec3(1.0f));
    glm::vec3 sum{0.0f};
    for (size_t i = 0; i < 8; ++i) {
        const glm::vec3 w{i & 1 ? f.x : 1.0f - f.x, i & 2 ? f.y : 1.0f - f.y,
                          i & 4 ? f.z : 1.0f - f.z};
        sum += w.x * w.y * w.z * values[index(box.corner(i))];
    }
    return sum;
}

/// The box of this edge (a power of two) that a cell belongs to, cut off by the grid's end.
CellBox AdaptiveGrid::box_around(glm::ivec3 cell, int edge) const {
    // The last cells belong to the box before them.
    const glm::ivec3 last = grid_.dims - 1;
    glm::ivec3 lo = cell & ~(edge - 1);
    for (int i = 0; i < 3; ++i)
        if (lo[i] == last[i] && lo[i] > 0)
            lo[i] -= edge;
    return {lo, glm::min(lo + edge, last)};
}

void AdaptiveGrid::want(const CellBox& box, int step, volume::Slab layers) {
    const glm::ivec3 last = grid_.dims - 1;
    const auto on = [&](int i, int axis) { return i % step == 0 || i == last[axis]; };
    for (int z = std::max(box.lo.z, layers.begin); z <= box.hi.z && z < layers.end; ++z)
        for (int y = box.lo.y; y <= box.hi.y; ++y)
            for (int x = box.lo.x; x <= box.hi.x; ++x)
                if (on(x, 0) && on(y, 1) && on(z, 2)) {
                    const size_t cell = index({x, y, z});
                    if (state[cell] != CellState::solved && volume_.validity[first_ + cell] > 0.0f)
                        state[cell] = CellState::wanted;
                }
}

/// Leaves the valid cells of a box that are not solved to interpolation.
void AdaptiveGrid::leave(const CellBox& box, int edge) {
    for (int z = box.lo.z; z <= box.hi.z; ++z)
        for (int y = box.lo.y; y <= box.hi.y; ++y)
            for (int x = box.lo.x; x <= box.hi.x; ++x) {
                const size_t cell = index({x, y, z});
                if (state[cell] == CellState::open && volume_.validity[first_ + cell] > 0.0f)
                    state[cell] = edge == coarse_edge ? CellState::between_4 : CellState::between_2;
            }
}

/// True if what lies in the box may be interpolated from its corners.
bool AdaptiveGrid::smooth(const CellBox& box, int edge) const {
    if (occupied_(box.lo, edge == 4 ? 2 : 1))
        return false;
    std::array<size_t, 8> corners;
    for (size_t i = 0; i < 8; ++i) {
        corners[i] = index(box.corner(i));
        if (state[corners[i]] != CellState::solved)
            return false;
    }
    const int bands = std::min(volume_.sh_order, 2);
    for (int channel = 0; channel < 3; ++channel) {
        std::array<double, 8> square{};
        double mean_0 = 0.0;
        size_t k = 0;
        for (int l = 0; l <= bands; ++l)
            for (const size_t end = size_t(volume::sh_count(l)); k < end; ++k) {
                double mean = 0.0;
                for (const size_t cell : corners)
                    mean += double(volume_.sh[k][cell][channel]) / 8.0;
                if (k == 0)
                    mean_0 = mean;
                for (size_t i = 0; i < 8; ++i) {
                    const double off = volume::sh_cosine_factor(l)
                                       * (double(volume_.sh[k][corners[i]][channel]) - mean);
                    square[i] += off * off;
                }
            }
        // Mean over the sphere: of the square, sum / 4 pi; of irradiance, A_0 c_0 Y_0.
        const double bound = double(tolerance_) * volume::sh_cosine_factor(0) * mean_0;
        for (const double s : square)
            if (!(s <= bound * bound))
                return false;
    }
    return true;
}

std::vector<CellBox> AdaptiveGrid::leave_smooth(int edge) {
    const glm::ivec3 last = grid_.dims - 1;
    std::vector<CellBox> rough;
    for (int z = slab_.begin; z == slab_.begin || z < last.z; z += edge)
        for (int y = 0; y == 0 || y < last.y; y += edge)
            for (int x = 0; x == 0 || x < last.x; x += edge) {
                const CellBox box{{x, y, z}, glm::min(glm::ivec3(x, y, z) + edge, last)};
                if (box.hi.z >= slab_.end)
                    return rough; // of other layers
                if (smooth(box, edge))
                    leave(box, edge);
                else
                    rough.push_back(box);
            }
    return rough;
}

std::vector<CellBox> AdaptiveGrid::leave_smooth_halves(const std::vector<CellBox>& boxes,
                                                       int edge) {
    std::vector<CellBox> rough;
    for (const CellBox& box : boxes)
        for (int i = 0; i < 8; ++i) {
            const glm::ivec3 lo = box.lo + edge * glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
            if (glm::any(glm::greaterThan(lo, box.hi)))
                continue;
            const CellBox half{lo, glm::min(lo + edge, box.hi)};
            if (smooth(half, edge))
                leave(half, edge);
            else
                rough.push_back(half);
        }
    return rough;
}

void AdaptiveGrid::interpolate(volume::Slab layers, Volume& volume) const {
    tbb::parallel_for(layers.begin, layers.end, [&](int z) {
        for (int y = 0; y < grid_.dims.y; ++y)
            for (int x = 0; x < grid_.dims.x; ++x) {
                const size_t cell = index({x, y, z});
                if (state[cell] != CellState::between_4 && state[cell] != CellState::between_2)
                    continue;
                const CellBox box =
                    box_around({x, y, z}, state[cell] == CellState::between_4 ? 4 : 2);
                for (std::vector<glm::vec3>& values : volume.sh)
                    values[cell] = between(values, box, {x, y, z});
            }
    });
}

uint64_t AdaptiveGrid::interpolated(volume::Slab layers) const {
    const auto from = state.begin() + std::ptrdiff_t(index({0, 0, layers.begin}));
    const auto to = state.begin() + std::ptrdiff_t(grid_.index({0, 0, layers.end}) - first_);
    return uint64_t(std::count_if(from, to, [](CellState each) {
        return each == CellState::between_4 || each == CellState::between_2;
    }));
}

} // namespace lpvbake::solver::gather
