// Skies from pictures against the mapping's formula and sums over their texels.
#include "scene/sky.h"

#include <glm/gtc/constants.hpp>
#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

constexpr double pi = glm::pi<double>();

std::vector<glm::vec3> gradient(int width, int height) {
    std::vector<glm::vec3> texels;
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column)
            texels.emplace_back(1.0f + float(column), 2.0f + float(row), float(column * row % 7));
    return texels;
}

/// Sum over texels of f(direction of the centre) L d omega.
glm::dvec3 summed(int width, int height, const std::vector<glm::vec3>& texels) {
    glm::dvec3 sum{0.0};
    for (int row = 0; row < height; ++row) {
        const double band = std::cos(pi * row / height) - std::cos(pi * (row + 1) / height);
        for (int column = 0; column < width; ++column)
            sum += 2 * pi / width * band * glm::dvec3(texels[size_t(row * width + column)]);
    }
    return sum;
}

glm::vec3 random_direction(std::mt19937& random) {
    std::normal_distribution<float> normal;
    return glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
}

std::vector<glm::vec3> lattice(int count) {
    std::vector<glm::vec3> directions;
    for (int i = 0; i < count; ++i) {
        const double y = 1 - (2 * i + 1.0) / count, a = i * pi * (3 - std::sqrt(5.0));
        const double r = std::sqrt(1 - y * y);
        directions.emplace_back(r * std::sin(a), y, r * std::cos(a));
    }
    return directions;
}

TEST(Sky, TheMiddleOfAPictureStandsAtX) {
    constexpr int width = 12, height = 5;
    const auto texels = gradient(width, height);
    const Sky sky = scene::make_sky(width, height, texels, 0.0);
    std::mt19937 random(1);
    for (int i = 0; i < 1000; ++i) {
        const glm::vec3 w = random_direction(random);
        const double u = 0.5 + std::atan2(double(w.z), double(w.x)) / (2 * pi);
        const double v = 0.5 - std::asin(double(w.y)) / pi;
        EXPECT_EQ(scene::sky_luminance(sky, w),
                  texels[size_t(int(v * height) * width + int(u * width) % width)]);
    }
    for (const glm::vec3 edge : {glm::vec3(0, 1, 0), glm::vec3(0, -1, 0), glm::vec3(-1, 0, 0),
                                 glm::vec3(-1, 0, -0.0f), glm::vec3(0, 1.0001f, 0)})
        scene::sky_luminance(sky, edge); // stays inside the picture
}

TEST(Sky, TurnsAsTheSunsAzimuthGrows) {
    // What stood at +X, azimuth 90, stands at -Z, azimuth 180, after a quarter of a turn.
    const auto texels = gradient(16, 8);
    const Sky straight = scene::make_sky(16, 8, texels, 0.0),
              turned = scene::make_sky(16, 8, texels, pi / 2);
    EXPECT_EQ(scene::sky_luminance(turned, glm::normalize(glm::vec3(0.01f, 0.1f, -1))),
              scene::sky_luminance(straight, glm::normalize(glm::vec3(1, 0.1f, 0.01f))));
    EXPECT_NE(scene::sky_luminance(turned, {1, 0, 0}), scene::sky_luminance(straight, {1, 0, 0}));
}

TEST(Sky, AnEvenPictureIsAnEvenSky) {
    const glm::vec3 even(1.0f, 2.0f, 4.0f);
    for (const int width : {1, 64, 1500}) {
        const Sky sky = scene::make_sky(
            width, (width + 1) / 2,
            std::vector<glm::vec3>(size_t(width) * size_t((width + 1) / 2), even), 0.3);
        EXPECT_TRUE(scene::sky_suns(sky).empty());
        const Sky averaged = scene::averaged_sky(sky, lattice(48));
        std::mt19937 random(2);
        for (int i = 0; i < 100; ++i) {
            const glm::vec3 w = random_direction(random);
            for (int c = 0; c < 3; ++c) {
                EXPECT_NEAR(scene::sky_luminance(sky, w)[c], even[c], 1e-6 * even[c]);
                EXPECT_NEAR(scene::sky_rest(sky, w)[c], even[c], 1e-6 * even[c]);
                EXPECT_NEAR(scene::sky_luminance(averaged, w)[c], even[c], 1e-6 * even[c]);
                EXPECT_NEAR(scene::sky_mean(sky, w.y - 0.01, w.y, w.x, w.x + 1)[c], even[c],
                            1e-6 * even[c]);
            }
        }
    }
}

TEST(Sky, ALargePictureKeepsItsPower) {
    constexpr int width = 1700, height = 1101;
    auto texels = gradient(width, height);
    texels[size_t(200 * width + 77)] = glm::vec3(1e9f);
    const Sky sky = scene::make_sky(width, height, texels, 0.0);
    EXPECT_EQ(sky.map->width, 1024);
    EXPECT_EQ(sky.map->height, 512);
    const glm::dvec3 before = summed(width, height, texels);
    const glm::dvec3 after = summed(1024, 512, sky.map->texels);
    for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(after[c] / before[c], 1.0, 1e-6);
}

TEST(Sky, MeansOverBoxesAreExact) {
    const Sky sky = scene::make_sky(20, 9, gradient(20, 9), 0.7);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> number(0.0, 1.0);
    for (int i = 0; i < 20; ++i) {
        const double low = -1 + 1.5 * number(random), high = low + (1 - low) * number(random);
        const double from = 8 * number(random) - 4, to = from + 6 * number(random);
        constexpr int steps = 500;
        glm::dvec3 sum{0.0};
        for (int a = 0; a < steps; ++a)
            for (int b = 0; b < steps; ++b) {
                const double y = low + (high - low) * (a + 0.5) / steps;
                const double azimuth = from + (to - from) * (b + 0.5) / steps;
                const double r = std::sqrt(1 - y * y);
                sum += glm::dvec3(scene::sky_luminance(
                    sky, glm::vec3(r * std::sin(azimuth), y, r * std::cos(azimuth))));
            }
        const glm::dvec3 mean = scene::sky_mean(sky, low, high, from, to);
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(mean[c], sum[c] / (steps * steps), 0.01 * sum[c] / (steps * steps));
    }
}

TEST(Sky, SunsAndTheRestAreTheWhole) {
    constexpr int width = 256, height = 128;
    std::vector<glm::vec3> texels(size_t(width * height), glm::vec3(1000.0f, 2000.0f, 3000.0f));
    for (const int at : {30 * width + 80, 30 * width + 81})
        texels[size_t(at)] = {1e9f, 0.9e9f, 0.7e9f};
    const Sky sky = scene::make_sky(width, height, texels, 0.0);
    ASSERT_EQ(scene::sky_suns(sky).size(), 1u);
    const Light& sun = scene::sky_suns(sky)[0];
    const double polar = pi * 30.5 / height, azimuth = 2 * pi * (0.75 - 81.0 / width);
    const glm::dvec3 towards(std::sin(polar) * std::sin(azimuth), std::cos(polar),
                             std::sin(polar) * std::cos(azimuth));
    EXPECT_GT(glm::dot(-sun.direction, towards), std::cos(0.002));
    const glm::dvec3 whole = summed(width, height, texels);
    const glm::dvec3 rest = summed(width, height, sky.map->rest);
    for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR((rest[c] + double(sun.color[c])) / whole[c], 1.0, 1e-6);
        EXPECT_LT(rest[c], 4 * pi * 3100);
    }
}

TEST(Sky, ManySpotsAreAtMost64Suns) {
    std::vector<glm::vec3> texels(1024 * 512, glm::vec3(1.0f));
    for (size_t i = 0; i < texels.size(); i += 5003)
        texels[i] = glm::vec3(1e6f);
    const Sky sky = scene::make_sky(1024, 512, texels, 0.0);
    EXPECT_EQ(scene::sky_suns(sky).size(), 64u);
    glm::dvec3 sum = summed(1024, 512, sky.map->rest);
    for (const Light& sun : scene::sky_suns(sky))
        sum += glm::dvec3(sun.color);
    EXPECT_NEAR(sum.x / summed(1024, 512, texels).x, 1.0, 1e-6);
}

TEST(Sky, DirectionsSeeAllOfItsPower) {
    std::vector<glm::vec3> texels = gradient(128, 64);
    texels[20 * 128 + 3] = glm::vec3(1e7f, 1e6f, 0.0f);
    const Sky sky = scene::make_sky(128, 64, texels, 0.0);
    const auto directions = lattice(240);
    const Sky averaged = scene::averaged_sky(sky, directions);
    glm::dvec3 sum{0.0};
    for (const glm::vec3& d : directions)
        sum += 4 * pi / 240 * glm::dvec3(scene::sky_luminance(averaged, d));
    const glm::dvec3 whole = summed(128, 64, texels);
    for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(sum[c] / whole[c], 1.0, 1e-5);
}

TEST(Sky, DrawsDirectionsByTheirDensity) {
    std::vector<glm::vec3> texels = gradient(40, 20);
    texels[7 * 40 + 11] = glm::vec3(1e4f);
    texels[9] = glm::vec3(0.0f);
    const Sky sky = scene::make_sky(40, 20, texels, 0.4);
    std::mt19937 random(4);
    std::uniform_real_distribution<double> number(0.0, 1.0);
    // Sum of L / density is the integral, and so is that of L times a function of the direction.
    constexpr int count = 100'000;
    glm::dvec3 sum{0.0}, low{0.0};
    for (int i = 0; i < count; ++i) {
        const glm::vec3 w(scene::sample_sky(*sky.map, {number(random), number(random)}));
        const glm::dvec3 share =
            glm::dvec3(scene::sky_luminance(sky, w)) / scene::sky_density(*sky.map, w);
        sum += share / double(count);
        if (w.y < 0)
            low += share / double(count);
    }
    const glm::dvec3 whole = summed(40, 20, texels);
    const glm::dvec3 half = 2 * pi * scene::sky_mean(sky, -1, 0, 0, 2 * pi);
    for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(sum[c] / whole[c], 1.0, 0.01);
        EXPECT_NEAR(low[c] / half[c], 1.0, 0.02);
    }
}

TEST(Sky, ABlackPictureIsNoSky) {
    Scene scene;
    scene.sky = scene::make_sky(8, 4, std::vector<glm::vec3>(32, glm::vec3(0.0f)), 0.0);
    EXPECT_FALSE(scene::has_sky(scene));
    EXPECT_EQ(scene::sky_density(*scene.sky.map, {0, 1, 0}), 0.0);
}

} // namespace
} // namespace lpvbake
