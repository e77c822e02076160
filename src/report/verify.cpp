#include "report/verify.h"

#include "reference/sampler.h"
#include "reference/sampling.h"
#include "report/measure.h"
#include "visibility/visibility.h"
#include "volume/compare.h"
#include "volume/grid.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <random>

namespace lpvbake::report {
namespace {

constexpr std::size_t most_places = 5;
constexpr int samples = 1000;
/// From each place, before it is known what is wanted.
constexpr uint64_t first_paths = 64;
/// Noise that is none.
constexpr double least_noise = 0.01;

struct Drawn {
    std::size_t place = 0;
    double stands_for = 1;
};

/// `count` of the places, all where there are no more.
std::vector<Drawn> draw(std::span<const double> light, uint64_t count, uint64_t seed) {
    std::vector<Drawn> drawn;
    const double number = double(light.size());
    if (number <= double(count)) {
        for (std::size_t i = 0; i < light.size(); ++i)
            drawn.push_back({i});
        return drawn;
    }
    double all = 0;
    for (const double one : light)
        all += one;
    std::mt19937_64 random(seed);
    double next = double(random() >> 11) * 0x1p-53, up_to = 0;
    for (std::size_t i = 0; i < light.size(); ++i) {
        const double share = all > 0 ? 0.5 / number + 0.5 * light[i] / all : 1 / number;
        const double wanted = share * double(count);
        up_to += wanted;
        double times = 0;
        for (; next < up_to; next += 1)
            ++times;
        if (times > 0)
            drawn.push_back({i, times / wanted});
    }
    return drawn;
}

double sum_of(glm::dvec3 v) {
    return v.x + v.y + v.z;
}

/// Places of one kind, as they are drawn.
struct Sample {
    std::vector<Drawn> drawn;
    std::vector<glm::vec3> points;   ///< frame units
    std::vector<glm::dvec3> normals; ///< one a point, or none
    std::vector<glm::dvec3> shown;   ///< irradiance, lux: [point * normals + n]
    std::vector<glm::dvec3> places;  ///< metres
};

/// A cell of a level.
struct LevelCell {
    std::size_t level, cell;
};

/// The field at a cell's centre, of all levels there.
std::vector<glm::vec3> field_of(const volume::Levels& levels, const LevelCell& at) {
    const Volume& own = levels.volumes[at.level];
    std::vector<glm::vec3> field;
    if (levels.volumes.size() == 1)
        for (const std::vector<glm::vec3>& band : own.sh)
            field.push_back(band[at.cell]);
    else
        for (const glm::dvec3& c :
             volume::field_at(levels, own.grid.center(own.grid.cell_at(at.cell))))
            field.emplace_back(c);
    return field;
}

/// Where the light of cells is taken, units of one frame. That of bricks has finest cells for all.
class CapturePoints {
public:
    CapturePoints(const volume::Levels& levels, const visibility::Visibility& visibility,
                  const scene::Frame& frame)
        : levels_(levels),
          visibility_(visibility),
          frame_(frame) {
        if (levels.bricks)
            return;
        for (const Volume& level : levels.volumes) {
            frames_.push_back(scene::frame_of(level.grid));
            seen_.push_back(visibility.in_frame(frame, frames_.back()));
        }
    }

    glm::vec3 at(const LevelCell& cell) const {
        const Grid& grid = levels_.volumes[cell.level].grid;
        const glm::ivec3 at = grid.cell_at(cell.cell);
        if (levels_.bricks)
            return visibility_.capture_at(glm::vec3(frame_.from_world(grid.center(at)))).point;
        const visibility::Visibility& seen = seen_[cell.level];
        const glm::vec3 place(frames_[cell.level].from_world(grid.center(at)));
        const glm::vec3 point =
            (grid.is_turned() ? seen.capture_at(place) : seen.capture(at)).point;
        return cell.level == 0
                   ? point
                   : glm::vec3(frame_.from_world(frames_[cell.level].to_world(glm::dvec3(point))));
    }

private:
    const volume::Levels& levels_;
    const visibility::Visibility& visibility_;
    const scene::Frame& frame_;
    std::vector<scene::Frame> frames_;
    std::vector<visibility::Visibility> seen_;
};

bool is_in(const std::optional<Bounds>& box, glm::dvec3 point) {
    return !box
           || (glm::all(glm::greaterThanEqual(point, box->lo))
               && glm::all(glm::lessThanEqual(point, box->hi)));
}

Sample sample_cells(const volume::Levels& levels, const visibility::Visibility& visibility,
                    const scene::Frame& frame, const std::optional<Bounds>& box, uint64_t count,
                    uint64_t seed) {
    std::vector<LevelCell> cells;
    std::vector<double> light;
    for (std::size_t level = 0; level < levels.volumes.size(); ++level) {
        const Volume& volume = levels.volumes[level];
        for (std::size_t i = 0; i < volume.grid.size(); ++i) {
            const glm::dvec3 at = volume.grid.center(volume.grid.cell_at(i));
            if (volume.is_valid(i) && is_in(box, at) && volume::level_at(levels, at) == level) {
                cells.push_back({level, i});
                light.push_back(std::max(0.0, sum_of(glm::dvec3(volume.sh[0][i]))));
            }
        }
    }
    const CapturePoints points(levels, visibility, frame);
    Sample sample;
    sample.drawn = draw(light, count, seed);
    std::vector<std::vector<glm::vec3>> sh(levels.volumes.front().sh.size());
    for (Drawn& one : sample.drawn) {
        const LevelCell& own = cells[one.place];
        const Grid& grid = levels.volumes[own.level].grid;
        sample.points.push_back(points.at(own));
        sample.places.push_back(grid.center(grid.cell_at(own.cell)));
        const std::vector<glm::vec3> field = field_of(levels, own);
        for (std::size_t k = 0; k < sh.size(); ++k)
            sh[k].push_back(field[k]);
    }
    if (!sample.points.empty())
        sample.shown = irradiance_of(sh, levels.volumes.front().sh_order);
    return sample;
}

Sample sample_surfaces(const Scene& scene, const volume::Levels& levels,
                       const visibility::Visibility& visibility, const scene::Frame& frame,
                       const readers::Reader& reader, const std::optional<Bounds>& within,
                       uint64_t count, uint64_t seed) {
    Bounds box;
    if (levels.bricks) {
        const Grid& all = levels.bricks->levels().finest;
        box = {all.center(glm::ivec3(0)), all.center(all.dims - 1)};
    } else {
        for (const Volume& volume : levels.volumes) {
            const volume::GridBox own = volume::box_of(volume.grid);
            box = {glm::min(box.lo, own.lo), glm::max(box.hi, own.hi)};
        }
    }
    if (within)
        box = {glm::max(box.lo, within->lo), glm::min(box.hi, within->hi)};
    if (glm::any(glm::greaterThanEqual(box.lo, box.hi)))
        return {};
    std::vector<FrontPoint> points =
        draw_surface_points(scene, visibility, frame, box, 8 * count, seed);
    std::erase_if(points, [&](const FrontPoint& point) {
        return !levels.bricks && std::ranges::none_of(levels.volumes, [&](const Volume& volume) {
            return volume::depth_in(volume.grid, point.position) >= 0;
        });
    });
    std::vector<glm::dvec3> shown;
    std::vector<double> light;
    for (const FrontPoint& point : points) {
        shown.push_back(readers::irradiance(reader, levels, point.position, point.normal));
        light.push_back(std::max(0.0, sum_of(shown.back())));
    }
    Sample sample;
    sample.drawn = draw(light, count, seed);
    for (const Drawn& one : sample.drawn) {
        const FrontPoint& point = points[one.place];
        sample.points.push_back(lifted(point, frame));
        sample.normals.push_back(point.normal);
        sample.shown.push_back(shown[one.place]);
        sample.places.push_back(point.position);
    }
    return sample;
}

/// Irradiance that paths bring to the places of a sample. Those of a place come in a few groups,
/// each stratified in itself: few, since what is wanted is the noise of all places together, and
/// the stratification is what keeps it small.
class Traced {
public:
    Traced(const reference::Paths& paths, const Sample& sample, uint64_t seed)
        : paths_(paths),
          sample_(sample),
          seed_(seed),
          normals_(sample.normals.empty() ? volume::neighbour_normals().size() : 1),
          sums_(groups * sample.shown.size(), glm::dvec3(0.0)) {}

    std::size_t normals() const { return normals_; }
    uint64_t rays() const { return rays_; }

    /// Goes on until `paths` came from each place, a multiple of `groups`; returns the number of
    /// rays that were traced for it.
    uint64_t go_on(uint64_t paths, Progress& progress) {
        constexpr std::size_t step = 32; // places at a time, between which progress is told
        progress.begin("trace " + std::to_string(paths), sample_.points.size());
        std::atomic<uint64_t> traced = 0;
        for (std::size_t first = 0; first < sample_.points.size(); first += step) {
            progress.advance(first);
            const std::size_t last = std::min(first + step, sample_.points.size());
            tbb::parallel_for(first * groups, last * groups, [&](std::size_t i) {
                uint64_t own = 0;
                for (uint64_t path = rays_ / groups; path < paths / groups; ++path)
                    add(i, path, own);
                traced += own;
            });
        }
        rays_ = paths;
        return traced;
    }

    glm::dvec3 mean(std::size_t place, std::size_t normal) const {
        glm::dvec3 sum(0.0);
        for (std::size_t group = 0; group < groups; ++group)
            sum += sums_[(place * groups + group) * normals_ + normal];
        return sum / double(rays_);
    }
    /// |shown - T| as far as groups agree: what one is off in the direction in which the others
    /// are. On average less than the true one, as |shown - mean| is more.
    glm::dvec3 agreed(std::size_t place, std::size_t normal, glm::dvec3 shown) const {
        const glm::dvec3 all = double(groups) * (shown - mean(place, normal));
        glm::dvec3 sum(0.0);
        for (std::size_t group = 0; group < groups; ++group) {
            const glm::dvec3 own = shown
                                   - sums_[(place * groups + group) * normals_ + normal]
                                         * double(groups) / double(rays_);
            sum += own * glm::sign(all - own);
        }
        return sum / double(groups);
    }
    /// Its standard error.
    glm::dvec3 error(std::size_t place, std::size_t normal) const {
        const glm::dvec3 all = mean(place, normal);
        glm::dvec3 squares(0.0);
        for (std::size_t group = 0; group < groups; ++group) {
            const glm::dvec3 off =
                sums_[(place * groups + group) * normals_ + normal] * double(groups) / double(rays_)
                - all;
            squares += off * off;
        }
        // The mean deviation of so few is below the true one.
        return glm::sqrt(squares / double(groups * (groups - 1))) / mean_deviation;
    }

    static constexpr std::size_t groups = 4;

private:
    static constexpr double mean_deviation = 0.92132; // c4 of four Gaussian numbers

    void add(std::size_t i, uint64_t path, uint64_t& traced) {
        const std::size_t place = i / groups;
        const glm::vec3 point = sample_.points[place];
        reference::PathSampler sampler(
            reference::join_bits(reference::join_bits(seed_, place), i % groups), uint32_t(path));
        glm::dvec3* const sum = &sums_[i * normals_];
        if (!sample_.normals.empty()) {
            *sum += paths_.irradiance(point, sample_.normals[place], sampler, traced);
            return;
        }
        const auto add_light = [&](glm::dvec3 direction, glm::dvec3 luminance) {
            if (luminance != glm::dvec3(0.0))
                for (std::size_t n = 0; n < normals_; ++n)
                    sum[n] += 4 * glm::pi<double>()
                              * std::max(0.0, glm::dot(volume::neighbour_normals()[n], direction))
                              * luminance;
        };
        for (const reference::Paths::Glimpse& seen : paths_.arriving(point, sampler, traced))
            add_light(seen.direction, seen.luminance);
    }

    const reference::Paths& paths_;
    const Sample& sample_;
    uint64_t seed_;
    std::size_t normals_;
    uint64_t rays_ = 0;            ///< from each place
    std::vector<glm::dvec3> sums_; ///< [(place * groups + group) * normals_ + normal]
};

/// What is wrong at the places, and adds where to `worst`.
std::vector<VerifiedPoint> compare(const Sample& sample, const Traced& traced,
                                   std::vector<WrongPlace>& worst) {
    const std::size_t normals = traced.normals();
    std::vector<VerifiedPoint> points;
    std::vector<WrongPlace> places;
    double all = 0;
    for (std::size_t i = 0; i < sample.points.size(); ++i) {
        VerifiedPoint point;
        point.stands_for = sample.drawn[i].stands_for;
        WrongPlace place;
        place.on_surface = !sample.normals.empty();
        place.position = sample.places[i];
        for (std::size_t n = 0; n < normals; ++n) {
            const glm::dvec3 shown = sample.shown[i * normals + n], mean = traced.mean(i, n);
            point.wrong += sum_of(glm::abs(shown - mean));
            point.agreed += sum_of(traced.agreed(i, n, shown));
            point.true_ += sum_of(mean);
            point.noise += sum_of(traced.error(i, n));
            place.shown += sum_of(shown) / double(3 * normals);
        }
        // Where no light arrives at all, such as below what stands on a floor, nothing is read.
        if (place.on_surface && point.true_ == 0)
            continue;
        place.true_ = point.true_ / double(3 * normals);
        place.share = point.stands_for * std::max(0.0, point.wrong - 2 * point.noise);
        all += point.stands_for * point.wrong;
        points.push_back(point);
        places.push_back(place);
    }
    for (WrongPlace& place : places)
        if (place.share > 0) {
            place.share /= all;
            worst.push_back(place);
        }
    return points;
}

/// Traces until the noise hardly matters beside the error that is found.
MeasuredError measure(const reference::Paths& paths, const Sample& sample,
                      const VerifySettings& settings, Verified& verified, Progress& progress) {
    Traced traced(paths, sample, settings.seed);
    for (uint64_t wanted = first_paths;;) {
        verified.rays += traced.go_on(wanted, progress);
        std::vector<WrongPlace> worst;
        const MeasuredError error = measured_error(compare(sample, traced, worst), settings.seed);
        const double limit = std::max(settings.noise * error.error, least_noise);
        if (error.noise <= limit || wanted >= settings.most_paths) {
            verified.converged = verified.converged && error.noise <= limit;
            verified.worst.insert(verified.worst.end(), worst.begin(), worst.end());
            return error;
        }
        // In powers of two, which are stratified.
        const double more = error.noise / limit;
        do
            wanted *= 2;
        while (double(wanted) < double(traced.rays()) * more * more
               && wanted < settings.most_paths);
    }
}

} // namespace

MeasuredError measured_error(std::span<const VerifiedPoint> points, uint64_t seed) {
    MeasuredError result;
    // Noise makes |E - T| too large, and what groups of paths agree on too small, by about half as
    // much in scenes whose truth is known, where most of an error is in few places.
    const auto likely = [](const VerifiedPoint& p) { return (p.wrong + 2 * p.agreed) / 3; };
    double error = 0, gap = 0, true_ = 0, noise = 0;
    for (const VerifiedPoint& point : points) {
        error += point.stands_for * likely(point);
        gap += point.stands_for * (point.wrong - point.agreed);
        true_ += point.stands_for * point.true_;
        noise += point.stands_for * point.noise;
    }
    if (!(true_ > 0))
        return result;
    result.points = points.size();
    result.noise = noise / true_;
    result.error = std::max(0.0, error / true_);
    std::mt19937_64 random(seed);
    std::vector<double> errors;
    for (int i = 0; i < samples; ++i) {
        double some_error = 0, some_true = 0;
        for (std::size_t n = 0; n < points.size(); ++n) {
            const VerifiedPoint& point = points[std::size_t(random() % points.size())];
            some_error += point.stands_for * likely(point);
            some_true += point.stands_for * point.true_;
        }
        if (some_true > 0)
            errors.push_back(some_error / some_true);
    }
    std::ranges::sort(errors);
    const auto percentile = [&](double share) {
        return errors[std::size_t(share * double(errors.size() - 1) + 0.5)];
    };
    // Where between the two it is: to a twentieth, above to a tenth, which is as much as it is
    // where all places err alike; and less where both are far apart.
    gap = std::max(0.0, gap / true_);
    const double apart = 0.1 * gap * gap / std::max(result.error, 1e-30);
    const auto unknown = [&](double share) {
        return std::min(0.5 * gap, std::max(share * result.error, apart));
    };
    // Errors are uneven: samples of those that were drawn lack the largest.
    constexpr double undrawn = 1.25;
    result.low = std::max(0.0, std::min(percentile(0.025), result.error) - unknown(0.05));
    result.high =
        result.error + undrawn * std::max(0.0, percentile(0.975) - result.error) + unknown(0.1);
    return result;
}

Verified verify(const Scene& scene, const volume::Levels& levels, const reference::PathRules& rules,
                const readers::Reader& reader, const VerifySettings& settings, Progress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    const scene::Frame frame = scene::frame_of(levels.bricks ? levels.bricks->levels().finest
                                                             : levels.volumes.front().grid);
    const visibility::Visibility visibility(scene, frame, settings.isa);
    reference::PathRules short_paths = rules;
    short_paths.faint = 1;
    const reference::Paths paths(scene, visibility, frame, short_paths);
    Verified verified;
    const uint64_t half = std::max<uint64_t>(1, settings.points / 2);
    const auto measure_at = [&](const Sample& sample) {
        return sample.points.empty() ? MeasuredError()
                                     : measure(paths, sample, settings, verified, progress);
    };
    verified.cells =
        measure_at(sample_cells(levels, visibility, frame, settings.box, half, settings.seed));
    verified.surfaces = measure_at(sample_surfaces(scene, levels, visibility, frame, reader,
                                                   settings.box, half, settings.seed));
    std::ranges::stable_sort(verified.worst, std::greater<>(), &WrongPlace::share);
    verified.worst.resize(std::min(verified.worst.size(), most_places));
    verified.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return verified;
}

} // namespace lpvbake::report
