#include "solver/outside.h"

#include "solver/models.h"
#include "text.h"
#include "visibility/validity.h"
#include "volume/adjust.h"
#include "volume/volume.h"

#include <algorithm>

namespace lpvbake::solver {

namespace {

std::vector<float> kept_validity(const Inputs& inputs) {
    const auto make = [&] {
        return visibility::trace_validity(inputs.visibility, inputs.grid.dims);
    };
    if (!inputs.cache)
        return make();
    cache::Key key = inputs.cache->key("validity");
    key.add(inputs.frame.origin, inputs.frame.unit, inputs.grid.dims);
    std::vector<float> validity;
    if (!inputs.cache->get(key, [&](cache::Reader& in) {
            return in.get(validity) && validity.size() == inputs.grid.size();
        })) {
        validity = make();
        inputs.cache->put(key, [&](cache::Writer& out) { out.put(validity); });
    }
    return validity;
}

} // namespace

void find_validity(const Inputs& inputs, Stages& stages, Volume& volume) {
    stages.begin("validity");
    volume.validity = kept_validity(inputs);
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
