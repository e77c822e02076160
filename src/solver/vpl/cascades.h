// Cascades of a reflective shadow map: where the cells of a finer level are, the map is drawn with
// smaller texels.
#pragma once

#include "scene/light_view.h"

#include <vector>

namespace lpvbake::solver::vpl {

/// Texels of a map, [lo, hi).
struct Texels {
    glm::ivec2 lo{0}, hi{0};

    bool is_empty() const { return glm::any(glm::greaterThanEqual(lo, hi)); }
    bool holds(glm::ivec2 texel) const {
        return glm::all(glm::greaterThanEqual(texel, lo)) && glm::all(glm::lessThan(texel, hi));
    }
};

struct Cascade {
    int size;     ///< texels that all of the map would have along a side
    Texels drawn; ///< those that are, the ones of `cut` left out
    Texels cut;   ///< what the next cascade draws; empty: there is none
};

/// How many it draws.
inline double texels_of(const Cascade& cascade) {
    const glm::dvec2 drawn(cascade.drawn.hi - cascade.drawn.lo);
    const glm::dvec2 cut(cascade.cut.hi - cascade.cut.lo);
    return drawn.x * drawn.y - cut.x * cut.y;
}

/// The cascades of a map, coarsest first: all of it with `size` texels along a side; then, for each
/// finer level of the frame, what its box covers of the map, rounded out to whole texels of the
/// cascade before, which are parted into 2^n x 2^n each. So every square of the map is in one
/// texel, and the light of all of them does not depend on their number. n is the least that brings
/// eight texels to a cell at the box's far end, or as many as the cascade before has to a cell of
/// its level; levels that need no smaller texels have no cascade.
std::vector<Cascade> cascades_of(const scene::RsmView& view, const scene::Frame& frame, int size);

} // namespace lpvbake::solver::vpl
