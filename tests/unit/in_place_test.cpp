// Surfaces that lie in one place: which is seen, and where the light that falls on them ends.

#include "surface/in_place.h"

#include "scenes.h"
#include "surface/flux.h"
#include "surface/side_points.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

namespace lpvbake {
namespace {

constexpr double hairs[] = {0.0, 1e-6, -1e-6, 1e-4, -1e-4};

/// Straight on the lattice, and turned.
const std::array<glm::dmat4, 2> turns{
    glm::dmat4(1.0), glm::rotate(glm::dmat4(1.0), 0.4, glm::normalize(glm::dvec3(1, 2, 3)))};

std::vector<visibility::Isa> sets() {
    std::vector<visibility::Isa> all;
    for (const visibility::Isa isa : visibility::isas)
        if (isa != visibility::Isa::automatic && visibility::processor_has(isa))
            all.push_back(isa);
    return all;
}

/// A scene with its patches and what its lamps give them.
struct Lit {
    visibility::Visibility visibility;
    surface::LitSurfaces lit;
    surface::PunctualLight light;

    Lit(const Scene& scene, visibility::Isa isa)
        : visibility(scene, {glm::dvec3(-8.0), 1.0, glm::dvec3(16.0)}, isa) {
        const scene::Frame frame{glm::dvec3(-8.0), 1.0, glm::dvec3(16.0)};
        Progress silent;
        surface::LightingSettings dark;
        dark.bounces = 0;
        lit = surface::light_surfaces(scene, visibility, frame, dark, silent);
        light = surface::illuminate(scene, scene.lights, lit, frame, 0, silent);
    }

    /// Square cells of an instance that are seen, of what faces along a vector more or less.
    double seen(uint32_t instance, glm::dvec3 along = glm::dvec3(0.0)) const {
        double sum = 0.0;
        for (const surface::Patch& patch : lit.patches)
            if (patch.instance == instance
                && (along == glm::dvec3(0.0)
                    || glm::dot(glm::dvec3(patch.normal), glm::normalize(along)) > 0.9))
                sum += double(patch.area);
        return sum;
    }
    /// Lumen on one side of an instance.
    double power(uint32_t instance, size_t side) const {
        double sum = 0.0;
        for (size_t i = 0; i < lit.patches.size(); ++i)
            if (lit.patches[i].instance == instance)
                sum += double(light.lux[2 * i + side].y) * double(lit.patches[i].area);
        return sum;
    }
};

int grey(Scene& scene, bool double_sided = false) {
    return scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0.0f), double_sided);
}

void add_sheet(Scene& scene, int material, bool up, const glm::dmat4& there) {
    const glm::vec3 u(8, 0, 0), v(0, 0, 8);
    scenes::add_quad(scene, material, {-4, 0, -4}, up ? v : u, up ? u : v, there);
}

glm::dmat4 raised(const glm::dmat4& turn, double by) {
    return glm::translate(turn, glm::dvec3(0, by, 0));
}

TEST(InPlace, TheUndersideOfWhatStandsOnAFloorIsNotSeen) {
    for (const glm::dmat4& turn : turns)
        for (const bool double_sided : {false, true})
            for (const double hair : hairs) {
                if (double_sided && hair == -1e-4)
                    continue; // it looks out below the floor
                Scene scene;
                add_sheet(scene, grey(scene, double_sided), true, turn);
                scenes::add_box(scene, grey(scene), {-1.5f, 0, -2}, {1.5f, 2, 1},
                                scenes::Facing::outward, raised(turn, hair));
                const glm::dvec3 up = turn * glm::dvec4(0, 1, 0, 0);
                for (const visibility::Isa isa : sets()) {
                    const Lit lit(scene, isa);
                    EXPECT_EQ(lit.seen(1, -up), 0.0) << hair << visibility::name_of(isa);
                    EXPECT_NEAR(lit.seen(1), 9 + 4 * 6, 1e-4) << hair;
                    EXPECT_GE(lit.seen(0), 64 - 9 - 1e-4) << hair;
                    const surface::SidePoints points =
                        surface::draw_side_points(lit.lit, glm::vec3(16.0f), {.density = 9});
                    for (const auto& [position, normal] : points.points) {
                        EXPECT_TRUE(double_sided || glm::dot(glm::dvec3(normal), up) > -0.9);
                    }
                }
            }
}

TEST(InPlace, BothSheetsOfAWallBetweenRoomsAreSeenAndLit) {
    for (const glm::dmat4& turn : turns)
        for (const double hair : {0.0, 1e-6, -1e-6}) {
            // Two rooms, each with walls of its own, and a lamp in the upper.
            Scene scene;
            const int white = grey(scene);
            scenes::add_box(scene, white, {-4, 0, -4}, {4, 3, 4}, scenes::Facing::inward, turn);
            scenes::add_box(scene, white, {-4, -3, -4}, {4, 0, 4}, scenes::Facing::inward,
                            raised(turn, hair));
            scene.lights.push_back(
                scenes::point_light(glm::dvec3(turn * glm::dvec4(0.3, 1.1, 0.2, 1.0)), 100.0));
            for (const visibility::Isa isa : sets()) {
                const Lit lit(scene, isa);
                for (const uint32_t room : {0u, 1u})
                    EXPECT_NEAR(lit.seen(room), 2 * 64 + 4 * 24, 1e-3) << hair;
                EXPECT_NEAR(lit.power(0, 0), 400.0 * glm::pi<double>(), 1.0)
                    << hair << visibility::name_of(isa);
                EXPECT_NEAR(lit.power(1, 0), 0.0, 1.0) << hair;
            }
        }
}

TEST(InPlace, OfTwoSheetsThatFaceAlikeOneIsSeenAndHasAllLight) {
    for (const glm::dmat4& turn : turns)
        for (const bool first_is_double : {false, true})
            for (const bool second_is_double : {false, true})
                for (const double hair : hairs) {
                    Scene scene;
                    add_sheet(scene, grey(scene, first_is_double), true, turn);
                    add_sheet(scene, grey(scene, second_is_double), true, raised(turn, hair));
                    scene.lights.push_back(scenes::sun(turn * glm::dvec4(0.1, -1, 0.2, 0), 100.0));
                    const bool apart = std::abs(hair) > 1e-5;
                    if (apart && (first_is_double || second_is_double))
                        continue; // what lies behind has a side that is seen from there
                    const uint32_t seen = apart ? hair > 0 : second_is_double && !first_is_double;
                    const double lumen = 64.0 * 100.0 / std::sqrt(1.05);
                    for (const visibility::Isa isa : sets()) {
                        const Lit lit(scene, isa);
                        EXPECT_NEAR(lit.seen(seen), 64.0, 1e-4);
                        EXPECT_EQ(lit.seen(1 - seen), 0.0)
                            << hair << first_is_double << second_is_double;
                        EXPECT_NEAR(lit.power(seen, 0), lumen, 5e-3 * lumen)
                            << hair << visibility::name_of(isa);
                        EXPECT_EQ(lit.lit.lost, 0.0);
                        // Rays may meet the other one: it is as bright.
                        for (size_t i = 0; i < lit.light.lux.size(); i += 2)
                            EXPECT_NEAR(lit.light.lux[i].y, lumen / 64.0, 0.01 * lumen);
                    }
                }
}

} // namespace
} // namespace lpvbake
