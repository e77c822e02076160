// A sky from a picture.
#pragma once

#include "scene/scene.h"

#include <cstdint>
#include <string>
#include <vector>

namespace lpvbake {

/// Reads an equirectangular picture (see SkyMap) whose values times `scale` are nits, turned by
/// `turn` degrees around +Y, counter-clockwise from above. Texels that are negative or not finite,
/// or above 1e12 nits, count as 0 and give a warning, as does a picture that is not twice as wide
/// as high. Throws Error (file, invalid; also for more than `max_bytes` once it is unpacked).
Sky load_sky(const std::string& path, double scale, double turn, uint64_t max_bytes,
             std::vector<std::string>& warnings);

} // namespace lpvbake
