// How a lattice is fitted to a scene.
#pragma once

#include "lpvbake/volume.h"

namespace lpvbake::volume {

/// How a grid is fitted to a box. Exactly one of `resolution` and `cell` counts.
struct GridSettings {
    int resolution = 32; ///< cells along the longest axis, margins included; at least 3
    double cell = 0.0;   ///< metres; above 0 it overrides `resolution`
    int margin = 1;      ///< whole cells around the box on each side
};

/// The box of a grid's cells in the world's axes, metres.
struct GridBox {
    glm::dvec3 lo, hi;
};
GridBox box_of(const Grid& grid);

/// The margin where none is asked for. A box that is asked for is the grid's own.
constexpr int usual_margin(bool box_is_given) {
    return box_is_given ? 0 : GridSettings().margin;
}

/// Fits a grid around the box [lo, hi] (metres), centred on it. A flat box gets one cell (and the
/// margins) across. Throws Error (invalid) for a box that is not finite, is a single point, or is
/// so far from the origin that double precision cannot tell its cells apart, and for more than
/// 2^31 - 1 cells.
Grid fit_grid(glm::dvec3 lo, glm::dvec3 hi, const GridSettings& settings);

} // namespace lpvbake::volume
