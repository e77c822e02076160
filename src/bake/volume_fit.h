// A volume fitted to what a program shows of it, where nothing is known but the volume itself, and
// perhaps the scene's surfaces: what arrives at a point is what our own sampler reads there.
#pragma once

#include "bake/surface_fit.h"

namespace lpvbake::bake {

/// Points on the walls that the volume's cells know of (Volume::walls), nearest to each valid cell:
/// four each, and one in their midst to check. They are on the side of the cell, so that a thin
/// wall has points on both; none where the volume has no walls.
SurfacePoints wall_points(const Volume& volume);

/// Points on all sides of the scene's surfaces, as fit_points has them.
SurfacePoints scene_points(Scene scene, const Volume& volume, Progress& progress);

} // namespace lpvbake::bake
