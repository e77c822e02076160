#include "bake/air.h"

#include "bake/direct.h"
#include "text.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::bake {

void set_air_grids(const medium::Medium& medium, Volume& volume) {
    volume::set_grids(volume, volume::kind_named("scatter"), 1);
    if (medium.g != 0)
        volume::set_grids(volume, volume::kind_named("scattered"),
                          volume::sh_count(volume.sh_order));
    volume::set_grids(volume, volume::kind_named("extinction"), 1);
}

DirectInAir direct_in_air(const Scene& scene, const BakePlan& plan,
                          const visibility::Visibility& visibility, const scene::Frame& frame,
                          const Volume& volume, int order, Progress& progress) {
    medium::BeamSettings beams = beam_settings(plan.settings.direct);
    beams.order = order;
    beams.medium = &*plan.settings.medium;
    DirectInAir direct;
    direct.sh.assign(std::size_t(volume::sh_count(order)),
                     std::vector(volume.grid.size(), glm::vec3(0.0f)));
    for (std::size_t i = 0; i < scene.lights.size(); ++i) {
        const medium::DirectLight light =
            medium::direct_light(scene.lights[i], visibility, frame, volume.walls, beams);
        direct.beams += light.beams;
        for (std::size_t k = 0; k < direct.sh.size(); ++k)
            for (std::size_t cell = 0; cell < direct.sh[k].size(); ++cell)
                direct.sh[k][cell] += light.sh[k][cell];
        progress.advance(i + 1);
    }
    return direct;
}

void add_air(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
             const scene::Frame& frame, solver::Stages& stages, Volume& volume) {
    if (!plan.settings.medium)
        return;
    const medium::Medium& air = *plan.settings.medium;
    stages.begin("air", scene.lights.size() + 1);
    const DirectInAir direct = direct_in_air(scene, plan, visibility, frame, volume,
                                             air.g == 0 ? 0 : volume.sh_order, stages.progress());
    const std::size_t count = direct.sh.size(), cells = volume.grid.size();
    set_air_grids(air, volume);
    float* const scatter = volume::grids_of(volume, volume::kind_named("scatter"))[0].data;
    float* const extinction = volume::grids_of(volume, volume::kind_named("extinction"))[0].data;
    const std::vector<volume::GridView> scattered =
        volume::grids_of(volume, volume::kind_named("scattered"));
    const double peak = air.peak();
    tbb::parallel_for(std::size_t(0), cells, [&](std::size_t cell) {
        const glm::dvec3 lo = frame.to_world(volume.grid.cell_at(cell));
        const double density = air.mean_density(lo, lo + frame.unit);
        const glm::vec3 lost(density * air.extinction());
        std::copy_n(&lost.x, 3, extinction + 3 * cell);
        for (std::size_t k = 0; k < count; ++k) {
            const int band = k == 0 ? 0 : k < 4 ? 1 : k < 9 ? 2 : k < 16 ? 3 : 4;
            const glm::vec3 light(air.scatter * std::pow(air.g, band)
                                  * (density * glm::dvec3(volume.sh[k][cell])
                                     + peak * glm::dvec3(direct.sh[k][cell])));
            if (k == 0) {
                const glm::vec3 mean = glm::max(volume::sh_y0 * light, glm::vec3(0.0f));
                std::copy_n(&mean.x, 3, scatter + 3 * cell);
            }
            if (!scattered.empty())
                std::copy_n(&light.x, 3, scattered[k].data + 3 * cell);
        }
    });
    volume.metadata["medium"] = medium::text_of(air);
    stages.end(medium::text_of(air) + ", " + counted(direct.beams, "beam"));
}

} // namespace lpvbake::bake
