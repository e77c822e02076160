#include "report/verify.h"

#include "report/measure.h"
#include "visibility/visibility.h"
#include "volume/compare.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>

namespace lpvbake::report {
namespace {

constexpr std::size_t most_places = 5;
constexpr int samples = 1000;

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

Sample sample_cells(const Volume& volume, const visibility::Visibility& visibility, uint64_t count,
                    uint64_t seed) {
    std::vector<std::size_t> cells;
    std::vector<double> light;
    for (std::size_t i = 0; i < volume.grid.size(); ++i)
        if (volume.is_valid(i)) {
            cells.push_back(i);
            light.push_back(std::max(0.0, sum_of(glm::dvec3(volume.sh[0][i]))));
        }
    Sample sample;
    sample.drawn = draw(light, count, seed);
    std::vector<std::vector<glm::vec3>> sh(volume.sh.size());
    for (Drawn& one : sample.drawn) {
        const std::size_t cell = cells[one.place];
        const glm::ivec3 at = volume.grid.cell_at(cell);
        sample.points.push_back(visibility.capture(at).point);
        sample.places.push_back(volume.grid.center(at));
        for (std::size_t k = 0; k < sh.size(); ++k)
            sh[k].push_back(volume.sh[k][cell]);
    }
    if (!sample.points.empty())
        sample.shown = irradiance_of(sh, volume.sh_order);
    return sample;
}

Sample sample_surfaces(const Scene& scene, const Volume& volume,
                       const visibility::Visibility& visibility, const scene::Frame& frame,
                       const readers::Reader& reader, uint64_t count, uint64_t seed) {
    const Grid& grid = volume.grid;
    const Bounds box{grid.origin, grid.origin + grid.cell * glm::dvec3(grid.dims)};
    const std::vector<FrontPoint> points =
        draw_surface_points(scene, visibility, frame, box, 8 * count, seed);
    std::vector<glm::dvec3> shown;
    std::vector<double> light;
    for (const FrontPoint& point : points) {
        shown.push_back(readers::irradiance(reader, volume, point.position, point.normal));
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

MeasuredError measure(const Sample& sample, const Truth& truth, uint64_t seed, Verified& verified) {
    const std::size_t normals = sample.normals.empty() ? volume::neighbour_normals().size() : 1;
    std::vector<VerifiedPoint> points;
    std::vector<WrongPlace> places;
    double all = 0;
    for (std::size_t i = 0; i < sample.points.size(); ++i) {
        // Where no light arrives at all, such as below what stands on a floor, nothing is read.
        if (normals == 1 && truth.irradiance[i] == glm::dvec3(0.0))
            continue;
        VerifiedPoint& point = points.emplace_back();
        point.stands_for = sample.drawn[i].stands_for;
        WrongPlace& place = places.emplace_back();
        place.on_surface = !sample.normals.empty();
        place.position = sample.places[i];
        for (std::size_t n = i * normals; n < (i + 1) * normals; ++n) {
            point.wrong += sum_of(glm::abs(sample.shown[n] - truth.irradiance[n]));
            point.true_ += sum_of(truth.irradiance[n]);
            point.noise += sum_of(truth.error[n]);
            place.shown += sum_of(sample.shown[n]) / double(3 * normals);
        }
        place.true_ = point.true_ / double(3 * normals);
        place.share = point.stands_for * std::max(0.0, point.wrong - 2 * point.noise);
        all += point.stands_for * point.wrong;
    }
    for (WrongPlace& place : places)
        if (place.share > 0) {
            place.share /= all;
            verified.worst.push_back(place);
        }
    verified.rays += truth.traced;
    verified.converged = verified.converged && truth.converged;
    return measured_error(points, seed);
}

} // namespace

MeasuredError measured_error(std::span<const VerifiedPoint> points, uint64_t seed) {
    MeasuredError result;
    double wrong = 0, true_ = 0, noise = 0;
    for (const VerifiedPoint& point : points) {
        wrong += point.stands_for * point.wrong;
        true_ += point.stands_for * point.true_;
        noise += point.stands_for * point.noise;
    }
    if (!(true_ > 0))
        return result;
    result.points = points.size();
    result.noise = noise / true_;
    // The mean of |x| of a Gaussian is less than its deviation.
    const double by_noise = std::sqrt(2 / std::numbers::pi) * result.noise;
    const auto without_noise = [by_noise](double error) {
        return std::sqrt(std::max(0.0, error * error - by_noise * by_noise));
    };
    result.error = without_noise(wrong / true_);
    std::mt19937_64 random(seed);
    std::vector<double> errors;
    for (int i = 0; i < samples; ++i) {
        double some_wrong = 0, some_true = 0;
        for (std::size_t n = 0; n < points.size(); ++n) {
            const VerifiedPoint& point = points[std::size_t(random() % points.size())];
            some_wrong += point.stands_for * point.wrong;
            some_true += point.stands_for * point.true_;
        }
        if (some_true > 0)
            errors.push_back(without_noise(some_wrong / some_true));
    }
    std::ranges::sort(errors);
    const auto percentile = [&](double share) {
        return errors[std::size_t(share * double(errors.size() - 1) + 0.5)];
    };
    // Noise that is taken off is itself known to some part only.
    const double unknown = 0.25 * std::min(by_noise, result.error);
    result.low = std::max(0.0, std::min(percentile(0.025), result.error) - unknown);
    result.high = std::max(percentile(0.975), result.error) + unknown;
    return result;
}

Verified verify(const Scene& scene, const Volume& volume, const reference::PathRules& rules,
                const readers::Reader& reader, const VerifySettings& settings, Progress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    const scene::Frame frame = scene::frame_of(volume.grid);
    const visibility::Visibility visibility(scene, frame, settings.isa);
    const TruthSettings exact{settings.noise, settings.most_rays, settings.seed};
    Verified verified;
    const uint64_t half = std::max<uint64_t>(1, settings.points / 2);
    const auto measure_at = [&](const Sample& sample) {
        if (sample.points.empty())
            return MeasuredError();
        const Truth truth = trace_truth(scene, visibility, frame, sample.points, sample.normals,
                                        rules, exact, progress);
        return measure(sample, truth, settings.seed, verified);
    };
    verified.cells = measure_at(sample_cells(volume, visibility, half, settings.seed));
    verified.surfaces =
        measure_at(sample_surfaces(scene, volume, visibility, frame, reader, half, settings.seed));
    std::ranges::stable_sort(verified.worst, std::greater<>(), &WrongPlace::share);
    verified.worst.resize(std::min(verified.worst.size(), most_places));
    verified.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return verified;
}

} // namespace lpvbake::report
