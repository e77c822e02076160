// What is seen from cells, and how bright it is all in all.
#pragma once

#include "scene/sky.h"
#include "surface/lit_surfaces.h"
#include "volume/grid.h"

#include <span>

namespace lpvbake::solver::sn {

/// Light of surfaces and the sky; refers to them.
struct SnLight {
    const surface::LitSurfaces& lit;
    const visibility::Visibility& visibility;
    Sky sky;
    float limit = HUGE_VALF; ///< nits; surfaces are seen without luminance_above() this

    /// What a ray of this direction sees at its hit, nits.
    glm::vec3 luminance(const visibility::Hit& hit, glm::vec3 direction) const;
};

/// Mean luminance (mean of the channels, nits) that arrives in the cells whose validity is above 0,
/// by 8192 rays; 0 where there are none.
float mean_luminance(const SnLight& light, const Grid& grid, std::span<const float> validity);

/// A cell whose luminance is looked up, or a place beside the grid.
struct SnPlace {
    uint32_t slot; ///< see sweep.h
    glm::ivec3 cell;
};

/// The luminance (nits) that arrives along each direction of travel in up to eight cells:
/// luminance[cell * stride + direction].
void trace_arriving(const SnLight& light, std::span<const SnPlace> places,
                    std::span<const glm::vec3> travel, size_t stride,
                    std::span<glm::vec4> luminance);

} // namespace lpvbake::solver::sn
