// Nested levels: their lattices, how they are read as one, and their files.
#include "io/levels.h"
#include "lpvbake/error.h"
#include "readers/readers.h"
#include "volume/levels.h"
#include "volume/sh.h"
#include "volumes.h"

#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

using volume::LevelBox;
using volume::VolumeSet;

const std::vector<LevelBox> three{{{1.1, 0, 1}, {2.9, 1.5, 3}, 0.125},
                                  {{-2, 0, -1}, {5, 3, 4}, 0.5},
                                  {{-10, 0, -10}, {10, 8, 11}, 1}};

glm::dvec3 affine(std::size_t k, glm::dvec3 p) {
    return glm::dvec3(3, 5, 7) + double(k + 1) * glm::dvec3(0.2, -0.1, 0.3) * p.x
           + glm::dvec3(0.5, 0.25, -0.2) * p.y + double(k) * glm::dvec3(0.1, 0.4, 0.2) * p.z;
}

/// Levels of a field that every interpolation has to return.
VolumeSet affine_levels(const std::vector<LevelBox>& boxes, int order = 1) {
    VolumeSet set;
    for (const Grid& grid : volume::nest_grids(boxes)) {
        Volume& level = set.levels.emplace_back();
        level.grid = grid;
        level.sh_order = order;
        for (int k = 0; k < volume::sh_count(order); ++k) {
            level.sh.emplace_back();
            for (std::size_t i = 0; i < grid.size(); ++i)
                level.sh.back().push_back(
                    glm::vec3(affine(std::size_t(k), grid.center(grid.cell_at(i)))));
        }
        level.validity.assign(grid.size(), 1.0f);
        level.metadata = {{"scene_hash", "1"}, {"settings", "{}"}};
    }
    return set;
}

glm::dvec3 random_in(std::mt19937& random, glm::dvec3 lo, glm::dvec3 hi) {
    const auto share = [&] { return std::uniform_real_distribution<double>()(random); };
    return lo + (hi - lo) * glm::dvec3(share(), share(), share());
}

/// In the outermost hull, every other one in that of a finer level.
glm::dvec3 random_point(std::mt19937& random, const VolumeSet& set) {
    const Grid& grid = set.levels[random() % set.levels.size()].grid;
    return random_in(random, grid.center({0, 0, 0}), grid.center(grid.dims - 1));
}

TEST(Levels, SamplesNestAndHullsEndOnThoseOfTheNext) {
    const std::vector<Grid> grids = volume::nest_grids(three);
    ASSERT_EQ(grids.size(), 3u);
    for (std::size_t l = 0; l < grids.size(); ++l) {
        const glm::dvec3 lo = grids[l].center({0, 0, 0}), hi = grids[l].center(grids[l].dims - 1);
        EXPECT_EQ(grids[l].cell, three[l].cell);
        EXPECT_TRUE(glm::all(glm::lessThanEqual(lo, three[l].lo + 1e-9))) << l;
        EXPECT_TRUE(glm::all(glm::greaterThanEqual(hi, three[l].hi - 1e-9))) << l;
        if (l + 1 == grids.size())
            continue;
        const Grid& next = grids[l + 1];
        for (const glm::dvec3 corner : {lo, hi}) {
            const glm::dvec3 at = (corner - next.center({0, 0, 0})) / next.cell;
            EXPECT_LT(glm::length(at - glm::round(at)), 1e-9) << l;
            EXPECT_TRUE(glm::all(glm::greaterThan(at, glm::dvec3(-1e-9)))
                        && glm::all(glm::lessThan(at, glm::dvec3(next.dims) - (1 - 1e-9))));
        }
        EXPECT_LT(glm::length(lo - grids[l].origin - 0.5 * grids[l].cell), 1e-12);
    }
    std::vector<LevelBox> turned(three.rbegin(), three.rend());
    EXPECT_EQ(volume::nest_grids(turned), grids) << "whatever the order";
}

TEST(Levels, BoxesThatDoNotNestAreRefusedByName) {
    const auto refused = [](std::vector<LevelBox> levels, const char* why) {
        const Error error = error_of("`level`", [&] { volume::nest_grids(std::move(levels)); });
        EXPECT_EQ(error.kind, ErrorKind::argument) << error.what();
        EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    };
    refused({{{0, 0, 0}, {1, 1, 1}, 0.3}, {{0, 0, 0}, {2, 2, 2}, 0.5}}, "use 0.3 or 0.6");
    refused({{{0, 0, 0}, {1, 1, 3}, 0.25}, {{0, 0, 0}, {2, 2, 2}, 0.5}}, "levels are nested");
    refused({{{0, 0, 0}, {1, 1, 1}, 0.5}, {{0, 0, 0}, {2, 2, 2}, 0.5}}, "cells of another level");
    refused({{{0, 0, 0}, {-1, 1, 1}, 0.5}, {{0, 0, 0}, {2, 2, 2}, 1}}, "inside out");
    refused({{{0, 0, 0}, {1, 1, 1}, 0.0}, {{0, 0, 0}, {2, 2, 2}, 1}}, "no cell size");
    refused({{{0, 0, 0}, {1, 1, 1}, 0x1p-10}, {{0, 0, 0}, {200, 2, 2}, 1}}, "cannot be told apart");
    refused(std::vector<LevelBox>(9, {{0, 0, 0}, {1, 1, 1}, 1}), "more than 8");
}

TEST(Levels, BoxesAroundAFocusGrowAndStayInside) {
    const auto boxes =
        volume::levels_around({{1, 0, 1}, {2, 1, 2}, 0.25}, {0, 0, 0}, {10, 4, 10}, 3);
    ASSERT_EQ(boxes.size(), 3u);
    EXPECT_EQ(boxes[1].lo, glm::dvec3(0.5, 0, 0.5));
    EXPECT_EQ(boxes[1].hi, glm::dvec3(2.5, 1.5, 2.5));
    EXPECT_EQ(boxes[1].cell, 0.5);
    EXPECT_EQ(boxes[2].hi, glm::dvec3(10, 4, 10));
    EXPECT_NO_THROW(volume::nest_grids(boxes));
    EXPECT_THROW(volume::levels_around({{1, 5, 1}, {2, 6, 2}, 1}, {0, 0, 0}, {10, 4, 10}, 2),
                 Error);
}

TEST(Levels, SharesAreZeroAtFacesInsideAndFullAtThoseInCommon) {
    const VolumeSet set = affine_levels(three);
    const Grid& fine = set.levels[0].grid;
    const glm::dvec3 lo = fine.center({0, 0, 0}), middle = 0.5 * (three[0].lo + three[0].hi);
    EXPECT_EQ(volume::share_of(set, 0, middle), 1.0);
    EXPECT_EQ(volume::share_of(set, 0, {lo.x, middle.y, middle.z}), 0.0);
    EXPECT_NEAR(volume::share_of(set, 0, {lo.x + 0.25, middle.y, middle.z}), 0.5, 1e-9);
    // y = 0 is the floor of all levels.
    EXPECT_EQ(volume::share_of(set, 0, {middle.x, -0.01, middle.z}), 1.0);
    EXPECT_EQ(volume::level_at(set, {-9, 1, -9}), 2u);
}

TEST(Levels, AnAffineFieldIsReadExactlyAnywhere) {
    const VolumeSet set = affine_levels(three, 2);
    const readers::Reader trilinear{.name = "trilinear"};
    const readers::Reader& facing = *readers::reader_named("lpvbake");
    std::mt19937 random(1);
    const auto expected = [](glm::dvec3 p, glm::dvec3 n) {
        std::vector<glm::vec3> c;
        for (std::size_t k = 0; k < 9; ++k)
            c.push_back(glm::vec3(affine(k, p)));
        return readers::evaluate(readers::Evaluation::linear, c, n);
    };
    const auto size = [](glm::dvec3 p) { // of what is summed
        double sum = 0;
        for (std::size_t k = 0; k < 9; ++k)
            sum += glm::length(affine(k, p));
        return sum;
    };
    double worst = 0, unblended = 0;
    for (int i = 0; i < 10000; ++i) {
        const glm::dvec3 p = random_point(random, set);
        const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
        const glm::dvec3 e = expected(p, n);
        const auto off = [&](glm::dvec3 at) {
            return glm::length(readers::irradiance(trilinear, set, at, n) - e) / size(p);
        };
        worst = std::max(worst, off(p));
        unblended = std::max(unblended, off(p + 0.0625)); // as a reader half a cell off
        // The facing sampler weighs cells by direction: of one value it makes that value.
        const glm::dvec3 own = readers::irradiance(facing, set, p, n);
        EXPECT_TRUE(std::isfinite(own.x));
    }
    EXPECT_LT(worst, 1e-6);
    EXPECT_GT(unblended, 1e-3);
}

TEST(Levels, AVolumeThatIsAloneIsReadToTheSameBits) {
    const Volume volume = random_volume({7, 6, 5}, 2, false, 5);
    std::mt19937 random(2);
    for (const readers::Reader& reader : readers::all_readers())
        for (int i = 0; i < 200; ++i) {
            const glm::dvec3 p = random_in(random, volume.grid.origin - 0.1,
                                           volume.grid.origin + 0.1 * glm::dvec3(8, 7, 6));
            const glm::dvec3 n = glm::normalize(random_in(random, glm::dvec3(-1), glm::dvec3(1)));
            EXPECT_EQ(readers::irradiance(reader, volume, p, n),
                      readers::irradiance(reader, volume::Levels(volume), p, n))
                << reader.name;
        }
}

TEST(Levels, WhatSeesNoClearCellLeavesThePointToTheNext) {
    VolumeSet set = affine_levels({{{0, 0, 0}, {2, 2, 2}, 0.5}, {{-2, -2, -2}, {4, 4, 4}, 1}});
    for (std::size_t l = 0; l < 2; ++l)
        for (auto& c : set.levels[l].sh)
            std::ranges::fill(c, glm::vec3(l == 0 ? 100.0f : 1.0f));
    const readers::Reader& facing = *readers::reader_named("lpvbake");
    const glm::dvec3 p(1), up(0, 1, 0);
    const glm::dvec3 fine = readers::irradiance(facing, set, p, up);
    std::ranges::fill(set.levels[0].validity, 0.0f);
    const glm::dvec3 coarse = readers::irradiance(facing, set, p, up);
    EXPECT_NEAR(coarse.x * 100, fine.x, 1e-3 * fine.x);
    std::ranges::fill(set.levels[1].validity, 0.0f);
    EXPECT_TRUE(std::isfinite(readers::irradiance(facing, set, p, up).x));
}

TEST(Levels, FlatteningKeepsAnAffineFieldAndTheFinestSamples) {
    const VolumeSet set = affine_levels(three);
    for (const double cell : {0.125, 0.37}) {
        const Volume flat = volume::flatten(set, cell);
        double worst = 0;
        for (std::size_t i = 0; i < flat.grid.size(); ++i) {
            const glm::dvec3 p = flat.grid.center(flat.grid.cell_at(i));
            const Grid& outermost = set.levels.back().grid;
            if (glm::any(glm::greaterThan(p, outermost.center(outermost.dims - 1))))
                continue; // clamped
            if (glm::any(glm::lessThan(p, outermost.center({0, 0, 0}))))
                continue;
            for (std::size_t k = 0; k < 4; ++k)
                worst = std::max(worst, glm::length(glm::dvec3(flat.sh[k][i]) - affine(k, p))
                                            / glm::length(affine(k, p)));
            EXPECT_EQ(flat.validity[i], 1.0f);
        }
        EXPECT_LT(worst, 1e-6) << cell;
    }
}

TEST(Levels, FlatteningMixesNothingThroughWalls) {
    // A wall at x = 2.4 between samples at 2 and 3: light on the left, none on the right.
    VolumeSet set = affine_levels({{{0, 0, 0}, {5, 3, 3}, 1}});
    Volume& volume = set.levels[0];
    volume.walls.assign(1, std::vector<glm::vec3>(volume.grid.size()));
    for (std::size_t i = 0; i < volume.grid.size(); ++i) {
        const double x = volume.grid.center(volume.grid.cell_at(i)).x;
        for (auto& c : volume.sh)
            c[i] = glm::vec3(x < 2.4 ? 1.0f : 0.0f);
        if (std::abs(x - 2.4) < 2)
            volume.walls[0][i] = glm::vec3(2.4 - x, 0, 0);
    }
    const Volume flat = volume::flatten(set, 0.25);
    for (std::size_t i = 0; i < flat.grid.size(); ++i) {
        const double x = flat.grid.center(flat.grid.cell_at(i)).x;
        EXPECT_NEAR(flat.sh[0][i].x, x < 2.4 ? 1 : 0, 1e-6) << x;
        const float wall = flat.walls[0][i].x; // those beyond two cells are left out
        EXPECT_NEAR(wall, std::abs(2.4 - x) < 0.5 ? (2.4 - x) / 0.25 : 0, 1e-4) << x;
    }
}

TEST(Levels, FilesComeBackAsTheyWere) {
    const TemporaryFolder folder;
    const VolumeSet set = affine_levels(three);
    std::vector<Grid> grids;
    for (const char* name : {"a.vdb", "b.ktx2", "c.exr"}) {
        const std::string path = folder / name;
        grids.clear();
        for (std::size_t l = 0; l < 3; ++l) {
            io::write_for(*io::target_named("generic"), io::level_path(path, l), set.levels[l]);
            grids.push_back(set.levels[l].grid);
        }
        io::write_manifest(path, grids, volume::Axes::gltf, 1.5);
        const VolumeSet read = io::read_levels(io::manifest_path(path));
        ASSERT_EQ(read.levels.size(), 3u);
        EXPECT_EQ(read.blend, 1.5);
        for (std::size_t l = 0; l < 3; ++l) {
            EXPECT_EQ(read.levels[l].sh, set.levels[l].sh);
            EXPECT_LT(glm::length(read.levels[l].grid.origin - set.levels[l].grid.origin), 1e-9);
        }
        EXPECT_EQ(
            error_of(io::manifest_path(path), [&] { read_volume(io::manifest_path(path)); }).kind,
            ErrorKind::unsupported);
    }
    EXPECT_EQ(io::level_path("x/town.vdb", 2), "x/town_level2.vdb");
}

TEST(Levels, FilesThatDoNotBelongTogetherAreToldApart) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.vdb", manifest = io::manifest_path(path);
    VolumeSet set = affine_levels(three);
    const auto write = [&] {
        std::vector<Grid> grids;
        for (std::size_t l = 0; l < 3; ++l) {
            io::write_for(*io::target_named("generic"), io::level_path(path, l), set.levels[l]);
            grids.push_back(set.levels[l].grid);
        }
        io::write_manifest(path, grids, volume::Axes::gltf, 1);
    };
    const auto kind = [&](const char* named) {
        const Error error = error_of(manifest, [&] { io::read_levels(manifest); });
        EXPECT_NE(std::string(error.what()).find(named), std::string::npos) << error.what();
        return error.kind;
    };
    for (const char* fact : {"scene_hash", "settings"}) {
        set.levels[1].metadata[fact] = "other";
        write();
        EXPECT_EQ(kind("a_level1.vdb"), ErrorKind::invalid);
        EXPECT_EQ(kind(fact), ErrorKind::invalid);
        set.levels[1].metadata[fact] = set.levels[0].metadata[fact];
    }
    set.levels[0].grid.origin.x += 0.03;
    write();
    EXPECT_EQ(kind("a.vdb does not lie in the next level"), ErrorKind::invalid);
    set = affine_levels(three);
    write();
    EXPECT_NO_THROW(io::read_levels(manifest));
    std::filesystem::remove(io::level_path(path, 2));
    const std::string missing = io::level_path(path, 2);
    EXPECT_EQ(error_of(missing, [&] { io::read_levels(manifest); }).kind, ErrorKind::file);
    spill(manifest, "{");
    EXPECT_EQ(kind("no manifest"), ErrorKind::invalid);
    const auto lists = [&](const std::string& levels, int version = 1) {
        spill(manifest, R"({"format": "lpvbake levels", "version": )" + std::to_string(version)
                            + R"(, "blend": 1, "levels": [)" + levels + "]}");
    };
    lists("");
    EXPECT_EQ(kind("lists no levels"), ErrorKind::invalid);
    lists(R"({"file": "a.vdb", "cell": 1})", 2);
    EXPECT_EQ(kind("another \"version\""), ErrorKind::invalid);
    lists(R"({"file": "../a.vdb"})");
    EXPECT_EQ(kind("beside it"), ErrorKind::invalid);
    for (const char* file : {"..", "-", "a.levels.json", "a.txt"}) {
        lists(std::string(R"({"file": ")") + file + "\"}");
        EXPECT_EQ(kind("no kind of volume file"), ErrorKind::invalid) << file;
    }
}

} // namespace
} // namespace lpvbake
