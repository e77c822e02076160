// A world in tiles.
#include "lpvbake/error.h"
#include "volume/tiles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace lpvbake {
namespace {

using volume::Tile;
using volume::tiles_around;

std::vector<std::string> names_of(const std::vector<Tile>& tiles) {
    std::vector<std::string> names;
    for (const Tile& tile : tiles)
        names.push_back(tile.name());
    return names;
}

TEST(Tiles, StandAtMultiplesOfTheirSize) {
    // From 1 to 9 m along x: cells 2 to 18 of half a metre.
    const Bounds box{{1.0, 0.2, 1.0}, {9.0, 3.0, 1.5}};
    const std::vector<Tile> tiles = tiles_around(std::vector{box}, 0.5, 16);
    EXPECT_EQ(names_of(tiles), (std::vector<std::string>{"x0_y0_z0", "x1_y0_z0"}));
    EXPECT_EQ(tiles[0].begin, glm::ivec3(0, 0, 0)); // 8 by 8
    EXPECT_EQ(tiles[0].end, glm::ivec3(16, 8, 16));
    EXPECT_EQ(tiles[1].begin, glm::ivec3(16, 0, 0));
    EXPECT_EQ(tiles[1].end, glm::ivec3(32, 8, 16));
    EXPECT_EQ(tiles[1].bounds(0.5).hi, glm::dvec3(16.0, 4.0, 8.0));
    // A tower is some above each other.
    const Bounds tower{{1.0, 0.2, 1.0}, {2.0, 9.0, 1.5}};
    const std::vector<Tile> above = tiles_around(std::vector{tower}, 0.5, 16);
    EXPECT_EQ(names_of(above), (std::vector<std::string>{"x0_y0_z0", "x0_y1_z0"}));
    EXPECT_EQ(above[1].begin.y, 16);
    EXPECT_EQ(above[1].end.y, 24);
}

TEST(Tiles, CoverAllSurfacesOnceAndNothingElse) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> place(-90, 90), edge(0, 12);
    std::vector<Bounds> boxes;
    for (int i = 0; i < 60; ++i) {
        const glm::dvec3 lo(place(random), place(random) / 3, place(random));
        boxes.push_back({lo, lo + glm::dvec3(edge(random), edge(random), edge(random))});
    }
    const std::vector<Tile> tiles = tiles_around(boxes, 0.7, 24);
    std::set<std::string> names;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
        EXPECT_TRUE(names.insert(tiles[i].name()).second);
        const Bounds bounds = tiles[i].bounds(0.7);
        EXPECT_TRUE(std::ranges::any_of(boxes, [&](const Bounds& box) {
            return glm::all(glm::lessThanEqual(box.lo - 1.4, bounds.hi))
                   && glm::all(glm::lessThanEqual(bounds.lo, box.hi + 1.4));
        })) << tiles[i].name();
        for (std::size_t j = 0; j < i; ++j) // they share no cell
            EXPECT_TRUE(glm::any(glm::lessThanEqual(tiles[i].end, tiles[j].begin))
                        || glm::any(glm::lessThanEqual(tiles[j].end, tiles[i].begin)));
    }
    std::uniform_real_distribution<double> share(0, 1);
    for (const Bounds& box : boxes)
        for (int k = 0; k < 50; ++k) {
            const glm::dvec3 p =
                glm::mix(box.lo, box.hi, glm::dvec3(share(random), share(random), share(random)));
            EXPECT_EQ(std::ranges::count_if(tiles,
                                            [&](const Tile& tile) {
                                                const Bounds b = tile.bounds(0.7);
                                                return glm::all(glm::lessThanEqual(b.lo, p))
                                                       && glm::all(glm::lessThan(p, b.hi));
                                            }),
                      1);
        }
}

TEST(Tiles, DoNotHearOfWhatIsElsewhere) {
    std::vector<Bounds> boxes{{{1, 0, 1}, {5, 9, 5}}, {{100, 0, 0}, {101, 2, 1}}};
    const std::vector<Tile> before = tiles_around(boxes, 1.0, 16);
    boxes[1] = {{-400, -50, 90}, {-350, 60, 120}};
    const std::vector<Tile> after = tiles_around(boxes, 1.0, 16);
    const auto find = [](const std::vector<Tile>& tiles, const std::string& name) {
        return *std::ranges::find(tiles, name, &Tile::name);
    };
    EXPECT_EQ(find(before, "x0_y0_z0").begin, find(after, "x0_y0_z0").begin);
    EXPECT_EQ(find(before, "x0_y0_z0").end, find(after, "x0_y0_z0").end);
}

TEST(Tiles, ThatAreTooManyAreRefused) {
    const std::vector<Bounds> plain{{{-1e6, 0, -1e6}, {1e6, 1, 1e6}}};
    EXPECT_THROW(tiles_around(plain, 1.0, 16), Error);
    EXPECT_THROW(tiles_around(std::vector<Bounds>{{{1e9, 0, 0}, {1e9, 1, 1}}}, 1.0, 16), Error);
    EXPECT_TRUE(tiles_around(std::vector<Bounds>{Bounds()}, 1.0, 16).empty());
    EXPECT_EQ(tiles_around(std::vector<Bounds>{{{16, 0, 0}, {16, 4, 4}}}, 1.0, 16).size(),
              1u); // flat
    EXPECT_EQ(tiles_around(plain, 1000.0, 16).size(), 126u * 126u);
}

} // namespace
} // namespace lpvbake
