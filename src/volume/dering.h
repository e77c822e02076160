// Volumes without negative irradiance, for programs that show it.
#pragma once

#include "volume/volume.h"

#include <span>

namespace lpvbake::volume {

/// Least irradiance (lux) over all normals from canonical coefficients (nits) of order 0 to 2, one
/// colour: exact, up to rounding.
double least_irradiance(std::span<const float> coefficients);

/// Where the least irradiance of a cell is brought, as a share of its mean over normals: above 0 by
/// what rounding to half precision takes.
inline constexpr double dering_margin = 1.0 / 256;

/// Changes bands 1 and 2 where irradiance is negative (below dering_margin) towards any normal, as
/// little as can be in its mean square over normals, so that it is not; colour by colour. Band 0
/// stays, but where it is negative itself: that colour becomes 0. With order 1 a band 1 that is too
/// long is shortened. Bands above `order` (0 to 2) are not looked at; cells in geometry take part,
/// as trilinear readers read them. Returns the number of cells that changed.
std::size_t dering(Volume& volume, int order);

} // namespace lpvbake::volume
