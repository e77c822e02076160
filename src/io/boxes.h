// Files of boxes that adjust a bake:
//
//     {"boxes": [{"box": [x0, y0, z0, x1, y1, z1], metres,
//                 "set": "valid" | "invalid", "intensity": X}, ...]}
//
// with one of the two, or both.
#pragma once

#include "volume/adjust.h"

namespace lpvbake::io {

/// Throws Error: file; invalid (names the box and its property); unsupported ("finer" and
/// "coarser", which no grid of cells of one size can be set).
std::vector<volume::Adjustment> read_adjustments(const std::string& path);

} // namespace lpvbake::io
