#include "solver/outside.h"

#include "solver/models.h"
#include "text.h"
#include "visibility/validity.h"
#include "volume/adjust.h"
#include "volume/volume.h"

#include <algorithm>

namespace lpvbake::solver {

void find_validity(const Inputs& inputs, Stages& stages, Volume& volume) {
    stages.begin("validity");
    volume.validity = visibility::trace_validity(inputs.visibility, inputs.grid.dims);
    volume::adjust_validity(inputs.adjust, volume);
    stages.end(outside_geometry(volume.validity));
}

double validity_seconds(const Grid& grid) {
    return models::seconds::validity_cell * double(grid.size())
           / std::max({grid.dims.x, grid.dims.y, grid.dims.z});
}

std::string outside_geometry(std::span<const float> validity) {
    const auto valid = std::ranges::count(validity, 1.0f);
    return format("%.1f %% of the cells outside geometry",
                  100.0 * double(valid) / double(validity.size()));
}

} // namespace lpvbake::solver
