// Volumes of one bake that stand beside each other, such as a room each. They may overlap: of those
// that hold a point the one of the highest priority is seen, faded into the others at its faces.
#pragma once

#include "lpvbake/volume.h"

#include <string>
#include <vector>

namespace lpvbake::volume {

/// How a volume stands among others.
struct Place {
    std::string name; ///< of letters, digits, '_', '-' and '.'
    int priority = 0; ///< the highest is seen; of equal ones that of smaller cells, then the first
    double falloff = 0; ///< metres inside of its faces over which it takes over from the others
};

/// What such a volume is asked for by.
struct VolumeBox {
    Place place;
    glm::dvec3 lo, hi;                   ///< metres
    double cell;                         ///< metres
    glm::dquat turn{1.0, 0.0, 0.0, 0.0}; ///< about the middle of the box
};

/// The box that `to_world` makes of that from lo to hi: an affine map without shear. Axes are those
/// of its edges that lie nearest to the world's, so that a box along these is not turned, whatever
/// quarter turns it has. Throws Error (argument), with the volume's name, for a map that shears,
/// flattens or is not finite.
VolumeBox box_in_world(const Place& place, glm::dvec3 lo, glm::dvec3 hi,
                       const glm::dmat4& to_world);

inline constexpr std::size_t most_places = 256;

/// Puts boxes of smaller cells first and gives each its grid, of whole cells around the box.
/// Throws Error (argument), naming the volume: names that are alike, or none; a box that is inside
/// out or has no inside; cells that cannot be told apart; too many volumes or cells.
std::vector<Grid> place_grids(std::vector<VolumeBox>& boxes);

/// The names of two whose grids overlap by more than a cell, as those that are rounded up
/// to whole ones do not; empty: none do.
std::pair<std::string, std::string> overlapping(const std::vector<Place>& places,
                                                const std::vector<Grid>& grids);

/// How far inside of a grid's cells a point (metres) lies; below 0: how far outside.
double depth_in(const Grid& grid, glm::dvec3 point);

} // namespace lpvbake::volume
