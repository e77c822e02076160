// A slice with what is needed to read it.
#pragma once

#include "image/image.h"
#include "volume/volume.h"

#include <functional>
#include <string>

namespace lpvbake::io {

/// What the colours of a slice stand for.
struct Legend {
    std::string title;                             ///< as "z = 16, nits"
    std::function<glm::vec3(double share)> colour; ///< sRGB-encoded, share 0 to 1 along the bar
    std::function<double(double share)> value;     ///< what that colour stands for
};

/// The slice (slice_picture of this grid and axis) between its axes, in metres, with the legend
/// above as a bar from dark to bright with numbers under it. Letters that there are none of are
/// left blank: there are those of numbers, axes and units.
image::Pixels chart(const image::Pixels& slice, const Grid& grid, int axis, const Legend& legend);

} // namespace lpvbake::io
