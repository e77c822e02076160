// Lighting in parts, each of which traces the rays of some elements.
#pragma once

#include "surface/reflections.h"

namespace lpvbake::surface {

/// All that is known before light goes from element to element, but of the rays those of elements
/// [count * (index - 1) / parts, count * index / parts) alone.
struct LitPart {
    int index = 1, count = 1; ///< of parts, from 1
    ElementRays rays;
    LitSurfaces lit;                                                            ///< by lamps
    Elements elements{.of_side = {}, .first = {0}, .members = {}, .up_to = {}}; ///< none
    std::vector<glm::vec3> spots; ///< Spots::luminance
    bool emitters = false;        ///< sides send light by themselves
    Reflections reflections;      ///< without `endless`
};

/// The i-th of `count` parts of what light_surfaces does, without layers and maps.
LitPart light_part(const Scene& scene, const visibility::Visibility& visibility,
                   const scene::Frame& frame, const LightingSettings& settings, int index,
                   int count, Progress& progress);

/// What light_surfaces would have made, bit for bit, of all parts in their order; those after the
/// first need nothing but their rays. Throws Error (invalid) where light would never end.
LitSurfaces join(std::vector<LitPart> parts, Progress& progress);

} // namespace lpvbake::surface
