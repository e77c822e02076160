#include "transfer/relight.h"

#include "lpvbake/error.h"
#include "medium/beams.h"
#include "scene/sky.h"
#include "volume/grids.h"
#include "volume/light_content.h"

#include <cstdlib>
#include <span>

namespace lpvbake::transfer {
namespace {

/// What lights send straight to the cells, those walls in the way.
std::vector<Light4> direct_light(std::span<const Light> lights,
                                 const visibility::Visibility& visibility,
                                 const scene::Frame& frame, const Volume& volume) {
    if (lights.empty())
        return {};
    std::vector<Light4> all(volume.grid.size());
    medium::BeamSettings beams;
    beams.order = 1;
    for (const Light& light : lights) {
        const medium::DirectLight direct =
            medium::direct_light(light, visibility, frame, volume.walls, beams);
        for (std::size_t cell = 0; cell < all.size(); ++cell)
            for (std::size_t k = 0; k < 4; ++k)
                all[cell][k] += direct.sh[k][cell];
    }
    return all;
}

/// Metres; 0: none.
double radius_of(const Volume& volume) {
    const auto radius = volume.metadata.find("local_radius");
    return radius == volume.metadata.end() ? 0.0 : std::strtod(radius->second.c_str(), nullptr);
}

} // namespace

bool has_operators(const Volume& volume) {
    return radius_of(volume) > 0
           && volume::grids_of(volume, volume::local_transfer_kind()).size() == 16
           && volume::grids_of(volume, volume::local_visibility_kind()).size() == 9;
}

Propagated relight(const Scene& scene, const visibility::Visibility& visibility,
                   const scene::Frame& frame, const RelightSettings& settings, Volume& volume,
                   Progress& progress) {
    if (volume.grid.is_turned())
        throw Error(ErrorKind::unsupported,
                    "light is carried along the axes of a lattice that is not turned; bake it "
                    "upright");
    Sources sources;
    sources.direct = direct_light(scene.lights, visibility, frame, volume);
    sources.suns = direct_light(scene::sky_suns(scene.sky), visibility, frame, volume);
    if (settings.emitters)
        sources.emitted =
            local_emission(scene, visibility, float(radius_of(volume) / frame.unit), volume);
    const bool sky = scene::has_sky(scene);
    if (sky)
        sources.beyond = [&](glm::vec3 towards) { return scene::sky_rest(scene.sky, towards); };
    Propagated propagated = propagate(volume, sources, settings.propagation, progress);

    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size()));
    for (std::size_t cell = 0; cell < volume.grid.size(); ++cell)
        for (std::size_t k = 0; k < 4; ++k)
            volume.sh[k][cell] = propagated.field[cell][k];
    for (const char* of_other_light : {"fit", "fit_evaluation", "bounces"})
        volume.metadata.erase(of_other_light);
    volume::set_content(
        volume::content_of(!scene.lights.empty(), !sources.emitted.empty(), sky, std::nullopt),
        volume.metadata);
    return propagated;
}

} // namespace lpvbake::transfer
