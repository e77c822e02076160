// Reading a field between its cells, at a point of a surface.
#pragma once

#include "volume/volume.h"

#include <array>
#include <cstddef>

namespace lpvbake {

/// How the eight cells whose centres surround a point become one value.
enum class Reading {
    /// Trilinear weights, whatever the cells are: light of cells inside and behind walls leaks in.
    trilinear,
    /// Trilinear weights times max(0, n.d)^2, d the direction from the point to a cell's centre,
    /// times what the cell's walls let pass, of valid cells only, scaled to a sum of 1. Each wall w
    /// (Volume::walls) lets pass clamp((w.w - w.x) / (0.2 |w|), 0, 1), where x, in cells, is the
    /// point, lifted by 0.2 cells along n, as seen from the cell's centre: 0 behind the wall.
    ///
    /// What no such cell surrounds is read from the nearest one (valid, n.d > 0, before its walls,
    /// less than 2 cells away) of the 4 x 4 x 4 around; then as if there were no walls; then from
    /// the valid ones of the eight by their trilinear weights; then from the nearest valid one of
    /// the 4 x 4 x 4 (the first by index of equally near ones); else it is dark.
    facing,
};

/// Cells (Grid::index) and their weights, which sum to 1; all are 0 where nothing can be read.
struct CellWeights {
    std::array<std::size_t, 8> cell{};
    std::array<double, 8> weight{};
};

/// The weights at a point (metres) of a surface with unit normal n. Beyond the outermost centres
/// the lattice is clamped. A volume without a grid of validity is valid everywhere.
CellWeights weights_at(const Volume& volume, glm::dvec3 point, glm::dvec3 n, Reading reading);

/// Irradiance (lux, RGB) that the field gives a surface point (metres) of unit normal n, from all
/// the bands that the volume has; 0 where that is negative.
glm::dvec3 read_irradiance(const Volume& volume, glm::dvec3 point, glm::dvec3 n, Reading reading);

} // namespace lpvbake
