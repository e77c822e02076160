// Bricks: which there may be, how they are read, stitched and trimmed, and their files.
#include "io/bricks.h"
#include "lpvbake/error.h"
#include "lpvbake/file.h"
#include "readers/readers.h"
#include "volume/levels.h"
#include "volume/sh.h"
#include "volumes.h"

#include <gtest/gtest.h>

#include <functional>
#include <numbers>
#include <random>

namespace lpvbake {
namespace {

using volume::Brick;
using volume::BrickLevels;
using volume::BrickTree;
using volume::VolumeSet;

/// Three levels over 2 x 1 x 1 coarsest bricks of 8 m.
const glm::dvec3 corner(-3.25, 0.5, 7);
BrickLevels three() {
    return volume::brick_levels(0.25, 1, corner, corner + glm::dvec3(16, 8, 8));
}

/// A brick of each level beside one of the next, balanced.
std::vector<Brick> some_bricks() {
    std::vector<Brick> bricks{{2, {0, 0, 0}}, {2, {1, 0, 0}}};
    for (int i = 0; i < 8; ++i)
        bricks.push_back({1, {i & 1, i >> 1 & 1, i >> 2}});
    bricks.push_back({1, {2, 0, 0}});
    bricks.push_back({1, {2, 0, 1}});
    bricks.push_back({1, {2, 1, 0}});
    bricks.push_back({1, {2, 1, 1}});
    bricks.push_back({0, {0, 0, 0}});
    bricks.push_back({0, {1, 1, 0}});
    bricks.push_back({0, {2, 1, 1}});
    return bricks;
}

using Field = std::function<glm::dvec3(std::size_t k, glm::dvec3 point)>;

VolumeSet bricks_of(const Field& field, int order = 1, std::vector<Brick> bricks = some_bricks()) {
    VolumeSet set;
    set.bricks.emplace(three(), std::move(bricks));
    for (const Brick& brick : set.bricks->bricks()) {
        Volume& volume = set.levels.emplace_back();
        volume.grid = set.bricks->levels().grid_of(brick);
        volume.sh_order = order;
        for (int k = 0; k < volume::sh_count(order); ++k) {
            volume.sh.emplace_back();
            for (std::size_t i = 0; i < volume.grid.size(); ++i)
                volume.sh.back().push_back(
                    glm::vec3(field(std::size_t(k), volume.grid.center(volume.grid.cell_at(i)))));
        }
        volume.validity.assign(volume::brick_samples, 1.0f);
        volume.walls.assign(std::size_t(most_walls),
                            std::vector<glm::vec3>(volume::brick_samples, glm::vec3(0)));
    }
    set.levels.front().metadata = {{"scene_hash", "1"}, {"settings", "{}"}};
    set.levels.back().metadata = set.levels.front().metadata;
    return set;
}

glm::dvec3 affine(std::size_t k, glm::dvec3 p) {
    return glm::dvec3(30, 50, 70) + double(k + 1) * glm::dvec3(0.2, -0.1, 0.3) * p.x
           + glm::dvec3(0.5, 0.25, -0.2) * p.y + double(k) * glm::dvec3(0.1, 0.4, 0.2) * p.z;
}

/// What no cell but the finest can show.
glm::dvec3 wavy(std::size_t k, glm::dvec3 p) {
    return glm::dvec3(k == 0 ? 10 : 1) * (2 + std::sin(3 * p.x) * std::cos(2 * p.y + p.z));
}

glm::dvec3 random_in(std::mt19937& random, glm::dvec3 lo, glm::dvec3 hi) {
    const auto share = [&] { return std::uniform_real_distribution<double>()(random); };
    return lo + (hi - lo) * glm::dvec3(share(), share(), share());
}

const readers::Reader trilinear{.name = "trilinear"};

TEST(Bricks, LevelsFillTheBoxFromItsCornerOn) {
    const BrickLevels levels = three();
    EXPECT_EQ(levels.count, 3);
    EXPECT_EQ(levels.finest.dims, glm::ivec3(65, 33, 33));
    EXPECT_EQ(levels.places(0), glm::ivec3(8, 4, 4));
    EXPECT_EQ(levels.places(2), glm::ivec3(2, 1, 1));
    for (int level = 0; level < 3; ++level) {
        const Grid grid = levels.lattice(level);
        EXPECT_EQ(grid.cell, 0.25 * (1 << level));
        EXPECT_LT(glm::length(grid.center({0, 0, 0}) - corner), 1e-12);
        EXPECT_LT(glm::length(grid.center(grid.dims - 1) - corner - glm::dvec3(16, 8, 8)), 1e-12);
    }
    // A box that ends inside of a brick is filled by one more.
    EXPECT_EQ(volume::brick_levels(0.25, 1, glm::dvec3(0), {8.1, 3, 8}).places(2),
              glm::ivec3(2, 1, 1));
}

TEST(Bricks, SizesThatCannotBeAreRefusedByName) {
    const auto refused = [](double fine, double coarse, double edge, const char* why) {
        const Error error = error_of("`adaptive`", [&] {
            volume::brick_levels(fine, coarse, glm::dvec3(0), glm::dvec3(edge));
        });
        EXPECT_EQ(error.kind, ErrorKind::argument) << error.what();
        EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    };
    refused(1, 0.25, 10, "the finest are first");
    refused(0.25, 0.75, 10, "use 0.25..0.5 or 0.25..1");
    refused(0.01, 2.56, 100, "9 levels, more than 8");
    refused(0.25, 4, 10, "larger than the box of 10 m; use coarsest cells of 1 or less");
    refused(0.01, 1, 10, "power of two");
    refused(0.001, 0.001, 1000, "more than");
}

TEST(Bricks, ATreeIsFoundAndHasNoHoles) {
    const VolumeSet set = bricks_of(affine);
    const BrickTree& tree = *set.bricks;
    EXPECT_EQ(tree.bricks().front().level, 0);
    EXPECT_EQ(tree.bricks().back().level, 2);
    std::mt19937 random(1);
    std::array<int, 3> met{};
    for (int i = 0; i < 2000; ++i) {
        const glm::dvec3 p = random_in(random, corner, corner + glm::dvec3(16, 8, 8));
        const std::size_t found = tree.at(p);
        const Grid grid = tree.levels().grid_of(tree.bricks()[found]);
        EXPECT_TRUE(glm::all(glm::lessThanEqual(grid.center({0, 0, 0}), p))
                    && glm::all(glm::lessThanEqual(p, grid.center({8, 8, 8}))));
        for (std::size_t finer = 0; finer < found; ++finer) {
            const Grid other = tree.levels().grid_of(tree.bricks()[finer]);
            EXPECT_FALSE(glm::all(glm::lessThan(other.center({0, 0, 0}), p))
                         && glm::all(glm::lessThan(p, other.center({8, 8, 8}))));
        }
        ++met[std::size_t(tree.bricks()[found].level)];
    }
    EXPECT_GT(*std::ranges::min_element(met), 20);
    const auto refused = [](std::vector<Brick> bricks, const char* why) {
        const Error error = error_of("brick", [&] { BrickTree(three(), std::move(bricks)); });
        EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    };
    refused({{2, {0, 0, 0}}}, "missing");
    refused({{2, {0, 0, 0}}, {2, {1, 0, 0}}, {0, {0, 0, 0}}}, "an eighth of none");
    refused({{2, {0, 0, 0}}, {2, {0, 0, 0}}, {2, {1, 0, 0}}}, "twice");
    refused({{2, {0, 0, 0}}, {2, {1, 0, 0}}, {2, {2, 0, 0}}}, "outside");
}

/// The largest difference of what a reader shows from an affine field, of its size.
double off_affine(const VolumeSet& set, double shift = 0) {
    std::mt19937 random(2);
    double worst = 0;
    for (int i = 0; i < 10000; ++i) {
        const glm::dvec3 p = random_in(random, corner, corner + glm::dvec3(16, 8, 8));
        const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
        std::vector<glm::vec3> c;
        double size = 0;
        for (std::size_t k = 0; k < set.levels[0].sh.size(); ++k) {
            c.push_back(glm::vec3(affine(k, p)));
            size += glm::length(affine(k, p));
        }
        const glm::dvec3 e = readers::evaluate(readers::Evaluation::linear, c, n);
        worst = std::max(worst,
                         glm::length(readers::irradiance(trilinear, set, p + shift, n) - e) / size);
    }
    return worst;
}

TEST(Bricks, AnAffineFieldIsReadExactlyAnywhere) {
    VolumeSet set = bricks_of(affine, 2);
    EXPECT_LT(off_affine(set), 1e-6);
    EXPECT_GT(off_affine(set, 0.125), 1e-4); // as a reader that is half a cell off
    volume::stitch(*set.bricks, set.levels);
    EXPECT_LT(off_affine(set), 1e-6);
    for (const double cell : {0.25, 0.37}) {
        const Volume flat = volume::flatten(set, cell);
        const glm::dvec3 end = corner + glm::dvec3(16, 8, 8) + 1e-9;
        for (std::size_t i = 0; i < flat.grid.size(); ++i) {
            const glm::dvec3 p = flat.grid.center(flat.grid.cell_at(i));
            if (glm::any(glm::lessThan(p, corner - 1e-9)) || glm::any(glm::greaterThan(p, end)))
                continue; // clamped
            for (std::size_t k = 0; k < 9; ++k)
                ASSERT_LT(glm::length(glm::dvec3(flat.sh[k][i]) - affine(k, p))
                              / glm::length(affine(k, p)),
                          1e-6);
            EXPECT_EQ(flat.validity[i], 1.0f);
        }
    }
}

/// The largest step of a trilinear reader across the faces of bricks, of the field's size.
double step_of(const VolumeSet& set) {
    std::mt19937 random(3);
    double worst = 0;
    for (int i = 0; i < 20000; ++i) {
        const Grid& grid = set.levels[random() % set.levels.size()].grid;
        const glm::dvec3 lo = grid.center({0, 0, 0}), hi = grid.center({8, 8, 8});
        glm::dvec3 p = random_in(random, lo, hi);
        const int axis = int(random() % 3);
        p[axis] = random() % 2 ? lo[axis] : hi[axis];
        glm::dvec3 step(0);
        step[axis] = 1e-9;
        const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
        worst = std::max(worst, glm::length(readers::irradiance(trilinear, set, p + step, n)
                                            - readers::irradiance(trilinear, set, p - step, n)));
    }
    return worst / 60;
}

TEST(Bricks, StitchedBricksHaveNoStepForATrilinearReader) {
    VolumeSet set = bricks_of(wavy);
    EXPECT_GT(step_of(set), 1e-2); // as they are solved
    volume::stitch(*set.bricks, set.levels);
    EXPECT_LT(step_of(set), 1e-6);
    // Inside of its faces a brick is as it was.
    const VolumeSet before = bricks_of(wavy);
    for (std::size_t i = 0; i < set.levels.size(); ++i)
        EXPECT_EQ(set.levels[i].sh[0][set.levels[i].grid.index({4, 4, 4})],
                  before.levels[i].sh[0][before.levels[i].grid.index({4, 4, 4})]);
}

TEST(Bricks, SamplesStitchedFromInvalidOnesAreNotValid) {
    VolumeSet set = bricks_of(affine);
    const auto coarse = *set.bricks->find({1, {2, 1, 1}});
    set.levels[coarse].validity[set.levels[coarse].grid.index({4, 4, 4})] = 0;
    const auto fine = *set.bricks->find({0, {2, 1, 1}});
    volume::stitch(*set.bricks, set.levels);
    EXPECT_EQ(std::ranges::count(set.levels[fine].validity, 0.0f), 0) << "of another eighth";
    set = bricks_of(affine);
    // A sample on the face towards the level-2 brick; the fine brick's is at half cells of that.
    const auto brick = *set.bricks->find({1, {2, 0, 0}});
    const auto root = *set.bricks->find({2, {1, 0, 0}});
    set.levels[root].validity[set.levels[root].grid.index({4, 2, 2})] = 0;
    volume::stitch(*set.bricks, set.levels);
    EXPECT_EQ(set.levels[brick].validity[set.levels[brick].grid.index({8, 4, 4})], 0.0f);
    EXPECT_EQ(set.levels[brick].validity[set.levels[brick].grid.index({8, 5, 5})], 0.0f);
    EXPECT_EQ(set.levels[brick].validity[set.levels[brick].grid.index({8, 6, 6})], 1.0f);
}

TEST(Bricks, WhatSeesNoClearSampleIsReadFromTheNextCoarserBrick) {
    VolumeSet set = bricks_of([](std::size_t, glm::dvec3) { return glm::dvec3(1); });
    const readers::Reader& facing = *readers::reader_named("lpvbake");
    const glm::dvec3 p = corner + 1.1, up(0, 1, 0);
    const glm::dvec3 known = readers::irradiance(facing, set, p, up);
    const std::size_t finest = set.bricks->at(p);
    ASSERT_EQ(set.bricks->bricks()[finest].level, 0);
    std::ranges::fill(set.levels[finest].validity, 0.0f);
    for (auto& c : set.levels[finest].sh)
        std::ranges::fill(c, glm::vec3(100.0f));
    EXPECT_EQ(readers::irradiance(facing, set, p, up), known);
}

volume::Trimmed trimmed_of(const VolumeSet& set, const volume::TrimGoal& goal,
                           std::span<const double> noise = {}) {
    return volume::trim(
        *set.bricks, [&](std::size_t brick) { return set.levels[brick]; }, goal, noise);
}

TEST(Bricks, TrimmingKeepsErrorAndSize) {
    const VolumeSet flat = bricks_of(affine), rough = bricks_of(wavy);
    // What an affine field loses is nothing.
    EXPECT_EQ(trimmed_of(flat, {.error = 1e-5}).bricks.size(), 2u);
    EXPECT_EQ(trimmed_of(rough, {.error = 0}).bricks.size(), rough.levels.size());
    double last = 1e9;
    for (std::size_t most = 2; most <= rough.levels.size(); most += 3) {
        const auto trimmed = trimmed_of(rough, {0, most});
        EXPECT_LE(trimmed.bricks.size(), most);
        EXPECT_LT(trimmed.error, last) << most;
        EXPECT_NO_THROW(BrickTree(three(), trimmed.bricks));
        last = trimmed.error;
        // The same by reading: of the samples that are lost.
        VolumeSet left = bricks_of(wavy, 1, trimmed.bricks);
        double sum = 0, mean = 0;
        std::size_t count = 0;
        for (std::size_t i = 0; i < rough.levels.size(); ++i) {
            const Volume& brick = rough.levels[i];
            for (std::size_t s = 0; s < brick.grid.size(); ++s) {
                const glm::ivec3 at = brick.grid.cell_at(s);
                const glm::dvec3 p = brick.grid.center(at);
                if (glm::any(glm::equal(at, glm::ivec3(8))) || rough.bricks->at(p + 1e-6) != i)
                    continue;
                const Volume& read = left.levels[left.bricks->at(p + 1e-6)];
                const auto taps = volume::taps_at(read, p);
                std::array<glm::dvec3, 4> off;
                for (std::size_t k = 0; k < 4; ++k) {
                    off[k] = glm::dvec3(brick.sh[k][s]);
                    for (std::size_t t = 0; t < 8; ++t)
                        off[k] -= taps.cells.weight[t] * glm::dvec3(read.sh[k][taps.cells.cell[t]]);
                }
                sum += volume::mean_square_irradiance(off);
                mean += volume::mean_irradiance(brick, s);
                ++count;
            }
        }
        mean /= double(count);
        EXPECT_NEAR(trimmed.error, std::sqrt(sum / double(count)) / mean, 1e-6) << most;
    }
    const auto both = trimmed_of(rough, {1e-9, 5});
    EXPECT_LE(both.bricks.size(), 5u) << "the size counts first";
}

/// Light of no trend, the same in all bricks: its own noise.
glm::dvec3 noisy(std::size_t k, glm::dvec3 p) {
    const glm::ivec3 at(glm::round(p * 16.0));
    std::mt19937 random(uint32_t(at.x * 73856093 ^ at.y * 19349663 ^ at.z * 83492791)
                        + uint32_t(k));
    random.discard(8);
    return glm::dvec3(k == 0 ? 100 : 0)
           + glm::dvec3(std::normal_distribution<double>(0, k == 0 ? 5 : 2)(random));
}

TEST(Bricks, NoiseIsNotLost) {
    const VolumeSet set = bricks_of(noisy);
    std::array<glm::dvec3, 4> chance{glm::dvec3(5), glm::dvec3(2), glm::dvec3(2), glm::dvec3(2)};
    double square = 0; // of independent coefficients: the sum of each alone
    for (std::size_t k = 0; k < 4; ++k) {
        std::array<glm::dvec3, 4> one{};
        one[k] = chance[k];
        square += volume::mean_square_irradiance(one);
    }
    const std::vector<double> noise(set.levels.size(), square);
    const volume::TrimGoal goal{.error = 0.02};
    EXPECT_GT(trimmed_of(set, goal).bricks.size(), set.levels.size() - 3)
        << "noise of 6 % counts as light";
    const auto trimmed = trimmed_of(set, goal, noise);
    EXPECT_EQ(trimmed.bricks.size(), 2u);
    EXPECT_LT(trimmed.error, 0.01);
    // What light does lose is told as before.
    const VolumeSet rough = bricks_of(wavy);
    const std::vector<double> little(rough.levels.size(), 1e-6);
    EXPECT_NEAR(trimmed_of(rough, {0, 4}, little).error, trimmed_of(rough, {0, 4}).error, 1e-3);
}

TEST(Bricks, WhatIsKeptDoesNotGo) {
    const VolumeSet flat = bricks_of(affine);
    std::vector<uint8_t> kept(flat.levels.size(), 0);
    const std::size_t fine = *flat.bricks->find({0, {2, 1, 1}});
    kept[fine] = 1;
    for (const std::size_t most : {SIZE_MAX, std::size_t(1)}) {
        const BrickTree left(three(), trimmed_of(flat, {1, most, kept}).bricks);
        EXPECT_TRUE(left.find({0, {2, 1, 1}}));
        EXPECT_FALSE(left.find({0, {1, 1, 0}}));
    }
}

TEST(Bricks, IrradianceIsThatOfAllNormals) {
    // c0 alone: E = pi c0 Y0 everywhere; c1: E = 2/3 pi c1 Y1, its mean square (2/3)^2 pi c1^2 / 4.
    using std::numbers::pi;
    const std::array one{glm::dvec3(2)};
    EXPECT_NEAR(volume::mean_square_irradiance(one), pi * pi * 4 / (4 * pi), 1e-6);
    const std::array two{glm::dvec3(0), glm::dvec3(3)};
    EXPECT_NEAR(volume::mean_square_irradiance(two), 4 * pi / 9 * 9 / 4, 1e-6);
}

TEST(Bricks, TrimmedBricksStayBesideTheNextLevel) {
    const VolumeSet set = bricks_of(wavy);
    for (std::size_t most = 2; most < set.levels.size(); ++most) {
        const BrickTree tree(three(), trimmed_of(set, {0, most}).bricks);
        for (const Brick& brick : tree.bricks()) {
            if (brick.level == 2)
                continue;
            for (int i = 0; i < 27; ++i) {
                const glm::ivec3 at = brick.at + glm::ivec3(i % 3, i / 3 % 3, i / 9) - 1;
                const glm::ivec3 places = tree.levels().places(brick.level);
                if (glm::all(glm::greaterThanEqual(at, glm::ivec3(0)))
                    && glm::all(glm::lessThan(at, places))) {
                    EXPECT_TRUE(tree.find({brick.level + 1, at >> 1})) << most;
                }
            }
        }
    }
}

TEST(Bricks, FilesComeBackAsTheyWere) {
    const TemporaryFolder folder;
    VolumeSet set = bricks_of(wavy, 2);
    for (Volume& volume : set.levels) // what bricks have in common is alike
        for (std::size_t i = 0; i < volume::brick_samples; ++i) {
            const glm::ivec3 at(glm::round(volume.grid.center(volume.grid.cell_at(i)) * 4.0));
            volume.validity[i] = (7 * at.x + 13 * at.y + 29 * at.z) % 50 != 0;
        }
    volume::stitch(*set.bricks, set.levels);
    for (const char* name : {"a.vdb", "b.exr", "c.ktx2", "d.dds"}) {
        const std::string path = folder / name;
        ASSERT_TRUE(io::takes_bricks(path));
        const WriteReport report = io::write_bricks(path, set, Precision::full);
        std::vector<std::string> files;
        for (const WriteReport::File& file : report.files) {
            files.push_back(file.path);
            EXPECT_EQ(std::filesystem::file_size(file.path), file.bytes);
        }
        EXPECT_EQ(files, io::brick_files(path, 3, set.levels.front()));
        const VolumeSet read = io::read_levels(io::manifest_path(path));
        ASSERT_TRUE(read.bricks) << name;
        EXPECT_TRUE(*read.bricks == *set.bricks);
        ASSERT_EQ(read.levels.size(), set.levels.size());
        for (std::size_t i = 0; i < set.levels.size(); ++i) {
            EXPECT_EQ(read.levels[i].sh, set.levels[i].sh) << name << ' ' << i;
            EXPECT_EQ(read.levels[i].validity, set.levels[i].validity);
            EXPECT_EQ(read.levels[i].walls, set.levels[i].walls);
            EXPECT_EQ(read.levels[i].grid, set.levels[i].grid);
        }
    }
    for (const char* name : {"a.glb", "a.tres", "a.nvdb"})
        EXPECT_FALSE(io::takes_bricks(name)) << name;
}

TEST(Bricks, ALevelIsThereOnlyWhereItsBricksAre) {
    const TemporaryFolder folder;
    const VolumeSet set = bricks_of(affine);
    io::write_bricks(folder / "a.vdb", set, Precision::full);
    const Volume level = read_volume(folder / "a.vdb");
    EXPECT_EQ(level.grid.dims, glm::ivec3(65, 33, 33));
    EXPECT_EQ(level.metadata.at("level"), "0");
    EXPECT_EQ(level.metadata.at("level_set"), "a.levels.json");
    const auto valid = std::ranges::count(level.validity, 1.0f);
    EXPECT_EQ(valid, 3 * 729 - 9 - 9) << "two bricks share an edge, and two another";
}

TEST(Bricks, FilesThatDoNotBelongTogetherAreToldApart) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.vdb", manifest = io::manifest_path(path);
    VolumeSet set = bricks_of(affine);
    io::write_bricks(path, set, Precision::full);
    const std::string good = slurp(manifest);
    const auto refused = [&](const std::string& why) {
        const Error error = error_of(manifest, [&] { io::read_levels(manifest); });
        EXPECT_EQ(error.kind, ErrorKind::invalid) << error.what();
        EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    };
    const auto with = [&](const std::string& from, const std::string& to) {
        std::string text = good;
        text.replace(text.find(from), from.size(), to);
        spill(manifest, text);
    };
    with("\"dims\":[65,", "\"dims\":[66,");
    refused("not filled by bricks");
    with("\"bricks\":[0,0,0,", "\"bricks\":[0,0,");
    refused("threes");
    with("\"bricks\":[0,0,0,", "\"bricks\":[99,0,0,");
    refused("outside of the box");
    with("\"cell\":0.25", "\"cell\":0.26");
    EXPECT_NE(std::string(error_of(path, [&] { io::read_levels(manifest); }).what())
                  .find("another lattice"),
              std::string::npos);
    with("\"a.vdb\"", "\"../a.vdb\"");
    refused("no volume file beside it");
    with("\"a.vdb\"", "\"a.exr\"");
    refused("no .vdb");
    spill(manifest, good);
    set.levels.front().metadata["settings"] = "other";
    set.levels.back().metadata["settings"] = "other";
    io::write_bricks(folder / "b.vdb", set, Precision::full);
    std::filesystem::copy_file(folder / "b_level1.vdb", folder / "a_level1.vdb",
                               std::filesystem::copy_options::overwrite_existing);
    refused("a_level1.vdb is of another bake");
    std::filesystem::remove(folder / "a_level1.vdb");
    EXPECT_EQ(error_of(folder / "a_level1.vdb", [&] { io::read_levels(manifest); }).kind,
              ErrorKind::file);
    // An atlas of other bricks.
    io::write_bricks(folder / "c.exr", set, Precision::full);
    VolumeSet less = bricks_of(affine, 1, {{2, {0, 0, 0}}, {2, {1, 0, 0}}});
    io::write_bricks(folder / "d.exr", less, Precision::full);
    std::filesystem::copy_file(folder / "d.levels.json", folder / "c.levels.json",
                               std::filesystem::copy_options::overwrite_existing);
    std::string text = slurp(folder / "c.levels.json");
    text.replace(text.find("d_atlas.exr"), 11, "c_atlas.exr");
    spill(folder / "c.levels.json", text);
    const Error error =
        error_of(folder / "c.levels.json", [&] { io::read_levels(folder / "c.levels.json"); });
    EXPECT_NE(std::string(error.what()).find("another bake"), std::string::npos) << error.what();
}

} // namespace
} // namespace lpvbake
