// How far volumes are from each other.
#include "volume/compare.h"

#include "unit/volumes.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

using namespace lpvbake;

namespace {

constexpr double pi = std::numbers::pi;
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Irradiance by equation 13 of Ramamoorthi and Hanrahan, "An efficient representation for
/// irradiance environment maps" (2001), with the paper's own constants, not clamped.
double irradiance(const Volume& volume, size_t cell, int channel, glm::dvec3 n) {
    const double c1 = 0.429043, c2 = 0.511664, c3 = 0.743125, c4 = 0.886227, c5 = 0.247708;
    const auto l = [&](size_t k) { // order 1; y, z, x; xy, yz, z2, xz, x2y2
        return k < volume.sh.size() ? double(volume.sh[k][cell][channel]) : 0.0;
    };
    return c1 * l(8) * (n.x * n.x - n.y * n.y) + c3 * l(6) * n.z * n.z + c4 * l(0) - c5 * l(6)
           + 2 * c1 * (l(4) * n.x * n.y + l(7) * n.x * n.z + l(5) * n.y * n.z)
           + 2 * c2 * (l(3) * n.x + l(1) * n.y + l(2) * n.z);
}

struct Value {
    size_t cell;
    int channel;
    glm::dvec3 normal;
    double a, b; ///< before they are clamped
    double difference() const { return std::abs(std::max(a, 0.0) - std::max(b, 0.0)); }
};

/// All samples, one after the other.
std::vector<Value> samples_of(const Volume& a, const Volume& b) {
    std::vector<Value> values;
    for (size_t cell = 0; cell < a.grid.size(); ++cell) {
        if ((!a.validity.empty() && a.validity[cell] == 0)
            || (!b.validity.empty() && b.validity[cell] == 0))
            continue;
        for (int channel = 0; channel < 3; ++channel)
            for (int z = -1; z <= 1; ++z)
                for (int y = -1; y <= 1; ++y)
                    for (int x = -1; x <= 1; ++x) {
                        if (x == 0 && y == 0 && z == 0)
                            continue;
                        const glm::dvec3 n = glm::dvec3(x, y, z) / std::sqrt(x * x + y * y + z * z);
                        values.push_back({cell, channel, n, irradiance(a, cell, channel, n),
                                          irradiance(b, cell, channel, n)});
                    }
    }
    return values;
}

/// Luminance L from everywhere: c_0 = L 2 sqrt(pi), and the irradiance is pi L for any normal.
Volume uniform(glm::ivec3 dims, glm::vec3 luminance) {
    Volume volume;
    volume.grid = {{-1, 2, 0.5}, 0.25, dims};
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size()));
    volume.sh[0].assign(volume.grid.size(), float(2 * std::sqrt(pi)) * luminance);
    volume.validity.assign(volume.grid.size(), 1);
    return volume;
}

const volume::GridDifference* find(const volume::Comparison& c, const std::string& name) {
    const auto found = std::ranges::find(c.grids, name, &volume::GridDifference::name);
    return found == c.grids.end() ? nullptr : &*found;
}

void expect_no_nan(const volume::Comparison& c) {
    for (const double value : {c.mean_a, c.mean_b, c.relative_l1, c.rms, c.relative_rms,
                               c.percentile95, c.max, c.energy_a, c.energy_b, c.energy_ratio})
        EXPECT_FALSE(std::isnan(value));
    for (const float error : c.cell_error)
        EXPECT_FALSE(std::isnan(error));
    for (const volume::GridDifference& grid : c.grids)
        EXPECT_FALSE(std::isnan(grid.relative));
}

} // namespace

TEST(Compare, NormalsAreThe26Neighbours) {
    std::set<std::tuple<int, int, int>> found;
    for (const glm::dvec3 n : volume::neighbour_normals()) {
        EXPECT_NEAR(glm::length(n), 1, 1e-15);
        const double scale = 1 / std::max({std::abs(n.x), std::abs(n.y), std::abs(n.z)});
        found.emplace(int(std::lround(scale * n.x)), int(std::lround(scale * n.y)),
                      int(std::lround(scale * n.z)));
    }
    EXPECT_EQ(found.size(), 26u);
}

TEST(Compare, AVolumeIsItself) {
    for (int order : {0, 1, 2, 4}) {
        const Volume volume = random_volume({7, 6, 5}, order, true, 3);
        const volume::Comparison c = volume::compare(volume, volume, {{0.0}, 5});
        EXPECT_TRUE(c.identical);
        EXPECT_GT(c.samples, 1000u);
        EXPECT_GT(c.mean_b, 0);
        EXPECT_EQ(c.mean_a, c.mean_b);
        for (const double value : {c.relative_l1, c.rms, c.relative_rms, c.percentile95, c.max})
            EXPECT_EQ(value, 0);
        EXPECT_EQ(c.energy_ratio, 1);
        EXPECT_EQ(c.exceeding[0], 0u);
        EXPECT_TRUE(c.worst.empty());
        EXPECT_EQ(c.grids.size(), volume.sh.size() + 4 + 1 + 2); // occlusion, validity, walls
    }
}

TEST(Compare, UniformLightInClosedForm) {
    const Volume b = uniform({3, 4, 5}, {8, 8, 8}), a = uniform({3, 4, 5}, {10, 10, 10});
    const volume::Comparison c = volume::compare(a, b, {{0.24, 0.26}, 5});
    EXPECT_FALSE(c.identical);
    EXPECT_EQ(c.samples, 3u * 4 * 5 * 26 * 3);
    EXPECT_NEAR(c.mean_a, 10 * pi, 1e-5);
    EXPECT_NEAR(c.mean_b, 8 * pi, 1e-5);
    EXPECT_NEAR(c.rms, 2 * pi, 1e-5);
    for (const double value : {c.relative_l1, c.relative_rms, c.percentile95, c.max})
        EXPECT_NEAR(value, 0.25, 1e-6);
    EXPECT_EQ(c.exceeding, (std::vector<uint64_t>{c.samples, 0}));
    // L 4 pi steradians a cell.
    EXPECT_NEAR(c.energy_b, 60 * 8 * 4 * pi, 1e-2);
    EXPECT_NEAR(c.energy_ratio, 1.25, 1e-6);
    EXPECT_NEAR(c.grids[0].max_abs, 4 * std::sqrt(pi), 1e-5);
    EXPECT_NEAR(c.grids[0].rms, 4 * std::sqrt(pi), 1e-5);
    EXPECT_NEAR(c.grids[0].relative, 0.25, 1e-6);
    EXPECT_EQ(c.grids[0].cells, 60u);
    EXPECT_EQ(c.grids[1].cells, 0u);
    EXPECT_EQ(c.grids[1].relative, 0);
}

TEST(Compare, AgreesWithEverySampleTakenByHand) {
    for (const auto& [order_a, order_b] : {std::pair(1, 1), {2, 2}, {1, 2}, {2, 0}}) {
        const Volume a = random_volume({9, 4, 7}, order_a, false, 1);
        const Volume b = random_volume({9, 4, 7}, order_b, true, 2);
        const std::vector<Value> values = samples_of(a, b);
        double sum_b = 0, sum_abs = 0, squares = 0;
        uint64_t negative_a = 0, negative_b = 0, exceeding = 0;
        std::vector<double> differences;
        std::vector<double> of_cell(a.grid.size()), cell_max(a.grid.size());
        for (const Value& value : values) {
            sum_b += std::max(value.b, 0.0);
            sum_abs += value.difference();
            squares += value.difference() * value.difference();
            negative_a += value.a < 0;
            negative_b += value.b < 0;
            differences.push_back(value.difference());
            of_cell[value.cell] += value.difference();
            cell_max[value.cell] = std::max(cell_max[value.cell], value.difference());
        }
        const double count = double(values.size()), mean = sum_b / count;
        for (const double d : differences)
            exceeding += d > 0.5 * mean;
        std::ranges::sort(differences);

        const volume::Comparison c = volume::compare(a, b, {{0.5}, 4});
        ASSERT_EQ(c.samples, values.size());
        ASSERT_GT(negative_a, 100u);
        EXPECT_NEAR(c.mean_b, mean, 1e-5 * mean);
        EXPECT_NEAR(c.relative_l1, sum_abs / sum_b, 1e-5 * sum_abs / sum_b);
        EXPECT_NEAR(c.rms, std::sqrt(squares / count), 1e-5 * c.rms);
        EXPECT_NEAR(c.relative_rms, std::sqrt(squares / count) / mean, 1e-5 * c.relative_rms);
        EXPECT_NEAR(c.percentile95 * mean, differences[size_t(std::ceil(0.95 * count)) - 1],
                    1e-4 * mean);
        EXPECT_NEAR(c.max * mean, differences.back(), 1e-5 * differences.back());
        EXPECT_NEAR(double(c.negative_a), double(negative_a), 2);
        EXPECT_NEAR(double(c.negative_b), double(negative_b), 2);
        EXPECT_NEAR(double(c.exceeding[0]), double(exceeding), 2);
        for (size_t cell = 0; cell < a.grid.size(); ++cell)
            EXPECT_NEAR(c.cell_error[cell], of_cell[cell] / 78 / mean, 1e-4);

        ASSERT_EQ(c.worst.size(), 4u);
        std::vector<double> largest = cell_max;
        std::ranges::sort(largest, std::greater());
        for (size_t w = 0; w < 4; ++w) {
            const volume::IrradianceSample& worst = c.worst[w];
            const size_t cell = a.grid.index(worst.cell);
            EXPECT_NEAR(worst.difference * mean, largest[w], 1e-5 * largest[w]);
            EXPECT_NEAR(cell_max[cell], largest[w], 1e-5 * largest[w]);
            const auto expect = [&](const Volume& volume, double value) {
                const double e = irradiance(volume, cell, worst.channel, worst.normal);
                EXPECT_NEAR(value, std::max(e, 0.0), 1e-5 * largest[w]);
            };
            expect(a, worst.a);
            expect(b, worst.b);
        }
    }
}

TEST(Compare, OnePerturbedCoefficientIsFoundAndLocated) {
    const Volume b = uniform({5, 6, 7}, {3, 2, 1});
    const glm::ivec3 cell(4, 1, 5);
    const size_t i = b.grid.index(cell);
    for (size_t k = 0; k < 4; ++k)
        for (int channel = 0; channel < 3; ++channel) {
            Volume a = b;
            a.sh[k][i][channel] += 0.5f;
            const volume::Comparison c = volume::compare(a, b, {{0.0}, 5});
            EXPECT_FALSE(c.identical);
            ASSERT_EQ(c.worst.size(), 1u);
            EXPECT_EQ(c.worst[0].cell, cell);
            EXPECT_EQ(c.worst[0].channel, channel);
            // Band 0 adds to all 26 normals; the vector of band 1 to all but the 8 across it.
            EXPECT_EQ(c.exceeding[0], k == 0 ? 26u : 18u);
            for (size_t other = 0; other < 4; ++other)
                EXPECT_EQ(c.grids[other].cells, other == k ? 1u : 0u);
            EXPECT_EQ(c.grids[k].cell, cell);
            EXPECT_EQ(c.grids[k].channel, channel);
            EXPECT_EQ(c.grids[k].a, a.sh[k][i][channel]);
            EXPECT_EQ(c.grids[k].b, b.sh[k][i][channel]);
            EXPECT_NEAR(c.grids[k].max_abs, 0.5, 1e-6);
            EXPECT_NEAR(c.grids[k].rms, 0.5 / std::sqrt(3.0 * 5 * 6 * 7), 1e-6);
            for (size_t other = 0; other < c.cell_error.size(); ++other)
                EXPECT_EQ(c.cell_error[other] > 0, other == i);
            // In band 1 the worst normals look along the axis.
            const glm::dvec3 axes[] = {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}};
            if (k > 0) {
                EXPECT_NEAR(std::abs(glm::dot(c.worst[0].normal, axes[k - 1])), 1, 1e-12);
            }
        }
}

TEST(Compare, TheSmallestChangeOfAnyGridCounts) {
    const Volume b = random_volume({4, 4, 4}, 2, true, 5);
    const auto expect_found = [&](const auto& change) {
        Volume a = b;
        change(a);
        EXPECT_FALSE(volume::compare(a, b, {}).identical);
        EXPECT_FALSE(volume::compare(b, a, {}).identical);
    };
    for (size_t cell = 0; cell < b.grid.size(); cell += 7) // valid or not
        for (size_t k : {0u, 8u})
            expect_found([&](Volume& a) {
                a.sh[k][cell].g = std::nextafter(a.sh[k][cell].g, float(infinity));
            });
    expect_found([](Volume& a) { a.occlusion[3][1] += 1e-6f; });
    expect_found([](Volume& a) { a.validity[2] = 1 - a.validity[2]; });
    expect_found([](Volume& a) { a.occlusion.clear(); });
    expect_found([](Volume& a) { a.validity.clear(); });
    expect_found([](Volume& a) { a.walls[1][2].y += 1e-6f; });
    expect_found([](Volume& a) { a.walls.pop_back(); });
    expect_found([](Volume& a) {
        a.sh_order = 1;
        a.sh.resize(4);
    });
    Volume other = b;
    other.metadata["more"] = "x";
    EXPECT_TRUE(volume::compare(other, b, {}).identical);
}

TEST(Compare, OrdersAreComparedWithAllThatTheyHave) {
    const Volume l2 = random_volume({6, 6, 6}, 2, false, 9);
    Volume l1 = l2;
    l1.sh_order = 1;
    l1.sh.resize(4);
    const volume::Comparison c = volume::compare(l1, l2, {});
    EXPECT_EQ(c.grids.size(), 4u + 1 + 2);
    EXPECT_EQ(c.only_a.size(), 0u);
    EXPECT_EQ(c.only_b.size(), 5u);
    for (const volume::GridDifference& grid : c.grids)
        EXPECT_EQ(grid.cells, 0u);
    EXPECT_GT(c.relative_l1, 0.05) << "band 2 is light too";
    EXPECT_EQ(c.energy_ratio, 1);
}

TEST(Compare, OnlyCellsValidInBothAreSampled) {
    Volume a = uniform({4, 1, 1}, {1, 1, 1}), b = uniform({4, 1, 1}, {1, 1, 1});
    a.validity = {1, 1, 0, 0};
    b.validity = {1, 0, 1, 0};
    a.sh[0][1] = a.sh[0][2] = a.sh[0][3] = glm::vec3(1000);
    const volume::Comparison c = volume::compare(a, b, {});
    EXPECT_EQ(c.valid_both, 1u);
    EXPECT_EQ(c.valid_only_a, 1u);
    EXPECT_EQ(c.valid_only_b, 1u);
    EXPECT_EQ(c.valid_neither, 1u);
    EXPECT_EQ(c.samples, 78u);
    EXPECT_EQ(c.relative_l1, 0);
    EXPECT_EQ(c.energy_ratio, 1);
    const volume::GridDifference* validity = find(c, "validity");
    ASSERT_TRUE(validity);
    EXPECT_EQ(validity->cells, 2u);
    EXPECT_EQ(validity->cell, glm::ivec3(1, 0, 0));
    EXPECT_EQ(c.grids[0].cells, 3u) << "grids are compared everywhere";

    a.validity.clear(); // then all of A is valid
    const volume::Comparison whole = volume::compare(a, b, {});
    EXPECT_EQ(whole.valid_both, 2u);
    EXPECT_EQ(whole.valid_only_a, 2u);
    EXPECT_FALSE(find(whole, "validity"));
    EXPECT_GT(whole.relative_l1, 1);
}

TEST(Compare, GridsAreMeasuredWhereBothAreValid) {
    Volume b = uniform({4, 1, 1}, {1, 1, 1});
    b.sh[1] = std::vector<glm::vec3>(4, {3, 0, 4});
    b.validity = {1, 1, 0, 0};
    Volume a = b;
    a.sh[1][2] = {0, -50, 4};
    const volume::GridDifference outside = volume::compare(a, b, {}).grids[1];
    EXPECT_EQ(outside.cells, 1u);
    EXPECT_EQ(outside.cells_valid_both, 0u);
    EXPECT_EQ(outside.rms, 0);
    EXPECT_EQ(outside.relative, 0);
    EXPECT_EQ(outside.max_abs, 50);
    EXPECT_EQ(outside.cell, glm::ivec3(2, 0, 0));
    EXPECT_EQ(outside.channel, 1);
    EXPECT_EQ(outside.a, -50);

    a.sh[1][1].b = 10; // a difference of 6 in 2 cells of 3 channels
    const volume::GridDifference inside = volume::compare(a, b, {}).grids[1];
    EXPECT_EQ(inside.cells, 2u);
    EXPECT_EQ(inside.cells_valid_both, 1u);
    EXPECT_NEAR(inside.rms, 6 / std::sqrt(6.0), 1e-12);
    EXPECT_NEAR(inside.relative, 6 / std::sqrt(2.0 * (9 + 16)), 1e-12);
    EXPECT_EQ(inside.max_abs, 6);
    EXPECT_EQ(inside.cell, glm::ivec3(1, 0, 0));
    EXPECT_EQ(inside.channel, 2);
    EXPECT_EQ(inside.b, 4);
}

TEST(Compare, NegativeIrradianceIsClampedAndCounted) {
    // E = pi (c_0 Y_0) + (2 pi / 3) c_y Y_1 n_y: with c_y large, negative for the 9 normals below.
    Volume a = uniform({2, 1, 1}, {1, 1, 1}), b = a;
    a.sh[1][1] = glm::vec3(100, 0, 0);
    b.sh[1][1] = glm::vec3(200, 0, 0);
    const volume::Comparison c = volume::compare(a, b, {{0.0}, 1});
    EXPECT_EQ(c.negative_a, 9u);
    EXPECT_EQ(c.negative_b, 9u);
    EXPECT_EQ(c.exceeding[0], 9u) << "both are 0 below";

    // Where all is below 0 nothing differs but the coefficients.
    const volume::Comparison dark =
        volume::compare(uniform({2, 1, 1}, glm::vec3(-1)), uniform({2, 1, 1}, {}), {});
    EXPECT_EQ(dark.negative_a, 2u * 78);
    EXPECT_EQ(dark.negative_b, 0u);
    EXPECT_EQ(dark.relative_l1, 0);
    EXPECT_FALSE(dark.identical);
}

TEST(Compare, ABlackReferenceGivesZeroOrInfinityNeverNaN) {
    const Volume black = uniform({3, 3, 3}, {}), lit = uniform({3, 3, 3}, {1, 1, 1});
    const volume::Comparison same = volume::compare(black, black, {{0.0}, 5});
    EXPECT_TRUE(same.identical);
    EXPECT_EQ(same.relative_l1, 0);
    EXPECT_EQ(same.energy_ratio, 1);
    expect_no_nan(same);

    const volume::Comparison c = volume::compare(lit, black, {{0.0, 1e30}, 5});
    for (const double value :
         {c.relative_l1, c.relative_rms, c.percentile95, c.max, c.energy_ratio})
        EXPECT_EQ(value, infinity);
    EXPECT_NEAR(c.rms, pi, 1e-5);
    EXPECT_EQ(c.exceeding, (std::vector<uint64_t>{c.samples, c.samples}));
    EXPECT_EQ(c.cell_error[0], infinity);
    EXPECT_EQ(c.grids[0].relative, infinity);
    EXPECT_EQ(c.worst[0].difference, infinity);
    expect_no_nan(c);

    Volume spot = black; // one lit cell of 27: the percentile stays at 0, the rest does not
    spot.sh[0][13] = glm::vec3(1);
    const volume::Comparison few = volume::compare(spot, black, {{0.0}, 5});
    EXPECT_EQ(few.percentile95, 0);
    EXPECT_EQ(few.max, infinity);
    EXPECT_EQ(few.exceeding[0], 78u);
    EXPECT_EQ(few.cell_error[0], 0);
    expect_no_nan(few);

    Volume nowhere = lit;
    nowhere.validity.assign(27, 0);
    const volume::Comparison none = volume::compare(nowhere, nowhere, {{0.0}, 5});
    EXPECT_TRUE(none.identical);
    EXPECT_EQ(none.samples, 0u);
    expect_no_nan(none);
}

TEST(Compare, HugeAndTinyValuesStayInRange) {
    for (const float scale : {1e-36f, 1e36f}) {
        const Volume b = uniform({3, 3, 3}, glm::vec3(scale));
        const Volume a = uniform({3, 3, 3}, glm::vec3(2 * scale));
        const volume::Comparison c = volume::compare(a, b, {{0.5}, 5});
        EXPECT_NEAR(c.relative_l1, 1, 1e-5);
        EXPECT_NEAR(c.relative_rms, 1, 1e-5);
        EXPECT_NEAR(c.percentile95, 1, 1e-5);
        EXPECT_EQ(c.exceeding[0], c.samples);
        expect_no_nan(c);
    }
}

TEST(Compare, AtMostFivePercentLieAboveThe95thPercentile) {
    for (unsigned seed = 0; seed < 5; ++seed) {
        const Volume a = random_volume({5, 5, int(seed) + 2}, 1, false, seed);
        const Volume b = random_volume({5, 5, int(seed) + 2}, 1, false, seed + 100);
        const double p = volume::compare(a, b, {}).percentile95;
        const volume::Comparison c = volume::compare(a, b, {{p, p * (1 - 1e-7)}, 0});
        EXPECT_LE(double(c.exceeding[0]), 0.05 * double(c.samples));
        EXPECT_GT(double(c.exceeding[1]), 0.05 * double(c.samples) - 1e-9);
        EXPECT_TRUE(c.worst.empty());
        EXPECT_GT(c.max, p);
    }
}

TEST(Compare, SameBitsForAnyNumberOfThreads) {
    const Volume a = random_volume({31, 29, 27}, 2, true, 1);
    const Volume b = random_volume({31, 29, 27}, 2, true, 2);
    const tbb::global_control more(tbb::global_control::max_allowed_parallelism, 8);
    const auto with_threads = [&](int threads) {
        tbb::task_arena arena(threads);
        return arena.execute([&] { return volume::compare(a, b, {{0.1}, 9}); });
    };
    const volume::Comparison one = with_threads(1);
    for (int threads : {2, 3, 8}) {
        const volume::Comparison c = with_threads(threads);
        EXPECT_EQ(c.relative_l1, one.relative_l1);
        EXPECT_EQ(c.rms, one.rms);
        EXPECT_EQ(c.mean_a, one.mean_a);
        EXPECT_EQ(c.percentile95, one.percentile95);
        EXPECT_EQ(c.energy_ratio, one.energy_ratio);
        EXPECT_EQ(c.exceeding, one.exceeding);
        EXPECT_EQ(c.cell_error, one.cell_error);
        EXPECT_EQ(c.grids[5].rms, one.grids[5].rms);
        for (size_t w = 0; w < 9; ++w)
            EXPECT_EQ(c.worst[w].cell, one.worst[w].cell);
    }
}

TEST(Compare, EqualDifferencesAreListedByIndex) {
    const Volume b = uniform({4, 3, 2}, {1, 1, 1});
    Volume a = b;
    for (glm::ivec3 cell : {glm::ivec3(3, 2, 1), {2, 2, 0}, {1, 0, 1}})
        a.sh[0][a.grid.index(cell)] += glm::vec3(0, 1, 1);
    const volume::Comparison c = volume::compare(a, b, {{}, 2});
    ASSERT_EQ(c.worst.size(), 2u);
    EXPECT_EQ(c.worst[0].cell, glm::ivec3(2, 2, 0));
    EXPECT_EQ(c.worst[1].cell, glm::ivec3(1, 0, 1));
    EXPECT_EQ(c.worst[0].channel, 1);
}

TEST(Compare, OtherLatticesAreRefused) {
    const Volume b = uniform({4, 3, 2}, {1, 1, 1});
    const auto refused = [&](const char* text, const Grid& grid) {
        Volume a = uniform(grid.dims, {1, 1, 1});
        a.grid = grid;
        EXPECT_EQ(error_of(text, [&] { volume::compare(a, b, {}); }).kind, ErrorKind::invalid);
        EXPECT_EQ(error_of(text, [&] { volume::difference(a, b); }).kind, ErrorKind::invalid);
    };
    const Grid& g = b.grid;
    refused("dims: 3 x 4 x 2 and 4 x 3 x 2 cells", {g.origin, g.cell, {3, 4, 2}});
    refused("cell: 0.5 and 0.25 m", {g.origin, 0.5, g.dims});
    refused("cell: 0.250001", {g.origin, 0.250001, g.dims});
    refused("origin: (-1, 2.5, 0.5) and (-1, 2, 0.5) m", {{-1, 2.5, 0.5}, g.cell, g.dims});
    refused("origin: ", {{-1, 2, 0.500001}, g.cell, g.dims});

    Volume rounded = b;
    rounded.grid.origin.x += 1e-9;
    rounded.grid.cell *= 1 + 1e-9;
    EXPECT_FALSE(volume::lattice_difference(rounded.grid, b.grid));
    EXPECT_TRUE(volume::compare(rounded, b, {}).identical);
}

TEST(Compare, ValuesThatAreNotFiniteAreRefused) {
    const Volume b = uniform({4, 3, 2}, {1, 1, 1});
    for (const float bad : {float(infinity), -float(infinity), std::nanf("")}) {
        Volume a = b;
        a.sh[0][7].b = bad;
        EXPECT_EQ(error_of("finite", [&] { volume::compare(b, a, {}); }).kind, ErrorKind::invalid);
        a.validity[7] = 0; // there it is only a coefficient that differs
        EXPECT_FALSE(volume::compare(b, a, {}).identical);
    }
}

TEST(Compare, TheDifferenceIsAVolume) {
    const Volume a = random_volume({4, 5, 3}, 1, true, 1);
    const Volume b = random_volume({4, 5, 3}, 2, true, 2);
    for (const bool swapped : {false, true}) {
        const Volume &left = swapped ? b : a, &right = swapped ? a : b;
        const Volume d = volume::difference(left, right);
        EXPECT_EQ(d.grid, a.grid);
        EXPECT_EQ(d.sh_order, 2);
        ASSERT_EQ(d.sh.size(), 9u);
        ASSERT_EQ(d.occlusion.size(), 4u);
        for (size_t i = 0; i < a.grid.size(); ++i) {
            for (size_t k = 0; k < 9; ++k) {
                const auto value = [&](const Volume& v) {
                    return k < v.sh.size() ? v.sh[k][i] : glm::vec3(0);
                };
                EXPECT_EQ(d.sh[k][i], value(left) - value(right));
            }
            EXPECT_EQ(d.occlusion[2][i], left.occlusion[2][i] - right.occlusion[2][i]);
            EXPECT_EQ(d.validity[i], a.validity[i] * b.validity[i]);
        }
    }
    Volume plain = a;
    plain.occlusion.clear();
    EXPECT_TRUE(volume::difference(plain, a).occlusion.empty());
}
