// Files of boxes that adjust a bake:
//
//     {"boxes": [{"box": [x0, y0, z0, x1, y1, z1], metres,
//                 "set": "valid" | "invalid", "intensity": X}, ...]}
//
// with one of the two, or both; and of boxes that volumes are baked in:
//
//     {"volumes": [{"name": "hall", "box": [x0, y0, z0, x1, y1, z1], metres,
//                   "cell": metres, "priority": whole number (0), "falloff": metres,
//                   "rotation": [x, y, z, w], a quaternion by which the box is turned about its
//                   middle, or "transform": [16 numbers], a matrix column by column that places it,
//                   without shear}, ...]}
//
// of which "name" and "box" or "transform" are there; a transform alone places a unit cube around
// 0.
#pragma once

#include "volume/adjust.h"
#include "volume/places.h"

namespace lpvbake::io {

/// Throws Error: file; invalid (names the box and its property); unsupported ("finer" and
/// "coarser", which no grid of cells of one size can be set).
std::vector<volume::Adjustment> read_adjustments(const std::string& path);

/// A cell of 0 and a falloff below 0 where the file has none. Throws Error: file; invalid (names
/// the box and its property); argument (as volume::box_in_world).
std::vector<volume::VolumeBox> read_boxes(const std::string& path);

} // namespace lpvbake::io
