// The stage that keeps what air does to light.
#pragma once

#include "bake/plan.h"
#include "visibility/visibility.h"

namespace lpvbake::bake {

/// Grids that --medium brings: `extinction` and `scatter`, and where the medium does not scatter
/// evenly `scattered`.
void set_air_grids(const medium::Medium& medium, Volume& volume);

/// Direct light of all lamps and suns in air, attenuated.
struct DirectInAir {
    /// [k][cell] as Volume::sh; of a cell the mean of the light times density over Medium::peak().
    std::vector<std::vector<glm::vec3>> sh;
    uint64_t beams = 0;
};
/// Up to a band, in a volume that has its walls. Tells `progress` each light.
DirectInAir direct_in_air(const Scene& scene, const BakePlan& plan,
                          const visibility::Visibility& visibility, const scene::Frame& frame,
                          const Volume& volume, int order, Progress& progress);

/// Adds the grids to a volume that has its walls, and no direct light in its field yet: what air
/// scatters of the field, which is baked without it, and of punctual lights, which are attenuated
/// on their way to it; once. Nothing without a medium.
void add_air(const Scene& scene, const BakePlan& plan, const visibility::Visibility& visibility,
             const scene::Frame& frame, solver::Stages& stages, Volume& volume);

} // namespace lpvbake::bake
