#include "volume/bricks.h"

#include "lpvbake/error.h"
#include "text.h"
#include "volume/grid.h"
#include "volume/grids.h"
#include "volume/levels.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <tuple>

namespace lpvbake::volume {
namespace {

constexpr double slack = 1e-6; ///< of a ratio, and of cells
/// Finest cells along an edge of the box, so that single precision tells them apart.
constexpr double most_cells = 65536;

std::size_t count_of(glm::ivec3 dims) {
    return std::size_t(dims.x) * std::size_t(dims.y) * std::size_t(dims.z);
}

bool contains(glm::ivec3 places, glm::ivec3 at) {
    return glm::all(glm::greaterThanEqual(at, glm::ivec3(0)))
           && glm::all(glm::lessThan(at, places));
}

auto order_of(const Brick& brick) {
    return std::tuple(brick.level, brick.at.z, brick.at.y, brick.at.x);
}

[[noreturn]] void refuse(double fine, double coarse, const std::string& why) {
    throw Error(ErrorKind::argument, format("`adaptive` %.6g..%.6g ", fine, coarse) + why);
}

} // namespace

Grid BrickLevels::lattice(int level) const {
    const double cell = std::exp2(level) * finest.cell;
    return {finest.center(glm::ivec3(0)) - 0.5 * cell, cell, ((finest.dims - 1) >> level) + 1};
}

glm::ivec3 BrickLevels::places(int level) const {
    return (finest.dims - 1) / (brick_cells << level);
}

Grid BrickLevels::grid_of(const Brick& brick) const {
    const Grid all = lattice(brick.level);
    return {all.origin + all.cell * glm::dvec3(brick_cells * brick.at), all.cell,
            glm::ivec3(brick_edge)};
}

BrickLevels brick_levels(double fine, double coarse, glm::dvec3 lo, glm::dvec3 hi) {
    if (!(fine > 0 && std::isnormal(fine) && std::isfinite(coarse)))
        refuse(fine, coarse, "has a cell size that is not above 0");
    if (fine > coarse)
        refuse(fine, coarse, "begins with the larger cells; the finest are first");
    const double power = std::log2(coarse / fine), whole = std::round(power);
    if (std::abs(power - whole) > slack)
        refuse(fine, coarse,
               format("is no ratio of a power of two; use %.6g..%.6g or %.6g..%.6g", fine,
                      fine * std::exp2(std::floor(power)), fine,
                      fine * std::exp2(std::ceil(power))));
    if (whole >= double(most_levels))
        refuse(fine, coarse,
               format("has %.0f levels, more than %zu; use %.6g..%.6g or larger cells", whole + 1,
                      most_levels, fine, fine * std::exp2(double(most_levels) - 1)));
    fit_grid(lo, hi, {.resolution = 3, .margin = 0}); // what it refuses of a box
    BrickLevels levels;
    levels.count = int(whole) + 1;
    const double root = brick_cells * fine * std::exp2(whole);
    const glm::dvec3 roots = glm::max(glm::ceil((hi - lo) / root - slack), glm::dvec3(1));
    const double longest = std::max({hi.x - lo.x, hi.y - lo.y, hi.z - lo.z});
    if (longest < root * (1 - slack))
        refuse(fine, coarse,
               format("makes bricks of 8 cells, %.6g m, that are larger than the box of %.6g m; "
                      "use coarsest cells of %.6g or less",
                      root, longest, fine * std::exp2(std::floor(std::log2(longest / 8 / fine)))));
    const glm::dvec3 places = roots * std::exp2(whole);
    if (const double all = places.x * places.y * places.z; all > double(most_brick_places))
        refuse(fine, coarse,
               format("makes %.3g places of bricks in the box, more than %zu; use larger finest "
                      "cells or a smaller box",
                      all, most_brick_places));
    const double farthest = std::max(glm::length(lo), glm::length(hi));
    if (longest > most_cells * fine
        || farthest * std::numeric_limits<double>::epsilon() > fine / 1000)
        refuse(fine, coarse,
               format("has cells that cannot be told apart in a box of %.4g m, %.4g m from the "
                      "origin; use larger ones",
                      longest, farthest));
    levels.finest = {lo - 0.5 * fine, fine, brick_cells * glm::ivec3(places) + 1};
    return levels;
}

BrickTree::BrickTree(const BrickLevels& levels, std::vector<Brick> bricks)
    : levels_(levels),
      bricks_(std::move(bricks)) {
    std::ranges::sort(bricks_, {}, order_of);
    const auto fail = [](const Brick& brick, const char* why) {
        throw Error(ErrorKind::invalid, format("brick %d, %d, %d of level %d ", brick.at.x,
                                               brick.at.y, brick.at.z, brick.level)
                                            + why);
    };
    const int roots = levels.count - 1;
    for (std::size_t i = 0; i < bricks_.size(); ++i) {
        const Brick& brick = bricks_[i];
        if (brick.level < 0 || brick.level > roots
            || !contains(levels.places(brick.level), brick.at))
            fail(brick, "lies outside of the box");
        if (i > 0 && bricks_[i - 1] == brick)
            fail(brick, "is there twice");
        if (brick.level < roots && !find({brick.level + 1, brick.at >> 1}))
            fail(brick, "is an eighth of none");
    }
    const auto coarsest = std::ranges::count(bricks_, roots, &Brick::level);
    if (std::size_t(coarsest) != count_of(levels.places(roots)))
        throw Error(ErrorKind::invalid, "bricks of the coarsest level are missing");
    const Grid all{{}, 1, levels.places(0)};
    finest_.resize(all.size());
    for (std::size_t i = bricks_.size(); i-- > 0;) { // coarse ones first
        const int edge = 1 << bricks_[i].level;
        const glm::ivec3 lo = edge * bricks_[i].at;
        glm::ivec3 at;
        for (at.z = lo.z; at.z < lo.z + edge; ++at.z)
            for (at.y = lo.y; at.y < lo.y + edge; ++at.y)
                for (at.x = lo.x; at.x < lo.x + edge; ++at.x)
                    finest_[all.index(at)] = uint32_t(i);
    }
}

std::optional<std::size_t> BrickTree::find(const Brick& brick) const {
    const auto found = std::ranges::lower_bound(bricks_, order_of(brick), {}, order_of);
    if (found == bricks_.end() || !(*found == brick))
        return {};
    return std::size_t(found - bricks_.begin());
}

std::size_t BrickTree::at(glm::dvec3 point) const {
    const glm::ivec3 places = levels_.places(0);
    const glm::dvec3 at = (levels_.finest.to_grid(point) - 0.5) / double(brick_cells);
    // Not a number is nowhere: the first will do.
    const glm::ivec3 place(
        glm::clamp(at == at ? at : glm::dvec3(0), glm::dvec3(0), glm::dvec3(places - 1)));
    return finest_[Grid{{}, 1, places}.index(place)];
}

std::optional<std::size_t> BrickTree::parent(std::size_t brick) const {
    const Brick& own = bricks_[brick];
    return own.level + 1 < levels_.count ? find({own.level + 1, own.at >> 1}) : std::nullopt;
}

bool BrickTree::operator==(const BrickTree& other) const {
    return levels_.finest == other.levels_.finest && levels_.count == other.levels_.count
           && bricks_ == other.bricks_;
}

// ---------------------------------------------------------------- stitching

namespace {

/// Whether some brick at the sample `s` of one is of a coarser level.
bool ends_at(const BrickTree& tree, const Brick& brick, glm::ivec3 s) {
    glm::ivec3 lo(0), hi(0), way;
    for (int axis = 0; axis < 3; ++axis) {
        lo[axis] = s[axis] == 0 ? -1 : 0;
        hi[axis] = s[axis] == brick_cells ? 1 : 0;
    }
    for (way.z = lo.z; way.z <= hi.z; ++way.z)
        for (way.y = lo.y; way.y <= hi.y; ++way.y)
            for (way.x = lo.x; way.x <= hi.x; ++way.x) {
                const glm::ivec3 at = brick.at + way;
                if (contains(tree.levels().places(brick.level), at)
                    && !tree.find({brick.level, at}))
                    return true;
            }
    return false;
}

/// Overwrites a sample by the samples of a coarser brick around it, `at` half cells of that.
void take_between(const Volume& coarse, glm::ivec3 at, Volume& fine, std::size_t own) {
    const glm::ivec3 low = at >> 1, odd = at & 1;
    const double weight = std::exp2(-double(odd.x + odd.y + odd.z));
    std::array<glm::dvec3, sh_count(sh_max_order)> sum{};
    bool valid = true;
    glm::ivec3 way;
    for (way.z = 0; way.z <= odd.z; ++way.z)
        for (way.y = 0; way.y <= odd.y; ++way.y)
            for (way.x = 0; way.x <= odd.x; ++way.x) {
                const std::size_t sample = coarse.grid.index(low + way);
                valid = valid && coarse.is_valid(sample);
                for (std::size_t k = 0; k < fine.sh.size(); ++k)
                    sum[k] += weight * glm::dvec3(coarse.sh[k][sample]);
            }
    for (std::size_t k = 0; k < fine.sh.size(); ++k)
        fine.sh[k][own] = glm::vec3(sum[k]);
    if (!fine.validity.empty() && !valid)
        fine.validity[own] = 0.0f;
}

} // namespace

void stitch(const BrickTree& tree, std::span<Volume> bricks) {
    for (int level = tree.levels().count - 2; level >= 0; --level)
        tbb::parallel_for(std::size_t(0), bricks.size(), [&](std::size_t i) {
            const Brick& brick = tree.bricks()[i];
            if (brick.level != level)
                return;
            const Volume& coarse = bricks[*tree.parent(i)];
            const glm::ivec3 half = brick_cells * (brick.at & 1);
            for (std::size_t own = 0; own < brick_samples; ++own) {
                const glm::ivec3 s = bricks[i].grid.cell_at(own);
                const bool inside = glm::all(glm::greaterThan(s, glm::ivec3(0)))
                                    && glm::all(glm::lessThan(s, glm::ivec3(brick_cells)));
                if (!inside && ends_at(tree, brick, s))
                    take_between(coarse, half + s, bricks[i], own);
            }
        });
}

// ---------------------------------------------------------------- trimming

double mean_irradiance(const Volume& volume, std::size_t sample) {
    const glm::dvec3 c(volume.sh[0][sample]);
    return (c.r + c.g + c.b) / 3 * sh_cosine_factor(0) * double(sh_y0);
}

double mean_square_irradiance(std::span<const glm::dvec3> c) {
    double sum = 0;
    std::size_t k = 0;
    for (int l = 0; k < c.size(); ++l) {
        const double a = sh_cosine_factor(l);
        for (const auto end = std::size_t(sh_count(l)); k < end && k < c.size(); ++k)
            sum += a * a * glm::dot(c[k], c[k]);
    }
    return sum / (3 * 4 * glm::pi<double>());
}

namespace {

/// Of the samples that belong to a brick or to what is in it.
struct Loss {
    /// By level: sum of the squares that reading them from that level costs.
    std::array<double, most_levels> squares{};
    double sum = 0; ///< of irradiance
    std::size_t samples = 0;

    void add(const Loss& other) {
        for (std::size_t l = 0; l < most_levels; ++l)
            squares[l] += other.squares[l];
        sum += other.sum;
        samples += other.samples;
    }
};

/// The square of what a sample loses if a coarser brick is read there, with noise of so much in
/// both.
double loss_at(const Volume& fine, std::size_t sample, const Volume& coarse, double fine_noise,
               double coarse_noise) {
    const Taps taps = taps_at(coarse, fine.grid.center(fine.grid.cell_at(sample)));
    std::array<glm::dvec3, sh_count(sh_max_order)> off{};
    for (std::size_t k = 0; k < fine.sh.size(); ++k) {
        off[k] = glm::dvec3(fine.sh[k][sample]);
        for (std::size_t i = 0; i < 8 && taps.valid; ++i)
            if (taps.cells.weight[i] > 0)
                off[k] -= taps.cells.weight[i] * glm::dvec3(coarse.sh[k][taps.cells.cell[i]]);
    }
    double chance = fine_noise, largest = 0;
    for (std::size_t i = 0; i < 8 && taps.valid; ++i) {
        chance += taps.cells.weight[i] * taps.cells.weight[i] * coarse_noise;
        largest = std::max(largest, double(taps.cells.weight[i]));
    }
    if (largest > 1 - slack) // that sample itself
        chance = 0;
    return mean_square_irradiance(std::span(off).first(fine.sh.size())) - chance;
}

/// A brick, and the noise of its samples.
struct Made {
    const Brick* brick;
    const Volume* volume;
    double noise;
};

/// Of the samples of the eighths of the last brick that no finer one has, by the bricks above it.
Loss own_loss(const BrickTree& tree, std::span<const Made> way) {
    const Brick& own = *way.back().brick;
    const Volume& volume = *way.back().volume;
    Loss loss;
    for (int eighth = 0; eighth < 8; ++eighth) {
        const glm::ivec3 part(eighth & 1, eighth >> 1 & 1, eighth >> 2);
        if (own.level > 0 && tree.find({own.level - 1, 2 * own.at + part}))
            continue;
        glm::ivec3 at;
        for (at.z = 0; at.z < brick_cells / 2; ++at.z)
            for (at.y = 0; at.y < brick_cells / 2; ++at.y)
                for (at.x = 0; at.x < brick_cells / 2; ++at.x) {
                    const std::size_t sample = volume.grid.index(brick_cells / 2 * part + at);
                    if (!volume.is_valid(sample))
                        continue;
                    ++loss.samples;
                    loss.sum += mean_irradiance(volume, sample);
                    for (const Made& up : way.first(way.size() - 1))
                        loss.squares[std::size_t(up.brick->level)] +=
                            loss_at(volume, sample, *up.volume, way.back().noise, up.noise);
                }
    }
    return loss;
}

/// Takes bricks away one by one.
class Trimming {
public:
    Trimming(const BrickTree& tree, const MakeBrick& make, const TrimGoal& goal,
             std::span<const double> noise)
        : tree_(tree),
          goal_(goal),
          noise_(noise),
          losses_(tree.bricks().size()),
          there_(losses_.size(), 1),
          left_(losses_.size()) {
        std::vector<std::size_t> roots;
        for (std::size_t i = 0; i < losses_.size(); ++i)
            if (!tree.parent(i))
                roots.push_back(i);
        tbb::parallel_for(std::size_t(0), roots.size(),
                          [&](std::size_t i) { measure(make, roots[i], {}); });
        for (const std::size_t root : roots)
            whole_.add(losses_[root]);
        for (std::size_t i = 0; i < losses_.size(); ++i)
            offer(i);
    }

    Trimmed run() {
        const double mean = whole_.samples ? whole_.sum / double(whole_.samples) : 0;
        const double most = goal_.error * goal_.error * mean * mean * double(whole_.samples);
        while (!offers_.empty()) {
            const auto [cost, brick] = offers_.top();
            if (left_ <= goal_.most && lost_ + cost > most)
                break;
            offers_.pop();
            if (!there_[brick] || !is_free(brick))
                continue;
            there_[brick] = 0;
            --left_;
            lost_ += cost;
            offer_around(tree_.bricks()[brick]);
        }
        Trimmed trimmed;
        for (std::size_t i = 0; i < there_.size(); ++i)
            if (there_[i])
                trimmed.bricks.push_back(tree_.bricks()[i]);
        trimmed.error =
            mean > 0 ? std::sqrt(std::max(0.0, lost_) / double(whole_.samples)) / mean : 0;
        return trimmed;
    }

private:
    /// What a brick and all in it lose, which the bricks of `way` are above of.
    void measure(const MakeBrick& make, std::size_t brick, std::vector<Made> way) {
        const Volume own = make(brick);
        const Brick& at = tree_.bricks()[brick];
        way.push_back({&at, &own, noise_.empty() ? 0.0 : noise_[brick]});
        losses_[brick] = own_loss(tree_, way);
        std::array<std::optional<std::size_t>, 8> parts;
        for (int i = 0; i < 8 && at.level > 0; ++i)
            parts[std::size_t(i)] =
                tree_.find({at.level - 1, 2 * at.at + glm::ivec3(i & 1, i >> 1 & 1, i >> 2)});
        tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t i) {
            if (parts[i])
                measure(make, *parts[i], way);
        });
        for (const std::optional<std::size_t>& part : parts)
            if (part)
                losses_[brick].add(losses_[*part]);
    }

    /// Whether no finer brick is in it or beside it, so that it may go.
    bool is_free(std::size_t brick) const {
        const Brick& own = tree_.bricks()[brick];
        if (own.level == 0)
            return true;
        const glm::ivec3 places = tree_.levels().places(own.level - 1);
        const glm::ivec3 lo = glm::max(2 * own.at - 1, 0),
                         hi = glm::min(2 * own.at + 2, places - 1);
        glm::ivec3 at;
        for (at.z = lo.z; at.z <= hi.z; ++at.z)
            for (at.y = lo.y; at.y <= hi.y; ++at.y)
                for (at.x = lo.x; at.x <= hi.x; ++at.x)
                    if (const auto found = tree_.find({own.level - 1, at}); found && there_[*found])
                        return false;
        return true;
    }

    void offer(std::size_t brick) {
        const auto level = std::size_t(tree_.bricks()[brick].level);
        if (level + 1 == std::size_t(tree_.levels().count) || !there_[brick] || !is_free(brick)
            || (!goal_.kept.empty() && goal_.kept[brick]))
            return;
        const double cost = losses_[brick].squares[level + 1] - losses_[brick].squares[level];
        // Noise is known on average: what seems to be gained does not pay for what is lost.
        offers_.push({noise_.empty() ? cost : std::max(0.0, cost), brick});
    }

    /// What a brick that is gone kept from going.
    void offer_around(const Brick& gone) {
        glm::ivec3 way;
        std::vector<std::size_t> coarse;
        for (way.z = -1; way.z <= 1; ++way.z)
            for (way.y = -1; way.y <= 1; ++way.y)
                for (way.x = -1; way.x <= 1; ++way.x)
                    if (const auto found = tree_.find({gone.level + 1, (gone.at + way) >> 1}))
                        coarse.push_back(*found);
        std::ranges::sort(coarse);
        coarse.erase(std::unique(coarse.begin(), coarse.end()), coarse.end());
        for (const std::size_t each : coarse)
            offer(each);
    }

    const BrickTree& tree_;
    const TrimGoal& goal_;
    std::span<const double> noise_;
    std::vector<Loss> losses_; ///< of a brick with all in it
    Loss whole_;
    std::vector<uint8_t> there_;
    std::size_t left_;
    double lost_ = 0;
    using Offer = std::pair<double, std::size_t>; ///< what it costs to take a brick away
    std::priority_queue<Offer, std::vector<Offer>, std::greater<>> offers_;
};

} // namespace

Trimmed trim(const BrickTree& tree, const MakeBrick& make, const TrimGoal& goal,
             std::span<const double> noise) {
    return Trimming(tree, make, goal, noise).run();
}

// ---------------------------------------------------------------- one volume of all

BrickStack::BrickStack(std::size_t bricks) {
    const int edge = std::max(1, int(std::ceil(std::cbrt(double(bricks)) - 1e-9)));
    const auto layer = std::size_t(edge) * std::size_t(edge);
    slots = {edge, edge, int((bricks + layer - 1) / layer)};
    if (slots.z <= 1)
        slots = {std::min(int(bricks), edge), (int(bricks) + edge - 1) / edge, 1};
}

glm::ivec3 BrickStack::first(std::size_t brick) const {
    return brick_edge * Grid{{}, 1, slots}.cell_at(brick);
}

namespace {

/// Copies the samples of a brick that stands in a stack, either way.
template <class From, class To, class Copy>
void copy_brick(const From& from, To& to, const Copy& copy) {
    const auto source = grids_of(from);
    const auto target = grids_of(to);
    for (std::size_t g = 0; g < source.size(); ++g) {
        const auto width = std::size_t(source[g].kind->width());
        copy(source[g].data, target[g].data, width);
    }
}

void set_grids_as(const Volume& like, Volume& volume) {
    for (const GridKind* kind : grid_kinds())
        if (const auto count = grids_of(like, *kind).size(); count > 0)
            set_grids(volume, *kind, int(count));
}

} // namespace

Volume stacked(std::span<const Volume> bricks) {
    const BrickStack stack(bricks.size());
    Volume all;
    all.grid.dims = stack.dims();
    all.sh_order = bricks.front().sh_order;
    all.metadata = bricks.front().metadata;
    set_grids_as(bricks.front(), all);
    tbb::parallel_for(std::size_t(0), bricks.size(), [&](std::size_t i) {
        const glm::ivec3 first = stack.first(i);
        copy_brick(bricks[i], all, [&](const float* from, float* to, std::size_t width) {
            for (std::size_t row = 0; row < brick_samples / brick_edge; ++row) {
                const glm::ivec3 at(0, int(row) % brick_edge, int(row) / brick_edge);
                std::copy_n(from + row * brick_edge * width, brick_edge * width,
                            to + all.grid.index(first + at) * width);
            }
        });
    });
    return all;
}

std::vector<Volume> unstacked(const Volume& all, std::span<const Grid> grids) {
    const BrickStack stack(grids.size());
    if (all.grid.dims != stack.dims())
        throw Error(ErrorKind::invalid,
                    format("%d x %d x %d samples are not those of %zu bricks", all.grid.dims.x,
                           all.grid.dims.y, all.grid.dims.z, grids.size()));
    std::vector<Volume> bricks(grids.size());
    tbb::parallel_for(std::size_t(0), bricks.size(), [&](std::size_t i) {
        bricks[i].grid = grids[i];
        bricks[i].sh_order = all.sh_order;
        set_grids_as(all, bricks[i]);
        const glm::ivec3 first = stack.first(i);
        copy_brick(all, bricks[i], [&](const float* from, float* to, std::size_t width) {
            for (std::size_t row = 0; row < brick_samples / brick_edge; ++row) {
                const glm::ivec3 at(0, int(row) % brick_edge, int(row) / brick_edge);
                std::copy_n(from + all.grid.index(first + at) * width, brick_edge * width,
                            to + row * brick_edge * width);
            }
        });
    });
    bricks.front().metadata = bricks.back().metadata = all.metadata;
    return bricks;
}

} // namespace lpvbake::volume
