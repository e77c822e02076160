// Parts of documents.
#pragma once

#include "volume/grid.h"

#include <nlohmann/json.hpp>

namespace lpvbake::report {

using Json = nlohmann::ordered_json;

template <class T>
Json vector_json(glm::vec<3, T> v) {
    return {v.x, v.y, v.z};
}

/// dims, cell, origin and the number of cells.
inline Json grid_json(const Grid& grid) {
    return {{"dims", vector_json(grid.dims)},
            {"cell", grid.cell},
            {"origin", vector_json(grid.origin)},
            {"cells", grid.size()}};
}

} // namespace lpvbake::report
