#include "scene/emission.h"

#include "scene/material.h"
#include "scenes.h"

#include <gtest/gtest.h>

#include <random>

namespace lpvbake {
namespace {

/// A quad whose texture has random texels, of which most are black.
Scene textured(std::mt19937& random, int width, int height, Texture texture) {
    Scene scene;
    const int lamp = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(10, 20, 40));
    Image image{"", width, height, {}};
    for (int i = 0; i < width * height; ++i)
        for (int channel = 0; channel < 4; ++channel)
            image.rgba.push_back(random() % 5 == 0 ? uint8_t(random() % 256) : uint8_t(0));
    scene.images.push_back(image);
    texture.image = 0;
    scene.textures.push_back(texture);
    scene.materials[0].emission_texture = 0;
    scenes::add_quad(scene, lamp, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    Mesh& mesh = scene.meshes[0];
    mesh.uv_emission = mesh.uv;
    return scene;
}

using Corners = std::array<glm::vec2, 3>;
constexpr Corners whole{glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(0, 1)};

/// By many points.
scene::PieceEmission sampled(const Scene& scene, uint32_t triangle, const Corners& piece,
                             int steps) {
    glm::dvec3 sum{0.0}, squares{0.0};
    glm::dvec2 first{0.0};
    double light = 0.0;
    int points = 0;
    for (int i = 0; i < steps; ++i)
        for (int j = 0; i + j < steps; ++j)
            for (const float at : {1.0f / 3.0f, 2.0f / 3.0f}) {
                if (at > 0.5f && i + j + 1 >= steps)
                    continue;
                const glm::vec2 w = (glm::vec2(i, j) + at) / float(steps);
                const glm::dvec3 e = scene::sample_emission(scene, scene.meshes[0], triangle,
                                                            (1.0f - w.x - w.y) * piece[0]
                                                                + w.x * piece[1] + w.y * piece[2]);
                const double most = std::max({e.x, e.y, e.z});
                sum += e;
                light += most;
                first += most * glm::dvec2(w);
                squares += most * glm::dvec3(w.x * w.x, w.y * w.y, w.x * w.y);
                ++points;
            }
    if (light == 0.0)
        return {};
    return {sum / double(points), first / light, squares / light};
}

TEST(Emission, IsTheIntegralOfTheTexture) {
    std::mt19937 random(4);
    std::uniform_real_distribution<float> number(0.0f, 1.0f);
    for (const Wrap u : {Wrap::repeat, Wrap::mirrored_repeat, Wrap::clamp_to_edge})
        for (const Wrap v : {Wrap::repeat, Wrap::mirrored_repeat, Wrap::clamp_to_edge})
            for (const bool nearest : {false, true})
                for (int i = 0; i < 6; ++i) {
                    Scene scene = textured(random, 1 + int(random() % 6), 1 + int(random() % 6),
                                           {-1, u, v, nearest});
                    // Turned, sheared, mirrored, shifted.
                    for (glm::vec2& uv : scene.meshes[0].uv_emission)
                        uv = glm::vec2(number(random) * 1.5f - 0.6f, number(random) * 1.4f - 0.5f);
                    Corners piece = whole;
                    if (i % 2 == 0) {
                        const glm::vec2 at(0.5f * number(random), 0.5f * number(random));
                        const float size = 0.02f + 0.4f * number(random);
                        piece = {at, at + glm::vec2(size, 0.1f * size), at + glm::vec2(0, size)};
                    }
                    const scene::EmissionMaps maps(scene);
                    const scene::PieceEmission exact = maps.over(scene.meshes[0], 1, piece);
                    const scene::PieceEmission about = sampled(scene, 1, piece, 300);
                    const float most = 40.0f;
                    for (int c = 0; c < 3; ++c)
                        EXPECT_NEAR(exact.mean[c], about.mean[c], (nearest ? 4e-3f : 2e-4f) * most);
                    if (about.mean.z < 0.02f * most)
                        continue;
                    // The largest of channels is not bilinear.
                    for (int c = 0; c < 2; ++c)
                        EXPECT_NEAR(exact.centre[c], about.centre[c], 0.02f);
                    for (int c = 0; c < 3; ++c)
                        EXPECT_NEAR(exact.squares[c], about.squares[c], 0.02f);
                }
}

TEST(Emission, PiecesSumUpToTheirWhole) {
    // Of an image of any size the quad has the mean, however it is cut; one lit texel among many
    // is never lost.
    std::mt19937 random(8);
    for (const glm::ivec2 size : {glm::ivec2(1, 1), {1000, 700}, {33, 1024}, {513, 1}}) {
        Scene scene = textured(random, size.x, size.y, {-1, Wrap::repeat, Wrap::repeat, true});
        std::ranges::fill(scene.images[0].rgba, uint8_t(0));
        const int lit = int(random() % uint32_t(size.x * size.y));
        scene.images[0].rgba[size_t(4 * lit + 1)] = 255;
        const scene::EmissionMaps maps(scene);
        for (const int steps : {1, 7, 40}) {
            double sum = 0.0;
            for (int i = 0; i < steps; ++i)
                for (int j = 0; i + j < steps; ++j)
                    for (const bool upper : {false, true}) {
                        if (upper && i + j + 1 >= steps)
                            continue;
                        const glm::vec2 at = glm::vec2(i, j) / float(steps);
                        const float s = 1.0f / float(steps);
                        const Corners piece =
                            upper ? Corners{at + s, at + glm::vec2(0, s), at + glm::vec2(s, 0)}
                                  : Corners{at, at + glm::vec2(s, 0), at + glm::vec2(0, s)};
                        for (const uint32_t triangle : {0u, 1u})
                            sum += double(maps.over(scene.meshes[0], triangle, piece).mean.y);
                    }
            EXPECT_NEAR(sum / (2.0 * steps * steps) / (20.0 / (size.x * size.y)), 1.0, 1e-3)
                << size.x << " " << size.y << " " << steps;
        }
    }
}

TEST(Emission, ManyRepetitionsHaveTheMean) {
    std::mt19937 random(2);
    for (const Wrap wrap : {Wrap::repeat, Wrap::mirrored_repeat}) {
        Scene scene = textured(random, 5, 3, {-1, wrap, wrap, false});
        for (glm::vec2& uv : scene.meshes[0].uv_emission)
            uv *= glm::vec2(1e3f, 0.5e3f);
        glm::dvec3 mean{0.0};
        for (int i = 0; i < 15; ++i)
            mean += glm::dvec3(scene::sample_texture(
                        scene, 0, {(float(i % 5) + 0.5f) / 5.0f, (float(i / 5) + 0.5f) / 3.0f}))
                    / 15.0;
        const glm::vec3 over = scene::EmissionMaps(scene).over(scene.meshes[0], 0, whole).mean;
        EXPECT_NEAR(double(over.x) / (10.0 * mean.x), 1.0, 1e-3);
        EXPECT_NEAR(double(over.z) / (40.0 * mean.z), 1.0, 1e-3);
    }
}

TEST(Emission, WhatDoesNotCoverDoesNotGlow) {
    std::mt19937 random(6);
    Scene scene = textured(random, 4, 4, {-1, Wrap::repeat, Wrap::repeat, false});
    scene.materials[0].alpha_mode = AlphaMode::blend;
    scene.materials[0].base_color.a = 0.25f;
    const scene::PieceEmission part = scene::EmissionMaps(scene).over(scene.meshes[0], 0, whole);
    scene.materials[0].alpha_mode = AlphaMode::opaque;
    const scene::PieceEmission all = scene::EmissionMaps(scene).over(scene.meshes[0], 0, whole);
    EXPECT_NEAR(part.mean.y / all.mean.y, 0.25f, 0.01f);
    scene.materials[0].emission = glm::vec3(0.0f);
    EXPECT_EQ(scene::EmissionMaps(scene).over(scene.meshes[0], 0, whole).mean, glm::vec3(0.0f));
}

TEST(Emission, IsEvenOrNot) {
    std::mt19937 random(6);
    Scene scene = textured(random, 8, 8, {-1, Wrap::clamp_to_edge, Wrap::clamp_to_edge, true});
    const auto uneven = [&](auto lit) {
        for (int i = 0; i < 64; ++i)
            scene.images[0].rgba[size_t(4 * i)] = lit(i % 8, i / 8) ? 255 : 0;
        for (int i = 0; i < 64; ++i)
            scene.images[0].rgba[size_t(4 * i + 1)] = scene.images[0].rgba[size_t(4 * i + 2)] = 0;
        return scene::unevenness(scene::EmissionMaps(scene).over(scene.meshes[0], 0, whole),
                                 {1, 0, 0}, {1, 1, 0});
    };
    const scene::Unevenness full = uneven([](int, int) { return true; });
    EXPECT_NEAR(full.shift, 0.0f, 1e-5f);
    EXPECT_NEAR(full.spread, 0.0f, 1e-5f);
    const scene::Unevenness fine = uneven([](int x, int y) { return (x + y) % 2 == 0; });
    EXPECT_LT(fine.shift, 0.05f);
    EXPECT_LT(fine.spread, 0.02f);
    EXPECT_NEAR(scene::EmissionMaps(scene).over(scene.meshes[0], 0, whole).lit, 0.5f, 0.1f);
    EXPECT_GT(uneven([](int x, int y) { return x == 7 && y == 4; }).shift, 0.2f);
    EXPECT_GT(uneven([](int x, int y) { return x == 5 && y == 2; }).spread, 0.04f);
}

} // namespace
} // namespace lpvbake
