#include "volume/sampler.h"

#include "volume/sh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace lpvbake::volume {
namespace {

/// Cells: how far off its surface a point is held against walls, so that it lies before its own,
/// and how far before a wall a cell begins to fade.
constexpr double wall_lift = 0.2;
/// Cells: how far below its surface a point faces cells from, so that those in the surface count.
constexpr double facing_depth = 0.1;
/// Cells: where the cells around are read that a point looks for further off.
constexpr double further = 0.5;
/// Of the cells around: what counts less in all is as good as none, since rounding would choose.
constexpr double least_weight = 1e-3;

/// Scales the weights to a sum of 1; false if theirs is not above `least`.
bool normalise(CellWeights& weights, double least = 0) {
    double sum = 0;
    for (const double weight : weights.weight)
        sum += weight;
    if (!(sum > least))
        return false;
    for (double& weight : weights.weight)
        weight /= sum;
    return true;
}

/// max(0, n.d)^2, d the direction to what lies `from_surface` of the point.
double facing(glm::dvec3 from_surface, glm::dvec3 n) {
    const glm::dvec3 way = from_surface + facing_depth * n;
    const double square = glm::dot(way, way), along = std::max(0.0, glm::dot(way, n));
    return square > 0 ? along * along / square : 1.0;
}

/// A product over the walls of a cell: 0 at and beyond the plane, rising to 1 at wall_lift before
/// it. x is seen from the cell's centre, in cells.
double before_walls(const Volume& volume, std::size_t cell, glm::dvec3 x) {
    double before = 1;
    for (const auto& wall : volume.walls) {
        const glm::dvec3 w(wall[cell]);
        if (const double square = glm::dot(w, w); square > 0)
            before *=
                std::clamp((square - glm::dot(w, x)) / (wall_lift * std::sqrt(square)), 0.0, 1.0);
    }
    return before;
}

/// The nearest valid cell of the 64 around `point` (grid units), less than `reach` away, for which
/// allowed(cell, way from the point to its centre) holds.
template <class Allowed>
CellWeights nearest(const Volume& volume, glm::dvec3 point, glm::ivec3 low, double reach,
                    const Allowed& allowed) {
    CellWeights result;
    double least = reach * reach;
    glm::ivec3 at;
    for (at.z = low.z - 1; at.z <= low.z + 2; ++at.z)
        for (at.y = low.y - 1; at.y <= low.y + 2; ++at.y)
            for (at.x = low.x - 1; at.x <= low.x + 2; ++at.x) {
                if (!volume.grid.contains(at) || !volume.is_valid(volume.grid.index(at)))
                    continue;
                const std::size_t cell = volume.grid.index(at);
                const glm::dvec3 way = glm::dvec3(at) + 0.5 - point;
                if (const double square = glm::dot(way, way);
                    square < least && allowed(cell, way)) {
                    least = square;
                    result.cell[0] = cell;
                    result.weight[0] = 1;
                }
            }
    return result;
}

/// The weights of the eight cells around a place.
struct Around {
    glm::ivec3 low{0};
    CellWeights plain, valid, faced, clear;
};

/// Of the cells around `place`, as the point `at` sees them; both in grid units.
Around around(const Volume& volume, glm::dvec3 place, glm::dvec3 at, glm::dvec3 n) {
    const Grid& grid = volume.grid;
    const glm::dvec3 clamped = glm::clamp(place - 0.5, glm::dvec3(0), glm::dvec3(grid.dims - 1));
    Around result;
    if (clamped != clamped) // a lattice so large that the point has no place on it
        return result;
    result.low = glm::clamp(glm::ivec3(clamped), glm::ivec3(0), glm::max(grid.dims - 2, 0));
    const glm::dvec3 share = clamped - glm::dvec3(result.low);
    for (std::size_t i = 0; i < 8; ++i) {
        const glm::ivec3 corner(i & 1, i >> 1 & 1, i >> 2 & 1);
        const glm::ivec3 cell = result.low + corner;
        double weight = 1;
        for (int axis = 0; axis < 3; ++axis)
            weight *= corner[axis] ? share[axis] : 1 - share[axis];
        if (!grid.contains(cell)) // the far side of a lattice of one layer: weight 0
            continue;
        const std::size_t own = grid.index(cell);
        for (CellWeights* each : {&result.plain, &result.valid, &result.faced, &result.clear})
            each->cell[i] = own;
        result.plain.weight[i] = weight;
        if (volume.is_valid(own)) {
            const glm::dvec3 way = glm::dvec3(cell) + 0.5 - at;
            result.valid.weight[i] = weight;
            result.faced.weight[i] = weight * facing(way, n);
            result.clear.weight[i] =
                result.faced.weight[i] * before_walls(volume, own, wall_lift * n - way);
        }
    }
    return result;
}

} // namespace

CellWeights weights_at(const Volume& volume, glm::dvec3 point, glm::dvec3 n, Reading reading) {
    const glm::dvec3 at = volume.grid.to_grid(point);
    n = volume.grid.to_axes(n);
    Around own = around(volume, at, at, n);
    if (reading == Reading::trilinear)
        return own.plain;
    if (normalise(own.clear, least_weight))
        return own.clear;
    if (Around next = around(volume, at + further * n, at, n); normalise(next.clear, least_weight))
        return next.clear;
    if (normalise(own.clear))
        return own.clear;
    if (!volume.walls.empty()) {
        const CellWeights near =
            nearest(volume, at, own.low, walls_reach, [&](std::size_t cell, glm::dvec3 way) {
                return facing(way, n) > 0 && before_walls(volume, cell, wall_lift * n - way) > 0;
            });
        if (near.weight[0] > 0)
            return near;
    }
    const auto instead = [](CellWeights weights) {
        weights.clear = false;
        return weights;
    };
    if (normalise(own.faced))
        return instead(own.faced);
    if (normalise(own.valid))
        return instead(own.valid);
    return instead(nearest(volume, at, own.low, std::numeric_limits<double>::infinity(),
                           [](std::size_t, glm::dvec3) { return true; }));
}

} // namespace lpvbake::volume

namespace lpvbake {

glm::dvec3 read_irradiance(const Volume& volume, glm::dvec3 point, glm::dvec3 n, Reading reading) {
    const volume::CellWeights weights = volume::weights_at(volume, point, n, reading);
    glm::dvec3 irradiance;
    std::vector<float> coefficients(volume.sh.size());
    for (int colour = 0; colour < 3; ++colour) {
        for (std::size_t k = 0; k < coefficients.size(); ++k) {
            double sum = 0;
            for (std::size_t i = 0; i < 8; ++i)
                if (weights.weight[i] > 0)
                    sum += weights.weight[i] * double(volume.sh[k][weights.cell[i]][colour]);
            coefficients[k] = float(sum);
        }
        irradiance[colour] =
            std::max(0.0, double(volume::sh_irradiance(coefficients, glm::vec3(n))));
    }
    return irradiance;
}

} // namespace lpvbake
