// Cascades of reflective shadow maps: each square of a map in one texel.
#include "solver/vpl/cascades.h"

#include "scenes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace lpvbake {
namespace {

using solver::vpl::Cascade;

/// Boxes in each other around a corner of a grid of 16 cells.
scene::Frame nested(std::size_t levels) {
    scene::Frame frame{glm::dvec3(0), 0.1, glm::dvec3(16)};
    const scene::CoarserBox boxes[] = {{glm::vec3(-1, -2, -3), glm::vec3(29, 30, 31), 2},
                                       {glm::vec3(-10, -10, -10), glm::vec3(54), 4},
                                       {glm::vec3(-40, -30, -90), glm::vec3(120, 130, 110), 16}};
    frame.coarser.assign(boxes, boxes + levels - 1);
    return frame;
}

struct Looking {
    const char* name;
    Light light;
};

std::vector<Looking> lights() {
    return {{"sun", scenes::sun({0.3, -1, 0.2}, 100)},
            {"lamp inside", scenes::point_light({0.8, 0.9, 0.7}, 10)},
            {"lamp beside", scenes::point_light({6, 2, 3}, 10)},
            {"spot", scenes::spot_light({5, 9, -2}, {-1, -2, 0.5}, 10, 0.2, 0.6)}};
}

/// All of its maps' cascades.
std::vector<std::pair<scene::RsmView, std::vector<Cascade>>> cascades(const Light& light,
                                                                      const scene::Frame& frame) {
    std::vector<std::pair<scene::RsmView, std::vector<Cascade>>> all;
    for (const scene::RsmView& view :
         scene::views_of(light, frame, glm::dvec3(-40, -30, -90), glm::dvec3(120, 130, 110)))
        all.emplace_back(view, solver::vpl::cascades_of(view, frame, 64));
    return all;
}

TEST(Cascades, EachSquareOfAMapIsInOneTexel) {
    std::size_t parted = 0;
    for (const auto& [name, light] : lights())
        for (std::size_t levels = 1; levels <= 4; ++levels)
            for (const auto& [view, all] : cascades(light, nested(levels))) {
                const int size = all.back().size;
                std::vector<int> count(std::size_t(size) * std::size_t(size)), uncut = count;
                for (const Cascade& cascade : all) {
                    const int edge = size / cascade.size;
                    ASSERT_EQ(edge * cascade.size, size) << "texels are not aligned";
                    for (int y = cascade.drawn.lo.y * edge; y < cascade.drawn.hi.y * edge; ++y)
                        for (int x = cascade.drawn.lo.x * edge; x < cascade.drawn.hi.x * edge;
                             ++x) {
                            const auto at = std::size_t(y) * std::size_t(size) + std::size_t(x);
                            ++uncut[at];
                            count[at] += !cascade.cut.holds({x / edge, y / edge});
                        }
                }
                ASSERT_EQ(std::ranges::count(count, 1), std::ptrdiff_t(count.size())) << name;
                if (all.size() > 1) { // the cuts are what does it
                    ++parted;
                    EXPECT_GT(*std::ranges::max_element(uncut), 1) << name;
                }
            }
    EXPECT_GT(parted, 10u);
}

TEST(Cascades, WhatLiesInAFinerLevelIsSeenBySmallTexels) {
    std::mt19937 random(2);
    for (const auto& [name, light] : lights()) {
        const scene::Frame frame = nested(3);
        const double cells[] = {1, 2};
        const glm::dvec3 lo[] = {glm::dvec3(0), glm::dvec3(-1, -2, -3)};
        const glm::dvec3 hi[] = {glm::dvec3(16), glm::dvec3(29, 30, 31)};
        std::size_t seen = 0;
        for (const auto& [view, all] : cascades(light, frame))
            for (int i = 0; i < 2000; ++i) {
                const std::size_t level = std::size_t(i % 2);
                glm::dvec3 p;
                for (int axis = 0; axis < 3; ++axis)
                    p[axis] = std::uniform_real_distribution<double>(lo[level][axis],
                                                                     hi[level][axis])(random);
                const glm::dvec3 way = p - view.origin;
                const double depth = glm::dot(way, view.axis);
                if (view.perspective && depth < 0.01)
                    continue;
                const glm::dvec2 at = glm::dvec2(glm::dot(way, view.u) / glm::dot(view.u, view.u),
                                                 glm::dot(way, view.v) / glm::dot(view.v, view.v))
                                      / (view.perspective ? depth : 1.0);
                if (glm::any(glm::greaterThan(glm::abs(at), glm::dvec2(1))))
                    continue;
                ++seen;
                std::size_t held = 0;
                for (const Cascade& cascade : all) {
                    const glm::ivec2 texel(glm::floor(0.5 * double(cascade.size) * (at + 1.0)));
                    if (!cascade.drawn.holds(texel) || cascade.cut.holds(texel))
                        continue;
                    ++held;
                    const double edge =
                        2 * glm::length(view.u) * (view.perspective ? depth : 1.0) / cascade.size;
                    // As many to a cell as the coarsest has to one of its own, or eight.
                    const double first = 64.0 * 4.0 / cells[level];
                    EXPECT_TRUE(edge <= cells[level] / 8 || cascade.size >= int(first))
                        << name << ' ' << edge << ' ' << cascade.size;
                }
                EXPECT_EQ(held, 1u) << name;
            }
        EXPECT_GT(seen, 100u) << name;
    }
}

TEST(Cascades, OneGridHasOneMap) {
    for (const auto& [name, light] : lights())
        for (const auto& [view, all] : cascades(light, nested(1))) {
            ASSERT_EQ(all.size(), 1u);
            EXPECT_EQ(all[0].size, 64);
            EXPECT_TRUE(all[0].cut.is_empty());
        }
}

} // namespace
} // namespace lpvbake
