// Light from element to element, over the rays that each has sent out.
#pragma once

#include "lpvbake/error.h"
#include "surface/elements.h"
#include "surface/lit_surfaces.h"

#include <functional>
#include <span>
#include <vector>

namespace lpvbake::surface {
class LayeredElements;

/// What the rays of elements find: of all elements, or of those from `first` on.
struct ElementRays {
    static constexpr uint32_t black = ~0u; ///< what a ray meets that reflects nothing
    size_t first = 0;
    std::vector<glm::vec3> lux;   ///< of an element, without light of other elements
    std::vector<glm::vec3> spots; ///< what Spots add to the mean that it meets, nits
    /// Sides that its rays meet, or `black`; empty where light is reflected once.
    std::vector<uint32_t> hits;
    std::vector<glm::vec3> tints; ///< what these rays passed; empty where nothing tints

    ElementRays() = default;
    /// Of elements [begin, end), so many rays each that are kept.
    ElementRays(size_t begin, size_t end, size_t rays, bool tinted)
        : first(begin),
          lux(end - begin),
          spots(end - begin, glm::vec3(0.0f)),
          hits((end - begin) * rays, black),
          tints(tinted ? hits.size() : 0) {}
};

/// How far light is followed.
struct Reflections {
    std::optional<int> most; ///< in all; none: until less than `tolerance` is missing
    float tolerance = 1e-4f; ///< LitSurfaces::residual at most
    /// What to throw where they would never end, by the brightest patch that takes no light.
    std::function<Error(const Patch&)> endless;
};

/// Adds the light that the rays of all elements have found, and what is reflected from element to
/// element of that and of LitSurfaces::luminance, to LitSurfaces::luminance. That of `spots`
/// (Spots::luminance; empty: none) is in ElementRays::spots. Layers go the same ways; null: there
/// are none.
void reflect_found(ElementRays rays, const Elements& elements, const std::vector<glm::vec3>& spots,
                   const Reflections& reflections, LayeredElements* layered, LitSurfaces& lit,
                   Progress& progress);

/// Luminance that every side sends by itself, nits.
std::vector<glm::vec3> emission_of(const std::vector<Patch>& patches);
/// Adds it; empty: nothing.
void add_emission(const std::vector<glm::vec3>& emission, LitSurfaces& lit);

} // namespace lpvbake::surface
