// Coloured glass against closed forms: the optics of a point, rays, lights, surfaces and paths.
#include "lpvbake/error.h"
#include "reference/peer.h"
#include "reference/reference.h"
#include "scene/material.h"
#include "scenes.h"
#include "surface/flux.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

const glm::vec3 amber{0.8f, 0.4f, 0.2f};

void expect_near(glm::dvec3 value, glm::dvec3 expected, double tolerance) {
    for (int channel = 0; channel < 3; ++channel)
        EXPECT_NEAR(value[channel], expected[channel], tolerance) << channel;
}

/// Glass that transmits, seen from both sides.
int add_glass(Scene& scene, glm::vec3 color, float transmission) {
    const int glass = scenes::add_material(scene, color, glm::vec3(0.0f), true);
    scene.materials[size_t(glass)].transmission = transmission;
    return glass;
}

int add_blended(Scene& scene, glm::vec3 color, float alpha) {
    const int pane = scenes::add_material(scene, color, glm::vec3(0.0f), true);
    scene.materials[size_t(pane)].alpha_mode = AlphaMode::blend;
    scene.materials[size_t(pane)].base_color.a = alpha;
    return pane;
}

/// A pane of 2 x 2 m, `height` above the origin.
void add_pane(Scene& scene, int material, float height) {
    scenes::add_quad(scene, material, {-1, height, -1}, {0, 0, 2}, {2, 0, 0});
}

// ---------------------------------------------------------------- a point

scene::SurfaceSample sample_of(const Material& material) {
    Scene scene;
    scene.materials.push_back(material);
    scenes::add_quad(scene, 0, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    return scene::sample_surface(scene, scene.meshes[0], 0, {0.3f, 0.3f});
}

TEST(Glass, TransmitsByItsColourAndReflectsTheRest) {
    Material material;
    material.base_color = {amber, 0.1f}; // an opaque material's alpha says nothing
    material.transmission = 0.75f;
    const scene::SurfaceSample sample = sample_of(material);
    EXPECT_FLOAT_EQ(sample.alpha, 0.25f);
    EXPECT_EQ(sample.albedo, amber);
    expect_near(sample.tint(), amber, 1e-6);
    expect_near(sample.tint({0.5f, 1.0f, 0.0f}), amber * glm::vec3(0.5f, 1.0f, 0.0f), 1e-6);
    material.transmission = 1.0f; // covers nothing, and is there
    EXPECT_EQ(sample_of(material).alpha, 0.0f);
    expect_near(sample_of(material).tint(), amber, 1e-6);
}

TEST(Glass, BlendedPassesItsShareInTheHueOfAWhiteGround) {
    const auto tint_of = [](glm::vec3 color, float alpha) {
        Material material;
        material.alpha_mode = AlphaMode::blend;
        material.base_color = {color, alpha};
        const scene::SurfaceSample sample = sample_of(material);
        EXPECT_FLOAT_EQ(sample.alpha, alpha);
        return sample.tint();
    };
    expect_near(tint_of({1, 0, 0}, 0.3f), {1, 0.7, 0.7}, 1e-6);
    expect_near(tint_of({0.5f, 0, 0.5f}, 0.8f), {1, 0.2 / 0.6, 1}, 1e-6);
    // How much passes is said by alpha alone: grey and black take no more of it.
    for (const float grey : {0.0f, 0.3f, 1.0f})
        EXPECT_EQ(tint_of(glm::vec3(grey), 0.6f), glm::vec3(1.0f)) << grey;
    // What is not there colours nothing, whatever its texels hold.
    EXPECT_EQ(tint_of({0, 1, 0}, 0.0f), glm::vec3(1.0f));
}

TEST(Glass, CoverageAndTransmissionShareLight) {
    Material material;
    material.base_color = {1, 0, 0, 0.4f};
    material.transmission = 0.5f;
    material.alpha_mode = AlphaMode::blend;
    const scene::SurfaceSample blended = sample_of(material);
    EXPECT_FLOAT_EQ(blended.alpha, 0.2f);
    // 0.6 past the coverage in its hue, and 0.4 * 0.5 through it.
    expect_near((1 - blended.alpha) * blended.tint(), {0.8, 0.6 * 0.6, 0.6 * 0.6}, 1e-6);
    material.alpha_mode = AlphaMode::mask;
    EXPECT_EQ(sample_of(material).alpha, 0.0f); // cut out
    EXPECT_EQ(sample_of(material).tint(), glm::vec3(1.0f));
    material.alpha_cutoff = 0.3f;
    EXPECT_FLOAT_EQ(sample_of(material).alpha, 0.5f);
    expect_near(sample_of(material).tint(), {1, 0, 0}, 1e-6);
}

TEST(Glass, NoMoreLightLeavesThanArrives) {
    for (const float value : {0.0f, 0.3f, 1.0f, 7.0f})
        for (const float alpha : {0.0f, 0.4f, 1.0f})
            for (const float transmission : {0.0f, 0.5f, 1.0f})
                for (const AlphaMode mode :
                     {AlphaMode::opaque, AlphaMode::mask, AlphaMode::blend}) {
                    Material material;
                    material.base_color = {value, 0.5f, 1.0f, alpha};
                    material.alpha_mode = mode;
                    material.transmission = transmission;
                    const scene::SurfaceSample s = sample_of(material);
                    const glm::vec3 leaves = s.alpha * s.albedo + (1 - s.alpha) * s.tint();
                    for (int channel = 0; channel < 3; ++channel) {
                        EXPECT_GE(leaves[channel], 0.0f);
                        EXPECT_LE(leaves[channel], 1.0f + 1e-6f);
                    }
                }
}

// ---------------------------------------------------------------- rays

TEST(Glass, PanesMultiplyOnTheWayOfARay) {
    Scene scene;
    const int glass = add_glass(scene, amber, 0.5f), blended = add_blended(scene, {1, 0, 0}, 0.25f);
    add_pane(scene, glass, 1.0f);
    add_pane(scene, glass, 2.0f);
    add_pane(scene, blended, 3.0f);
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {-1, 0, -1}, {0, 0, 2},
                     {2, 0, 0});
    const visibility::Visibility visibility(scene, scene::Frame{});
    const glm::dvec3 three = glm::dvec3(amber) * glm::dvec3(amber) * glm::dvec3(1, 0.75, 0.75);
    const visibility::Ray down{{0.3f, 4.0f, 0.4f}, {0, -1, 0}, 0.0f, 3.5f};
    expect_near(visibility.filter(down), 0.25 * 0.75 * three, 1e-6);
    EXPECT_FLOAT_EQ(visibility.transmittance(down), 0.25f * 0.75f);
    expect_near(visibility.tint(down), three, 1e-6);
    // A ray that passes all of them, by chance, is tinted by all, whether it hits something or not.
    std::array<int, 4> ends{};
    const glm::dvec3 tints[] = {
        three, glm::dvec3(amber) * glm::dvec3(1, 0.75, 0.75), {1, 0.75, 0.75}, {1, 1, 1}};
    std::vector<visibility::Ray> rays;
    for (int i = 0; i < 800; ++i)
        rays.push_back({{-0.9f + 0.002f * float(i), 4.0f, 0.3f}, {0, -1, 0}, 0.0f, HUGE_VALF});
    std::vector<visibility::Hit> eights(rays.size());
    visibility.closest_of_eights(rays, visibility::Bundle::tight, eights);
    for (size_t i = 0; i < rays.size(); ++i) {
        const visibility::Hit hit = visibility.closest(rays[i]);
        const size_t end = hit.instance == 3 ? 0 : hit.instance + 1;
        ++ends[end];
        expect_near(hit.tint, tints[end], 1e-6);
        EXPECT_EQ(eights[i].tint, hit.tint);
        visibility::Ray up = rays[i];
        up.origin.y = 0.5f;
        up.direction = -up.direction;
        const visibility::Hit above = visibility.closest(up);
        if (above.instance == visibility::no_hit) {
            expect_near(above.tint, three, 1e-6);
        }
    }
    EXPECT_NEAR(ends[3] / 800.0, 0.25, 0.06);
    EXPECT_NEAR(ends[0] / 800.0, 0.75 * 0.25, 0.06);
}

TEST(Glass, AVolumeAttenuatesOnceEitherWay) {
    for (const double scale : {1.0, 2.0}) {
        Scene scene;
        const int glass = add_glass(scene, glm::vec3(1.0f), 1.0f);
        scene.materials[size_t(glass)].double_sided = false;
        scene.materials[size_t(glass)].attenuation = {0.5f, 0.8f, 1.0f};
        scenes::add_box(scene, glass, glm::vec3(-0.1f), glm::vec3(0.1f), scenes::Facing::outward,
                        glm::scale(glm::dmat4(1.0), glm::dvec3(scale)));
        for (const bool cull : {false, true}) {
            scene.rules.cull_backfaces = cull;
            const visibility::Visibility visibility(scene, scene::Frame{});
            for (const float way : {1.0f, -1.0f})
                expect_near(visibility.filter({{0.03f, -way, 0.05f}, {0, way, 0}, 0.0f, 2.0f}),
                            glm::pow(glm::dvec3(0.5, 0.8, 1.0), glm::dvec3(scale)), 1e-6);
        }
    }
}

// ---------------------------------------------------------------- lights

/// Illuminance of a floor of 6 x 6 m, [-3, 3] along x and z, at patches between two x.
struct Floor {
    scene::Frame frame{glm::dvec3(-3.1, -0.1, -3.1), 0.25, glm::dvec3(25, 12, 25)};
    visibility::Visibility visibility;
    surface::LitSurfaces lit;
    surface::PunctualLight light;

    explicit Floor(const Scene& scene) : visibility(scene, frame) {
        Progress silent;
        surface::LightingSettings dark;
        dark.bounces = 0;
        lit = surface::light_surfaces(scene, visibility, frame, dark, silent);
        light = surface::illuminate(scene, scene.lights, lit, frame, 0, silent);
    }
    glm::dvec3 power(double from, double to) const {
        glm::dvec3 sum(0.0);
        for (size_t i = 0; i < lit.patches.size(); ++i) {
            const surface::Patch& patch = lit.patches[i];
            const double x = frame.to_world(glm::dvec3(patch.position)).x;
            if (patch.instance == 0 && x > from && x < to)
                sum += glm::dvec3(light.lux[2 * i]) * double(patch.area) * frame.unit * frame.unit;
        }
        return sum;
    }
};

Scene sunlit_floor() {
    Scene scene = scenes::floor_quad(6.0f, glm::vec3(0.5f));
    scene.lights.push_back(scenes::sun({0, -1, 0}, 1.0, {1, 0.9f, 0.8f}));
    return scene;
}

TEST(Glass, ColoursTheLightOfASun) {
    for (const float transmission : {0.6f, 1.0f})
        for (const int panes : {1, 2}) {
            Scene scene = sunlit_floor();
            const int glass = add_glass(scene, amber, transmission);
            for (int i = 0; i < panes; ++i)
                add_pane(scene, glass, 1.0f + float(i));
            const Floor floor(scene);
            const glm::dvec3 lux(1, 0.9, 0.8);
            const glm::dvec3 left =
                glm::pow(double(transmission) * glm::dvec3(amber), glm::dvec3(panes));
            expect_near(floor.power(-3, 3) / (32.0 + 4.0 * left) / lux, glm::dvec3(1.0), 0.01);
            expect_near(floor.power(-0.5, 0.5) / (4.0 + 2.0 * left) / lux, glm::dvec3(1.0), 0.04);
        }
}

TEST(Glass, ATextureColoursByItsAreas) {
    Scene scene = sunlit_floor();
    scene.lights[0].color = glm::vec3(1.0f);
    const int glass = add_glass(scene, glm::vec3(1.0f), 0.8f);
    scene.images.push_back({"halves", 2, 1, {255, 0, 0, 255, 0, 0, 255, 255}});
    scene.textures.push_back({0, Wrap::clamp_to_edge, Wrap::clamp_to_edge, true});
    scene.materials[size_t(glass)].base_color_texture = 0;
    scenes::add_quad(scene, glass, {-3, 2, 3}, {6, 0, 0}, {0, 0, -6}); // u along x
    const Floor floor(scene);
    expect_near(floor.power(-3, 3) / 36.0, {0.4, 0, 0.4}, 0.008);
    expect_near(floor.power(-3, -0.3) / (6 * 2.7), {0.8, 0, 0}, 0.05);
    expect_near(floor.power(0.3, 3) / (6 * 2.7), {0, 0, 0.8}, 0.05);
}

TEST(Glass, WhatIsGreyOrWhiteHasTheBitsOfAlphaAlone) {
    Scene scene = sunlit_floor();
    add_pane(scene, add_blended(scene, glm::vec3(0.3f), 0.4f), 1.0f);
    const Floor grey(scene);
    EXPECT_TRUE(grey.visibility.is_tinted()); // which costs time, and changes nothing
    scene.materials[1].base_color = {1, 1, 1, 0.4f};
    const Floor white(scene);
    EXPECT_FALSE(white.visibility.is_tinted());
    EXPECT_EQ(grey.light.lux, white.light.lux);
    EXPECT_EQ(grey.lit.cut_from.size(), 0u); // what falls on all of it by chance is not narrow
    EXPECT_LT(grey.light.narrow, 0.01 * grey.light.landed);
    scene.materials[1].alpha_mode = AlphaMode::opaque; // the same pane as glass that transmits
    scene.materials[1].transmission = 1.0f - 0.4f;
    EXPECT_EQ(Floor(scene).light.lux, white.light.lux);
    scene.materials[1].base_color.y = 0.9f;
    EXPECT_NE(Floor(scene).light.lux, white.light.lux);
}

// ---------------------------------------------------------------- a room of glass

const glm::dvec3 in_glass_room = scenes::luminance_in_glass_room();

TEST(Glass, ARoomOfItByPaths) {
    for (const bool sky : {false, true}) {
        const Scene scene = scenes::glass_room(sky);
        reference::ReferenceSettings settings;
        settings.paths.bounces = {};
        settings.rays = 4096;
        Progress silent;
        const Grid grid{glm::dvec3(1.2), 1.6 / 3, glm::ivec3(3)};
        const reference::Reference r = reference::make_reference(scene, grid, settings, silent);
        glm::dvec3 mean(0.0);
        for (const glm::vec3& c : r.volume.sh[0])
            mean += glm::dvec3(c) * double(volume::sh_y0) / double(grid.size());
        expect_near(mean / in_glass_room, glm::dvec3(1.0), 0.01);

        const visibility::Visibility visibility(scene, scene::Frame{});
        reference::PeerSettings peer;
        peer.paths.bounces = {};
        peer.rays = 1000;
        std::vector<glm::vec3> points;
        for (int i = 0; i < 40; ++i)
            points.push_back(glm::vec3(1.3f + 0.03f * float(i), 1.9f, 2.2f));
        const reference::PeerField field =
            reference::trace_peer(scene, visibility, scene::Frame{}, points, peer);
        mean = glm::dvec3(0.0);
        for (const glm::vec3& c : field.sh[0])
            mean += glm::dvec3(c) * double(volume::sh_y0) / double(points.size());
        expect_near(mean / in_glass_room, glm::dvec3(1.0), 0.015);
    }
}

TEST(Glass, ARoomOfItBySurfaces) {
    for (const bool sky : {false, true}) {
        const Scene scene = scenes::glass_room(sky);
        const scene::Frame frame{glm::dvec3(0.0), 0.5, glm::dvec3(8.0)};
        const visibility::Visibility visibility(scene, frame);
        surface::LightingSettings settings;
        settings.bounces = {};
        settings.rays = 1 << 18;
        Progress silent;
        const surface::LitSurfaces lit =
            surface::light_surfaces(scene, visibility, frame, settings, silent);
        glm::dvec3 sum(0.0);
        double area = 0.0;
        for (size_t i = 0; i < lit.patches.size(); ++i)
            if (lit.patches[i].alpha < 1.0f) {
                sum += double(lit.patches[i].area) * glm::dvec3(lit.luminance[2 * i]);
                area += double(lit.patches[i].area);
            }
        // What its walls reflect is r of what is inside.
        expect_near(sum / area / (glm::dvec3(amber) * in_glass_room), glm::dvec3(1.0), 0.01);
        // And what arrives at points within, by rays of their own and shared ones.
        const std::vector<surface::SidePoint> points(64, {glm::vec3(4.0f), {0, 1, 0}});
        for (const glm::vec3 lux :
             {surface::irradiance_at(scene, lit, points, true, 256, 1, silent)[0],
              surface::shared_irradiance_at(scene, lit, points, true, 64, 1, silent)[0].irradiance})
            expect_near(glm::dvec3(lux) / glm::pi<double>() / in_glass_room, glm::dvec3(1.0), 0.1);
    }
}

} // namespace
} // namespace lpvbake
