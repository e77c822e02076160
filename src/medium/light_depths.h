// How far a light reaches: a map of depths with a pyramid over it, which tells which parts of a ray
// are lit without walking along it.
#pragma once

#include "scene/light_view.h"
#include "visibility/visibility.h"

#include <cstdint>
#include <vector>

namespace lpvbake::medium {

/// How a light looks at what casts shadows into the box [lo, hi] (frame units).
std::vector<scene::RsmView> views_into(const Light& light, const visibility::Visibility& visibility,
                                       const scene::Frame& frame, glm::dvec3 lo, glm::dvec3 hi);

/// The depths of what a view sees with a ray through the middle of each texel, row-major; infinite
/// where it sees nothing. What is partly transparent is there in as many texels as is its share.
std::vector<float> depths_of(const scene::RsmView& view, const visibility::Visibility& visibility,
                             int size);

class LightDepths {
public:
    /// Of the box [lo, hi] (frame units), by maps of `size` texels (a power of two) along a side.
    LightDepths(const Light& light, const visibility::Visibility& visibility,
                const scene::Frame& frame, glm::dvec3 lo, glm::dvec3 hi, int size);

    /// The parts of a ray, from begin to end, that the light reaches, by rising t; a texel is lit
    /// before the depth that it has in its middle. Descends a tree of the least and the largest
    /// depth of 4, 16, ... texels: only what lies between them is looked at any closer. Without
    /// `pyramid` all texels on the way are: the same bits, to test by. Returns how many nodes were
    /// looked at.
    uint64_t lit_parts(glm::dvec3 origin, glm::dvec3 direction, double begin, double end,
                       std::vector<glm::dvec2>& parts, bool pyramid = true) const;

private:
    /// Linear along a ray across a map: minus the depth, or for perspective one over it.
    using Key = float;
    struct Keys {
        Key least, most;
    };
    struct Level {
        int size = 0;
        std::vector<Keys> nodes;
    };
    struct Map {
        scene::RsmView view;
        std::vector<Level> levels; ///< texels, then ever fewer
    };
    struct Line;
    struct Descent;

    std::vector<Map> maps_;
    bool open_ = false; ///< parallel light without a map: nothing stands in its way
};

} // namespace lpvbake::medium
