// Boxes in which somebody knows better than a bake which cells are valid, how bright they are to
// be, or how small.
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
    /// Of bricks alone: true, the finest stand wherever they meet it; false, no finer one stands in
    /// it for its own sake.
    std::optional<bool> finer;
    /// Where cells are in axes that were turned about a point: from those to the box's.
    glm::dquat turn{1.0, 0.0, 0.0, 0.0};
    glm::dvec3 about{0.0};
};

/// Whether any cell lies in it.
bool holds_cells(const Adjustment& box, const Grid& grid);

/// Sets Volume::validity, which is there, box by box: of several that hold a cell the last counts.
void adjust_validity(std::span<const Adjustment> boxes, Volume& volume);
/// The same of one point, which lies in a box if it is less than `slack` metres outside; none: no
/// box says.
std::optional<bool> validity_at(std::span<const Adjustment> boxes, glm::dvec3 point, double slack);
/// Multiplies Volume::sh, by all boxes that hold a cell.
void adjust_intensity(std::span<const Adjustment> boxes, Volume& volume);

/// As metadata have them: "X0,Y0,Z0,X1,Y1,Z1 valid intensity 2; ...".
std::string text_of(std::span<const Adjustment> boxes);

} // namespace lpvbake::volume
