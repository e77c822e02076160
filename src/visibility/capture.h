// Where the light of a cell is taken: its centre, unless that lies on a surface.
//
// What lies exactly on a plane lies on either side of it by rounding. So a centre less than
// surface_margin away from a surface is not asked for light, and not for its side: the point is
// moved to the open side of all surfaces within that margin, to be the margin before each of them
// (Unity's probe volumes call it virtual offset, RTXGI relocation). The open side of a surface is
// that of its front. Of one with two fronts, and of those that face each other's backs, as a thin
// wall's do, it is the side that is closed in: where at least two more of the six axis rays end on
// fronts, less those that end on backs, than on any other side. Where no side stops three of them,
// as on open ground, it is that of the triangles' fronts all the same. Between sides that are both
// closed in, as in a wall between rooms, or where what surrounds the cell leaves no room, the cell
// takes no light: it is not valid.
#pragma once

#include "lpvbake/volume.h"
#include "visibility/visibility.h"

#include <span>
#include <vector>

namespace lpvbake::visibility {

/// Cells: how far from a cell's centre its light is taken at most. Out of a right corner it is the
/// root of 3 margins.
inline constexpr float farthest_capture = 4.0f * surface_margin;

/// Cells: how far beside points of the lattice lines along its axes run, so that what lies along
/// them, as edges of what is modelled on a lattice do, is on one side of a line by more than
/// rounding. Two lengths, so that diagonals are none to it, and less than surface_margin.
inline constexpr glm::vec2 aside{0.0031f, 0.0047f};

/// Of a cell less than surface_margin from a surface; `centre` in frame units.
Capture find_capture(const Visibility& visibility, glm::vec3 centre,
                     std::span<const NearSurface> near);

/// Cells (x fastest, z slowest; rising) of a lattice less than surface_margin from a surface.
std::vector<size_t> cells_on_surfaces(const Visibility& visibility, glm::ivec3 dims);

/// What a line meets first, of the surfaces on it by rising t, or by falling t on the `way_back`: 1
/// for a back, -1 for a front, `both` for what is double-sided. What lies within surface_margin of
/// the first counts with it, a front before all: of sheets that lie on each other none is first.
int backs_met(std::span<const Crossing> crossings, bool way_back = false, int both = 0);

/// The sum over the six axis rays from a point, or a hair beside it.
int backs_around(const Visibility& visibility, glm::vec3 point, int both);

} // namespace lpvbake::visibility
