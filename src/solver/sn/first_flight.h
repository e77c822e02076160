// What is seen from cells, and how bright it is all in all.
#pragma once

#include "scene/sky.h"
#include "solver/sn/sweep.h"
#include "surface/lit_surfaces.h"
#include "volume/grid.h"

#include <span>
#include <vector>

namespace lpvbake::solver::sn {

/// What a ray meets.
struct Sight {
    static constexpr uint32_t sky = surface::LitSurfaces::no_side - 1;
    uint32_t side; ///< 2 * patch + side, `sky`, or LitSurfaces::no_side
    glm::vec3 tint;
};

/// Which part of the light is swept.
enum class LightPart {
    surfaces, ///< that of surfaces and the sky
    air,      ///< what air sends before those
};

/// Light of surfaces and the sky; refers to them.
struct SnLight {
    const surface::LitSurfaces& lit;
    const visibility::Visibility& visibility;
    Sky sky;
    float limit = HUGE_VALF; ///< nits; surfaces are seen without luminance_above() this
    /// One of LitSurfaces::layers instead: of surfaces the share that is seen of all light.
    const scene::LightLayer* layer = nullptr;
    size_t index = 0; ///< of the layer
    /// Null: there is none. `visibility` knows nothing of it.
    const visibility::Air* air = nullptr;
    LightPart part = LightPart::surfaces; ///< air: where there is some

    Sight sight(const visibility::Hit& hit, glm::vec3 direction) const;
    /// What a ray of this direction sees, nits.
    glm::vec3 luminance(const Sight& sight, glm::vec3 direction) const;
};

/// What the rays of a chunk met, as its luminance is laid out.
struct Sights {
    std::vector<uint32_t> sides;
    std::vector<glm::vec3> tints; ///< empty where nothing tints

    Sight operator[](size_t i) const {
        return {sides[i], tints.empty() ? glm::vec3(1.0f) : tints[i]};
    }
};

/// Mean luminance (mean of the channels, nits) that arrives in the cells whose validity is above 0,
/// by 8192 rays; 0 where there are none.
float mean_luminance(const SnLight& light, const Grid& grid, std::span<const float> validity);

/// A cell whose luminance is looked up, or a place beside the grid, for the directions of a
/// quadrant.
struct SnPlace {
    uint32_t entry;  ///< 4 * slot + quadrant (sweep.h)
    glm::vec3 point; ///< where its light is taken, in units of the grid

    uint32_t slot() const { return entry / quadrants; }
    size_t quadrant() const { return entry % quadrants; }
};

/// Unit directions of light, as many of each quadrant, one quadrant after the other.
struct Travel {
    std::vector<glm::vec3> all;

    size_t of_each() const { return all.size() / quadrants; }
    std::span<const glm::vec3> of(const SnPlace& place) const {
        return std::span(all).subspan(place.quadrant() * of_each(), of_each());
    }
};

/// The luminance (nits) that arrives along the directions of its quadrant in each of up to eight
/// places of one quadrant, of any and in any number where there is a caster:
/// luminance[place * stride + direction], of surfaces as it leaves them, and in w the column of air
/// before them. What the rays met is kept in `sights`, if it is not null, from `first` on.
void trace_arriving(const SnLight& light, std::span<const SnPlace> places, const Travel& travel,
                    size_t stride, std::span<glm::vec4> luminance, Sights* sights, size_t first);

} // namespace lpvbake::solver::sn
