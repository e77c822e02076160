#include "solver/sn/host_sweeper.h"

#include "solver/sn/directions.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::sn {
namespace {

/// Cells side by side.
constexpr int side_by_side = 8;
using Floats = float __attribute__((vector_size(side_by_side * sizeof(float))));
/// Where these lie in memory.
using Stored = float
    __attribute__((vector_size(side_by_side * sizeof(float)), aligned(alignof(float)), may_alias));

/// Places along u, x or y, of a row, with those beside the grid; so many that eight from any cell
/// on are there.
size_t row_pitch(const Grid& grid) {
    return size_t(std::max(grid.dims.x, grid.dims.y)) + 2 + side_by_side;
}

/// What arrives in a row from the plane before: a direction's taps are at `near` and `far`, rows of
/// places, and `back` places before.
[[gnu::always_inline]] inline void carry_row(const float* near, const float* far, ptrdiff_t back,
                                             glm::vec4 weights, float* to, size_t cells) {
    size_t i = 0;
    for (; i + side_by_side <= cells; i += side_by_side) {
        const Floats a = *reinterpret_cast<const Stored*>(near + i);
        const Floats b = *reinterpret_cast<const Stored*>(near + i - back);
        const Floats c = *reinterpret_cast<const Stored*>(far + i);
        const Floats d = *reinterpret_cast<const Stored*>(far + i - back);
        *reinterpret_cast<Stored*>(to + i) =
            (weights.x * a + weights.y * b) + (weights.z * c + weights.w * d);
    }
    for (const float *a = near, *b = near - back, *c = far, *d = far - back; i < cells; ++i)
        to[i] = (weights.x * a[i] + weights.y * b[i]) + (weights.z * c[i] + weights.w * d[i]);
}

/// Adds a channel of eight cells' luminance to `Count` of their coefficients; of some of them,
/// where the row ends. The weights are `coefficients` a direction; the sums `step` apart.
template <int Count>
[[gnu::always_inline]] inline void
project_eight(const float* luminance, size_t pitch, size_t directions, const float* weights,
              size_t coefficients, float* sums, ptrdiff_t step, int cells) {
    Floats sum[Count];
    for (int k = 0; k < Count; ++k)
        for (int i = 0; i < side_by_side; ++i)
            sum[k][i] = i < cells ? sums[i * step + 3 * k] : 0.0f;
    for (size_t d = 0; d < directions; ++d, luminance += 3 * pitch, weights += coefficients) {
        const Floats arrives = *reinterpret_cast<const Stored*>(luminance);
        for (int k = 0; k < Count; ++k)
            sum[k] += weights[k] * arrives;
    }
    for (int k = 0; k < Count; ++k)
        for (int i = 0; i < cells; ++i)
            sums[i * step + 3 * k] = sum[k][i];
}

struct ProjectedRow {
    const float* luminance; ///< of the first cell, the first direction's first channel
    size_t pitch, directions;
    const float* weights;
    size_t coefficients;
    float* sums; ///< of the first cell
    ptrdiff_t step;
    int cells;
};

/// `Count` coefficients at a time: as many as there are registers for.
template <int Count>
[[gnu::always_inline]] inline void project_row(const ProjectedRow& row) {
    for (int first = 0; first < row.cells; first += side_by_side)
        for (size_t k = 0; k < row.coefficients; k += Count)
            for (size_t channel = 0; channel < 3; ++channel)
                project_eight<Count>(row.luminance + channel * row.pitch + first, row.pitch,
                                     row.directions, row.weights + k, row.coefficients,
                                     row.sums + first * row.step + 3 * ptrdiff_t(k)
                                         + ptrdiff_t(channel),
                                     row.step, std::min(side_by_side, row.cells - first));
}

[[gnu::always_inline]] inline void project_any(const ProjectedRow& row) {
    switch (row.coefficients) {
    case 4:
        return project_row<4>(row);
    case 9:
        return project_row<9>(row);
    case 16:
        return project_row<8>(row);
    default:
        return project_row<5>(row); // 25
    }
}

// The same for processors that take eight floats at once. Products and sums are rounded one by one
// there, too: fused ones are of another extension.
#ifdef __x86_64__
[[gnu::target("avx2")]] void carry_wide(const float* near, const float* far, ptrdiff_t back,
                                        glm::vec4 weights, float* to, size_t cells) {
    carry_row(near, far, back, weights, to, cells);
}
[[gnu::target("avx2")]] void project_wide(const ProjectedRow& row) {
    project_any(row);
}
bool is_wide() {
    static const bool wide = __builtin_cpu_supports("avx2");
    return wide;
}
#else
constexpr auto carry_wide = carry_row;
constexpr auto project_wide = project_any;
constexpr bool is_wide() {
    return false;
}
#endif

} // namespace

HostSweeper::HostSweeper(const Grid& grid, uint32_t directions, int order)
    : grid_(grid),
      directions_(directions),
      coefficients_(size_t(volume::sh_count(order))),
      pitch_(row_pitch(grid)),
      sums_(grid.size() * 3 * coefficients_) {}

void HostSweeper::begin(const Course& course, const Directions& directions,
                        std::span<const glm::vec4> beyond) {
    course_ = &course;
    table_ = &directions;
    const size_t rows = size_t(course.layout.dims.y) + 2;
    for (std::vector<float>* plane : {&before_, &here_}) {
        plane->resize(rows * directions_ * 3 * pitch_);
        tbb::parallel_for(size_t(0), rows, [&](size_t v) {
            float* to = row(*plane, int(v) - 1);
            for (size_t d = 0; d < directions_; ++d)
                for (int channel = 0; channel < 3; ++channel, to += pitch_)
                    std::fill_n(to, pitch_, beyond[d][channel]);
        });
    }
}

void HostSweeper::run(const PlaneOrder& order, const Chunk& chunk) {
    const int rows = course_->layout.dims.y;
    for (int plane = chunk.begin; plane < chunk.end; ++plane) {
        tbb::parallel_for(-1, rows + 1, [&](int v) {
            const bool cells = plane > 0 && v >= 0 && v < rows;
            if (cells)
                carry(v);
            put_given(order, chunk, plane, v);
            if (cells)
                project(plane, v);
        });
        std::swap(before_, here_);
    }
}

void HostSweeper::carry(int v) {
    const size_t cells = size_t(course_->layout.dims.x);
    for (size_t d = 0; d < directions_; ++d) {
        const glm::ivec3 signs = course_->signs(int(d % quadrants));
        const glm::vec4 weights = table_->table[direction_vec4s * d];
        for (size_t channel = 0; channel < 3; ++channel) {
            const size_t at = (3 * d + channel) * pitch_ + 1;
            (is_wide() ? carry_wide
                       : carry_row)(row(before_, v) + at, row(before_, v - signs[course_->v]) + at,
                                    signs[course_->u], weights, row(here_, v) + at, cells);
        }
    }
}

void HostSweeper::put_given(const PlaneOrder& order, const Chunk& chunk, int plane, int v) {
    const size_t of_each = directions_ / quadrants;
    const uint32_t first_slot = course_->layout.slot(-1, v), pitch = course_->layout.pitch();
    float* const to = row(here_, v);
    for (size_t group = size_t(quadrants * plane); group < size_t(quadrants * (plane + 1));
         ++group) {
        const auto end = order.given.begin() + order.first[group + 1];
        auto place =
            std::partition_point(order.given.begin() + order.first[group], end,
                                 [&](const SnPlace& each) { return each.slot() < first_slot; });
        for (; place != end && place->slot() < first_slot + pitch; ++place) {
            const size_t index = size_t(place - order.given.begin()) - order.first_of(chunk.begin);
            for (size_t i = 0; i < of_each; ++i)
                for (size_t channel = 0; channel < 3; ++channel)
                    to[(3 * (quadrants * i + place->quadrant()) + channel) * pitch_
                       + (place->slot() - first_slot)] =
                        chunk.given[index * of_each + i][int(channel)];
        }
    }
}

void HostSweeper::project(int plane, int v) {
    const glm::ivec3 first = course_->cell(0, v, plane);
    glm::ivec3 next = first;
    ++next[course_->u];
    const size_t floats = 3 * coefficients_;
    const size_t step = grid_.dims[course_->u] > 1 ? grid_.index(next) - grid_.index(first) : 0;
    (is_wide() ? project_wide : project_any)(
        {row(here_, v) + 1, pitch_, directions_, table_->weights.data(), coefficients_,
         &sums_[grid_.index(first) * floats], ptrdiff_t(step * floats), course_->layout.dims.x});
}

void HostSweeper::add_to(const Grid& grid, glm::ivec3 at, std::vector<std::vector<glm::vec3>>& sh) {
    tbb::parallel_for(0, grid_.dims.z, [&](int z) {
        for (int y = 0; y < grid_.dims.y; ++y) {
            const float* c = &sums_[3 * coefficients_ * grid_.index({0, y, z})];
            const size_t row = grid.index(at + glm::ivec3(0, y, z));
            for (size_t x = 0; x < size_t(grid_.dims.x); ++x, c += 3 * coefficients_)
                for (size_t k = 0; k < coefficients_; ++k)
                    sh[k][row + x] += glm::vec3(c[3 * k], c[3 * k + 1], c[3 * k + 2]);
        }
    });
}

namespace {

/// Of both planes, along a direction.
uint64_t plane_bytes(const Grid& grid) {
    const uint64_t rows = uint64_t(std::max(grid.dims.y, grid.dims.z)) + 2;
    return 2 * rows * 3 * row_pitch(grid) * sizeof(float);
}

} // namespace

uint32_t host_directions(const Grid& grid, int directions) {
    // Of the planes; the coefficients of a cell take five times as much at order 2.
    constexpr uint64_t usual = uint64_t(64) << 20, of_cell = 20;
    const uint64_t all = uint64_t(directions / Course::count / int(quadrants));
    const uint64_t fit = std::max(usual, of_cell * grid.size()) / (quadrants * plane_bytes(grid));
    return quadrants * uint32_t(std::clamp<uint64_t>(fit, 1, all));
}

uint64_t host_sweep_bytes(const Grid& grid, int directions, int order) {
    return grid.size() * 3 * uint64_t(volume::sh_count(order)) * sizeof(float)
           + host_directions(grid, directions) * plane_bytes(grid);
}

} // namespace lpvbake::solver::sn
