// Rooms of a scene, found from the air in it: a box each for a volume of its own.
#pragma once

#include "lpvbake/scene.h"
#include "volume/places.h"

#include <cstddef>
#include <string>
#include <vector>

namespace lpvbake::bake {

/// What parts rooms, metres.
struct RoomSettings {
    /// A ball of this radius does not pass from one room to the next: openings are narrower than
    /// its diameter, rooms wider.
    double radius = 0.6;
    double least_height = 1.5;
    std::size_t most_rooms = volume::most_places; ///< the largest
};

struct Rooms {
    /// "room1", "room2", ... by falling size, around the walls that face the air; where there are
    /// none one box, "all", of the scene. Cells and falloffs are left open (0, below 0).
    std::vector<volume::VolumeBox> boxes;
    std::size_t left_out = 0; ///< beyond the largest
    std::string detail;       ///< how they were found, for people
};

/// Finds them on a lattice of at most 2^22 cells of 5 cm or more over the scene, or where doors
/// would be lost in them over its crowd (scene::trimmed_bounds). A room is air in one piece that a
/// ball can roll through, with a place for one 1.3 times as large, that has surfaces above and
/// below it and on three of four sides, and does not lie inside of solids (their backs all around,
/// or, in a scene with light, no path to any); and what is left beside it, but for doorways and
/// windows. A box is turned about the vertical as most of the wall that its air lies before, by the
/// peak of a histogram over area. Takes time in proportion to cells and area of surfaces. Depends
/// on the scene alone.
Rooms find_rooms(const Scene& scene, const RoomSettings& settings = {});

} // namespace lpvbake::bake
