// Which cells are read at a point of a surface, between their centres.
#pragma once

#include "lpvbake/volume.h"

#include <array>
#include <cstddef>

namespace lpvbake::volume {

/// Cells (Grid::index) and their weights, which sum to 1; all are 0 where nothing can be read.
struct CellWeights {
    std::array<std::size_t, 8> cell{};
    std::array<double, 8> weight{};
    bool clear = true; ///< Reading::facing: they see the point, none stands for those that would
};

/// The weights at a point (metres) of a surface with unit normal n. Beyond the outermost centres
/// the lattice is clamped. A volume without a grid of validity is valid everywhere.
CellWeights weights_at(const Volume& volume, glm::dvec3 point, glm::dvec3 n, Reading reading);

} // namespace lpvbake::volume
