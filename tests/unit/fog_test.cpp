// Light in air, beside closed forms and beside long sums.
#include "medium/fog.h"

#include "scenes.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace lpvbake {
namespace {

using medium::Fog;
using medium::FogSettings;
using medium::LightDepths;
using medium::Medium;

constexpr double pi = glm::pi<double>();
constexpr double unit = 0.5; ///< metres a frame unit

const scene::Frame frame{glm::dvec3(0), unit, glm::dvec3(20)};

/// A speck, so that all else is open.
Scene speck() {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {0, 0, 0}, {1e-4f, 0, 0},
                     {0, 1e-4f, 0});
    return scene;
}

/// Two boxes and a wall with a slit, in 10 x 10 x 10 m.
Scene blocks() {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true);
    scenes::add_quad(scene, grey, {0, 0, 0}, {0, 0, 10}, {10, 0, 0});
    scenes::add_box(scene, grey, {1, 0, 2}, {3, 5, 4}, scenes::Facing::outward);
    scenes::add_box(scene, grey, {6, 0, 5}, {7.5f, 7, 9}, scenes::Facing::outward);
    scenes::add_quad(scene, grey, {0, 9, 0}, {0, 0, 10}, {4.7f, 0, 0});
    scenes::add_quad(scene, grey, {5.2f, 9, 0}, {0, 0, 10}, {4.8f, 0, 0});
    return scene;
}

Medium air(glm::dvec3 scatter, glm::dvec3 absorb, double g) {
    return {scatter, absorb, g, {glm::dvec3(0), glm::dvec3(10)}};
}

TEST(Medium, PhasesIntegrateToOneAndHaveTheMeanCosine) {
    for (const double g : {-0.7, 0.0, 0.3, 0.9}) {
        double sum = 0, mean = 0;
        const int n = 20000;
        for (int i = 0; i < n; ++i) {
            const double cosine = 2 * (i + 0.5) / n - 1;
            sum += medium::phase(g, cosine) * 4 * pi / n;
            mean += medium::phase(g, cosine) * 4 * pi / n * cosine;
        }
        EXPECT_NEAR(sum, 1, 1e-4);
        EXPECT_NEAR(mean, g, 1e-4);
    }
}

TEST(Medium, DecaysAsItsSumDoes) {
    for (const double a : {-2.0, -1e-9, 0.0, 1e-12, 0.3, 40.0}) {
        double sum = 0;
        for (int i = 0; i < 100000; ++i)
            sum += std::exp(-a * (0.5 + 1.5 * (i + 0.5) / 100000)) * 1.5 / 100000;
        EXPECT_NEAR(medium::decay(a, 0.5, 2.0), sum, 1e-8 * std::max(1.0, sum));
    }
}

TEST(Fog, LightIsLostByTheWayInTheBoxAlone) {
    Scene scene = speck();
    const visibility::Visibility visibility(scene, frame);
    const Fog fog(scene, visibility, frame, nullptr, air({0.1, 0.2, 0.3}, {0, 0, 0.1}, 0), {});
    // From 2 m before the box to 3 m in it, and through all of it.
    const glm::dvec3 left = fog.transmittance({-4, 10, 10}, {1, 0, 0}, 10);
    const glm::dvec3 through = fog.transmittance({-4, 10, 10}, {1, 0, 0}, HUGE_VAL);
    for (int c = 0; c < 3; ++c) {
        const double extinction = glm::dvec3(0.1, 0.2, 0.4)[c];
        EXPECT_NEAR(left[c], std::exp(-3 * extinction), 1e-12);
        EXPECT_NEAR(through[c], std::exp(-10 * extinction), 1e-12);
    }
    EXPECT_EQ(fog.transmittance({-4, 30, 10}, {1, 0, 0}, 10), glm::dvec3(1.0));
}

TEST(Fog, AirlightOfALampIsItsAngle) {
    // sigma I (angle2 - angle1) / (4 pi h) where nothing is lost on the way.
    Scene scene = speck();
    scene.lights.push_back(scenes::point_light({4, 3, 5}, 200));
    const visibility::Visibility visibility(scene, frame);
    const Fog fog(scene, visibility, frame, nullptr, air(glm::dvec3(1e-9), glm::dvec3(0), 0), {});
    const double h = 2.5; // metres
    const double angle = std::atan(6 / h) + std::atan(4 / h);
    const glm::dvec3 light = fog.direct({0, 6 + 5, 10}, {1, 0, 0}, HUGE_VAL);
    EXPECT_NEAR(light.x, 1e-9 * 200 * angle / (4 * pi * h), 1e-15);
}

TEST(Fog, TheSunsIntegralIsThatOfAMillionSteps) {
    Scene scene = speck();
    // Against the light, with it, and across faces by which light enters.
    for (const glm::dvec3 sun : {glm::dvec3(-1, 0, 0), glm::dvec3(1, 0, 0),
                                 glm::dvec3(0.5, -0.7, 0.3), glm::dvec3(-0.6, -0.6, -0.5)}) {
        scene.lights = {scenes::sun(sun, 1000)};
        const visibility::Visibility visibility(scene, frame);
        const Medium medium = air({0.05, 0.2, 0.1}, {0, 0.3, 0.01}, 0.6);
        const Fog fog(scene, visibility, frame, nullptr, medium, {});
        for (const glm::dvec3 way : {glm::dvec3(1, 0, 0), glm::normalize(glm::dvec3(3, 1, -0.5))}) {
            const glm::dvec3 origin(1, 7, 11); // 19 or 20 units inside of the box
            const double end = medium::within(origin, way, glm::dvec3(0), glm::dvec3(20), 0, 18)->y;
            const int n = 100000;
            glm::dvec3 sum(0.0);
            const glm::dvec3 travel = glm::normalize(sun);
            for (int i = 0; i < n; ++i) {
                const double t = end * (i + 0.5) / n;
                const auto in = medium::within(origin + t * way, -travel, glm::dvec3(0),
                                               glm::dvec3(20), 0, HUGE_VAL);
                sum += glm::exp(-medium.extinction() * unit * (t + in->y)) * end / double(n) * unit;
            }
            sum *= medium.scatter * 1000.0 * medium::phase(0.6, -glm::dot(travel, way));
            const glm::dvec3 exact = fog.direct(origin, way, 18);
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(exact[c], sum[c], 1e-5 * sum[c]);
        }
    }
}

TEST(LightDepths, ThePyramidSavesVisitsAndChangesNoBit) {
    const Scene scene = blocks();
    const visibility::Visibility visibility(scene, frame);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(0.0, 20.0);
    for (const Light& light : {scenes::sun({0.3, -1, 0.2}, 1), scenes::point_light({5, 8, 5}, 1),
                               scenes::spot_light({5, 8.5, 4}, {0.1, -1, 0.2}, 1, 0.3, 0.6)}) {
        const LightDepths depths(light, visibility, frame, glm::dvec3(0), glm::dvec3(20), 512);
        uint64_t with = 0, without = 0;
        double wrong = 0, lit = 0, all = 0;
        for (int i = 0; i < 200; ++i) {
            const glm::dvec3 from(any(random), any(random), any(random));
            const glm::dvec3 to(any(random), any(random), any(random));
            const double length = glm::length(to - from);
            const glm::dvec3 way = (to - from) / length;
            std::vector<glm::dvec2> parts, plain;
            with += depths.lit_parts(from, way, 0, length, parts);
            without += depths.lit_parts(from, way, 0, length, plain, false);
            ASSERT_EQ(parts, plain) << i;
            for (std::size_t k = 0; k < parts.size(); ++k) {
                lit += parts[k].y - parts[k].x;
                EXPECT_LT(parts[k].x, parts[k].y);
                EXPECT_LE(k > 0 ? parts[k - 1].y : 0.0, parts[k].x);
            }
            all += length;
            for (int k = 0; k < 50; ++k) {
                const double t = length * (k + 0.5) / 50;
                const glm::dvec3 place = from + t * way;
                const bool parallel = light.type == LightType::directional;
                const glm::dvec3 back =
                    parallel ? -100.0 * light.direction : light.position / unit - place;
                if (light.type == LightType::spot
                    && glm::dot(-glm::normalize(back), light.direction) < std::cos(0.6))
                    continue;
                const bool open =
                    visibility.transmittance({glm::vec3(place), glm::vec3(back)}) > 0.5f;
                const bool seen = std::ranges::any_of(
                    parts, [&](glm::dvec2 part) { return t >= part.x && t < part.y; });
                wrong += open != seen;
            }
        }
        EXPECT_GT(lit, 0.05 * all);
        EXPECT_LT(wrong / 10000, 0.01);
        EXPECT_LT(5 * with, without);
    }
}

/// The light of a lamp or sun before anything attenuates it, and whether its map lets it by.
struct MarchedMap {
    const Light& light;
    std::vector<scene::RsmView> views;
    std::vector<std::vector<float>> depths;
    int size;

    MarchedMap(const Light& of, const visibility::Visibility& visibility, int texels)
        : light(of),
          views(medium::views_into(of, visibility, frame, glm::dvec3(0), glm::dvec3(20))),
          size(texels) {
        for (const scene::RsmView& view : views)
            depths.push_back(medium::depths_of(view, visibility, size));
    }
    bool reaches(glm::dvec3 place) const {
        for (std::size_t i = 0; i < views.size(); ++i) {
            const scene::RsmView& view = views[i];
            const glm::dvec3 from = place - view.origin;
            const double depth = glm::dot(from, view.axis);
            const glm::dvec2 at = glm::dvec2(glm::dot(from, view.u) / glm::dot(view.u, view.u),
                                             glm::dot(from, view.v) / glm::dot(view.v, view.v))
                                  / (view.perspective ? depth : 1.0);
            if ((view.perspective && !(depth > 0))
                || glm::any(glm::greaterThanEqual(glm::abs(at), glm::dvec2(1))))
                continue;
            const glm::ivec2 texel(0.5 * (at + 1.0) * double(size));
            return depth < double(depths[i][std::size_t(texel.y * size + texel.x)]);
        }
        return light.type == LightType::directional;
    }
    /// Of so many steps in a medium of 20 x 20 x 20 frame units.
    double march(const Medium& medium, glm::dvec3 origin, glm::dvec3 way, double end,
                 int steps) const {
        double sum = 0;
        const bool parallel = light.type == LightType::directional;
        const scene::Cone cone(light);
        for (int i = 0; i < steps; ++i) {
            const double t = end * (i + 0.5) / steps;
            const glm::dvec3 place = origin + t * way;
            if (!reaches(place))
                continue;
            const glm::dvec3 at = light.position / unit;
            const glm::dvec3 travel = glm::normalize(parallel ? light.direction : place - at);
            const double before = medium::within(place, -travel, glm::dvec3(0), glm::dvec3(20), 0,
                                                 parallel ? HUGE_VAL : glm::length(place - at))
                                      ->y;
            double arrives = light.intensity;
            if (!parallel)
                arrives /= glm::dot(place - at, place - at) * unit * unit;
            if (light.type == LightType::spot)
                arrives *= cone(travel);
            sum += arrives * medium::phase(medium.g, -glm::dot(travel, way))
                   * std::exp(-medium.extinction().x * unit * (t + before));
        }
        return medium.scatter.x * unit * end / steps * sum;
    }
};

TEST(Fog, ExactIsWhatSmallStepsOnTheSameMapComeTo) {
    Scene scene = blocks();
    const Medium medium = air(glm::dvec3(0.08), glm::dvec3(0.02), 0.4);
    for (const Light& light :
         {scenes::sun({0.3, -1, 0.2}, 1000), scenes::point_light({5, 8, 5}, 99),
          scenes::spot_light({5, 8.5, 4}, {0.1, -1, 0.2}, 99, 0.3, 0.6)}) {
        scene.lights = {light};
        const visibility::Visibility visibility(scene, frame);
        const Fog exact(scene, visibility, frame, nullptr, medium, {0, 256});
        const MarchedMap map(light, visibility, 256);
        double difference = 0, coarse = 0, sum = 0;
        for (int i = 0; i < 40; ++i) {
            const glm::dvec3 origin(0.5 + i % 8 * 2.5, 3 + i / 8 * 3, 19);
            const glm::dvec3 way = glm::normalize(glm::dvec3(10.1, 9.3, 8) - origin);
            const double end = medium::within(origin, way, glm::dvec3(0), glm::dvec3(20), 0, 30)->y;
            const double fog = exact.direct(origin, way, end).x;
            const double marched = map.march(medium, origin, way, end, 40000);
            difference += std::abs(fog - marched);
            coarse += std::abs(fog - map.march(medium, origin, way, end, 40));
            sum += marched;
        }
        EXPECT_GT(sum, 0);
        EXPECT_LT(difference, 1e-4 * sum) << int(light.type);
        EXPECT_GT(coarse, 1e-3 * sum) << int(light.type); // so steps matter here
    }
}

TEST(Fog, ExactIsTheLimitOfMarching) {
    Scene scene = blocks();
    const Medium medium = air(glm::dvec3(0.08), glm::dvec3(0.02), 0.4);
    for (const Light& light :
         {scenes::sun({0.3, -1, 0.2}, 1000), scenes::point_light({5, 8, 5}, 99),
          scenes::spot_light({5, 8.5, 4}, {0.1, -1, 0.2}, 99, 0.3, 0.6)}) {
        scene.lights = {light};
        const visibility::Visibility visibility(scene, frame);
        const Fog exact(scene, visibility, frame, nullptr, medium, {0, 2048});
        const Fog marched(scene, visibility, frame, nullptr, medium, {4000, 0});
        double difference = 0, sum = 0;
        for (int i = 0; i < 40; ++i) {
            const glm::dvec3 origin(0.5 + i % 8 * 2.5, 3 + i / 8 * 3, 19);
            const glm::dvec3 way = glm::normalize(glm::dvec3(10, 9, 8) - origin);
            const double a = exact.direct(origin, way, 30).x, b = marched.direct(origin, way, 30).x;
            difference += std::abs(a - b);
            sum += b;
        }
        EXPECT_GT(sum, 0);
        EXPECT_LT(difference, 0.01 * sum) << int(light.type);
    }
}

TEST(Fog, AnEvenFieldIsScatteredAsMuchAsItIs) {
    Scene scene = speck();
    const visibility::Visibility visibility(scene, frame);
    Volume volume;
    volume.grid = {glm::dvec3(-0.5), 1.0, glm::ivec3(11)};
    volume.sh_order = 2;
    volume.sh.assign(9, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0.0f)));
    for (glm::vec3& l0 : volume.sh[0])
        l0 = glm::vec3(float(5 * std::sqrt(4 * pi)));
    const volume::Levels levels(volume);
    for (const double g : {0.0, 0.5}) {
        const Fog fog(scene, visibility, frame, &levels, air(glm::dvec3(0.3), glm::dvec3(0.1), g),
                      {});
        EXPECT_NEAR(fog.of_field({0, 9, 9}, {1, 0, 0}, HUGE_VAL).x, 5 * 0.75 * (1 - std::exp(-4.0)),
                    1e-5);
    }
    // Light that comes from +x alone, to order 2, is seen as the first terms of the phase's series.
    const volume::ShValues from = volume::sh_basis(2, {1, 0, 0});
    for (std::size_t k = 0; k < 9; ++k)
        for (glm::vec3& c : volume.sh[k])
            c = glm::vec3(from[k]);
    const Fog fog(scene, visibility, frame, &levels, air(glm::dvec3(1e-6), glm::dvec3(0), 0.5), {});
    EXPECT_NEAR(fog.of_field({0, 9, 9}, {1, 0, 0}, HUGE_VAL).x,
                1e-6 * 10 * (1 + 3 * 0.5 + 5 * 0.25) / (4 * pi), 1e-10);
}

} // namespace
} // namespace lpvbake
