#include "readers/fit_nonlinear.h"

#include "unit/volumes.h"
#include "volume/compare.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>

namespace lpvbake::readers {
namespace {

const char* const names[] = {"geomerics", "zh3"};

using Cell = std::array<glm::dvec3, 4>;

/// Light that comes from one side more than from the other, none of it negative.
Cell random_cell(std::mt19937& random) {
    std::normal_distribution<double> bell;
    Cell cell;
    for (int c = 0; c < 3; ++c) {
        const glm::dvec3 way = glm::normalize(glm::dvec3(bell(random), bell(random), bell(random)));
        const double l0 = 1 + std::abs(bell(random)), l1 = l0 * 0.4 * (1 + std::sin(bell(random)));
        cell[0][c] = l0;
        for (int k = 0; k < 3; ++k)
            cell[std::size_t(k + 1)][c] = l1 * way[k];
    }
    return cell;
}

TEST(FitNonlinear, ShowsWhatTheReaderShowsAndItsSlopes) {
    std::mt19937 random(3);
    std::normal_distribution<double> bell;
    for (const char* name : names) {
        const Evaluation evaluation = reader_named(name)->evaluation;
        for (int i = 0; i < 200; ++i) {
            Cell cell = random_cell(random);
            if (evaluation == Evaluation::zh3) // the axis, which counts as fixed, along all colours
                for (std::size_t k = 1; k < 4; ++k)
                    cell[k] = glm::dvec3(cell[k].x, 0.5 * cell[k].x, 0.8 * cell[k].x);
            const glm::dvec3 n =
                glm::normalize(glm::dvec3(bell(random), bell(random), bell(random)));
            const Shown shown = shown_with_slope(evaluation, cell, n);
            std::array<glm::vec3, 4> single;
            std::ranges::copy(cell, single.begin());
            const glm::dvec3 expected = evaluate(evaluation, single, n);
            for (int c = 0; c < 3; ++c)
                ASSERT_NEAR(shown.irradiance[c], expected[c], 1e-5 * (1 + expected[c])) << name;
            for (std::size_t k = 0; k < 4; ++k) {
                // Along with band 1 for zh3, whose axis stays then.
                constexpr double h = 1e-6;
                Cell more = cell, less = cell;
                const bool whole = evaluation == Evaluation::zh3 && k > 0;
                glm::dvec3 slope = whole ? glm::dvec3(0.0) : shown.slope[k];
                for (std::size_t j = whole ? 1 : k; j < (whole ? 4 : k + 1); ++j) {
                    const glm::dvec3 change = whole ? h * cell[j] : glm::dvec3(h);
                    more[j] += change;
                    less[j] -= change;
                    if (whole)
                        slope += shown.slope[j] * cell[j];
                }
                const glm::dvec3 found = (shown_with_slope(evaluation, more, n).irradiance
                                          - shown_with_slope(evaluation, less, n).irradiance)
                                         / (2 * h);
                for (int c = 0; c < 3; ++c)
                    ASSERT_NEAR(slope[c], found[c], 1e-5 * (1 + std::abs(found[c]))) << name << k;
            }
        }
    }
}

/// A field, and points of it that a reader shows right.
struct Made {
    Volume truth;
    std::vector<FitPoint> points;
};

Made made(const Reader& reader) {
    Made result;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> share;
    std::normal_distribution<double> bell;
    Volume& volume = result.truth;
    volume.grid = {{0.5, -1, 2}, 0.5, {4, 5, 3}};
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size()));
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        const Cell cell = random_cell(random);
        for (std::size_t k = 0; k < 4; ++k)
            volume.sh[k][i] = glm::vec3(cell[k]);
    }
    for (int i = 0; i < 8000; ++i) {
        const glm::dvec3 p = volume.grid.origin
                             + volume.grid.cell * glm::dvec3(volume.grid.dims)
                                   * glm::dvec3(share(random), share(random), share(random));
        const glm::dvec3 n = glm::normalize(glm::dvec3(bell(random), bell(random), bell(random)));
        result.points.push_back({p, n, 1, irradiance(reader, volume, p, n)});
    }
    return result;
}

Volume even(Volume volume) {
    for (std::size_t k = 0; k < 4; ++k)
        volume.sh[k].assign(volume.grid.size(), glm::vec3(k == 0 ? 2.0f : 0.0f));
    return volume;
}

FitSettings free_cells() {
    FitSettings settings;
    settings.hold_valid = settings.hold_other = 1e-9;
    settings.steps = 200;
    return settings;
}

TEST(FitNonlinear, FindsTheFieldThatTheTargetsWereReadFrom) {
    for (const char* name : names) {
        const Reader& reader = *reader_named(name);
        const Made given = made(reader);
        Volume volume = even(given.truth);
        const double before = error_of(reader, volume, given.points).relative;
        const FitReport report = fit_nonlinear(reader, given.points, free_cells(), volume);
        EXPECT_GT(before, 0.2) << name;
        const double after = error_of(reader, volume, given.points).relative;
        EXPECT_LT(after, 0.001) << name;
        EXPECT_EQ(report.points, given.points.size());
        EXPECT_EQ(report.cells, volume.grid.size());
        // One step, which takes the reader for linear, is not enough.
        Volume linear = even(given.truth);
        fit_nonlinear(reader, given.points, free_cells(), linear, {.outer = 1});
        EXPECT_GT(error_of(reader, linear, given.points).relative, 3 * after) << name;
    }
}

TEST(FitNonlinear, IsNeverWorseThanItBegan) {
    for (const char* name : names) {
        const Reader& reader = *reader_named(name);
        Made given = made(reader);
        Volume volume = given.truth;
        fit_nonlinear(reader, given.points, {}, volume);
        EXPECT_LT(error_of(reader, volume, given.points).relative, 1e-5) << name;
        // What nothing shows: light from two sides alone.
        for (FitPoint& point : given.points)
            point.irradiance = glm::dvec3(std::abs(point.normal.z) > 0.9 ? 10.0 : 0.0);
        const auto squares = [&](const Volume& of) {
            double sum = 0;
            for (const FitPoint& point : given.points) {
                const glm::dvec3 d =
                    irradiance(reader, of, point.position, point.normal) - point.irradiance;
                sum += glm::dot(d, d);
            }
            return sum;
        };
        const double before = squares(volume);
        fit_nonlinear(reader, given.points, free_cells(), volume);
        EXPECT_LT(squares(volume), before) << name;
        for (const auto& band : volume.sh)
            for (const glm::vec3& c : band)
                ASSERT_TRUE(std::isfinite(c.x) && std::isfinite(c.y) && std::isfinite(c.z));
    }
}

TEST(FitNonlinear, BitsDoNotDependOnThreads) {
    const Reader& reader = *reader_named("geomerics");
    const Made given = made(reader);
    Volume first;
    for (const std::size_t threads : {1, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Volume volume = even(given.truth);
        fit_nonlinear(reader, given.points, {}, volume);
        if (threads == 1)
            first = volume;
        else
            EXPECT_EQ(volume.sh, first.sh);
    }
}

} // namespace
} // namespace lpvbake::readers
