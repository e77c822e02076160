// Boxes in which somebody knows better than a bake which cells are valid, or how bright they are to
// be.
#pragma once

#include "lpvbake/volume.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::volume {

/// Of all cells whose centres lie in it, its faces included.
struct Adjustment {
    glm::dvec3 lo, hi; ///< metres
    /// Whatever geometry says: true, the cell counts as outside of solids; false, as inside.
    std::optional<bool> valid;
    double intensity = 1; ///< their light is multiplied by it
    /// Where cells are in axes that were turned about a point: from those to the box's.
    glm::dquat turn{1.0, 0.0, 0.0, 0.0};
    glm::dvec3 about{0.0};
};

/// Whether any cell lies in it.
bool holds_cells(const Adjustment& box, const Grid& grid);

/// Sets Volume::validity, which is there, box by box: of several that hold a cell the last counts.
void adjust_validity(std::span<const Adjustment> boxes, Volume& volume);
/// Multiplies Volume::sh, by all boxes that hold a cell.
void adjust_intensity(std::span<const Adjustment> boxes, Volume& volume);

/// As metadata have them: "X0,Y0,Z0,X1,Y1,Z1 valid intensity 2; ...".
std::string text_of(std::span<const Adjustment> boxes);

} // namespace lpvbake::volume
