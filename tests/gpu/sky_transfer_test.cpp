// What becomes of any sky: what cells see of it to order 4, and what surfaces reflect of its modes.
#include "bake/layers.h"
#include "gpu/device.h"
#include "lit_layers.h"
#include "scenes.h"
#include "solver/gather/gather.h"
#include "visibility/validity.h"
#include "volume/grid.h"
#include "volume/sh.h"

#include <gtest/gtest.h>

#include <numbers>

namespace lpvbake {
namespace {

using Part = scene::LightLayer::Part;
using std::numbers::pi;

constexpr std::size_t modes = 9, bands_of_sight = 25;

Scene under_white_sky(Scene scene) {
    scene.sky = {};
    scene.sky.luminance = glm::vec3(1.0f);
    return scene;
}

/// What is seen of a sky of one nit, and these parts of nine modes, one after the other.
std::vector<scene::LightLayer> transfer_of(const Scene& scene, std::vector<Part> parts) {
    std::vector<bake::Layer> wanted = bake::make_layers(
        scene, std::vector{bake::LayerWish{bake::LayerWish::Kind::transfer, {}, {}, 2}}, true);
    std::vector<scene::LightLayer> layers;
    for (const bake::Layer& layer : wanted)
        if (layer.kind == "visibility")
            layers.push_back(layer.light);
    for (const Part part : parts)
        for (const bake::Layer& layer : wanted)
            if (layer.kind == "bounce")
                layers.emplace_back(layer.light).part = part;
    return layers;
}

class SkyTransfer : public testing::DeviceTest {
protected:
    /// Volumes of layers at the cells of a box.
    static std::vector<Volume> gather(const Scene& scene,
                                      const std::vector<scene::LightLayer>& layers, Bounds box,
                                      int resolution,
                                      solver::gather::GatherSettings settings = {}) {
        Progress silent;
        Volume volume;
        volume.grid = volume::fit_grid(box.lo, box.hi, {resolution, 0.0, 0});
        const scene::Frame frame{volume.grid.origin, volume.grid.cell,
                                 glm::dvec3(volume.grid.dims)};
        const visibility::Visibility visibility(scene, frame);
        volume.validity = visibility::trace_validity(visibility, volume.grid.dims);
        surface::LightingSettings lighting;
        lighting.bounces.reset();
        lighting.rays = 1 << 18;
        const surface::LitSurfaces lit =
            surface::light_surfaces(scene, visibility, frame, lighting, silent, layers);
        std::vector<Volume> volumes(layers.size());
        settings.tolerance = settings.order > 1 ? 0.0f : settings.tolerance;
        solver::gather::GatherProgram(device(), settings)
            .gather(lit, scene.sky, visibility, volume, silent, 0.0f, {layers, volumes});
        for (Volume& layer : volumes)
            layer.validity = volume.validity;
        return volumes;
    }
};

/// Of what is seen to a band, what the modes become: [9 * i + j].
std::array<double, modes * modes> seen_modes(const Volume& sight, std::size_t cell, int order = 4) {
    std::array<double, modes * modes> seen{};
    for (std::size_t j = 0; j < modes; ++j) {
        std::array<float, modes> mode{};
        mode[j] = 1.0f;
        const std::vector<double> product = volume::sh_product(2, mode);
        for (std::size_t i = 0; i < modes; ++i)
            for (std::size_t k = 0; k < std::size_t(volume::sh_count(order)); ++k)
                seen[modes * i + j] +=
                    product[bands_of_sight * i + k] * double(sight.sh[k][cell].y);
    }
    return seen;
}

double coefficient(std::span<const Volume> of_modes, std::size_t i, std::size_t j,
                   std::size_t cell) {
    return double(of_modes[j].sh[i][cell].y);
}

TEST_F(SkyTransfer, OfEmptySpaceIsTheIdentity) {
    Scene speck = under_white_sky(scenes::floor_quad(1e-4f, glm::vec3(0.5f)));
    const std::vector<Volume> found =
        gather(speck, transfer_of(speck, {Part::all}), {glm::dvec3(-1.0), glm::dvec3(1.0)}, 4);
    for (std::size_t cell = 0; cell < 64; ++cell) {
        for (std::size_t k = 0; k < bands_of_sight; ++k)
            EXPECT_NEAR(double(found[0].sh[k][cell].x), k == 0 ? std::sqrt(4 * pi) : 0.0, 1e-3)
                << k;
        const auto seen = seen_modes(found[0], cell);
        for (std::size_t i = 0; i < modes; ++i)
            for (std::size_t j = 0; j < modes; ++j) {
                const double identity = i == j ? 1.0 : 0.0;
                EXPECT_NEAR(coefficient(std::span(found).subspan(1), i, j, cell), identity, 1e-3)
                    << i << " " << j;
                EXPECT_NEAR(seen[modes * i + j], identity, 1e-3) << i << " " << j;
            }
    }
}

TEST_F(SkyTransfer, AboveAPlaneIsItsClosedForm) {
    // Y(1; y, z, x; xy, yz, 3z^2-1, xz, x^2-y^2) over the upper half, and the plane's cosine.
    const double albedo = 0.6;
    std::array<std::array<double, modes>, modes> half{};
    for (std::size_t i = 0; i < modes; ++i)
        half[i][i] = 0.5;
    const auto both = [&](std::size_t i, std::size_t j, double value) {
        half[i][j] = half[j][i] = value;
    };
    both(0, 1, std::sqrt(3.0) / 4);
    both(1, 6, -0.12103);
    both(1, 8, -0.20963);
    both(2, 5, 0.41926);
    both(3, 4, 0.41926);
    const std::array<double, modes> cosine{0.88623, 1.02333, 0, 0, 0, 0, -0.24771, 0, -0.42904},
        below{1.77245, -1.53499, 0, 0, 0, 0, 0, 0, 0};

    const Scene plane = under_white_sky(scenes::floor_quad(400.0f, glm::vec3(float(albedo))));
    solver::gather::GatherSettings settings;
    settings.sky_bins = 4096;
    settings.vpls = 2048;
    const std::vector<Volume> found =
        gather(plane, transfer_of(plane, {Part::direct, Part::reflected}),
               {glm::dvec3(-1.0, 0.5, -1.0), glm::dvec3(1.0, 1.5, 1.0)}, 3, settings);
    const std::span<const Volume> direct = std::span(found).subspan(1, modes),
                                  bounced = std::span(found).subspan(1 + modes);
    for (std::size_t cell = 0; cell < found[0].validity.size(); ++cell)
        for (std::size_t i = 0; i < modes; ++i)
            for (std::size_t j = 0; j < modes; ++j) {
                EXPECT_NEAR(coefficient(direct, i, j, cell), half[i][j], 0.01) << i << " " << j;
                EXPECT_NEAR(seen_modes(found[0], cell)[modes * i + j], half[i][j], 0.01)
                    << i << " " << j;
                EXPECT_NEAR(coefficient(bounced, i, j, cell), albedo / pi * below[i] * cosine[j],
                            0.01)
                    << i << " " << j;
            }
}

TEST_F(SkyTransfer, OfAClosedRoomIsNothing) {
    const Scene room = under_white_sky(scenes::furnace(2.0f, 0.7f, 1.0f));
    const std::vector<Volume> found =
        gather(room, transfer_of(room, {Part::direct, Part::reflected}),
               {glm::dvec3(0.5), glm::dvec3(1.5)}, 3);
    for (const Volume& volume : found)
        for (const std::vector<glm::vec3>& values : volume.sh)
            for (const glm::vec3 value : values)
                EXPECT_EQ(value, glm::vec3(0.0f));
}

TEST_F(SkyTransfer, IsWhatIsSeenAndWhatIsReflected) {
    const Scene scene = scenes::lit_by_all();
    const Bounds box{glm::dvec3(-1.0, 0.0, -1.0), glm::dvec3(1.0, 2.0, 1.5)};
    for (const int order : {1, 2}) {
        solver::gather::GatherSettings settings;
        settings.order = order;
        const std::vector<Volume> found =
            gather(scene, transfer_of(scene, {Part::direct, Part::reflected, Part::all}), box, 10,
                   settings);
        const std::span<const Volume> direct = std::span(found).subspan(1, modes),
                                      bounced = std::span(found).subspan(1 + modes, modes),
                                      all = std::span(found).subspan(1 + 2 * modes);
        const auto terms = std::size_t(volume::sh_count(order));
        double truncated = 0.0, most = 0.0, light = 0.0;
        for (std::size_t cell = 0; cell < found[0].validity.size(); ++cell) {
            const auto seen = seen_modes(found[0], cell), low = seen_modes(found[0], cell, 1);
            double largest = 1e-6;
            for (std::size_t i = 0; i < terms; ++i)
                for (std::size_t j = 0; j < modes; ++j)
                    largest = std::max(largest, std::abs(coefficient(all, i, j, cell)));
            most = std::max(most, largest);
            for (std::size_t i = 0; i < terms; ++i)
                for (std::size_t j = 0; j < modes; ++j) {
                    const double is = coefficient(direct, i, j, cell);
                    if (j < terms) {
                        EXPECT_NEAR(is, coefficient(direct, j, i, cell), 1e-5);
                    }
                    EXPECT_NEAR(seen[modes * i + j], is, 1e-4);
                    truncated = std::max(truncated, std::abs(low[modes * i + j] - is));
                    light = std::max(light, std::abs(coefficient(bounced, i, j, cell)));
                    EXPECT_NEAR(is + coefficient(bounced, i, j, cell), coefficient(all, i, j, cell),
                                1e-5 * largest);
                }
        }
        EXPECT_GT(truncated, 0.05);
        EXPECT_GT(light, 0.05);
        EXPECT_GT(most, 0.5);
    }
}

TEST_F(SkyTransfer, OfOrderOneShowsBandThree) {
    const Scene scene = scenes::lit_by_all();
    std::vector<scene::LightLayer> layers = transfer_of(scene, {});
    for (std::size_t j = 0; j < 16; ++j) {
        scene::LightLayer& mode = layers.emplace_back(scenes::no_light(scene));
        mode.beyond = [j](glm::vec3 towards) { return glm::vec3(volume::sh_basis(3, towards)[j]); };
        mode.part = Part::direct;
    }
    solver::gather::GatherSettings settings;
    settings.order = 1;
    const std::vector<Volume> found = gather(
        scene, layers, {glm::dvec3(-1.0, 0.0, -1.0), glm::dvec3(1.0, 2.0, 1.5)}, 10, settings);
    double largest = 0.0;
    for (std::size_t j = 0; j < 16; ++j) {
        std::array<float, 16> mode{};
        mode[j] = 1.0f;
        const std::vector<double> product = volume::sh_product(1, mode);
        for (std::size_t cell = 0; cell < found[0].validity.size(); ++cell)
            for (std::size_t i = 0; i < 4; ++i)
                for (int c = 0; c < 3; ++c) { // a pane tints
                    double sum = 0.0;
                    for (std::size_t k = 0; k < bands_of_sight; ++k)
                        sum += product[bands_of_sight * i + k] * double(found[0].sh[k][cell][c]);
                    const double is = double(found[1 + j].sh[i][cell][c]);
                    EXPECT_NEAR(sum, is, 1e-4) << i << " " << j;
                    largest = j < 9 ? largest : std::max(largest, std::abs(is));
                }
    }
    EXPECT_GT(largest, 0.05);
}

} // namespace
} // namespace lpvbake
