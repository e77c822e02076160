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

/// dims, cell, origin and the number of cells; of a turned one its turn.
inline Json grid_json(const Grid& grid) {
    Json json{{"dims", vector_json(grid.dims)},
              {"cell", grid.cell},
              {"origin", vector_json(grid.origin)},
              {"cells", grid.size()}};
    if (const glm::dquat& turn = grid.turn; grid.is_turned())
        json["turn"] = {turn.x, turn.y, turn.z, turn.w};
    return json;
}

} // namespace lpvbake::report
