#include "solver/vpl/lit_vpls.h"
#include "surface/patches.h"

#include "scenes.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

double total_area(const std::vector<surface::Patch>& patches) {
    double sum = 0.0;
    for (const surface::Patch& patch : patches)
        sum += double(patch.area);
    return sum;
}

TEST(Patches, CoverEverySurfaceOnce) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), glm::vec3(1.0f),
                    glm::vec3(8.0f, 5.0f, 3.0f), scenes::Facing::outward);
    const scene::Frame frame{glm::dvec3(0.0), 1.0, glm::dvec3(9.0)};
    const double area = 2.0 * (7 * 4 + 7 * 2 + 4 * 2);
    const std::vector<surface::Patch> coarse = surface::make_patches(scene, frame, 100.0f);
    EXPECT_EQ(coarse.size(), 12u);
    EXPECT_NEAR(total_area(coarse), area, 1e-4 * area);
    const std::vector<surface::Patch> fine = surface::make_patches(scene, frame, 0.7f);
    EXPECT_GT(fine.size(), 400u);
    EXPECT_NEAR(total_area(fine), area, 1e-4 * area);
    // Divergence theorem: the area-weighted normals of a closed surface cancel, and the flux of
    // the position through it is three times the volume.
    glm::dvec3 sum{0.0};
    double flux = 0.0;
    for (const surface::Patch& patch : fine) {
        sum += double(patch.area) * glm::dvec3(patch.normal);
        flux += double(patch.area) * glm::dot(glm::dvec3(patch.normal), glm::dvec3(patch.position));
    }
    EXPECT_LT(glm::length(sum), 1e-3);
    EXPECT_NEAR(flux, 3.0 * 7 * 4 * 2, 1e-2);
}

TEST(Patches, MirroredInstanceFacesTheSameWay) {
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), glm::vec3(1.0f),
                    glm::vec3(2.0f), scenes::Facing::outward,
                    glm::translate(glm::dmat4(1.0), glm::dvec3(4, 0, 0))
                        * glm::scale(glm::dmat4(1.0), glm::dvec3(-1, 1, 1)));
    double flux = 0.0;
    for (const surface::Patch& patch :
         surface::make_patches(scene, {glm::dvec3(0.0), 1.0, glm::dvec3(4.0)}, 0.5f))
        flux += double(patch.area) * glm::dot(glm::dvec3(patch.normal), glm::dvec3(patch.position));
    EXPECT_NEAR(flux, 3.0, 1e-4);
}

TEST(Patches, AHugeTriangleIsCutOnlyInsideTheGrid) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {-1e5f, 2, -1e5f},
                     {0, 0, 2e5f}, {2e5f, 0, 0});
    const std::vector<surface::Patch> patches =
        surface::make_patches(scene, {glm::dvec3(0.0), 1.0, glm::dvec3(16.0)}, 1.0f);
    EXPECT_NEAR(total_area(patches), 256.0, 30.0);
    EXPECT_LT(patches.size(), 4000u);
}

TEST(Patches, ZeroAreaTrianglesGiveNone) {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {1, 1, 1}, {1, 0, 0},
                     {2, 0, 0});
    EXPECT_TRUE(
        surface::make_patches(scene, {glm::dvec3(0.0), 1.0, glm::dvec3(8.0)}, 1.0f).empty());
}

surface::LitSurfaces glowing(const Scene& scene, const scene::Frame& frame) {
    Progress silent;
    surface::LightingSettings settings;
    settings.bounces = 0;
    const visibility::Visibility visibility(scene, frame);
    return surface::light_surfaces(scene, visibility, frame, settings, silent);
}

TEST(Emitters, PowerIsPiTimesLuminanceTimesArea) {
    for (const double unit : {1e-4, 0.25, 100.0}) {
        Scene scene;
        const int lamp = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(10, 20, 40));
        scenes::add_quad(scene, lamp, {0, 0, 0}, {3, 0, 0}, {0, 2, 1},
                         glm::scale(glm::dmat4(1.0), glm::dvec3(unit)));
        const scene::Frame frame{glm::dvec3(-unit), unit, glm::dvec3(6.0)};
        const double area = 3.0 * std::sqrt(5.0) * unit * unit;
        for (const bool both : {false, true}) {
            scene.materials[size_t(lamp)].double_sided = both;
            std::vector<solver::vpl::Vpl> vpls;
            solver::vpl::emit_vpls(glowing(scene, frame), frame, vpls);
            glm::dvec3 power{0.0};
            for (const solver::vpl::Vpl& vpl : vpls)
                power += glm::dvec3(vpl.power);
            const double expected = (both ? 2.0 : 1.0) * glm::pi<double>() * area;
            EXPECT_NEAR(power.x / (10.0 * expected), 1.0, 1e-5);
            EXPECT_NEAR(power.z / (40.0 * expected), 1.0, 1e-5);
        }
    }
}

TEST(Emitters, TheSkyEntersWhereNothingIsInTheWay) {
    // A floor below the whole grid: the lower faces get nothing, the upper ones all of the sky.
    Scene scene = scenes::floor_quad(1e3f, glm::vec3(0.5f));
    const scene::Frame frame{glm::dvec3(-2, 0.5, -2), 0.5, glm::dvec3(8)};
    const visibility::Visibility visibility(scene, frame);
    std::vector<solver::vpl::Vpl> vpls;
    solver::vpl::sky_vpls({glm::vec3(3.0f), {}}, visibility, frame, vpls);
    double top = 0.0, side = 0.0, bottom = 0.0;
    for (const solver::vpl::Vpl& vpl : vpls)
        (vpl.normal.y < -0.5f ? top : vpl.normal.y > 0.5f ? bottom : side) += double(vpl.power.x);
    const double face = glm::pi<double>() * 3.0 * 16.0; // of 4 m x 4 m
    EXPECT_NEAR(top / face, 1.0, 1e-5);
    EXPECT_EQ(bottom, 0.0);
    EXPECT_NEAR(side / (4.0 * face), 0.5, 1e-5);
}

TEST(Emitters, ASmallSpotOfATextureKeepsItsPowerAndItsPlace) {
    // A ceiling of 8 x 8 cells, turned, with a lit spot in its texture; its size in texels of 1024.
    std::mt19937 random(9);
    for (const int size : {1, 3, 10, 60, 200})
        for (int place = 0; place < 4; ++place) {
            Scene scene;
            const int lamp = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(1000.0f));
            const glm::ivec2 at(random() % uint32_t(1024 - size), random() % uint32_t(1024 - size));
            Image image{"spot", 1024, 1024, std::vector<uint8_t>(4 << 20, 0)};
            for (int y = at.y; y < at.y + size; ++y)
                std::fill_n(image.rgba.begin() + 4 * (1024 * y + at.x), 4 * size, uint8_t(255));
            scene.images.push_back(image);
            scene.textures.push_back({0, Wrap::repeat, Wrap::repeat, place % 2 == 0});
            scene.materials[size_t(lamp)].emission_texture = 0;
            const glm::mat3 turn(scenes::random_turn(random));
            const glm::vec3 u = turn * glm::vec3(8, 0, 0), v = turn * glm::vec3(0, 8, 0);
            const int mesh = scenes::add_quad(scene, lamp, glm::vec3(8) - 0.5f * (u + v), u, v);
            scene.meshes[size_t(mesh)].uv_emission = scene.meshes[size_t(mesh)].uv;
            const glm::vec3 spot =
                glm::vec3(8) - 0.5f * (u + v)
                + (u * (float(at.x) + 0.5f * float(size)) + v * (float(at.y) + 0.5f * float(size)))
                      / 1024.0f;
            const surface::LitSurfaces lit =
                glowing(scene, {glm::dvec3(0.0), 1.0, glm::dvec3(16.0)});
            double power = 0.0;
            glm::dvec3 centre{0.0};
            for (const surface::Patch& patch : lit.patches) {
                const double of_patch = double(patch.area) * double(patch.emission.y);
                power += of_patch;
                centre += of_patch * glm::dvec3(patch.position);
                if (patch.emission.y > 0.0f && size < 20) {
                    EXPECT_LT(glm::distance(patch.position, spot), 0.4f) << size;
                }
            }
            EXPECT_NEAR(power / (1000.0 * 64.0 * size * size / (1024.0 * 1024.0)), 1.0, 1e-3)
                << size;
            EXPECT_LT(glm::distance(glm::vec3(centre / power), spot), 0.1f) << size;
            EXPECT_LT(lit.patches.size(), 1500u); // 512 of an even one
        }
}

TEST(Emitters, TextureScalesTheEmission) {
    Scene scene;
    const int lamp = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(10.0f));
    // Left half white, right half black.
    scene.images.push_back({"halves", 2, 1, {255, 255, 255, 255, 0, 0, 0, 255}});
    Texture texture;
    texture.image = 0;
    texture.nearest = true;
    texture.wrap_u = texture.wrap_v = Wrap::clamp_to_edge;
    scene.textures.push_back(texture);
    scene.materials[size_t(lamp)].emission_texture = 0;
    const int mesh = scenes::add_quad(scene, lamp, {1, 1, 1}, {4, 0, 0}, {0, 4, 0});
    scene.meshes[size_t(mesh)].uv_emission = scene.meshes[size_t(mesh)].uv;
    std::vector<solver::vpl::Vpl> vpls;
    const scene::Frame frame{glm::dvec3(0.0), 1.0, glm::dvec3(6.0)};
    solver::vpl::emit_vpls(glowing(scene, frame), frame, vpls);
    double power = 0.0;
    for (const solver::vpl::Vpl& vpl : vpls)
        power += double(vpl.power.x);
    EXPECT_NEAR(power / (glm::pi<double>() * 10.0 * 8.0), 1.0, 0.02);
}

} // namespace
} // namespace lpvbake
