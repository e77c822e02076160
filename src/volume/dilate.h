// Values for cells inside geometry, for readers that cannot leave those out.
#pragma once

#include "volume/volume.h"

namespace lpvbake::volume {

/// Fills the spherical harmonics of cells that are not valid from the cells around them, `rings`
/// times one cell further in: each cell of a ring gets the mean of those of its 26 neighbours that
/// are valid or of an earlier ring, weighted by 1 / distance. Valid cells and the validity stay as
/// they are, and so do cells deeper in. It knows no walls: a wall with one layer of cells in it
/// gets the mean of both its sides. Returns the number of cells that were filled; 0 for a volume
/// without validity.
std::size_t dilate(Volume& volume, int rings);

} // namespace lpvbake::volume
