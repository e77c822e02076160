#include "solver/lpv/diffusion.h"

#include "solver/lpv/levels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

namespace lpvbake::solver::lpv {
namespace {

// Of the slowest mode of a slab of n cells that takes all light at its sides, a step leaves
// 1 - diffusion (pi / (n + 2 beyond))^2: by the eigenvalues of the scheme at n = 64 and 128.
constexpr float diffusion = 0.2283f; ///< cells^2 a step
constexpr float beyond = 0.69f;      ///< cells from a side to where light would be 0

constexpr int at_the_end = 20;    ///< on the coarsest
constexpr int most_rounds = 24;   ///< of sweeps that find what light reaches
constexpr int slab_layers = 16;   ///< that one thread sweeps
constexpr int serial_rows = 1024; ///< below which threads cost more than they bring

template <class Body>
void for_rows(glm::ivec3 dims, const Body& body) {
    const int rows = dims.y * dims.z;
    const auto row = [&](int i) { body(i % dims.y, i / dims.y); };
    if (rows < serial_rows)
        for (int i = 0; i < rows; ++i)
            row(i);
    else
        tbb::parallel_for(0, rows, row);
}

struct Links {
    const Grid& grid;
    std::span<const float> open;

    /// From a cell towards + along an axis.
    float towards(glm::ivec3 cell, int axis) const {
        if (cell[axis] < 0 || cell[axis] + 1 >= grid.dims[axis])
            return 0.0f;
        return open.empty() ? 1.0f : open[3 * grid.index(cell) + std::size_t(axis)];
    }
    float back(glm::ivec3 cell, int axis) const {
        --cell[axis];
        return towards(cell, axis);
    }
};

/// Sweeps to and fro over the layers [begin, end), until they find no more cells that a link joins
/// to a reached one. Returns whether they have found any.
bool sweep(const Links& links, int begin, int end, std::vector<std::uint8_t>& reached) {
    const Grid& grid = links.grid;
    const glm::ivec3 dims = grid.dims;
    const auto look = [&](glm::ivec3 cell, std::size_t i, bool forward) {
        if (reached[i])
            return false;
        for (int axis = 0; axis < 3; ++axis) {
            glm::ivec3 other = cell;
            other[axis] += forward ? -1 : 1;
            if ((forward ? links.back(cell, axis) : links.towards(cell, axis)) > 0.0f
                && reached[grid.index(other)]) {
                reached[i] = 1;
                return true;
            }
        }
        return false;
    };
    bool found = false, changed = true;
    for (int round = 0; changed && round < most_rounds; ++round) {
        changed = false;
        std::size_t i = grid.index({0, 0, begin});
        for (int z = begin; z < end; ++z)
            for (int y = 0; y < dims.y; ++y)
                for (int x = 0; x < dims.x; ++x, ++i)
                    changed |= look({x, y, z}, i, true);
        for (int z = end; z-- > begin;)
            for (int y = dims.y; y-- > 0;)
                for (int x = dims.x; x-- > 0;)
                    changed |= look({x, y, z}, --i, false);
        found |= changed;
    }
    return found;
}

/// Cells that a chain of links joins to one that is lit. Slabs of layers are swept at once, every
/// other one and then those between, which they look at; where they are not done after
/// most_rounds and as many rounds as there are slabs, some are missing, which then take more
/// propagations. The same for any number of threads.
std::vector<std::uint8_t> reach(const Links& links, std::span<const std::uint8_t> lit) {
    std::vector<std::uint8_t> reached(lit.begin(), lit.end());
    const int layers = links.grid.dims.z, slabs = (layers + slab_layers - 1) / slab_layers;
    std::vector<std::uint8_t> stale(std::size_t(slabs), 1), found(stale);
    const auto half = [&](int parity) {
        tbb::parallel_for(0, (slabs + 1 - parity) / 2, [&](int pair) {
            const int slab = 2 * pair + parity;
            const auto at = std::size_t(slab);
            found[at] = stale[at]
                        && sweep(links, slab * slab_layers,
                                 std::min((slab + 1) * slab_layers, layers), reached);
            stale[at] = 0;
        });
        bool any = false;
        for (int slab = parity; slab < slabs; slab += 2) {
            const auto at = std::size_t(slab);
            if (!found[at])
                continue;
            any = true;
            if (slab > 0)
                stale[at - 1] = 1;
            if (slab + 1 < slabs)
                stale[at + 1] = 1;
        }
        return any;
    };
    for (int round = 0; round < most_rounds + slabs; ++round) {
        const bool even = half(0), odd = half(1);
        if (!even && !odd)
            break;
    }
    return reached;
}

/// Of a block: sums over the links of its cells that leave it towards +x, +y and +z, and what the
/// links of its cells take.
using Sums = std::vector<glm::vec4>;

/// What the neighbours of a cell send to it; `at` is its index.
template <class Level>
glm::vec4 from_around(const Level& level, const std::vector<glm::vec4>& all, glm::ivec3 cell,
                      std::size_t at) {
    const std::array<std::size_t, 3> pitch{1, std::size_t(level.dims.x),
                                           std::size_t(level.dims.x) * std::size_t(level.dims.y)};
    glm::vec4 sum(0.0f);
    for (int axis = 0; axis < 3; ++axis) {
        const std::size_t step = pitch[std::size_t(axis)];
        if (cell[axis] + 1 < level.dims[axis])
            sum += level.links[at][axis] * all[at + step];
        if (cell[axis] > 0)
            sum += level.links[at - step][axis] * all[at - step];
    }
    return sum;
}

} // namespace

Diffusion::Diffusion(const Grid& grid, std::span<const float> open,
                     std::span<const std::uint8_t> lit) {
    const Links links{grid, open};
    const std::vector<std::uint8_t> reached =
        open.empty() ? std::vector<std::uint8_t>(grid.size(), 1) : reach(links, lit);
    Level* level = &levels_.emplace_back();
    level->dims = (grid.dims + 1) / 2;
    const std::size_t count =
        std::size_t(level->dims.x) * std::size_t(level->dims.y) * std::size_t(level->dims.z);
    reached_.resize(count);
    Sums sums(count);
    for_rows(level->dims, [&](int y, int z) {
        for (int x = 0; x < level->dims.x; ++x) {
            const glm::ivec3 block(x, y, z);
            const std::size_t i = level->index(block);
            for (int k = 0; k < 8; ++k) {
                const glm::ivec3 child(k & 1, k >> 1 & 1, k >> 2), cell = 2 * block + child;
                if (!grid.contains(cell) || !reached[grid.index(cell)])
                    continue;
                reached_[i] = std::uint8_t(reached_[i] | 1u << k);
                for (int axis = 0; axis < 3; ++axis) {
                    const float towards = links.towards(cell, axis);
                    if (child[axis])
                        sums[i][axis] += towards;
                    sums[i].w += 2.0f - towards - links.back(cell, axis);
                }
            }
        }
    });
    for (float h = 2.0f;; h *= 2.0f) {
        const std::size_t size = sums.size();
        level->links.resize(size);
        tbb::parallel_for(std::size_t(0), size,
                          [&](std::size_t i) { level->links[i] = sums[i] * (diffusion / h); });
        for_rows(level->dims, [&](int y, int z) {
            for (int x = 0; x < level->dims.x; ++x) {
                const glm::ivec3 at(x, y, z);
                const std::size_t i = level->index(at);
                glm::vec4& own = level->links[i];
                float sum = sums[i].w * (diffusion / (0.5f * h + beyond)) + own.x + own.y + own.z;
                for (int axis = 0; axis < 3; ++axis) {
                    glm::ivec3 other = at;
                    --other[axis];
                    if (other[axis] >= 0)
                        sum += level->links[level->index(other)][axis];
                }
                own.w = sum > 0.0f ? 1.0f / sum : 0.0f;
            }
        });
        if (std::max({level->dims.x, level->dims.y, level->dims.z}) <= 2)
            return;
        Level coarse;
        coarse.dims = (level->dims + 1) / 2;
        Sums coarse_sums(std::size_t(coarse.dims.x) * std::size_t(coarse.dims.y)
                         * std::size_t(coarse.dims.z));
        for_rows(coarse.dims, [&](int y, int z) {
            for (int x = 0; x < coarse.dims.x; ++x) {
                glm::vec4& sum = coarse_sums[coarse.index({x, y, z})];
                for (int k = 0; k < 8; ++k) {
                    const glm::ivec3 child(k & 1, k >> 1 & 1, k >> 2);
                    const glm::ivec3 at = 2 * glm::ivec3(x, y, z) + child;
                    if (glm::any(glm::greaterThanEqual(at, level->dims)))
                        continue;
                    const glm::vec4& fine = sums[level->index(at)];
                    for (int axis = 0; axis < 3; ++axis)
                        sum[axis] += child[axis] ? fine[axis] : 0.0f;
                    sum.w += fine.w;
                }
            }
        });
        sums = std::move(coarse_sums);
        level = &levels_.emplace_back(std::move(coarse));
    }
}

void Diffusion::relax(Level& level) {
    const std::size_t nx = std::size_t(level.dims.x), layer = nx * std::size_t(level.dims.y);
    const std::vector<glm::vec4> dark(nx, glm::vec4(0.0f)); // beyond the sides
    for_rows(level.dims, [&](int y, int z) {
        const std::size_t first = level.index({0, y, z});
        const auto row = [&](const std::vector<glm::vec4>& of, bool is_there, std::ptrdiff_t off) {
            return is_there ? of.data() + (std::ptrdiff_t(first) + off) : dark.data();
        };
        const auto across = std::ptrdiff_t(nx), up = std::ptrdiff_t(layer);
        const glm::vec4* links = row(level.links, true, 0);
        const glm::vec4* links_south = row(level.links, y > 0, -across);
        const glm::vec4* links_below = row(level.links, z > 0, -up);
        const glm::vec4* all = row(level.all, true, 0);
        const glm::vec4* south = row(level.all, y > 0, -across);
        const glm::vec4* north = row(level.all, y + 1 < level.dims.y, across);
        const glm::vec4* below = row(level.all, z > 0, -up);
        const glm::vec4* above = row(level.all, z + 1 < level.dims.z, up);
        for (std::size_t x = 0; x < nx; ++x) {
            glm::vec4 sum = links[x].y * north[x] + links_south[x].y * south[x]
                            + (links[x].z * above[x] + links_below[x].z * below[x]);
            if (x + 1 < nx)
                sum += links[x].x * all[x + 1];
            if (x > 0)
                sum += links[x - 1].x * all[x - 1];
            level.next[first + x] =
                (1.0f - relaxed) * all[x] + relaxed * links[x].w * (level.light[first + x] + sum);
        }
    });
    std::swap(level.all, level.next);
}

void Diffusion::restrict_rest(const Level& fine, Level& coarse) {
    for_rows(coarse.dims, [&](int y, int z) {
        for (int x = 0; x < coarse.dims.x; ++x) {
            const glm::ivec3 block(x, y, z);
            glm::vec4 rest(0.0f);
            for (int k = 0; k < 8; ++k) {
                const glm::ivec3 cell = 2 * block + glm::ivec3(k & 1, k >> 1 & 1, k >> 2);
                if (glm::any(glm::greaterThanEqual(cell, fine.dims)))
                    continue;
                const std::size_t i = fine.index(cell);
                if (fine.links[i].w > 0.0f)
                    rest += fine.light[i] - fine.all[i] / fine.links[i].w
                            + from_around(fine, fine.all, cell, i);
            }
            coarse.light[coarse.index(block)] = rest;
        }
    });
    std::ranges::fill(coarse.all, glm::vec4(0.0f));
}

void Diffusion::add_coarse(const Level& coarse, Level& fine) {
    // Linear between the centres of blocks; at the ends that of the last.
    const auto weights = [&](int at, int axis) {
        const int own = at / 2, other = at % 2 ? own + 1 : own - 1;
        return std::pair(own, std::clamp(other, 0, coarse.dims[axis] - 1));
    };
    for_rows(fine.dims, [&](int y, int z) {
        const auto [y0, y1] = weights(y, 1);
        const auto [z0, z1] = weights(z, 2);
        const std::size_t rows[] = {coarse.index({0, y0, z0}), coarse.index({0, y1, z0}),
                                    coarse.index({0, y0, z1}), coarse.index({0, y1, z1})};
        constexpr float shares[] = {0.5625f, 0.1875f, 0.1875f, 0.0625f};
        for (int x = 0; x < fine.dims.x; ++x) {
            const auto [x0, x1] = weights(x, 0);
            glm::vec4 sum(0.0f);
            for (int k = 0; k < 4; ++k)
                sum += shares[k]
                       * (0.75f * coarse.all[rows[k] + std::size_t(x0)]
                          + 0.25f * coarse.all[rows[k] + std::size_t(x1)]);
            const std::size_t i = fine.index({x, y, z});
            if (fine.links[i].w > 0.0f)
                fine.all[i] += sum;
        }
    });
}

void Diffusion::cycle(std::size_t l) {
    Level& level = levels_[l];
    if (l + 1 == levels_.size()) {
        for (int i = 0; i < at_the_end; ++i)
            relax(level);
        return;
    }
    for (int i = 0; i < relaxations; ++i)
        relax(level);
    for (int twice = 0; twice < 2; ++twice) { // a W cycle
        restrict_rest(level, levels_[l + 1]);
        cycle(l + 1);
        add_coarse(levels_[l + 1], level);
    }
    for (int i = 0; i < relaxations; ++i)
        relax(level);
}

void Diffusion::solve(std::span<const glm::vec4> light, std::span<glm::vec4> all,
                      std::size_t level) {
    for (std::size_t l = level; l < levels_.size(); ++l)
        for (auto* values : {&levels_[l].light, &levels_[l].all, &levels_[l].next})
            values->resize(levels_[l].links.size());
    Level& first = levels_[level];
    std::ranges::copy(light, first.light.begin());
    std::ranges::fill(first.all, glm::vec4(0.0f));
    cycle(level);
    std::ranges::copy(first.all, all.begin());
}

std::vector<float> Diffusion::matrix(std::size_t level) {
    const std::size_t size = levels_[level].links.size();
    std::vector<float> columns(size * size);
    std::vector<glm::vec4> light(size), all(size);
    for (std::size_t first = 0; first < size; first += 4) {
        const std::size_t count = std::min<std::size_t>(4, size - first);
        std::ranges::fill(light, glm::vec4(0.0f));
        for (std::size_t k = 0; k < count; ++k)
            light[first + k][int(k)] = 1.0f;
        solve(light, all, level);
        for (std::size_t k = 0; k < count; ++k)
            for (std::size_t i = 0; i < size; ++i)
                columns[(first + k) * size + i] = all[i][int(k)];
    }
    return columns;
}

} // namespace lpvbake::solver::lpv
