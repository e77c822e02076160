// A volume fitted to what a program shows of it, where nothing is known but the volume itself, and
// perhaps the scene's surfaces: what arrives at a point is what our own sampler reads there.
#pragma once

#include "bake/surface_fit.h"

namespace lpvbake::bake {

/// Points on the walls that the volume's cells know of (Volume::walls), nearest to each valid cell,
/// four each; with `others`, one each, in their midst. They are on the side of the cell, so that a
/// thin wall has points on both; empty where the volume has no walls.
std::vector<readers::FitPoint> wall_points(const Volume& volume, bool others = false);

/// Points on all sides of the scene's surfaces, as fit_points has them.
std::vector<readers::FitPoint> scene_points(Scene scene, const Volume& volume,
                                            const surface::SidePointSettings& settings,
                                            Progress& progress);

} // namespace lpvbake::bake
