// How far one volume is from another on the same lattice.
#pragma once

#include "volume/grids.h"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::volume {

/// The 26 directions from a cell to its neighbours, unit length; x runs fastest, z slowest.
const std::array<glm::dvec3, 26>& neighbour_normals();

/// One value of irradiance in both volumes, lux, clamped at 0.
struct IrradianceSample {
    glm::ivec3 cell{0};
    glm::dvec3 normal{0.0};
    int channel = 0; ///< 0 red, 1 green, 2 blue
    double a = 0;
    double b = 0;
    double difference = 0; ///< |a - b| relative to the mean irradiance of B
};

/// How one grid differs, in its unit.
struct GridDifference {
    const GridKind* kind = nullptr;
    std::string name;
    uint64_t cells = 0;            ///< how many differ, valid or not
    uint64_t cells_valid_both = 0; ///< how many of these are valid in both volumes
    double rms = 0;                ///< root of the mean of (a - b)^2, over cells valid in both
    double relative = 0; ///< rms over the root mean square of B's grid, over cells valid in both
    /// The largest |a - b|: of the cells valid in both, or, where none of these differs, of the
    /// others. It is in the first such cell and its first such channel, with these two values.
    double max_abs = 0;
    glm::ivec3 cell{0};
    int channel = 0;
    float a = 0;
    float b = 0;
};

struct CompareSettings {
    std::vector<double> limits; ///< for Comparison::exceeding, relative to the mean irradiance of B
    int worst = 5;              ///< cells to list at most
};

/// A against the reference B. A sample is the irradiance E(n) = sum A_l c_lm Y_lm(n) of one cell
/// that is valid in both volumes, one of the 26 normals and one colour, from all the coefficients
/// that its volume has, and 0 where that is negative. What is called relative is a fraction of the
/// mean irradiance of B over all samples; where that is 0, 0 stays 0 and the rest is infinite.
struct Comparison {
    /// The same SH order, the same grids, the same value in every cell of each.
    bool identical = false;

    uint64_t valid_both = 0; ///< cells; a volume without a grid of validity is valid everywhere
    uint64_t valid_only_a = 0;
    uint64_t valid_only_b = 0;
    uint64_t valid_neither = 0;

    uint64_t samples = 0; ///< valid_both x 26 x 3
    double mean_a = 0;    ///< lux
    double mean_b = 0;
    double relative_l1 = 0; ///< sum |E_a - E_b| / sum E_b
    double rms = 0;         ///< lux
    double relative_rms = 0;
    double percentile95 = 0; ///< relative; at most 5 % of the samples are above
    double max = 0;          ///< relative
    uint64_t negative_a = 0; ///< samples below 0 before they were clamped
    uint64_t negative_b = 0;
    std::vector<uint64_t> exceeding; ///< samples whose relative difference is above limits[i]

    double energy_a = 0; ///< as total_energy, of the cells valid in both; nits * sr
    double energy_b = 0;
    double energy_ratio = 1; ///< A over B; 1 where both are 0

    /// The cells with the largest differences, each with its largest; equal ones by index. Cells
    /// without any difference are left out.
    std::vector<IrradianceSample> worst;
    /// Relative L1 of each cell: its mean |E_a - E_b| over the mean of B everywhere; 0 where not
    /// compared. Indexed by Grid::index.
    std::vector<float> cell_error;

    std::vector<GridDifference> grids;       ///< that both have, as grids_of() has them
    std::vector<std::string> only_a, only_b; ///< names of the others
};

/// Why the two are not one lattice, as "dims: 8 x 8 x 8 and 9 x 8 x 8 cells" (dims, cell,
/// origin or turn); none if no cell of one is off by more than a millionth of a cell.
std::optional<std::string> lattice_difference(const Grid& a, const Grid& b);

/// Compares two volumes whose grids all fit their lattice. The result has the same bits for any
/// number of threads. Throws Error (invalid) for different lattices and for irradiance that is not
/// finite.
Comparison compare(const Volume& a, const Volume& b, const CompareSettings& settings);

/// A - B, on A's lattice: the coefficients that either has (those of the other are 0), what else is
/// subtracted (GridKind) where both have it, validity 1 where both are valid; no metadata. Throws
/// Error (invalid) for different lattices.
Volume difference(const Volume& a, const Volume& b);

/// True where both volumes hold light outside geometry.
bool valid_in_both(const Volume& a, const Volume& b, std::size_t cell);

} // namespace lpvbake::volume
