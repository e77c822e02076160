// What light is missing of a propagation, by a diffusion that is close to it: the correction of an
// iteration that converges in a number of steps which does not grow with the grid. In the transport
// of neutrons it is known as diffusion synthetic acceleration (Larsen 1984).
#pragma once

#include "volume/grid.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace lpvbake::solver::lpv {

/// The diffusion in a grid, on its blocks of 2 x 2 x 2 cells, x fastest, z slowest.
class Diffusion {
public:
    /// `open`: of the links of a cell towards +x, +y and +z, [3 * cell + axis]; empty: all are. A
    /// link lets that share of light through and takes the rest, and the grid's sides take all.
    /// `lit`: of each cell whether light starts in it; what no chain of links joins to such a cell
    /// is left out.
    Diffusion(const Grid& grid, std::span<const float> open, std::span<const std::uint8_t> lit);

    glm::ivec3 dims(std::size_t level = 0) const { return levels_[level].dims; }
    std::size_t size() const { return reached_.size(); }

    /// From the blocks on, each of half the resolution.
    std::size_t levels() const { return levels_.size(); }
    /// Of a level's cells, x fastest: conductances towards +x, +y and +z, and the inverse of the
    /// sum of all around and of what is taken; 0 where that is 0.
    std::span<const glm::vec4> links(std::size_t level) const { return levels_[level].links; }
    /// Cells of each block that light reaches, a bit each: x + 2 y + 4 z.
    std::span<const std::uint8_t> reached() const { return reached_; }

    /// Jacobi steps of a level before and after a coarser one.
    static constexpr int relaxations = 3;

    /// About the light that all propagations of `light` bring together, itself included, for the
    /// mean of a block's cells, where `light` is the sum over them; or the same of cells of a
    /// coarser level. Each of the four values is a light of its own. Linear in `light`, and the
    /// same for any number of threads. Multigrid does the same on a device.
    void solve(std::span<const glm::vec4> light, std::span<glm::vec4> all, std::size_t level = 0);
    /// The matrix of that, a column (what one cell's light brings to all) after the other.
    std::vector<float> matrix(std::size_t level);

private:
    /// Cells, or blocks of so many that they are `h` along a side.
    struct Level {
        glm::ivec3 dims{0};
        std::vector<glm::vec4> links;
        std::vector<glm::vec4> light, all, next; ///< right side, solution, and room for its next;
                                                 ///< empty until one is solved for

        std::size_t index(glm::ivec3 at) const {
            return (std::size_t(at.z) * std::size_t(dims.y) + std::size_t(at.y))
                       * std::size_t(dims.x)
                   + std::size_t(at.x);
        }
    };

    void cycle(std::size_t level);
    static void relax(Level& level);
    static void restrict_rest(const Level& fine, Level& coarse);
    static void add_coarse(const Level& coarse, Level& fine);

    std::vector<Level> levels_;         ///< from blocks of 2 cells on
    std::vector<std::uint8_t> reached_; ///< cells of each of these blocks
};

} // namespace lpvbake::solver::lpv
