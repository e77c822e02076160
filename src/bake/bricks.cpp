#include "bake/bricks.h"

#include "lpvbake/error.h"
#include "machine.h"
#include "text.h"
#include "visibility/capture.h"
#include "visibility/walls.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>

namespace lpvbake::bake {
namespace {

using volume::Brick;
using volume::brick_cells;
using volume::brick_edge;
using volume::brick_samples;

/// How much nearer than it is a surface is taken to be to a brick, cells of level 0.
constexpr float occupied_margin = 0.1f;
/// Finest cells by which a sample may lie outside of a box of BakeSettings::adjust.
constexpr double adjust_slack = 1e-4;
/// What decides where to refine if no error is asked for.
constexpr double usual_error = 0.02;
/// Of so many samples one is solved twice, to know their noise.
constexpr uint64_t twice = 32;
/// Samples that a brick's own twins weigh as much as, those of its level together.
constexpr double usual_twins = 16;
/// What light in a cell's middle is off by is above the noise if its square is so many times that.
constexpr double beyond_noise = 8;

/// A sample, by its place in the lattice of level 0.
using Key = uint64_t;

Key key_of(glm::ivec3 at) {
    return Key(at.z) << 42 | Key(at.y) << 21 | Key(at.x);
}

glm::ivec3 at_of(Key key) {
    constexpr Key mask = (Key(1) << 21) - 1;
    return glm::ivec3(int(key & mask), int(key >> 21 & mask), int(key >> 42));
}

/// Frame units.
glm::vec3 place_of(glm::ivec3 at) {
    return glm::vec3(at) + 0.5f;
}

/// Coarse ones first.
auto order_of(const Brick& brick) {
    return std::tuple(-brick.level, brick.at.z, brick.at.y, brick.at.x);
}

struct CoarseFirst {
    bool operator()(const Brick& a, const Brick& b) const { return order_of(a) < order_of(b); }
};

glm::ivec3 eighth(int i) {
    return {i & 1, i >> 1 & 1, i >> 2};
}

/// Calls `each` for all places from lo to hi, both included.
void for_box(glm::ivec3 lo, glm::ivec3 hi, const auto& each) {
    glm::ivec3 at;
    for (at.z = lo.z; at.z <= hi.z; ++at.z)
        for (at.y = lo.y; at.y <= hi.y; ++at.y)
            for (at.x = lo.x; at.x <= hi.x; ++at.x)
                each(at);
}

/// Whether a sample is solved twice: by chance, and always the same.
bool is_twin(Key key) {
    key *= 0x9e3779b97f4a7c15u;
    key ^= key >> 32;
    return key * 0xd6e8feb86659fd93u >> 32 < (uint64_t(1) << 32) / twice;
}

/// Noise of samples that were solved twice.
struct Noise {
    double square = 0; ///< sum of volume::mean_square_irradiance
    double light = 0;  ///< sum of the squares of volume::mean_irradiance
    double twins = 0;

    void add(const Noise& other) {
        square += other.square;
        light += other.light;
        twins += other.twins;
    }
    /// Of the light's square.
    double share() const { return light > 0 ? square / light : 0; }
};

/// All samples that are solved, or are going to be.
class Samples {
public:
    Volume light;                     ///< a row
    std::map<uint32_t, double> twins; ///< the noise (mean square) of some
    Noise noise;                      ///< of all

    std::size_t size() const { return known_.size(); }
    uint32_t find(Key key) const { return lower(key)->sample; }
    bool is_valid(uint32_t sample) const { return light.validity[sample] > 0; }

    /// Adds those that are new.
    void add(std::vector<Key> keys) {
        std::ranges::sort(keys);
        keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
        std::erase_if(keys, [&](Key key) {
            const auto found = lower(key);
            return found != known_.end() && found->key == key;
        });
        const auto before = std::ptrdiff_t(size());
        for (const Key key : keys) {
            known_.push_back({key, uint32_t(known_.size())});
            places_.push_back(place_of(at_of(key)));
        }
        std::inplace_merge(known_.begin(), known_.begin() + before, known_.end(),
                           [](const Known& a, const Known& b) { return a.key < b.key; });
    }

    /// Finds which of those that are added lie outside of geometry, or are said to.
    void look(const solver::Inputs& inputs) {
        const visibility::Visibility& visibility = inputs.visibility;
        const std::size_t before = light.validity.size();
        light.validity.resize(size());
        tbb::parallel_for(before, size(), [&](std::size_t i) {
            const glm::vec3 place = places_[i - (size() - places_.size())];
            const visibility::Capture capture = visibility.capture_at(place);
            const bool outside =
                capture.open && visibility::backs_around(visibility, capture.point, 0) <= 0;
            light.validity[i] =
                volume::validity_at(inputs.adjust, inputs.frame.to_world(glm::dvec3(place)),
                                    adjust_slack * inputs.frame.unit)
                        .value_or(outside)
                    ? 1.0f
                    : 0.0f;
        });
    }

    /// How many, the first ones, are solved.
    std::size_t solved() const { return size() - places_.size(); }

    /// Solves those that are not; the valid ones stand in `blocks` by their number after solved().
    void solve(std::span<const solver::Block> blocks, solver::Solver& solver,
               const solver::Inputs& inputs, solver::Stages& stages) {
        if (places_.empty())
            return;
        const std::size_t before = solved(), count = places_.size();
        std::size_t again = 0;
        for (const solver::Block& block : blocks)
            again += block.again.size();
        Volume one;
        one.grid.dims = {int(count + again), 1, 1};
        solver.solve_blocks(blocks, inputs, stages, one);
        light.sh_order = one.sh_order;
        light.sh.resize(one.sh.size());
        compare_twins(blocks, one);
        for (std::size_t k = 0; k < light.sh.size(); ++k) {
            light.sh[k].insert(light.sh[k].end(), one.sh[k].begin(),
                               one.sh[k].begin() + std::ptrdiff_t(count));
            one.sh[k] = {}; // so that it is there once
        }
        for (std::size_t i = before; i < size(); ++i)
            if (is_valid(uint32_t(i))) {
                sum_ += volume::mean_irradiance(light, i);
                ++valid_;
            }
        places_.clear();
    }

    /// Mean irradiance of those that are solved and valid, lux.
    double mean() const { return valid_ > 0 ? sum_ / double(valid_) : 0; }

private:
    /// Twins stand at the end of what was solved, in the order of the blocks.
    void compare_twins(std::span<const solver::Block> blocks, const Volume& solved_now) {
        const std::size_t before = solved();
        std::size_t second = places_.size();
        for (const solver::Block& block : blocks) {
            auto place = block.places.begin(); // those of `again` are some of them, in their order
            for (const solver::Block::Place& twin : block.again) {
                while (place->at != twin.at)
                    ++place;
                const uint32_t first = place->cell;
                std::array<glm::dvec3, volume::sh_count(volume::sh_max_order)> off{};
                for (std::size_t k = 0; k < light.sh.size(); ++k)
                    off[k] =
                        glm::dvec3(solved_now.sh[k][first]) - glm::dvec3(solved_now.sh[k][second]);
                const double square =
                    0.5 * volume::mean_square_irradiance(std::span(off).first(light.sh.size()));
                const double own = volume::mean_irradiance(solved_now, first);
                twins[uint32_t(before + first)] = square;
                noise.add({square, own * own, 1});
                ++second;
            }
        }
    }

    struct Known {
        Key key;
        uint32_t sample;
    };
    std::vector<Known>::const_iterator lower(Key key) const {
        return std::ranges::lower_bound(known_, key, {}, &Known::key);
    }

    std::vector<Known> known_;      ///< by key
    std::vector<glm::vec3> places_; ///< of those at the end of the row that are not solved
    double sum_ = 0;
    std::size_t valid_ = 0;
};

/// Where surfaces may be: a place of a level is that of a brick.
class Occupied {
public:
    Occupied(const std::vector<surface::Patch>& patches, const volume::BrickLevels& levels) {
        for (int level = 0; level < levels.count; ++level) {
            grids_.push_back({{}, 1, levels.places(level)});
            there_.emplace_back(grids_.back().size());
        }
        for (const surface::Patch& patch : patches)
            add(patch);
        for (std::size_t level = 1; level < grids_.size(); ++level)
            for (std::size_t i = 0; i < there_[level - 1].size(); ++i)
                there_[level][grids_[level].index(grids_[level - 1].cell_at(i) >> 1)] |=
                    there_[level - 1][i];
    }

    bool operator()(const Brick& brick) const {
        const auto level = std::size_t(brick.level);
        return there_[level][grids_[level].index(brick.at)] != 0;
    }

private:
    void add(const surface::Patch& patch) {
        const glm::vec3 a = patch.at({0, 0}), b = patch.at({1, 0}), c = patch.at({0, 1});
        const auto place = [](glm::vec3 p) {
            // Those far outside have no int.
            return glm::ivec3(glm::floor(glm::clamp((p - 0.5f) / float(brick_cells), -1e6f, 1e6f)));
        };
        for_box(glm::max(place(glm::min(glm::min(a, b), c) - occupied_margin), 0),
                glm::min(place(glm::max(glm::max(a, b), c) + occupied_margin), grids_[0].dims - 1),
                [&](glm::ivec3 at) { there_[0][grids_[0].index(at)] = 1; });
    }

    std::vector<Grid> grids_;
    std::vector<std::vector<uint8_t>> there_;
};

/// Bricks being made.
class Refining {
public:
    Refining(const BakePlan& plan, const surface::LitSurfaces& surfaces, solver::Solver& solver,
             const solver::Inputs& inputs, solver::Stages& stages)
        : plan_(plan),
          levels_(plan.bricks->levels),
          occupied_(surfaces.patches, levels_),
          solver_(solver),
          inputs_(inputs),
          stages_(stages),
          error_(plan.settings.adaptive->error > 0 ? plan.settings.adaptive->error : usual_error) {}

    void run() {
        const int root = levels_.count - 1;
        for_box(glm::ivec3(0), levels_.places(root) - 1, [&](glm::ivec3 at) { add({root, at}); });
        while (!untested_.empty()) {
            std::vector<Brick> same;
            const int level = untested_.begin()->first.level;
            while (!untested_.empty() && untested_.begin()->first.level == level)
                same.push_back(untested_.extract(untested_.begin()).key());
            stages_.set_of(format("cells of %.4g m: ", levels_.lattice(level).cell));
            refine(same);
        }
        stages_.set_of("");
    }

    std::size_t samples() const { return samples_.size(); }

    volume::BrickTree tree() const {
        std::vector<Brick> bricks;
        for (const auto& each : bricks_)
            bricks.push_back(each.first);
        return {levels_, std::move(bricks)};
    }

    /// Which of its bricks somebody wants.
    std::vector<uint8_t> kept(const volume::BrickTree& tree) const {
        std::vector<uint8_t> kept;
        for (const Brick& brick : tree.bricks())
            kept.push_back(told(brick) == true);
        return kept;
    }

    /// The noise of the samples of each of its bricks, as volume::trim wants it.
    std::vector<double> noise(const volume::BrickTree& tree) const {
        const std::span<const Brick> bricks = tree.bricks();
        std::vector<Noise> own(bricks.size());
        std::vector<double> squares(bricks.size());
        tbb::parallel_for(std::size_t(0), bricks.size(), [&](std::size_t i) {
            own[i] = noise_of(bricks[i]);
            squares[i] = mean_square(bricks[i]);
        });
        std::map<int, Noise> of_level;
        for (std::size_t i = 0; i < bricks.size(); ++i)
            of_level[bricks[i].level].add(own[i]);
        std::vector<double> noise;
        for (std::size_t i = 0; i < bricks.size(); ++i) {
            const double usual = of_level[bricks[i].level].share() * squares[i];
            noise.push_back((own[i].square + usual_twins * usual) / (own[i].twins + usual_twins));
        }
        return noise;
    }

    /// One of its bricks, without walls.
    Volume brick(const Brick& brick) const {
        const Row samples = samples_of(brick);
        Volume volume = unlit(brick, samples);
        for (const std::vector<glm::vec3>& c : samples_.light.sh)
            volume.sh.push_back(picked(c, samples));
        return volume;
    }

    /// Some of its bricks, for good.
    volume::VolumeSet take(std::vector<Brick> bricks) && {
        check_memory(samples_.size(), bricks.size());
        volume::VolumeSet set;
        set.bricks.emplace(levels_, std::move(bricks));
        set.levels.resize(set.bricks->bricks().size());
        std::vector<Row> samples(set.levels.size());
        const auto each_brick = [&](const auto& each) {
            tbb::parallel_for(std::size_t(0), set.levels.size(), each);
        };
        each_brick([&](std::size_t i) {
            const Brick& brick = set.bricks->bricks()[i];
            samples[i] = samples_of(brick);
            set.levels[i] = unlit(brick, samples[i]);
        });
        for (std::vector<glm::vec3>& c : samples_.light.sh) {
            each_brick([&](std::size_t i) { set.levels[i].sh.push_back(picked(c, samples[i])); });
            c = {}; // so that it is there once
        }
        return set;
    }

private:
    /// The samples of a brick, in its volume's order.
    using Row = std::array<uint32_t, brick_samples>;

    Noise noise_of(const Brick& brick) const {
        Noise noise;
        for (const Key key : keys_of(brick)) {
            if (!is_twin(key))
                continue;
            const uint32_t sample = samples_.find(key);
            if (const auto found = samples_.twins.find(sample); found != samples_.twins.end()) {
                const double light = volume::mean_irradiance(samples_.light, sample);
                noise.add({found->second, light * light, 1});
            }
        }
        return noise;
    }

    /// Of the irradiance of its valid samples.
    double mean_square(const Brick& brick) const {
        double light = 0, valid = 0;
        for (const uint32_t sample : samples_of(brick))
            if (samples_.is_valid(sample)) {
                const double one = volume::mean_irradiance(samples_.light, sample);
                light += one * one;
                ++valid;
            }
        return valid > 0 ? light / valid : 0;
    }

    Volume unlit(const Brick& brick, const Row& samples) const {
        Volume volume;
        volume.grid = levels_.grid_of(brick);
        volume.sh_order = samples_.light.sh_order;
        volume.validity = picked(samples_.light.validity, samples);
        return volume;
    }

    /// With those around that it asks for.
    void add(const Brick& brick) {
        if (!bricks_.emplace(brick, 0).second)
            return;
        untested_.emplace(brick, 0);
        if (brick.level + 1 == levels_.count)
            return;
        const glm::ivec3 last = levels_.places(brick.level) - 1;
        for_box(glm::max(brick.at - 1, 0), glm::min(brick.at + 1, last), [&](glm::ivec3 at) {
            add({brick.level + 1, at >> 1});
        });
    }

    /// The same by their places.
    std::array<Key, brick_samples> keys_of(const Brick& brick) const {
        std::array<Key, brick_samples> keys;
        std::size_t i = 0;
        for_box(glm::ivec3(0), glm::ivec3(brick_cells), [&](glm::ivec3 s) {
            keys[i++] = key_of((brick_cells * brick.at + s) << brick.level);
        });
        return keys;
    }

    Row samples_of(const Brick& brick) const {
        const std::array<Key, brick_samples> keys = keys_of(brick);
        Row samples;
        std::ranges::transform(keys, samples.begin(), [&](Key key) { return samples_.find(key); });
        return samples;
    }

    template <class T>
    static std::vector<T> picked(const std::vector<T>& values, const Row& samples) {
        std::vector<T> own(samples.size());
        std::ranges::transform(samples, own.begin(),
                               [&](uint32_t sample) { return values[sample]; });
        return own;
    }

    /// Whether the place of a brick meets the box that is asked for.
    bool is_wanted(const Brick& brick) const {
        const Grid own = levels_.grid_of(brick);
        const glm::dvec3 lo = own.center(glm::ivec3(0)), hi = own.center(own.dims - 1);
        return glm::all(glm::lessThan(lo, plan_.bricks->box.hi))
               && glm::all(glm::greaterThan(hi, plan_.bricks->box.lo));
    }

    /// What the last box of BakeSettings::adjust that meets a brick, or holds its middle, says.
    std::optional<bool> told(const Brick& brick) const {
        const Grid own = levels_.grid_of(brick);
        const glm::dvec3 lo = own.center(glm::ivec3(0)), hi = own.center(own.dims - 1);
        std::optional<bool> finer;
        for (const volume::Adjustment& box : inputs_.adjust)
            if (box.finer == true && glm::all(glm::lessThan(lo, box.hi))
                && glm::all(glm::greaterThan(hi, box.lo)))
                finer = true;
            else if (box.finer == false && glm::all(glm::lessThan(box.lo, 0.5 * (lo + hi)))
                     && glm::all(glm::lessThan(0.5 * (lo + hi), box.hi)))
                finer = false;
        return finer;
    }

    /// Refuses what does not fit before it is there.
    void check_memory(std::size_t samples, std::size_t left) const {
        const uint64_t bytes = plan_.bricks->other_bytes
                               + brick_bytes(plan_.settings.solver.order()) * left
                               + sample_bytes(plan_.settings.solver.order()) * samples;
        if (const uint64_t memory = machine_memory(); bytes > memory)
            throw Error(ErrorKind::memory,
                        format("`adaptive` %.6g..%.6g: %zu bricks and more need about %s of "
                               "this machine's %s of memory; use larger finest cells, a "
                               "smaller `bounds` or a larger `error`",
                               levels_.finest.cell, levels_.lattice(levels_.count - 1).cell,
                               bricks_.size(), memory_text(double(bytes)).c_str(),
                               memory_text(double(memory)).c_str()));
    }

    /// Adds samples, and looks where they are.
    void look(std::vector<Key> keys) {
        check_memory(samples_.size() + keys.size(), 0);
        samples_.add(std::move(keys));
        samples_.look(inputs_);
    }

    /// Solves bricks of one level, and adds those of the next that they ask for.
    void refine(const std::vector<Brick>& bricks) {
        std::vector<Key> keys;
        for (const Brick& brick : bricks)
            for (const Key key : keys_of(brick))
                keys.push_back(key);
        look(std::move(keys));
        std::vector<Brick> wanted, open;
        for (const Brick& brick : bricks)
            for (int i = 0; i < 8 && brick.level > 0; ++i)
                sort_out({brick.level - 1, 2 * brick.at + eighth(i)}, wanted, open);
        keys.clear();
        for (const Brick& each : open)
            for_box(glm::ivec3(0), glm::ivec3(brick_cells / 2 - 1),
                    [&](glm::ivec3 cell) { keys.push_back(middle_of(each, cell)); });
        look(std::move(keys));
        samples_.solve(blocks_of(bricks, open), solver_, inputs_, stages_);
        std::vector<uint8_t> rough(open.size());
        tbb::parallel_for(std::size_t(0), open.size(),
                          [&](std::size_t i) { rough[i] = is_rough(open[i]); });
        for (std::size_t i = 0; i < open.size(); ++i)
            if (rough[i])
                wanted.push_back(open[i]);
        for (const Brick& each : wanted)
            add(each);
    }

    /// The valid samples of bricks of one level, and the middles of the cells of `open`, as the
    /// solver has them: bricks of the finest level by eights, others by themselves.
    std::vector<solver::Block> blocks_of(const std::vector<Brick>& bricks,
                                         const std::vector<Brick>& open) const {
        const int cube = std::max(bricks.front().level, 1), step = cube - 1;
        const auto in_cube = [&](const Brick& brick) {
            return Brick{cube, brick.at >> (cube - brick.level)};
        };
        std::map<Brick, std::vector<Key>, CoarseFirst> keys;
        for (const Brick& brick : bricks)
            for (const Key key : keys_of(brick))
                keys[in_cube(brick)].push_back(key);
        for (const Brick& each : open)
            for_box(glm::ivec3(0), glm::ivec3(brick_cells / 2 - 1),
                    [&](glm::ivec3 cell) { keys[in_cube(each)].push_back(middle_of(each, cell)); });
        std::vector<solver::Block> blocks;
        const std::size_t fresh = samples_.size() - samples_.solved();
        std::vector<uint8_t> taken(fresh);
        auto next = uint32_t(fresh); // cell of one that is solved again
        const Grid all{{}, 1, glm::ivec3(solver::Block::edge + 1)};
        for (auto& [brick, own] : keys) {
            const glm::ivec3 first = brick_cells * brick.at << cube;
            solver::Block block{place_of(first), float(1 << step), {}, {}};
            std::ranges::sort(own);
            own.erase(std::unique(own.begin(), own.end()), own.end());
            for (const Key key : own) {
                const uint32_t sample = samples_.find(key);
                if (!samples_.is_valid(sample))
                    continue;
                uint32_t cell = solver::Block::known;
                if (sample >= samples_.solved() && !taken[sample - samples_.solved()]++)
                    cell = uint32_t(sample - samples_.solved());
                const auto at = uint16_t(all.index((at_of(key) - first) >> step));
                block.places.push_back({at, cell});
                if (cell != solver::Block::known && is_twin(key))
                    block.again.push_back({at, next++});
            }
            blocks.push_back(std::move(block));
        }
        return blocks;
    }

    /// An eighth of a brick, as the brick that it would be: wanted by what is known before its
    /// light is, or open.
    void sort_out(const Brick& part, std::vector<Brick>& wanted, std::vector<Brick>& open) const {
        const std::optional<bool> finer = told(part);
        if (bricks_.contains(part) || !is_wanted(part) || finer == false)
            return;
        std::size_t valid = 0;
        for_box(glm::ivec3(0), glm::ivec3(brick_cells / 2), [&](glm::ivec3 s) {
            valid += samples_.is_valid(samples_.find(corner_of(part, s)));
        });
        constexpr std::size_t edge = brick_cells / 2 + 1;
        if (finer == true || occupied_(part) || (valid > 0 && valid < edge * edge * edge))
            wanted.push_back(part);
        else if (valid > 0)
            open.push_back(part);
    }

    /// Of the cells of the next coarser level in the place of a brick.
    static Key corner_of(const Brick& part, glm::ivec3 cell) {
        return key_of((brick_cells * part.at + 2 * cell) << part.level);
    }
    static Key middle_of(const Brick& part, glm::ivec3 cell) {
        return key_of((brick_cells * part.at + 2 * cell + 1) << part.level);
    }

    /// Whether one of these cells has another light in its middle than its corners tell.
    bool is_rough(const Brick& part) const {
        const Volume& light = samples_.light;
        const double most = error_ * samples_.mean();
        const double chance = beyond_noise * 9 / 8 * samples_.noise.share();
        bool rough = false;
        for_box(glm::ivec3(0), glm::ivec3(brick_cells / 2 - 1), [&](glm::ivec3 cell) {
            const uint32_t middle = samples_.find(middle_of(part, cell));
            if (rough || !samples_.is_valid(middle)) {
                rough = true;
                return;
            }
            std::array<glm::dvec3, volume::sh_count(volume::sh_max_order)> off{};
            for (std::size_t k = 0; k < light.sh.size(); ++k)
                off[k] = glm::dvec3(light.sh[k][middle]);
            for (int i = 0; i < 8; ++i) {
                const uint32_t corner = samples_.find(corner_of(part, cell + eighth(i)));
                for (std::size_t k = 0; k < light.sh.size(); ++k)
                    off[k] -= 0.125 * glm::dvec3(light.sh[k][corner]);
            }
            const double own = volume::mean_irradiance(light, middle);
            rough = volume::mean_square_irradiance(std::span(off).first(light.sh.size()))
                    > most * most + chance * own * own;
        });
        return rough;
    }

    const BakePlan& plan_;
    const volume::BrickLevels& levels_;
    Occupied occupied_;
    solver::Solver& solver_;
    const solver::Inputs& inputs_;
    solver::Stages& stages_;
    double error_;
    Samples samples_;
    std::map<Brick, char, CoarseFirst> bricks_, untested_;
};

/// As visibility::find_walls, in cells of a brick's level.
void find_walls(const visibility::Visibility& visibility, const scene::Frame& frame, int level,
                Volume& volume) {
    const auto cell = float(1 << level);
    volume.walls.assign(std::size_t(most_walls),
                        std::vector<glm::vec3>(brick_samples, glm::vec3(0)));
    std::array<glm::vec3, std::size_t(most_walls)> own;
    for (std::size_t sample = 0; sample < brick_samples; ++sample) {
        if (!volume.is_valid(sample))
            continue;
        const glm::vec3 place(frame.from_world(volume.grid.center(volume.grid.cell_at(sample))));
        const std::size_t found = visibility::walls_around(
            visibility, visibility.capture_at(place).point, walls_reach * cell, own);
        for (std::size_t k = 0; k < found; ++k)
            volume.walls[k][sample] = own[k] / cell;
    }
}

/// Solves the samples of all bricks that may be needed, and makes those that are.
volume::VolumeSet refine_and_trim(const BakePlan& plan, const surface::LitSurfaces& surfaces,
                                  solver::Solver& solver, const solver::Inputs& inputs,
                                  solver::Stages& stages, BakedBricks& baked) {
    Refining refining(plan, surfaces, solver, inputs, stages);
    refining.run();
    baked.samples = refining.samples();
    stages.begin("trim");
    const volume::BrickTree tree = refining.tree();
    const std::vector<uint8_t> kept = refining.kept(tree);
    volume::Trimmed trimmed = volume::trim(
        tree,
        [&](std::size_t i) {
            Volume brick = refining.brick(tree.bricks()[i]);
            find_walls(inputs.visibility, plan.frame, tree.bricks()[i].level, brick);
            return brick;
        },
        {plan.settings.adaptive->error, std::size_t(plan.bricks->most), kept},
        refining.noise(tree));
    baked.error = trimmed.error;
    stages.end(format("%zu of %s left, %s %% of irradiance lost by it", trimmed.bricks.size(),
                      counted(tree.bricks().size(), "brick").c_str(),
                      two_digits(100 * trimmed.error).c_str()));
    return std::move(refining).take(std::move(trimmed.bricks));
}

} // namespace

BakedBricks bake_bricks(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                        Progress& progress) {
    BakedBricks baked;
    baked.warnings = plan.warnings;
    solver::Stages stages(progress, baked.warnings, scene.path, plan.settings.cache);
    const std::unique_ptr<solver::Solver> solver =
        plan.settings.solver.kind().make(device, plan.grid, plan.settings.solver);
    const visibility::Visibility visibility = open_scene(scene, plan, device, stages);
    const surface::LitSurfaces surfaces = light_scene(scene, plan, visibility, stages);
    const solver::Inputs inputs{scene,      device,    plan.grid, plan.frame,
                                visibility, &surfaces, plan.maps, plan.settings.adjust};
    warn_of_empty(plan.settings.adjust, {&plan.grid, 1}, stages);
    volume::VolumeSet& set = baked.set;
    set = refine_and_trim(plan, surfaces, *solver, inputs, stages, baked);
    stages.begin("walls");
    tbb::parallel_for(std::size_t(0), set.levels.size(), [&](std::size_t i) {
        find_walls(visibility, plan.frame, set.bricks->bricks()[i].level, set.levels[i]);
        volume::adjust_intensity(plan.settings.adjust, set.levels[i]);
    });
    volume::stitch(*set.bricks, set.levels);
    stages.end("of " + counted(set.levels.size(), "brick"));
    if (const double wanted = plan.settings.adaptive->error; wanted > 0 && baked.error > wanted)
        stages.warn(
            format("bricks of `max_size` lose %s %% of irradiance, more than the `error` of "
                   "%.3g %%",
                   two_digits(100 * baked.error).c_str(), 100 * wanted));
    describe_light(scene, plan, device, visibility, set.levels.front());
    if (!plan.settings.adjust.empty())
        set.levels.front().metadata["adjust"] = volume::text_of(plan.settings.adjust);
    set.levels.back().metadata = set.levels.front().metadata;
    if (set.levels.size() > plan.bricks->most)
        stages.warn(format("`adjust`: the finer bricks of its boxes are more than `max_size` "
                           "allows, %zu",
                           std::size_t(plan.bricks->most)));
    warn_of_dark(scene, set.levels, stages);
    baked.stages = stages.reports();
    return baked;
}

} // namespace lpvbake::bake
