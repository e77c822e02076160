#include "volume/dilate.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::volume {
namespace {

constexpr std::size_t nobody = ~std::size_t(0);

/// How far a place lies beyond the walls of a cell.
struct Beyond {
    double depth = 0;        ///< cells beyond the one that it is farthest behind; 0: before all
    glm::dvec3 towards{0.0}; ///< from the cell to that wall, unit
};

Beyond beyond_walls(const Volume& volume, std::size_t cell, glm::ivec3 place) {
    const glm::dvec3 x(place - volume.grid.cell_at(cell));
    Beyond beyond;
    for (const auto& planes : volume.walls) {
        const glm::dvec3 w(planes[cell]);
        const double distance = glm::length(w);
        if (distance == 0)
            continue;
        if (const double depth = glm::dot(x, w) / distance - distance; depth > beyond.depth)
            beyond = {depth, w / distance};
    }
    return beyond;
}

/// A neighbour that a cell can be filled from.
struct Neighbour {
    std::size_t cell;
    double weight; ///< 1 / distance
    Beyond beyond; ///< how far the cell lies beyond the neighbour's walls
};

/// What is left of a neighbour's weight beside the one that is nearest through its walls: all,
/// unless it lies on the other side of what the cell is in.
double share_beside(const Neighbour& nearest, const Neighbour& neighbour) {
    if (glm::dot(nearest.beyond.towards, neighbour.beyond.towards) > -0.5)
        return 1;
    return std::max(0.0, 1 - 4 * (neighbour.beyond.depth - nearest.beyond.depth));
}

/// Fills a cell; returns the valid cell on whose side it lies, nobody where no neighbour is known.
/// sides[cell] is the same of those that are known.
std::size_t fill(Volume& volume, glm::ivec3 place, const std::vector<std::size_t>& sides) {
    std::array<Neighbour, 27> around;
    std::size_t count = 0;
    for (int n = 0; n < 27; ++n) {
        const glm::ivec3 step = glm::ivec3(n % 3, n / 3 % 3, n / 9) - 1;
        if (!volume.grid.contains(place + step))
            continue;
        const std::size_t beside = volume.grid.index(place + step);
        if (const std::size_t side = sides[beside]; side != nobody)
            around[count++] = {beside, 1.0 / glm::length(glm::dvec3(step)),
                               beyond_walls(volume, side, place)};
    }
    const auto end = around.begin() + std::ptrdiff_t(count);
    const auto nearest = std::min_element(around.begin(), end, [](const auto& a, const auto& b) {
        return a.beyond.depth < b.beyond.depth;
    });
    if (nearest == end)
        return nobody;
    const Neighbour own = *nearest;
    double weights = 0.0;
    for (auto neighbour = around.begin(); neighbour != end; ++neighbour) {
        neighbour->weight *= share_beside(own, *neighbour);
        weights += neighbour->weight;
    }
    for (std::vector<glm::vec3>& coefficient : volume.sh) {
        glm::dvec3 sum(0.0);
        for (auto neighbour = around.begin(); neighbour != end; ++neighbour)
            sum += neighbour->weight * glm::dvec3(coefficient[neighbour->cell]);
        coefficient[volume.grid.index(place)] = glm::vec3(sum / weights);
    }
    return sides[own.cell];
}

} // namespace

std::size_t dilate(Volume& volume, int rings) {
    const Grid& grid = volume.grid;
    if (volume.validity.empty())
        return 0;
    std::vector<std::size_t> sides(grid.size(), nobody);
    std::vector<std::size_t> unknown;
    for (std::size_t i = 0; i < sides.size(); ++i)
        if (volume.validity[i] > 0.0f)
            sides[i] = i;
        else
            unknown.push_back(i);

    std::size_t filled = 0;
    for (int number = 0; number < rings; ++number) {
        // A cell is known only when its ring is complete, so that none sees another of its own.
        std::vector<std::pair<std::size_t, std::size_t>> ring; // cells and their sides
        for (const std::size_t cell : unknown)
            if (const std::size_t side = fill(volume, grid.cell_at(cell), sides); side != nobody)
                ring.emplace_back(cell, side);
        if (ring.empty())
            break;
        for (const auto& [cell, side] : ring)
            sides[cell] = side;
        std::erase_if(unknown, [&](std::size_t cell) { return sides[cell] != nobody; });
        filled += ring.size();
    }
    return filled;
}

} // namespace lpvbake::volume
