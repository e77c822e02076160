// The result of a bake: a field of spherical harmonics on a grid, and what lies beside it.
#pragma once

#include "volume/grid.h"

#include <map>
#include <string>
#include <vector>

namespace lpvbake {

inline constexpr int most_walls = 3;       ///< planes a cell
inline constexpr float walls_reach = 2.0f; ///< cells; planes farther from a cell are not kept

struct GridKind; // grids.h

/// Grids of a kind that has no member in Volume.
struct OtherGrids {
    const GridKind* kind;
    std::vector<std::vector<float>> grids; ///< [k][width * Grid::index + channel]
};

/// Everything is indexed by Grid::index. Empty vectors are absent grids. What kinds of grids there
/// are, and what each is, says the table of grids.h.
struct Volume {
    Grid grid;
    int sh_order = 1;
    /// sh[k][cell]: coefficient k (order of sh.h) of incident luminance, RGB, nits, canonical.
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

/// Rec.709 luminance of L0 over all cells: sum of sqrt(4 pi) c_0, nits * sr (a measure of energy).
double total_energy(const Volume& volume);

} // namespace lpvbake
