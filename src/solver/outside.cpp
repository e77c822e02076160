#include "solver/outside.h"

#include "solver/models.h"
#include "text.h"
#include "visibility/validity.h"
#include "volume/adjust.h"
#include "volume/sh.h"
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

void keep_slab(const Inputs& inputs, Volume& volume) {
    if (!inputs.slab)
        return;
    volume::cut(volume::all_of(inputs.grid), *inputs.slab, inputs.grid, volume.validity);
    volume.grid = volume::grid_of(*inputs.slab, inputs.grid);
}

Grid solved_grid(const Workload& work, int halo) {
    const Grid& grid = work.grid;
    return work.slab ? volume::grid_of(volume::widened(*work.slab, halo, grid), grid) : grid;
}

uint64_t beside_slab_bytes(const Workload& work, int halo, int order) {
    if (!work.slab)
        return 0;
    const uint64_t around =
        solved_grid(work, halo).size() - volume::grid_of(*work.slab, work.grid).size();
    return 8 * work.grid.size() + around * sizeof(glm::vec3) * uint64_t(volume::sh_count(order));
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
