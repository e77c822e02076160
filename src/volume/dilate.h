// Values for cells inside geometry, for readers that cannot leave those out.
#pragma once

#include "volume/volume.h"

namespace lpvbake::volume {

/// Fills the spherical harmonics of cells that are not valid from the cells around them, `rings`
/// times one cell further in: each cell of a ring gets the mean of those of its 26 neighbours that
/// are valid or of an earlier ring, weighted by 1 / distance. Where it lies between two sides of a
/// wall, by the planes (Volume::walls) of the neighbours, or of the valid cells that those were
/// filled from, the side that it lies deeper behind counts by 1 - 4 times the cells of depth that
/// it is farther, where that is positive: a cell inside a wall shows the light of the side that it
/// is nearer to, and not the mean of both. Valid cells and the validity stay as they are, and so do
/// cells deeper in. Returns the number of cells that were filled; 0 for a volume without validity.
std::size_t dilate(Volume& volume, int rings);

} // namespace lpvbake::volume
