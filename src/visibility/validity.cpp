#include "visibility/validity.h"

#include "lpvbake/volume.h"
#include "visibility/capture.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::visibility {

AxisLines::AxisLines(const Visibility& visibility, glm::ivec3 dims, int axis_)
    : axis(axis_),
      u((axis_ + 1) % 3),
      v((axis_ + 2) % 3),
      visibility_(visibility),
      dims_(dims) {
    // Far enough to meet what lies beyond the grid, near enough for single precision.
    const float n = float(dims[axis]);
    begin_ = std::clamp(visibility.lo()[axis] - 1.0f, -2.0f * n, 0.0f);
    end_ = std::clamp(visibility.hi()[axis] + 1.0f, n, 3.0f * n);
}

size_t AxisLines::cell(int i, int j, int k) const {
    glm::ivec3 c;
    c[axis] = i;
    c[u] = j;
    c[v] = k;
    return size_t(c.x) + size_t(dims_.x) * (size_t(c.y) + size_t(dims_.y) * size_t(c.z));
}

void AxisLines::trace(int j, int k, glm::vec2 shift, float from, float to,
                      std::vector<Crossing>& crossings) const {
    Ray ray{glm::vec3(0.0f), glm::vec3(0.0f), 0.0f, to - from};
    ray.origin[axis] = from;
    ray.origin[u] = float(j) + 0.5f + shift.x;
    ray.origin[v] = float(k) + 0.5f + shift.y;
    ray.direction[axis] = 1.0f;
    visibility_.crossings(ray, crossings);
    for (Crossing& crossing : crossings)
        crossing.t += from;
}

void AxisLines::trace(int j, int k, std::vector<Crossing>& crossings) const {
    trace(j, k, aside, begin_, end_, crossings);
}

void count_backs(std::span<const Crossing> crossings, std::span<int8_t> backs) {
    size_t next = 0;
    for (size_t i = 0; i < backs.size(); ++i) {
        const float at = float(i) + 0.5f;
        while (next < crossings.size() && crossings[next].t <= at)
            ++next;
        const auto before = crossings.first(next), behind = crossings.subspan(next);
        int vote = 0;
        if (!behind.empty())
            vote += backs_met(behind);
        if (!before.empty())
            vote += backs_met(before, true);
        backs[i] = int8_t(vote);
    }
}

std::vector<float> trace_validity(const Visibility& visibility, glm::ivec3 dims) {
    std::vector<int8_t> backs(size_t(dims.x) * size_t(dims.y) * size_t(dims.z), 0);
    for (int axis = 0; axis < 3; ++axis) {
        const AxisLines lines(visibility, dims, axis);
        const int n = dims[axis];
        tbb::parallel_for(0, dims[lines.v], [&](int k) {
            std::vector<Crossing> crossings;
            std::vector<int8_t> own(static_cast<size_t>(n));
            for (int j = 0; j < dims[lines.u]; ++j) {
                lines.trace(j, k, crossings);
                count_backs(crossings, own);
                for (int i = 0; i < n; ++i)
                    backs[lines.cell(i, j, k)] += own[size_t(i)];
            }
        });
    }
    return validity_of(visibility, dims, backs, cells_on_surfaces(visibility, dims));
}

std::vector<float> validity_of(const Visibility& visibility, glm::ivec3 dims,
                               std::span<const int8_t> backs, std::span<const size_t> on_surfaces) {
    std::vector<float> validity(backs.size());
    std::transform(backs.begin(), backs.end(), validity.begin(),
                   [](int8_t count) { return count > 0 ? 0.0f : 1.0f; });
    const Grid lattice{{}, 1.0, dims};
    tbb::parallel_for(size_t(0), on_surfaces.size(), [&](size_t i) {
        const Capture capture = visibility.capture(lattice.cell_at(on_surfaces[i]));
        validity[on_surfaces[i]] =
            capture.open && backs_around(visibility, capture.point, 0) <= 0 ? 1.0f : 0.0f;
    });
    return validity;
}

} // namespace lpvbake::visibility
