// Mip levels of a base colour texture that keep its mean.
#pragma once

#include "scene/scene.h"

#include <vector>

namespace lpvbake::raster {

/// Levels from `first` (0: the image itself) down to 1x1, each half the one before, rounded down.
/// Means are taken in linear light over exactly the area that a texel covers; colours are weighted
/// by alpha if `weighted`, so that what a cut-out hides does not bleed into what it shows.
std::vector<Image> mip_levels(const Image& image, int first, bool weighted);

} // namespace lpvbake::raster
