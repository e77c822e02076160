// A look at one slice of a volume.
#pragma once

#include "image/image.h"
#include "volume/volume.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::io {

/// How luminance becomes grey: (luminance / white)^exponent, clipped, is what a screen shows.
struct SliceScale {
    float white = 1;    ///< nits
    float exponent = 1; ///< below 1 it lifts what is dark

    /// Luminance that shows as this sRGB-encoded grey, 0 to 1.
    double luminance_at(double grey) const;
};

/// By what is lit of the slice's cells outside geometry (colour/metering.h): white is the 99th
/// percentile; where that is above ten times the median, the exponent shows the median as a tenth.
/// Throws Error (argument) for a slice that does not exist.
SliceScale slice_scale(const Volume& volume, int axis, int index);

/// Draws the cells with index `index` along `axis` (0 x, 1 y, 2 z): the mean luminance over all
/// directions (c_0 / (2 sqrt(pi)), nits) in its colour, sRGB-encoded; without a scale by
/// slice_scale. Every cell is a square of equal pixels, as large as it takes for a longer side of
/// 256 pixels. Cells inside geometry are hatched in dark magenta.
///
/// z slices show x to the right and y up; y slices x to the right and z down, as seen from above;
/// x slices z to the right and y up. RGB. Throws Error (argument) for a slice that does not exist.
image::Pixels slice_picture(const Volume& volume, int axis, int index,
                            std::optional<SliceScale> scale = {});

/// Error as colour: black at 0, over red and yellow to white at 1 and above.
glm::vec3 false_colour(double share);

/// Which error is drawn white: the 99th percentile of those above 0, but at most six times their
/// median, so that one bad spot leaves the rest visible. 1 if there are none; finite.
double error_white(std::vector<float> errors);

/// Writes an 8-bit PNG; samples are display-referred values, clamped to [0, 1]. Atomic. Throws
/// Error (file).
void write_png(const std::string& path, const image::Pixels& pixels);

} // namespace lpvbake::io
