// Which cells of a lattice lie outside solids, from what lines through their centres meet.
#pragma once

#include "visibility/visibility.h"

#include <span>

namespace lpvbake::visibility {

/// The lines along one axis of a lattice of unit cells, cell (i, j, k) spanning [i, i+1] x ... in
/// frame units.
class AxisLines {
public:
    AxisLines(const Visibility& visibility, glm::ivec3 dims, int axis);

    const int axis, u, v; ///< u and v follow `axis` in the cycle x, y, z

    /// Index (x fastest, z slowest) of the cell with coordinate i on the axis, j on u, k on v.
    size_t cell(int i, int j, int k) const;
    /// All crossings of the line through the centres of cells (*, j, k), shifted across the axis;
    /// Crossing::t becomes the coordinate on the axis.
    void trace(int j, int k, glm::vec2 shift, float from, float to,
               std::vector<Crossing>& crossings) const;
    /// The same from and to beyond whatever the line meets near the lattice, and a hair beside the
    /// centres (capture.h).
    void trace(int j, int k, std::vector<Crossing>& crossings) const;

private:
    const Visibility& visibility_;
    glm::ivec3 dims_;
    float begin_, end_;
};

/// For each centre i + 1/2 on a line: backs less fronts among the nearest surface before it and the
/// nearest behind it, as seen from the centre; double-sided ones do not count.
void count_backs(std::span<const Crossing> crossings, std::span<int8_t> backs);

/// 1 a cell, 0 where more of the six axis rays from where its light is taken meet a back than a
/// front first, and where it is taken nowhere (capture.h).
std::vector<float> trace_validity(const Visibility& visibility, glm::ivec3 dims);

/// The same from the sums of count_backs over the three axes, and what is on_surfaces
/// (cells_on_surfaces).
std::vector<float> validity_of(const Visibility& visibility, glm::ivec3 dims,
                               std::span<const int8_t> backs, std::span<const size_t> on_surfaces);

} // namespace lpvbake::visibility
