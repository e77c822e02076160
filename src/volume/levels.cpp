#include "volume/levels.h"

#include "lpvbake/error.h"
#include "machine.h"
#include "text.h"
#include "volume/grid.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

namespace lpvbake::volume {
namespace {

/// Of a cell: what positions of samples may be off by.
constexpr double slack = 1e-6;
/// Smallest cells along an edge of the outermost box, so that single precision tells them apart.
constexpr double most_cells = 65536;
constexpr double farthest = 1e18; ///< metres: its square is a float

[[noreturn]] void reject(const LevelBox& level, const std::string& why) {
    const auto& [lo, hi, cell, made] = level;
    if (made)
        throw Error(ErrorKind::argument,
                    format("`levels`: that of %.6g m cells, %.6g,%.6g,%.6g to %.6g,%.6g,%.6g, ",
                           cell, lo.x, lo.y, lo.z, hi.x, hi.y, hi.z)
                        + why);
    throw Error(ErrorKind::argument, format("`level` %.6g,%.6g,%.6g,%.6g,%.6g,%.6g:%.6g ", lo.x,
                                            lo.y, lo.z, hi.x, hi.y, hi.z, cell)
                                         + why);
}

struct Hull {
    glm::dvec3 lo, hi;
};

/// Of the outermost samples.
Hull hull_of(const Grid& grid) {
    return {grid.center(glm::ivec3(0)), grid.center(grid.dims - 1)};
}

void check(const std::vector<LevelBox>& levels) {
    if (levels.size() > most_levels)
        throw Error(ErrorKind::argument, format("`level`: %zu levels are more than %zu; leave some "
                                                "out",
                                                levels.size(), most_levels));
    const double least = levels.front().cell;
    for (std::size_t i = 0; i < levels.size(); ++i) {
        const LevelBox& level = levels[i];
        if (!(level.cell > 0 && std::isnormal(level.cell)))
            reject(level, "has no cell size above 0");
        if (!(level.cell <= farthest)
            || !glm::all(glm::lessThanEqual(glm::max(glm::abs(level.lo), glm::abs(level.hi)),
                                            glm::dvec3(farthest))))
            reject(level, format("has lengths above %.0g m; no scene is that large", farthest));
        if (!glm::all(glm::lessThanEqual(level.lo, level.hi)))
            reject(level, "has a box that is inside out; give the lower corner first");
        const double ratio = level.cell / least, power = std::exp2(std::round(std::log2(ratio)));
        if (std::abs(ratio - power) > slack * power)
            reject(level, format("has cells that are no power of two of the finest, of %.6g m; use "
                                 "%.6g or %.6g",
                                 least, least * std::exp2(std::floor(std::log2(ratio))),
                                 least * std::exp2(std::ceil(std::log2(ratio)))));
        if (i + 1 == levels.size())
            continue;
        const LevelBox& next = levels[i + 1];
        if (next.cell < level.cell * (1 + slack))
            reject(next, "has the cells of another level; give each level other ones, or one box");
        if (glm::any(glm::lessThan(level.lo, next.lo - slack * level.cell))
            || glm::any(glm::greaterThan(level.hi, next.hi + slack * level.cell)))
            reject(level, format("does not lie in the box of the next level, %.6g,%.6g,%.6g,%.6g,"
                                 "%.6g,%.6g; levels are nested: enlarge that one",
                                 next.lo.x, next.lo.y, next.lo.z, next.hi.x, next.hi.y, next.hi.z));
    }
    const glm::dvec3 extent = levels.back().hi - levels.back().lo;
    const double longest = std::max({extent.x, extent.y, extent.z});
    if (longest > most_cells * least)
        reject(levels.front(), format("has cells that cannot be told apart in a box of %.4g m; use "
                                      "%.3g or more",
                                      longest, longest / most_cells));
}

void check_cells(const LevelBox& level, glm::dvec3 dims) {
    if (dims.x * dims.y * dims.z > std::numeric_limits<int32_t>::max())
        reject(level, "has more than 2^31 - 1 cells; give it larger ones or a smaller box");
}

/// The grid of a box in the next coarser grid, from samples of that to samples of that.
Grid grid_in(const Grid& coarse, const LevelBox& level, int ratio) {
    const glm::dvec3 first = coarse.center(glm::ivec3(0));
    Grid grid;
    grid.cell = coarse.cell / ratio;
    glm::ivec3 from;
    for (int axis = 0; axis < 3; ++axis) {
        const int last = coarse.dims[axis] - 1;
        const auto at = [&](double x) { return (x - first[axis]) / coarse.cell; };
        from[axis] = std::clamp(int(std::floor(at(level.lo[axis]) + slack)), 0, last);
        int to = std::clamp(int(std::ceil(at(level.hi[axis]) - slack)), 0, last);
        if (from[axis] == to) // a flat box
            from[axis] == last ? from[axis] = std::max(0, last - 1) : to = to + 1;
        grid.dims[axis] = (to - from[axis]) * ratio + 1;
    }
    grid.origin = first + coarse.cell * glm::dvec3(from) - 0.5 * grid.cell;
    check_cells(level, glm::dvec3(grid.dims));
    return grid;
}

} // namespace

std::vector<Grid> nest_grids(std::vector<LevelBox> levels) {
    std::ranges::stable_sort(levels, {}, &LevelBox::cell);
    check(levels);
    const double least = levels.front().cell;
    const auto power = [&](double cell) { return std::exp2(std::round(std::log2(cell / least))); };
    for (LevelBox& level : levels)
        level.cell = least * power(level.cell);
    const auto& [lo, hi, cell, made] = levels.back();
    check_cells(levels.back(), (hi - lo) / cell + 1.0);
    std::vector<Grid> grids{
        fit_grid(lo - 0.5 * cell, hi + 0.5 * cell, {.cell = levels.back().cell, .margin = 0})};
    for (int axis = 0; axis < 3; ++axis) // without rounding's traces where it begins as asked for
        if (const double begin = lo[axis] - 0.5 * cell;
            std::abs(grids[0].origin[axis] - begin) < slack * cell)
            grids[0].origin[axis] = begin;
    for (std::size_t i = levels.size() - 1; i-- > 0;)
        grids.push_back(grid_in(grids.back(), levels[i],
                                int(std::lround(levels[i + 1].cell / levels[i].cell))));
    std::ranges::reverse(grids);
    return grids;
}

std::vector<LevelBox> levels_around(const LevelBox& focus, glm::dvec3 lo, glm::dvec3 hi,
                                    std::size_t count) {
    if (glm::any(glm::greaterThan(focus.lo, hi)) || glm::any(glm::lessThan(focus.hi, lo)))
        throw Error(ErrorKind::argument,
                    format("`focus` %.6g,%.6g,%.6g,%.6g,%.6g,%.6g lies outside of the outermost "
                           "box, %.6g,%.6g,%.6g,%.6g,%.6g,%.6g",
                           focus.lo.x, focus.lo.y, focus.lo.z, focus.hi.x, focus.hi.y, focus.hi.z,
                           lo.x, lo.y, lo.z, hi.x, hi.y, hi.z));
    std::vector<LevelBox> levels;
    const glm::dvec3 middle = 0.5 * (focus.lo + focus.hi), half = 0.5 * (focus.hi - focus.lo);
    for (std::size_t i = 0; i < count; ++i) {
        const double size = std::exp2(double(i));
        const bool last = i + 1 == count;
        levels.push_back({last ? lo : glm::clamp(middle - size * half, lo, hi),
                          last ? hi : glm::clamp(middle + size * half, lo, hi), size * focus.cell,
                          true});
    }
    return levels;
}

std::vector<Grid> VolumeSet::grids() const {
    std::vector<Grid> grids;
    if (bricks)
        for (int level = 0; level < bricks->levels().count; ++level)
            grids.push_back(bricks->levels().lattice(level));
    else
        for (const Volume& level : levels)
            grids.push_back(level.grid);
    return grids;
}

void order_by_priority(VolumeSet& set) {
    std::vector<std::size_t> order(set.levels.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
        return std::pair(-set.places[a].priority, set.levels[a].grid.cell)
               < std::pair(-set.places[b].priority, set.levels[b].grid.cell);
    });
    VolumeSet sorted;
    sorted.blend = set.blend;
    for (const std::size_t i : order) {
        sorted.levels.push_back(std::move(set.levels[i]));
        sorted.places.push_back(std::move(set.places[i]));
    }
    set = std::move(sorted);
}

std::string title_of(const VolumeSet& set, std::size_t level) {
    return set.places.empty() ? format("level %zu", level) : "volume " + set.places[level].name;
}

double share_of(const Levels& levels, std::size_t level, glm::dvec3 point) {
    const auto smooth = [](double t) { return t * t * (3 - 2 * t); };
    if (!levels.places.empty()) {
        const double depth = depth_in(levels.volumes[level].grid, point);
        const double falloff = std::max(levels.places[level].falloff, 1e-300);
        return smooth(std::clamp(depth / falloff, 0.0, 1.0));
    }
    if (levels.bricks || level + 1 == levels.volumes.size())
        return 1;
    const Grid& grid = levels.volumes[level].grid;
    const Hull own = hull_of(grid), outermost = hull_of(levels.volumes.back().grid);
    double inside = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
        if (own.lo[axis] > outermost.lo[axis] + slack * grid.cell)
            inside = std::min(inside, point[axis] - own.lo[axis]);
        if (own.hi[axis] < outermost.hi[axis] - slack * grid.cell)
            inside = std::min(inside, own.hi[axis] - point[axis]);
    }
    const double t =
        std::clamp(inside / (levels.blend * levels.volumes[level + 1].grid.cell), 0.0, 1.0);
    return smooth(t);
}

std::size_t level_at(const Levels& levels, glm::dvec3 point) {
    if (levels.bricks)
        return levels.bricks->at(point);
    std::size_t level = 0;
    if (!levels.places.empty()) {
        const auto share = [&](std::size_t i) { return share_of(levels, i, point); };
        const auto depth = [&](std::size_t i) { return depth_in(levels.volumes[i].grid, point); };
        for (std::size_t i = 0; i < levels.volumes.size(); ++i) {
            if (share(i) > 0)
                return i;
            if (depth(i) > depth(level))
                level = i;
        }
        return level;
    }
    while (!(share_of(levels, level, point) > 0))
        ++level;
    return level;
}

namespace {

/// Whether a point (cells, from the centre) lies before all walls of a cell.
bool is_before(const Volume& volume, std::size_t cell, glm::dvec3 x) {
    return std::ranges::all_of(volume.walls, [&](const auto& wall) {
        const glm::dvec3 w(wall[cell]);
        return !(glm::dot(w, w) > 0) || glm::dot(w, x) < glm::dot(w, w);
    });
}

} // namespace

Taps taps_at(const Volume& volume, glm::dvec3 point) {
    Taps taps{weights_at(volume, point, glm::dvec3(0, 1, 0), Reading::trilinear)};
    const glm::dvec3 at = volume.grid.to_grid(point);
    const CellWeights plain = taps.cells;
    std::array<bool, 8> before{};
    double all = 0, valid = 0;
    for (std::size_t i = 0; i < 8; ++i) {
        const std::size_t cell = plain.cell[i];
        before[i] = volume.is_valid(cell)
                    && is_before(volume, cell, at - (glm::dvec3(volume.grid.cell_at(cell)) + 0.5));
        valid += volume.is_valid(cell) ? plain.weight[i] : 0;
        all += before[i] ? plain.weight[i] : 0;
    }
    taps.valid = all > 0;
    const auto counts = [&](std::size_t i) {
        return all > 0 ? before[i] : valid > 0 ? volume.is_valid(plain.cell[i]) : true;
    };
    const double sum = all > 0 ? all : valid > 0 ? valid : 1;
    double most = 0;
    for (std::size_t i = 0; i < 8; ++i) {
        taps.cells.weight[i] = counts(i) ? plain.weight[i] / sum : 0;
        if (taps.cells.weight[i] > most) {
            most = taps.cells.weight[i];
            taps.nearest = plain.cell[i];
        }
    }
    taps.cells.clear = taps.valid;
    return taps;
}

namespace {

/// All coefficients of a sample.
struct Sample {
    std::array<glm::dvec3, sh_count(sh_max_order)> sh{};

    friend Sample operator*(double factor, Sample sample) {
        for (glm::dvec3& c : sample.sh)
            c *= factor;
        return sample;
    }
    Sample& operator+=(const Sample& other) {
        for (std::size_t k = 0; k < sh.size(); ++k)
            sh[k] += other.sh[k];
        return *this;
    }
    friend Sample operator/(Sample sample, double by) {
        for (glm::dvec3& c : sample.sh)
            c /= by;
        return sample;
    }
};

Sample mixed(const Volume& volume, const CellWeights& cells) {
    Sample sample;
    for (std::size_t k = 0; k < volume.sh.size(); ++k)
        for (std::size_t i = 0; i < 8; ++i)
            if (cells.weight[i] > 0)
                sample.sh[k] += cells.weight[i] * glm::dvec3(volume.sh[k][cells.cell[i]]);
    return sample;
}

/// The walls of a cell as seen from another place, in cells of another size; those that are too far
/// from there are left out.
void carry_walls(const Volume& from, std::size_t cell, Volume& to, std::size_t own) {
    const glm::dvec3 centre = from.grid.center(from.grid.cell_at(cell));
    const glm::dvec3 way = to.grid.center(to.grid.cell_at(own)) - centre;
    std::size_t kept = 0;
    for (const auto& wall : from.walls) {
        const glm::dvec3 w(wall[cell]);
        const double length = glm::length(w);
        if (!(length > 0))
            continue;
        const double away = (length * from.grid.cell - glm::dot(way, w) / length) / to.grid.cell;
        if (away > 0 && away < double(walls_reach))
            to.walls[kept++][own] = glm::vec3(away / length * w);
    }
}

} // namespace

std::vector<glm::dvec3> field_at(const Levels& levels, glm::dvec3 point) {
    const Sample sample = blend(levels, point, [&](std::size_t level) {
        const Taps taps = taps_at(levels.volumes[level], point);
        return LevelReading<Sample>{mixed(levels.volumes[level], taps.cells), taps.valid};
    });
    return {sample.sh.begin(), sample.sh.begin() + levels.volumes.front().sh.size()};
}

Volume flatten(const Levels& levels, double cell) {
    const Volume& outermost = levels.volumes.back();
    const Hull hull = hull_of(levels.bricks ? levels.bricks->levels().finest : outermost.grid);
    const glm::dvec3 dims = (hull.hi - hull.lo) / cell + 1.0;
    if (dims.x * dims.y * dims.z > std::numeric_limits<int32_t>::max())
        throw Error(ErrorKind::argument,
                    format("`flatten` %.6g: %.0f x %.0f x %.0f cells are more than 2^31 - 1; use "
                           "larger ones",
                           cell, dims.x, dims.y, dims.z));
    const double bytes = dims.x * dims.y * dims.z
                         * double(sizeof(glm::vec3) * (outermost.sh.size() + outermost.walls.size())
                                  + sizeof(float));
    if (const double has = double(machine_memory()); bytes > has)
        throw Error(ErrorKind::memory,
                    format("`flatten` %.6g: the cells take %s, more than "
                           "the machine has, %s; use larger ones",
                           cell, memory_text(bytes).c_str(), memory_text(has).c_str()));
    Volume flat;
    flat.grid = fit_grid(hull.lo - 0.5 * cell, hull.hi + 0.5 * cell, {.cell = cell, .margin = 0});
    flat.sh_order = outermost.sh_order;
    flat.metadata = outermost.metadata;
    flat.sh.assign(outermost.sh.size(), std::vector<glm::vec3>(flat.grid.size()));
    flat.validity.assign(outermost.validity.empty() ? 0 : flat.grid.size(), 0.0f);
    flat.walls.assign(outermost.walls.size(), std::vector<glm::vec3>(flat.grid.size()));
    tbb::parallel_for(std::size_t(0), flat.grid.size(), [&](std::size_t i) {
        const glm::dvec3 point = flat.grid.center(flat.grid.cell_at(i));
        std::optional<std::size_t> source; // the finest level with cells before whose walls it lies
        bool valid = false;
        const Sample sample = blend(levels, point, [&](std::size_t level) {
            const Taps taps = taps_at(levels.volumes[level], point);
            if (!source || (taps.valid && !valid)) {
                source = level;
                valid = taps.valid;
            }
            return LevelReading<Sample>{mixed(levels.volumes[level], taps.cells), taps.valid};
        });
        for (std::size_t k = 0; k < flat.sh.size(); ++k)
            flat.sh[k][i] = glm::vec3(sample.sh[k]);
        if (!flat.validity.empty())
            flat.validity[i] = valid ? 1.0f : 0.0f;
        if (valid && !flat.walls.empty()) {
            const Volume& from = levels.volumes[*source];
            carry_walls(from, taps_at(from, point).nearest, flat, i);
        }
    });
    return flat;
}

} // namespace lpvbake::volume
