// Conventions and axes: what other programs' formulas make of the stored numbers is what the
// canonical coefficients say.
#include "volume/convention.h"

#include "volume/sh.h"
#include "volumes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <span>

namespace lpvbake {
namespace {

constexpr double pi = std::numbers::pi;
constexpr volume::ShConvention all_conventions[] = {
    volume::ShConvention::radiance, volume::ShConvention::irradiance, volume::ShConvention::lpv,
    volume::ShConvention::godot,    volume::ShConvention::unity,      volume::ShConvention::unreal};
constexpr volume::Axes all_axes[] = {volume::Axes::gltf, volume::Axes::unity, volume::Axes::unreal,
                                     volume::Axes::blender};

std::vector<glm::dvec3> some_directions() {
    std::vector<glm::dvec3> all;
    for (int i = 0; i < 50; ++i) {
        const double z = 1.0 - (2 * i + 1) / 50.0, phi = 2.4 * i, r = std::sqrt(1.0 - z * z);
        all.push_back({r * std::cos(phi), r * std::sin(phi), z});
    }
    return all;
}

/// A cell's coefficients of one colour.
std::vector<float> at(const Volume& volume, size_t cell, int c) {
    std::vector<float> all;
    for (const auto& cells : volume.sh)
        all.push_back(cells[cell][c]);
    return all;
}

/// What each program computes from its numbers v, towards n; written from its own formula.
double their_value(volume::ShConvention convention, std::span<const float> v, glm::dvec3 n) {
    const double x = n.x, y = n.y, z = n.z;
    const bool two = v.size() == 9;
    switch (convention) {
    case volume::ShConvention::radiance: // three.js, SphericalHarmonics3.getIrradianceAt
        return v[0] * 0.886227 + 2 * 0.511664 * (v[1] * y + v[2] * z + v[3] * x)
               + (two ? 2 * 0.429043 * (v[4] * x * y + v[5] * y * z + v[7] * x * z)
                            + v[6] * (0.743125 * z * z - 0.247708)
                            + v[8] * 0.429043 * (x * x - y * y)
                      : 0);
    case volume::ShConvention::irradiance: {
        const volume::ShValues basis = volume::sh_basis(two ? 2 : 1, n);
        double sum = 0;
        for (size_t k = 0; k < v.size(); ++k)
            sum += double(v[k]) * double(basis[k]);
        return sum;
    }
    case volume::ShConvention::lpv: // the shaders of light propagation volumes, looking along -n
        return 0.282095 * v[0] - 0.488603 * -y * v[1] + 0.488603 * -z * v[2] - 0.488603 * -x * v[3];
    case volume::ShConvention::godot: // scene_forward_lights_inc.glsl: convolved by the engine
        return 0.886227 * v[0] + 1.023328 * (v[1] * y + v[2] * z + v[3] * x)
               + (two ? 0.858086 * (v[4] * x * y + v[5] * y * z + v[7] * x * z)
                            + 0.247708 * v[6] * (3 * z * z - 1) + 0.429043 * v[8] * (x * x - y * y)
                      : 0);
    case volume::ShConvention::unity: // UnityCG.cginc, ShadeSH9
        return v[0] + v[1] * y + v[2] * z + v[3] * x
               + (two ? v[4] * x * y + v[5] * y * z + v[6] * z * z + v[7] * z * x
                            + v[8] * (x * x - y * y)
                      : 0);
    case volume::ShConvention::unreal: // SHCommon.ush: basis with the signs of Condon and Shortley
        return pi * 0.282095 * v[0] + 2 * pi / 3 * 0.488603 * (-v[1] * y + v[2] * z - v[3] * x)
               + (two ? pi / 4
                            * (1.092548 * (v[4] * x * y - v[5] * y * z - v[7] * x * z)
                               + 0.315392 * v[6] * (3 * z * z - 1)
                               + 0.546274 * v[8] * (x * x - y * y))
                      : 0);
    }
    return 0;
}

TEST(Convention, TheirFormulasGiveOurIrradiance) {
    for (const volume::ShConvention convention : all_conventions)
        for (int order = 1; order <= std::min(2, volume::highest_order(convention)); ++order) {
            const Volume volume = random_volume({3, 2, 2}, order, false, 5);
            Volume stored = volume;
            volume::encode(convention, order, stored.sh);
            const bool over_pi = convention == volume::ShConvention::godot
                                 || convention == volume::ShConvention::unity;
            for (size_t cell = 0; cell < volume.grid.size(); ++cell)
                for (int c = 0; c < 3; ++c)
                    for (const glm::dvec3 n : some_directions()) {
                        const double ours = volume::sh_irradiance(at(volume, cell, c), n);
                        const double theirs = their_value(convention, at(stored, cell, c), n);
                        EXPECT_NEAR(theirs * (over_pi ? pi : 1.0), ours, 0.02)
                            << volume::name_of(convention) << ' ' << order;
                    }
        }
}

TEST(Convention, ComesBack) {
    for (const volume::ShConvention convention : all_conventions) {
        const int order = std::min(4, volume::highest_order(convention));
        const Volume volume = random_volume({3, 4, 5}, order, false, 6);
        Volume there = volume;
        volume::encode(convention, order, there.sh);
        EXPECT_EQ(there.sh == volume.sh, convention == volume::ShConvention::radiance);
        volume::decode(convention, order, there.sh);
        if (convention == volume::ShConvention::radiance
            || convention == volume::ShConvention::unreal) {
            EXPECT_EQ(there.sh, volume.sh);
        }
        for (size_t k = 0; k < volume.sh.size(); ++k)
            for (size_t cell = 0; cell < volume.grid.size(); ++cell)
                for (int c = 0; c < 3; ++c)
                    EXPECT_NEAR(there.sh[k][cell][c], volume.sh[k][cell][c], 1e-3)
                        << volume::name_of(convention); // of 1000
    }
}

TEST(Convention, NamesAreTheirOwn) {
    for (const volume::ShConvention convention : all_conventions)
        EXPECT_EQ(volume::convention_named(volume::name_of(convention)), convention);
    for (const volume::Axes axes : all_axes)
        EXPECT_EQ(volume::axes_named(volume::name_of(axes)), axes);
    EXPECT_FALSE(volume::convention_named("Radiance"));
    EXPECT_FALSE(volume::axes_named(""));
}

TEST(Turned, LatticeAndDirectionsTurnTogether) {
    const Volume volume = random_volume({3, 4, 5}, 4, true, 7);
    for (const volume::Axes axes : all_axes) {
        const glm::dmat3 turn = volume::from_gltf(axes);
        Volume other = volume;
        volume::turn_axes(turn, other);
        EXPECT_EQ(other.metadata, volume.metadata);
        for (int z = 0; z < 5; ++z)
            for (int y = 0; y < 4; ++y)
                for (int x = 0; x < 3; ++x) {
                    const size_t here = volume.grid.index({x, y, z});
                    const glm::dvec3 there =
                        other.grid.to_grid(turn * volume.grid.center({x, y, z}));
                    const glm::ivec3 cell(glm::floor(there));
                    ASSERT_TRUE(other.grid.contains(cell));
                    for (int a = 0; a < 3; ++a)
                        EXPECT_NEAR(there[a], cell[a] + 0.5, 1e-9);
                    const size_t i = other.grid.index(cell);
                    EXPECT_EQ(other.validity[i], volume.validity[here]);
                    for (const glm::dvec3 n : some_directions())
                        EXPECT_NEAR(volume::sh_irradiance(at(other, i, 1), turn * n),
                                    volume::sh_irradiance(at(volume, here, 1), n), 0.02)
                            << volume::name_of(axes);
                    EXPECT_EQ(other.occlusion[0][i], volume.occlusion[0][here]);
                    const glm::dvec3 lobe(volume.occlusion[3][here], volume.occlusion[1][here],
                                          volume.occlusion[2][here]);
                    EXPECT_EQ(glm::dvec3(other.occlusion[3][i], other.occlusion[1][i],
                                         other.occlusion[2][i]),
                              turn * lobe);
                    for (size_t k = 0; k < volume.walls.size(); ++k)
                        EXPECT_EQ(glm::dvec3(other.walls[k][i]),
                                  turn * glm::dvec3(volume.walls[k][here]));
                }
        Volume back = other;
        volume::turn_axes(glm::transpose(turn), back);
        EXPECT_EQ(back.grid.dims, volume.grid.dims);
        for (int a = 0; a < 3; ++a)
            EXPECT_NEAR(back.grid.origin[a], volume.grid.origin[a], 1e-12);
        for (size_t k = 0; k < 4; ++k)
            EXPECT_EQ(back.sh[k], volume.sh[k]) << k;
        EXPECT_EQ(back.occlusion, volume.occlusion);
        EXPECT_EQ(back.validity, volume.validity);
        EXPECT_EQ(back.walls, volume.walls);
    }
}

TEST(Turned, AreTheAxesThatTheProgramsHave) {
    // A point 1 m to the right, 2 m up and 3 m towards the viewer.
    const glm::dvec3 p(1, 2, 3);
    EXPECT_EQ(volume::from_gltf(volume::Axes::unity) * p, glm::dvec3(-1, 2, 3));
    EXPECT_EQ(volume::from_gltf(volume::Axes::unreal) * p, glm::dvec3(1, 3, 2));
    EXPECT_EQ(volume::from_gltf(volume::Axes::blender) * p, glm::dvec3(1, -3, 2));
    // Handedness.
    EXPECT_EQ(glm::determinant(volume::from_gltf(volume::Axes::blender)), 1.0);
    EXPECT_EQ(glm::determinant(volume::from_gltf(volume::Axes::unity)), -1.0);
    EXPECT_EQ(glm::determinant(volume::from_gltf(volume::Axes::unreal)), -1.0);
}

} // namespace
} // namespace lpvbake
