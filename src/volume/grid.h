// The lattice of a bake: cubic cells, any number along each axis.
#pragma once

#include <glm/glm.hpp>

#include <cstddef>

namespace lpvbake {

/// Cell (i, j, k) spans origin + cell * [i, i+1] x [j, j+1] x [k, k+1], in metres; values belong to
/// its centre. Grid units are cells: p_grid = (p - origin) / cell, so centres lie at i + 1/2.
struct Grid {
    glm::dvec3 origin{0.0};
    double cell = 1.0; ///< edge of a cell, metres
    glm::ivec3 dims{0};

    std::size_t size() const {
        return std::size_t(dims.x) * std::size_t(dims.y) * std::size_t(dims.z);
    }
    /// x runs fastest, z slowest.
    std::size_t index(glm::ivec3 c) const {
        return std::size_t(c.x)
               + std::size_t(dims.x) * (std::size_t(c.y) + std::size_t(dims.y) * std::size_t(c.z));
    }
    /// The cell of that index.
    glm::ivec3 cell_at(std::size_t i) const {
        const auto nx = std::size_t(dims.x), ny = std::size_t(dims.y);
        return {int(i % nx), int(i / nx % ny), int(i / (nx * ny))};
    }
    bool contains(glm::ivec3 c) const {
        return c.x >= 0 && c.y >= 0 && c.z >= 0 && c.x < dims.x && c.y < dims.y && c.z < dims.z;
    }
    glm::dvec3 center(glm::ivec3 c) const { return origin + cell * (glm::dvec3(c) + 0.5); }
    glm::dvec3 to_grid(glm::dvec3 world) const { return (world - origin) / cell; }
    bool operator==(const Grid&) const = default;
};

/// How a grid is fitted to a box. Exactly one of `resolution` and `cell` counts.
struct GridSettings {
    int resolution = 32; ///< cells along the longest axis, margins included; at least 3
    double cell = 0.0;   ///< metres; above 0 it overrides `resolution`
    int margin = 1;      ///< whole cells around the box on each side
};

/// Fits a grid around the box [lo, hi] (metres), centred on it. A flat box gets one cell (and the
/// margins) across. Throws Error (invalid) for a box that is not finite, is a single point, or is
/// so far from the origin that double precision cannot tell its cells apart, and for more than
/// 2^31 - 1 cells.
Grid fit_grid(glm::dvec3 lo, glm::dvec3 hi, const GridSettings& settings);

} // namespace lpvbake
