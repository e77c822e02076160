// Operators of local radiance transfer beside closed forms, and what carries light by them.
#include "scenes.h"
#include "transfer/relight.h"
#include "volume/convention.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

namespace lpvbake {
namespace {

using transfer::Light4;
using transfer::LocalTransfer;

constexpr double pi = std::numbers::pi;
const glm::vec3 red_blue{0.8f, 0.5f, 0.1f};

/// Far from where anything is asked.
Scene nothing() {
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, glm::vec3(0.5f)), {1e4f, 1e4f, 1e4f},
                     {1e-3f, 0, 0}, {0, 1e-3f, 0});
    return scene;
}

/// Of radius 1 about the origin, its fronts inside.
Scene sphere(glm::vec3 albedo, glm::vec3 emission = glm::vec3(0.0f)) {
    Scene scene;
    const int material = scenes::add_material(scene, albedo, emission);
    Mesh mesh;
    mesh.material = material;
    constexpr int rows = 64, columns = 128;
    const auto at = [](int row, int column) {
        const double polar = pi * row / rows, azimuth = 2 * pi * column / columns;
        return glm::vec3(std::sin(polar) * std::cos(azimuth), std::cos(polar),
                         std::sin(polar) * std::sin(azimuth));
    };
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            const auto first = uint32_t(mesh.positions.size());
            mesh.positions.insert(mesh.positions.end(),
                                  {at(row, column), at(row + 1, column), at(row + 1, column + 1),
                                   at(row, column + 1)});
            for (const glm::uvec3 triangle : {glm::uvec3(0, 1, 2), glm::uvec3(0, 2, 3)})
                mesh.triangles.push_back(first + triangle);
        }
    scene.meshes.push_back(std::move(mesh));
    scene.instances.push_back({0, glm::dmat4(1.0)});
    return scene;
}

LocalTransfer find(const Scene& scene, glm::vec3 place, float radius) {
    const scene::Frame frame{glm::dvec3(0), 1.0, glm::dvec3(1)};
    return transfer::find_local_transfer(scene, visibility::Visibility(scene, frame), place,
                                         radius);
}

/// The greatest difference of an operator from one of albedo 1, over channels of this albedo.
double difference(const std::array<glm::vec3, 16>& from, const std::array<double, 16>& white,
                  glm::vec3 albedo) {
    double most = 0;
    for (std::size_t k = 0; k < 16; ++k)
        for (int channel = 0; channel < 3; ++channel)
            most = std::max(
                most, std::abs(double(from[k][channel]) - white[k] * double(albedo[channel])));
    return most;
}

std::array<glm::vec3, 16> transposed(const std::array<glm::vec3, 16>& from) {
    std::array<glm::vec3, 16> to;
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 4; ++j)
            to[4 * j + i] = from[4 * i + j];
    return to;
}

TEST(LocalTransfer, InTheOpenNothingReflectsAndAllIsSeen) {
    const LocalTransfer local = find(nothing(), {0.3f, 0.2f, 0.1f}, 5);
    for (const glm::vec3& value : local.reflected)
        EXPECT_EQ(value, glm::vec3(0.0f));
    EXPECT_NEAR(local.visible[0], std::sqrt(4 * pi), 1e-5);
    for (std::size_t k = 1; k < 9; ++k)
        EXPECT_NEAR(local.visible[k], 0, 1e-5);
}

TEST(LocalTransfer, OfAClosedSphereIsDiagonal) {
    const LocalTransfer local = find(sphere(red_blue, {0, 2, 3}), glm::vec3(0.0f), 1.1f);
    std::array<double, 16> white{};
    white[0] = 1;
    white[5] = white[10] = white[15] = -2.0 / 3;
    EXPECT_LT(difference(local.reflected, white, red_blue), 1e-3);
    for (const float value : local.visible)
        EXPECT_EQ(value, 0.0f);
    EXPECT_NEAR(local.emitted[0].z, 3 * std::sqrt(4 * pi), 1e-4);
    // A lost sign of band 1 is told.
    white[5] = 2.0 / 3;
    EXPECT_GT(difference(local.reflected, white, red_blue), 0.5);
    // What is not within the radius is beyond.
    EXPECT_NEAR(find(sphere(red_blue), glm::vec3(0.0f), 0.9f).visible[0], std::sqrt(4 * pi), 1e-5);
}

TEST(LocalTransfer, BesideAPlaneIsTheProductOfWhatIsSeenAndLit) {
    // (rho / pi) d e^T, d what the lower half of the directions is, e what lights the plane.
    const double d[] = {std::sqrt(pi), -1.53499, 0, 0}, e[] = {0.88623, 1.02333, 0, 0};
    std::array<double, 16> white{};
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 4; ++j)
            white[4 * i + j] = d[i] * e[j] / pi;
    const LocalTransfer local = find(scenes::floor_quad(1000, red_blue), {0.3f, 0.2f, 0.1f}, 1e4f);
    EXPECT_LT(difference(local.reflected, white, red_blue), 3e-3);
    EXPECT_GT(difference(transposed(local.reflected), white, red_blue), 0.5);
    EXPECT_NEAR(local.visible[0], std::sqrt(pi), 1e-3);
    EXPECT_NEAR(local.visible[1], 1.53499, 5e-3);
    for (std::size_t k = 4; k < 9; ++k)
        EXPECT_NEAR(local.visible[k], 0, 5e-3) << k;
    // The product of it: half of each of order 1, and sqrt(3) / 4 between bands 0 and 1.
    const std::vector<double> product = volume::sh_product(1, local.visible);
    EXPECT_NEAR(product[0], 0.5, 1e-3);
    EXPECT_NEAR(product[volume::sh_count(volume::sh_max_order) * 1 + 1], 0.5, 3e-3);
    EXPECT_NEAR(product[1], std::sqrt(3.0) / 4, 2e-3);
}

TEST(LocalTransfer, AMaskOfOrderOneWouldMakeLight) {
    // A wall hides a cone about -y whose edge is at the cosine c.
    const double c = 0.58, band2 = std::sqrt(5 / (4 * pi)) * pi * (c * c * c - c);
    std::array<float, 9> visible{};
    visible[0] = float(std::sqrt(pi) * (1 + c));
    visible[1] = float(std::sqrt(3 * pi) / 2 * (1 - c * c));
    visible[6] = float(-0.5 * band2); // the harmonic that is even about y
    visible[8] = float(-0.5 * std::sqrt(3.0) * band2);
    // The greatest eigenvalue of the product between band 0 and y.
    const auto greatest = [](std::span<const float> mask) {
        const std::vector<double> product = volume::sh_product(1, mask);
        const double one = product[0], off = product[1],
                     other = product[volume::sh_count(volume::sh_max_order) + 1];
        return (one + other) / 2 + std::hypot((one - other) / 2, off);
    };
    EXPECT_LT(greatest(visible), 1.0);
    EXPECT_NEAR(greatest(std::span(visible).first(4)), 1.077, 1e-3);
}

TEST(LocalTransfer, ABackReflectsNothingAndHidesWhatIsBeyond) {
    const LocalTransfer local = find(scenes::floor_quad(1000, red_blue), {0, -0.2f, 0}, 1e4f);
    for (const glm::vec3& value : local.reflected)
        EXPECT_EQ(value, glm::vec3(0.0f));
    EXPECT_NEAR(local.visible[1], -1.53499, 5e-3);
}

// ---------------------------------------------------------------- operators of a lattice

/// A lattice of unit cells from the origin, all valid.
Volume lattice(glm::ivec3 dims, const Scene& scene, float radius) {
    Volume volume;
    volume.grid.dims = dims;
    volume.validity.assign(volume.grid.size(), 1.0f);
    const visibility::Visibility visibility(scene, scene::frame_of(volume.grid));
    transfer::add_local_transfer(scene, visibility, radius, volume);
    volume.metadata["local_radius"] = std::to_string(radius);
    return volume;
}

std::vector<float> values_of(const Volume& volume, const GridKind& kind) {
    std::vector<float> values;
    for (const volume::ConstGridView& grid : volume::grids_of(volume, kind))
        values.insert(values.end(), grid.values().begin(), grid.values().end());
    return values;
}

TEST(LocalTransfer, OperatorsOfObjectsAddUpWhereNeitherHidesTheOther) {
    const auto with = [](bool left, bool right) {
        Scene scene;
        if (left)
            scenes::add_box(scene, scenes::add_material(scene, {0.7f, 0.2f, 0.1f}), {0.4f, 1, 1},
                            {1.6f, 2, 2}, scenes::Facing::outward);
        if (right)
            scenes::add_box(scene, scenes::add_material(scene, {0.1f, 0.6f, 0.3f}), {4.4f, 1, 1},
                            {5.6f, 2, 2}, scenes::Facing::outward);
        return lattice({6, 3, 3}, scene, 1.9f); // from no cell are both within it
    };
    const Volume both = with(true, true), left = with(true, false), right = with(false, true);
    const auto all = values_of(both, volume::local_transfer_kind());
    const auto one = values_of(left, volume::local_transfer_kind());
    const auto other = values_of(right, volume::local_transfer_kind());
    for (std::size_t i = 0; i < all.size(); ++i)
        EXPECT_NEAR(all[i], one[i] + other[i], 1e-6);
    // Visibilities multiply as functions. What one does not touch the product leaves as it is.
    const std::size_t cells = both.grid.size();
    const auto visible = [&](const Volume& of, std::size_t cell) {
        const auto grids = volume::grids_of(of, volume::local_visibility_kind());
        std::array<float, 9> of_cell;
        for (std::size_t k = 0; k < 9; ++k)
            of_cell[k] = grids[k].data[cell];
        return of_cell;
    };
    for (std::size_t cell = 0; cell < cells; ++cell) {
        const std::vector<double> product = volume::sh_product(2, visible(right, cell));
        for (std::size_t i = 0; i < 9; ++i) {
            double value = 0;
            for (std::size_t k = 0; k < 9; ++k)
                value += product[volume::sh_count(volume::sh_max_order) * i + k]
                         * double(visible(left, cell)[k]);
            EXPECT_NEAR(value, visible(both, cell)[i], 1e-5);
        }
    }
}

TEST(LocalTransfer, TurnsWithTheAxes) {
    // What a scene in other axes has is what the operators become in them.
    Scene scene;
    scenes::add_quad(scene, scenes::add_material(scene, red_blue, glm::vec3(0.0f), true),
                     {0.2f, 0.1f, 0.3f}, {2, 0.4f, -0.3f}, {0.5f, 0.2f, 1.7f});
    for (const volume::Axes axes :
         {volume::Axes::unity, volume::Axes::unreal, volume::Axes::blender}) {
        const glm::dmat3 turn = volume::from_gltf(axes);
        Volume volume = lattice({2, 2, 2}, scene, 3);
        Scene turned = scene;
        for (glm::vec3& position : turned.meshes[0].positions)
            position = glm::vec3(turn * glm::dvec3(position));
        volume::turn_axes(turn, volume);
        Volume own;
        own.grid = volume.grid;
        own.validity.assign(8, 1.0f);
        transfer::add_local_transfer(
            turned, visibility::Visibility(turned, scene::frame_of(own.grid)), 3, own);
        for (const GridKind* kind :
             {&volume::local_transfer_kind(), &volume::local_visibility_kind()}) {
            const auto as = values_of(volume, *kind), is = values_of(own, *kind);
            for (std::size_t i = 0; i < as.size(); ++i)
                EXPECT_NEAR(as[i], is[i], 1e-5) << kind->name << " " << i;
        }
    }
}

// ---------------------------------------------------------------- propagation

transfer::Propagated run(const Volume& volume, const transfer::Sources& sources,
                         std::optional<int> iterations = {}, double missing = 1e-7) {
    Progress silent;
    return transfer::propagate(volume, sources, {iterations, missing, 4096}, silent);
}

double energy(const std::vector<Light4>& field, int channel = 0) {
    double sum = 0;
    for (const Light4& light : field)
        sum += double(light[0][channel]);
    return sum;
}

TEST(Propagation, AnEvenSkyInTheOpenIsEvenEverywhere) {
    const Volume volume = lattice({7, 5, 6}, nothing(), 2);
    transfer::Sources sources;
    sources.beyond = [](glm::vec3) { return glm::vec3(1, 2, 3); };
    for (const Light4& light : run(volume, sources).field) {
        for (int channel = 0; channel < 3; ++channel)
            EXPECT_NEAR(light[0][channel], (1 + channel) * std::sqrt(4 * pi), 2e-4);
        for (std::size_t k = 1; k < 4; ++k)
            EXPECT_NEAR(light[k].z, 0, 2e-4);
    }
}

TEST(Propagation, InTheOpenAHopNeitherMakesNorLosesLight) {
    const Volume volume = lattice(glm::ivec3(13), nothing(), 2);
    transfer::Sources sources;
    sources.emitted.resize(volume.grid.size());
    const std::size_t middle = volume.grid.index(glm::ivec3(6));
    // A beam as narrow as order 1 has it, from +x.
    sources.emitted[middle] = {glm::vec3(1), glm::vec3(0), glm::vec3(0),
                               glm::vec3(std::sqrt(3.0f))};
    for (const int hops : {2, 4, 6}) {
        const std::vector<Light4> field = run(volume, sources, hops).field;
        EXPECT_NEAR(energy(field), hops, 1e-5 * hops); // what was sent in each hop
        // Light comes from there, and goes the other way as far in each hop; and aside.
        glm::dvec3 way(0.0);
        double aside = 0;
        for (std::size_t cell = 0; cell < field.size(); ++cell) {
            const glm::dvec3 from(volume.grid.cell_at(cell) - 6);
            way += double(field[cell][0].x) * from;
            aside += double(field[cell][0].x) * (from.y * from.y + from.z * from.z);
        }
        const double since = 0.5 * (hops - 1); // hops ago, in the mean, it was sent
        EXPECT_NEAR(way.x / hops / since, -transfer::hop_length, 1e-3);
        EXPECT_NEAR(way.y, 0, 1e-4);
        if (hops == 2) { // after one
            EXPECT_NEAR(aside / hops / since, 1.334, 1e-2);
        }
    }
}

TEST(Propagation, AFurnaceIsItsClosedForm) {
    // All walls within the radius: endless reflections among near surfaces alone.
    Scene scene = scenes::furnace(4, 0.6f, 1);
    Volume volume = lattice(glm::ivec3(4), scene, 8);
    const visibility::Visibility visibility(scene, scene::frame_of(volume.grid));
    Progress silent;
    transfer::relight(scene, visibility, scene::frame_of(volume.grid), {}, volume, silent);
    for (const glm::vec3& light : volume.sh[0])
        EXPECT_NEAR(light.x, std::sqrt(4 * pi) / (1 - 0.6), 0.01);
    // Walls beyond that of most cells: carried, and a ninth of it lost to the darkness beyond
    // walls.
    volume = lattice(glm::ivec3(8), scenes::furnace(8, 0.6f, 1), float(transfer::hop_length));
    scene = scenes::furnace(8, 0.6f, 1);
    const visibility::Visibility larger(scene, scene::frame_of(volume.grid));
    transfer::relight(scene, larger, scene::frame_of(volume.grid), {}, volume, silent);
    double mean = 0;
    for (const glm::vec3& light : volume.sh[0])
        mean += double(light.x) / double(volume.sh[0].size());
    EXPECT_NEAR(mean, 0.89 * std::sqrt(4 * pi) / (1 - 0.6), 0.05);
}

TEST(Propagation, OneThreadAndManyGiveTheSameBits) {
    const auto all = [] {
        const Scene scene = scenes::cornell_box_with_point();
        Volume volume;
        volume.grid = {{-1, 0, -1}, 0.25, {8, 8, 8}};
        const scene::Frame frame = scene::frame_of(volume.grid);
        const visibility::Visibility visibility(scene, frame);
        volume.validity.assign(volume.grid.size(), 1.0f);
        transfer::add_local_transfer(scene, visibility, 2, volume);
        volume.metadata["local_radius"] = "0.5";
        Progress silent;
        transfer::relight(scene, visibility, frame, {}, volume, silent);
        return std::pair(values_of(volume, volume::local_transfer_kind()), volume.sh);
    };
    const auto many = all();
    tbb::task_arena alone(1);
    EXPECT_EQ(alone.execute(all), many);
}

} // namespace
} // namespace lpvbake
