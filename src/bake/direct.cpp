#include "bake/direct.h"

#include "medium/beams.h"
#include "text.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

namespace lpvbake::bake {
namespace {

/// Sums coefficients onto the volume's.
void add_light(const std::vector<std::vector<glm::vec3>>& sh, Volume& volume) {
    const std::vector<volume::GridView> grids = volume::grids_of(volume, volume::direct_kind());
    tbb::parallel_for(std::size_t(0), grids.size(), [&](std::size_t k) {
        const std::span<float> values = grids[k].values();
        for (std::size_t cell = 0; cell < sh[k].size(); ++cell)
            for (int channel = 0; channel < 3; ++channel)
                values[3 * cell + std::size_t(channel)] += sh[k][cell][channel];
    });
}

} // namespace

void add_direct(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
                const scene::Frame& frame, solver::Stages& stages, Volume& volume) {
    const DirectSettings& settings = plan.settings.direct;
    if (!settings.any() || scene.lights.empty())
        return;
    stages.begin("beams", scene.lights.size());
    medium::BeamSettings beams;
    beams.per_cell = settings.beams;
    beams.sun_angle = settings.sun_angle;
    beams.order = settings.sh ? volume.sh_order : 0;
    if (settings.sh)
        volume::set_grids(volume, volume::direct_kind(), volume::sh_count(volume.sh_order));
    if (settings.visibility)
        volume::set_grids(volume, volume::visibility_kind(), int(scene.lights.size()));
    nlohmann::json names = nlohmann::json::array();
    uint64_t sent = 0;
    for (std::size_t i = 0; i < scene.lights.size(); ++i) {
        const medium::DirectLight light =
            medium::direct_light(scene.lights[i], visibility, frame, volume.walls, beams);
        sent += light.beams;
        names.push_back(scene.lights[i].name);
        if (settings.sh)
            add_light(light.sh, volume);
        if (settings.visibility)
            std::ranges::copy(
                light.visibility,
                volume::grids_of(volume, volume::visibility_kind())[i].values().begin());
        stages.progress().advance(1);
    }
    if (settings.visibility)
        volume.metadata["visibility"] =
            names.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    stages.end(counted(scene.lights.size(), "light") + ", " + counted(sent, "beam"));
}

} // namespace lpvbake::bake
