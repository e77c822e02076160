// Points of all surfaces that something could stand before, on each side that can be seen.
#pragma once

#include "surface/lit_surfaces.h"

namespace lpvbake::surface {

struct SidePointSettings {
    double density = 4;             ///< points a square unit of a side
    uint64_t most_points = 1 << 20; ///< where there are more, each stands for more area
    uint32_t seed = 1;              ///< another one gives other points
    uint32_t looks = 32; ///< rays that tell how open a point is, and whether it lies inside of
                         ///< things; 0: nobody looks, and all are open
};

struct SidePoints {
    std::vector<SidePoint> points;
    /// Covered area that each stands for, frame units squared.
    std::vector<float> area;
    /// Share of the directions before each, weighted by their cosines, in which no surface is
    /// nearer than a unit.
    std::vector<float> open;
};

/// Points on the fronts of all patches, and on the backs of double-sided ones, inside the box
/// [0, extent] (frame units): area-weighted and stratified, along the patches by even steps and
/// within them by Halton's sequence. Sides from which most of what is seen are backs of
/// single-sided surfaces lie inside of things and have none.
SidePoints draw_side_points(const LitSurfaces& lit, glm::vec3 extent,
                            const SidePointSettings& settings);

} // namespace lpvbake::surface
