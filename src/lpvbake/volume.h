// The result of a bake: a field of spherical harmonics on a grid, what lies beside it, and how it
// is read at a point of a surface.
//
// Coefficients belong to real orthonormal spherical harmonics without Condon-Shortley signs, in the
// order 1; y, z, x; xy, yz, 3z^2-1, xz, x^2-y^2; bands 3 and 4 by m = -l to l, with the sines (odd
// in y) first, z the polar axis and x the azimuth's origin. The field is the luminance (nits) that
// arrives at a point from a direction, which points away from it.
#pragma once

#include "lpvbake/export.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace lpvbake {

/// The lattice of a bake: cubic cells, any number along each axis.
///
/// Cell (i, j, k) spans origin + turn * (cell * [i, i+1] x [j, j+1] x [k, k+1]), in metres; values
/// belong to its centre. Grid units are cells: p_grid = turn^-1 * (p - origin) / cell, so centres
/// lie at i + 1/2. Directions of spherical harmonics are the world's, whatever the turn; walls are
/// in grid units.
struct Grid {
    glm::dvec3 origin{0.0};
    double cell = 1.0; ///< edge of a cell, metres
    glm::ivec3 dims{0};
    /// From the lattice's axes to the world's: a unit quaternion, for most lattices none.
    glm::dquat turn{1.0, 0.0, 0.0, 0.0};

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
    bool is_turned() const { return turn != glm::dquat(1.0, 0.0, 0.0, 0.0); }
    glm::dvec3 to_world(glm::dvec3 grid) const {
        return origin + (is_turned() ? turn * (cell * grid) : cell * grid);
    }
    glm::dvec3 center(glm::ivec3 c) const { return to_world(glm::dvec3(c) + 0.5); }
    glm::dvec3 to_grid(glm::dvec3 world) const { return to_axes(world - origin) / cell; }
    /// A direction of the world in the lattice's axes.
    glm::dvec3 to_axes(glm::dvec3 way) const {
        return is_turned() ? glm::conjugate(turn) * way : way;
    }
    bool operator==(const Grid&) const = default;
};

inline constexpr int most_walls = 3;       ///< planes a cell
inline constexpr float walls_reach = 2.0f; ///< cells; planes farther from a cell are not kept
/// Cells: as near to a surface a cell's centre is on it, and its light is that beside it, as far on
/// its open side. Not a fraction that centres lie at when grids and scenes have whole measures.
inline constexpr float surface_margin = 0.0207f;

struct GridKind;

/// Grids of a kind that has no member in Volume.
struct OtherGrids {
    const GridKind* kind;
    std::vector<std::vector<float>> grids; ///< [k][width * Grid::index + channel]
};

/// Everything is indexed by Grid::index. Empty vectors are absent grids.
struct Volume {
    Grid grid;
    int sh_order = 1;
    /// sh[k][cell]: coefficient k (order: see above) of incident luminance, RGB, nits, canonical.
    std::vector<std::vector<glm::vec3>> sh;
    /// occlusion[k][cell]: SH L1 of the blocking potential, in [0, 1] per direction, travel
    /// direction's basis is canonical here too. Empty, or 4 grids.
    std::vector<std::vector<float>> occlusion;
    /// 1 where the cell's centre lies outside geometry, else 0.
    std::vector<float> validity;
    /// walls[k][cell]: what stands in the light's way between a cell and the points around it, as
    /// planes: from the cell's centre to the plane's nearest point, in cells; 0: no plane. A point
    /// x (from the centre, in cells) is before it, and may be read from the cell, where x.w < w.w.
    std::vector<std::vector<glm::vec3>> walls; ///< at most most_walls
    std::vector<OtherGrids> others;            ///< a kind each
    /// Written to every file, keys without the `lpv:` prefix: solver, settings, scene hash, ...
    std::map<std::string, std::string> metadata;

    /// True where the cell's centre lies outside geometry, as far as that is known.
    bool is_valid(std::size_t cell) const { return validity.empty() || validity[cell] != 0.0f; }
};

/// How the eight cells whose centres surround a point become one value.
enum class Reading {
    /// Trilinear weights, whatever the cells are: light of cells inside and behind walls leaks in.
    trilinear,
    /// Trilinear weights times max(0, n.d)^2, d the direction to a cell's centre from 0.1 cells
    /// below the point, times what the cell's walls let pass, of valid cells only, scaled to a sum
    /// of 1. Each wall w
    /// (Volume::walls) lets pass clamp((w.w - w.x) / (0.2 |w|), 0, 1), where x, in cells, is the
    /// point, lifted by 0.2 cells along n, as seen from the cell's centre: 0 behind the wall.
    ///
    /// What no such cell surrounds, or a sum of weights below 1e-3, is read from those around the
    /// place half a cell along n, by their trilinear weights there; then from the nearest one
    /// (valid, n.d > 0, before its walls, less than 2 cells away) of the 4 x 4 x 4 around; then as
    /// if there were no walls; then from the valid ones of the eight by their trilinear weights;
    /// then from the nearest valid one of the 4 x 4 x 4 (the first by index of equally near ones);
    /// else it is dark.
    facing,
};

/// Irradiance (lux, RGB) that the field gives a surface point (metres) of unit normal n, from all
/// the bands that the volume has; 0 where that is negative.
LPVBAKE_API glm::dvec3 read_irradiance(const Volume& volume, glm::dvec3 point, glm::dvec3 n,
                                       Reading reading);

} // namespace lpvbake
