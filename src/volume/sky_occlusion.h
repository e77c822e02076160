// What Unity's Adaptive Probe Volumes keep of a sky: how much of its light comes to a cell.
#pragma once

#include "volume/volume.h"

namespace lpvbake::volume {

/// Gives `volume` the grids of sky_occlusion_kind() and sky_direction_kind() by the light (nits, at
/// least order 1, of the same lattice) that a white sky of luminance 1 gives it, seen and
/// reflected. The numbers are (c_0; 2/3 c_y, 2/3 c_z, 2/3 c_x) of its luminance: irradiance over pi
/// on a plane of normal n is 0.282095 of the first and 0.488603 n.v of the others. APV multiplies
/// its ambient probe by that (EvalSHSkyOcclusion of ProbeVolume.hlsl, whose order is the first, x,
/// y, z), and looks it up along the direction: that of band 1, 0 where there is none.
void add_sky_occlusion(const Volume& white, Volume& volume);

} // namespace lpvbake::volume
