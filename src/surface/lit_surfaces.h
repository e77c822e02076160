// Lit surfaces: every patch of the scene with the light that leaves it. The one source of light
// for the solvers that gather.
#pragma once

#include "cache/cache.h"
#include "lpvbake/progress.h"
#include "scene/light_layer.h"
#include "surface/patches.h"
#include "visibility/visibility.h"

#include <optional>
#include <span>

namespace lpvbake::surface {

struct LightingSettings {
    std::optional<int> bounces = 1; ///< reflections at most; none: all
    bool emitters = true;           ///< emissive surfaces give light
    uint64_t rays = 1 << 20;        ///< for light between surfaces: in all, at least 32 an element
    float tolerance = 1e-4f;        ///< all bounces: LitSurfaces::residual at most
    /// Reflective shadow maps bring the first reflection of punctual lights: LitSurfaces::luminance
    /// is without it, but not without what follows from it.
    bool maps = false;
    cache::Cache* cache = nullptr; ///< keeps what was traced; null: nothing does
};

/// All surfaces, inside the grid and out.
struct LitSurfaces {
    std::vector<Patch> patches; ///< of area 0 where another surface lies on it
    PatchTree tree;
    std::vector<Patch> receivers; ///< light is wanted on them, but they are not there for it
    const visibility::Visibility* visibility =
        nullptr; ///< of the same scene and frame; outlives this
    /// luminance[2 * patch + side]: what leaves the covered part of the front (side 0) or the back
    /// (1), nits: emission and reflected light. Black for the back of a single-sided surface.
    std::vector<glm::vec3> luminance;
    /// The patch that each of the last ones was a part of, before light that fell on little of it
    /// cut it (narrow.h); that is itself another part of it now.
    std::vector<uint32_t> cut_from;
    /// As luminance, but parts of a patch share theirs: a few rays in all directions would meet
    /// small bright ones by luck. Empty where none was cut.
    std::vector<glm::vec3> shared;
    /// layers[layer_count * (2 * patch + side) + layer]: as luminance, of each layer of the light.
    std::vector<glm::vec3> layers;
    size_t layer_count = 0;
    int bounces = 0; ///< reflections that were summed
    /// Estimated share of the light that is missing, in the mean of elements: what is bright
    /// elsewhere does not end the series where little light is. Where the number is bounded: 0.
    double residual = 0;
    double narrow = 0; ///< share of the light of lamps that falls on less than a quarter of a patch
    double lost = 0;   ///< and share that no patch shows

    static constexpr uint32_t no_side = ~0u;
    /// Which side a ray of this direction sees at its hit; no_side for no_hit and for backs. A
    /// patch does not carry light through a wall: where something on it hides a hit from its
    /// centroid, the patch beside it on the hit's side of the wall is what is seen, or no_side if
    /// there is none.
    uint32_t side(const visibility::Hit& hit, glm::vec3 direction) const;
    /// The same of many rays that have these hits, so that their ways to memory overlap.
    void sides(std::span<const visibility::Hit> hits, std::span<const visibility::Ray> rays,
               std::span<uint32_t> result) const;
    /// Luminance (nits) that a ray of this direction meets at its hit, Hit::tint not in it; 0 for
    /// no_hit.
    glm::vec3 leaving(const visibility::Hit& hit, glm::vec3 direction) const;
    /// Luminance of a side for light that is summed from few rays.
    glm::vec3 to_few(uint32_t side) const {
        return shared.empty() ? luminance[side] : shared[side];
    }
    /// Sets `shared` by `luminance`.
    void share();

private:
    uint32_t side_at(const PatchTree::Approach& from, const visibility::Hit& hit,
                     glm::vec3 direction) const;
};

/// The same surfaces and light in units of frame `other` instead of `own`; `visibility` is of that
/// frame (Visibility::in_frame), and outlives the result.
LitSurfaces in_frame(LitSurfaces lit, const scene::Frame& own, const scene::Frame& other,
                     const visibility::Visibility& visibility);

/// The same surfaces and light of a scene that is turned about the frame's origin by the rotation;
/// `visibility` is of that scene, in the same frame, and outlives the result.
LitSurfaces turned(LitSurfaces lit, const glm::mat3& rotation,
                   const visibility::Visibility& visibility);

/// What a luminance has above a limit, both by the mean of the channels; of the same colour.
inline glm::vec3 luminance_above(glm::vec3 luminance, float limit) {
    const float mean = (luminance.x + luminance.y + luminance.z) / 3.0f;
    return mean > limit ? luminance * (1.0f - limit / mean) : glm::vec3(0.0f);
}

/// Lights all surfaces. Direct light of punctual lights is what each of them sends to what it sees
/// (flux.h). All other light is that of an element (elements.h): emitters by points on them and by
/// cosine-distributed rays together (multiple importance sampling, balance heuristic: Veach and
/// Guibas 1995), the sky by the latter. The same rays, their hits stored, carry light from element
/// to element: R = D + rho K R, iterated; but what lamps light so brightly that they would meet it
/// by luck, rays are aimed at, as at emitters (spots.h). Throws Error (invalid) for all bounces in
/// a closed scene of albedo 1.
///
/// Layers are lit by the same rays, and to the same end: all that is decided (patches, where rays
/// are aimed, when the series ends) is decided by the scene's light, so that they are linear in
/// their weights, and what is told of the scene's light does not depend on them. Whatever the
/// scene's light leaves black is left out of layers.
LitSurfaces light_surfaces(const Scene& scene, const visibility::Visibility& visibility,
                           const scene::Frame& frame, const LightingSettings& settings,
                           Progress& progress, std::span<const scene::LightLayer> layers = {});

/// A point of a surface, seen from one of its sides.
struct SidePoint {
    glm::vec3 position; ///< frame units
    glm::vec3 normal;   ///< unit, out of that side
};

/// Irradiance (lux, RGB) at points from lit surfaces and the sky, without the direct light of
/// punctual lights: what a volume holds. By `rays` cosine-distributed rays each, and an eighth as
/// many towards emitters, weighed as light_surfaces does; a surface counts as light as its patch.
/// `lit` comes from the same scene, without LightingSettings::maps; `emitters` as there.
/// A point's rays depend on its place in `points` and on `seed` alone.
std::vector<glm::vec3> irradiance_at(const Scene& scene, const LitSurfaces& lit,
                                     std::span<const SidePoint> points, bool emitters, int rays,
                                     uint32_t seed, Progress& progress);

/// What arrives at a point, and how much it sees.
struct SideLight {
    glm::vec3 irradiance; ///< lux
    /// As SidePoints::open; 0 where most of what is seen are backs of single-sided surfaces.
    float open;
};

/// As irradiance_at, by rays that are shared with the points around (shared_rays.h): `rays` of each
/// where 16 and more share theirs, up to 256 of a point alone. For points of a density of a few a
/// unit.
std::vector<SideLight> shared_irradiance_at(const Scene& scene, const LitSurfaces& lit,
                                            std::span<const SidePoint> points, bool emitters,
                                            int rays, uint32_t seed, Progress& progress);

} // namespace lpvbake::surface
