// --slice AXIS=INDEX, as info and diff take it.
#pragma once

#include "volume/grid.h"

#include <string>

namespace lpvbake {

struct Slice {
    int axis = 0; ///< 0 x, 1 y, 2 z
    int index = 0;
};

/// Reads "z=16". Throws Error (argument) for another form or a layer outside the grid.
Slice parse_slice(const std::string& text, const Grid& grid);

} // namespace lpvbake
