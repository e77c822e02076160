// Pictures of small scenes against closed forms, and against paths.
#include "render/render.h"

#include "gpu/device.h"
#include "reference/reference.h"
#include "render/display.h"
#include "render/flip.h"
#include "render/view.h"
#include "scenes.h"
#include "volume/grid.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <functional>

namespace lpvbake {
namespace {

constexpr double pi = glm::pi<double>();
constexpr float y0 = 0.28209479f; // 1 / (2 sqrt(pi))

/// A field of the same luminance from everywhere, in cells of 0.25 m around [-2, 2]^3.
Volume constant_volume(float nits) {
    Volume volume;
    volume.grid = {glm::dvec3(-2.25), 0.25, glm::ivec3(18)};
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(volume.grid.size(), glm::vec3(0)));
    volume.sh[0].assign(volume.grid.size(), glm::vec3(nits / y0));
    return volume;
}

glm::dvec3 pixel(const image::Pixels& picture, int column, int row) {
    const auto at = 3 * (std::size_t(row) * std::size_t(picture.width) + std::size_t(column));
    return {picture.samples[at], picture.samples[at + 1], picture.samples[at + 2]};
}

glm::dvec3 middle(const image::Pixels& picture) {
    return pixel(picture, picture.width / 2, picture.height / 2);
}

void expect_near(glm::dvec3 found, glm::dvec3 expected, double relative) {
    for (int channel = 0; channel < 3; ++channel)
        EXPECT_NEAR(found[channel], expected[channel],
                    relative * std::max(1e-6, std::abs(expected[channel])))
            << "channel " << channel;
}

render::ViewSettings view(Camera camera, render::Show show, int samples = 1,
                          glm::ivec2 size = glm::ivec2(33)) {
    render::ViewSettings settings;
    settings.camera = camera;
    settings.size = size;
    settings.samples = samples;
    settings.show = show;
    return settings;
}

Camera from(glm::dvec3 eye, glm::dvec3 target, double degrees = 45) {
    return render::look_at(eye, target, glm::radians(degrees));
}

class Render : public testing::DeviceTest {
protected:
    image::Pixels draw(const Scene& scene, const Volume& volume,
                       const render::ViewSettings& settings, Reading reading = Reading::facing) {
        return draw(scene, volume, settings,
                    readers::Reader{.name = "",
                                    .lookup = reading,
                                    .highest_order = volume::sh_max_order,
                                    .clamped = true});
    }
    image::Pixels draw(const Scene& scene, const Volume& volume,
                       const render::ViewSettings& settings, const readers::Reader& reader) {
        const scene::Frame frame = scene::frame_of(volume.grid);
        const visibility::Visibility visibility(scene, frame);
        const reference::Paths paths(scene, visibility, frame, {});
        const raster::Raster raster(device(), scene, frame);
        Progress silent;
        return render::render({scene, frame, visibility, paths}, volume, raster, reader, settings,
                              silent)
            .picture;
    }
    static render::Rendering trace(const Scene& scene, const Volume& volume,
                                   const render::ViewSettings& settings,
                                   const reference::PathRules& rules) {
        const scene::Frame frame = scene::frame_of(volume.grid);
        const visibility::Visibility visibility(scene, frame);
        const reference::Paths paths(scene, visibility, frame, rules);
        Progress silent;
        return render::trace_picture({scene, frame, visibility, paths}, settings, silent);
    }
};

TEST_F(Render, SunAndPointLightAFloorAsLambertSays) {
    const glm::dvec3 albedo(0.5, 0.3, 0.2), travel(0.3, -1, 0.2);
    Scene scene = scenes::floor_quad(4, glm::vec3(albedo));
    scene.lights = {scenes::sun(travel, 1000, {1, 0.5, 0.25})};
    const double cosine = 1 / glm::length(travel);
    const image::Pixels sunny =
        draw(scene, constant_volume(0), view(from({0.5, 2, 1}, {0, 0, 0}), render::Show::final, 4));
    for (int row = 4; row < 29; row += 4)
        for (int column = 4; column < 29; column += 4)
            expect_near(pixel(sunny, column, row),
                        albedo * glm::dvec3(1, 0.5, 0.25) * 1000.0 * cosine / pi, 1e-5);

    // 2 m above the floor, 1 m and 1.8 m aside: E = I cos / d^2.
    scene.lights = {scenes::point_light({1, 2, 2}, 90)};
    const image::Pixels lamp =
        draw(scene, constant_volume(0), view(from({-1, 2, 0}, {0, 0, 0.2}), render::Show::direct));
    const double square = 1 + 4 + 1.8 * 1.8;
    expect_near(middle(lamp), albedo * (90 * 2 / (square * std::sqrt(square))) / pi, 1e-5);
}

TEST_F(Render, AShadowIsBlackAndNothingElse) {
    Scene scene = scenes::floor_quad(4, glm::vec3(0.5f));
    scenes::add_quad(scene, 0, {-0.5, 1, 0.5}, {1, 0, 0}, {0, 0, -1});
    scene.lights = {scenes::sun({0, -1, 0}, pi)};
    for (const double x : {0.0, 0.45, -0.45, 0.55, -0.55, 1.0}) {
        const image::Pixels picture = draw(
            scene, constant_volume(0), view(from({x, 0.5, 1.5}, {x, 0, 0}), render::Show::final));
        expect_near(middle(picture), glm::dvec3(std::abs(x) < 0.5 ? 0.0 : 0.5), 1e-6);
    }
}

TEST_F(Render, AConstantFieldShowsTheReflectance) {
    const Scene scene = scenes::cornell_box();
    const render::ViewSettings indirect =
        view(from({0.3, 1.2, 3.5}, {0, 1, 0}), render::Show::indirect, 2);
    render::ViewSettings albedo = indirect;
    albedo.show = render::Show::albedo;
    const Volume volume = constant_volume(7);
    for (const Reading reading : {Reading::facing, Reading::trilinear}) {
        const image::Pixels lit = draw(scene, volume, indirect, reading);
        const image::Pixels reflectance = draw(scene, volume, albedo, reading);
        double seen = 0;
        for (std::size_t i = 0; i < lit.samples.size(); ++i) {
            EXPECT_NEAR(lit.samples[i], 7 * reflectance.samples[i], 1e-4);
            seen += double(reflectance.samples[i]);
        }
        EXPECT_GT(seen / double(lit.samples.size()), 0.2);
    }
}

TEST_F(Render, APointIsWhereAPinholeShowsIt) {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true);
    const glm::dvec3 place(0.7, -0.4, 0.2);
    scenes::add_quad(scene, white, glm::vec3(place) - glm::vec3(0.02f, 0.02f, 0), {0.04f, 0, 0},
                     {0, 0.04f, 0});
    const glm::ivec2 size(120, 80);
    const auto brightest = [&](const Camera& camera) {
        const image::Pixels picture =
            draw(scene, constant_volume(0), view(camera, render::Show::albedo, 16, size));
        glm::dvec2 sum(0);
        double weight = 0;
        for (int row = 0; row < size.y; ++row)
            for (int column = 0; column < size.x; ++column) {
                const double here = pixel(picture, column, row).x;
                sum += here * (glm::dvec2(column, row) + 0.5);
                weight += here;
            }
        return sum / weight;
    };
    // A focal length of 40 pixels (half the height at 90 degrees), z towards the eye.
    Camera camera = from({0, 0, 2}, {0, 0, 0}, 90);
    glm::dvec2 found = brightest(camera);
    EXPECT_NEAR(found.x, 60 + 40 * 0.7 / 1.8, 0.1);
    EXPECT_NEAR(found.y, 40 + 40 * 0.4 / 1.8, 0.1);
    // As a file places it: turned by 30 degrees around Y, scaled, which counts for nothing.
    camera.to_world = glm::scale(
        glm::rotate(glm::translate(glm::dmat4(1), {1, 0.5, 2}), glm::radians(30.0), {0, 1, 0}),
        glm::dvec3(3));
    const glm::dvec3 seen(glm::inverse(camera.to_world) * glm::dvec4(place, 1));
    found = brightest(camera);
    EXPECT_NEAR(found.x, 60 + 40 * seen.x / -seen.z, 0.1);
    EXPECT_NEAR(found.y, 40 - 40 * seen.y / -seen.z, 0.1);
}

TEST_F(Render, NormalsAreTheFilesTurnedWithTheInstance) {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.5f), glm::vec3(0), true);
    // A slope whose own normals are right; stretched and mirrored they must still be.
    glm::dmat4 placed = glm::rotate(glm::dmat4(1), 0.4, {0, 0, 1});
    placed = glm::scale(placed, {-1, 1, 3});
    scenes::add_quad(scene, white, {-1, -0.5f, 1}, {2, 1, 0}, {0, 0.4f, -2}, placed);
    const glm::dvec3 u(placed * glm::dvec4(2, 1, 0, 0)), v(placed * glm::dvec4(0, 0.4, -2, 0));
    glm::dvec3 n = glm::normalize(glm::cross(u, v));
    const Camera above = from({0.3, 3, 0.4}, {0, 0, 0});
    n = n.y < 0 ? -n : n;
    expect_near(middle(draw(scene, constant_volume(0), view(above, render::Show::normal))), n,
                1e-5);
    expect_near(middle(draw(scene, constant_volume(0),
                            view(from({0.3, -3, 0.4}, {0, 0, 0}), render::Show::normal))),
                -n, 1e-5);

    // Between the corners' normals: in the middle of this floor the mean of two opposite ones.
    scene = scenes::floor_quad(2, glm::vec3(0.5f));
    scene.meshes[0].normals = {{0.6f, 0.8f, 0}, {0, 1, 0}, {0, 0.8f, 0.6f}, {0, 1, 0}};
    expect_near(middle(draw(scene, constant_volume(0), view(above, render::Show::normal))),
                glm::normalize(glm::dvec3(0.6, 1.6, 0.6)), 1e-3);
    scene.meshes[0].normals.clear();
    expect_near(middle(draw(scene, constant_volume(0), view(above, render::Show::normal))),
                glm::dvec3(0, 1, 0), 1e-6);
}

TEST_F(Render, BacksAreOnlyThereOnBothSides) {
    Scene scene = scenes::floor_quad(2, glm::vec3(0.5f));
    scene.sky.luminance = {1, 2, 3};
    scene.lights = {scenes::sun({0, 1, 0}, pi)};
    const render::ViewSettings below = view(from({0, -2, 0.1}, {0, 0, 0}), render::Show::final);
    expect_near(middle(draw(scene, constant_volume(0), below)), {1, 2, 3}, 1e-6);
    expect_near(middle(trace(scene, constant_volume(0), below, {}).picture), {1, 2, 3}, 1e-6);
    scene.materials[0].double_sided = true;
    expect_near(middle(draw(scene, constant_volume(0), below)), glm::dvec3(0.5), 1e-5);
    scene.sky = {};
    expect_near(middle(trace(scene, constant_volume(0), below, {0, false}).picture),
                glm::dvec3(0.5), 1e-5);
}

TEST_F(Render, MaskAndBlendCoverTheirShare) {
    Scene scene = scenes::floor_quad(4, glm::vec3(0.2f));
    const int glass = scenes::add_material(scene, glm::vec3(0.8f), glm::vec3(10, 0, 0));
    scenes::add_quad(scene, glass, {-2, 0.5f, 2}, {4, 0, 0}, {0, 0, -4});
    Material& material = scene.materials[std::size_t(glass)];
    const Camera above = from({0, 3, 0.1}, {0, 0, 0});
    material.alpha_mode = AlphaMode::blend;
    for (const float alpha : {0.25f, 0.7f}) {
        material.base_color.a = alpha;
        const image::Pixels albedo =
            draw(scene, constant_volume(0), view(above, render::Show::albedo, 32));
        const image::Pixels light =
            draw(scene, constant_volume(0), view(above, render::Show::final, 32));
        const image::Pixels path = trace(scene, constant_volume(0),
                                         view(above, render::Show::final, 4096, {1, 1}), {0, false})
                                       .picture;
        double mean = 0;
        for (int row = 8; row < 25; ++row)
            for (int column = 8; column < 25; ++column) {
                const double share = (pixel(albedo, column, row).x - 0.2) / 0.6;
                EXPECT_NEAR(share, alpha, 0.07); // in every pixel: at most two samples off
                EXPECT_NEAR(pixel(light, column, row).x, 10 * share, 1e-4);
                mean += share / (17 * 17);
            }
        EXPECT_NEAR(mean, alpha, 0.005);
        EXPECT_NEAR(path.samples[0], 10 * alpha, 0.3);
    }
    material.alpha_mode = AlphaMode::mask;
    for (const auto& [alpha, seen] : {std::pair(0.4f, 0.2), std::pair(0.6f, 0.8)}) {
        material.base_color.a = alpha;
        expect_near(middle(draw(scene, constant_volume(0), view(above, render::Show::albedo))),
                    glm::dvec3(seen), 1e-6);
    }
}

TEST_F(Render, OnlyTrilinearReadsWhatIsBehindAWall) {
    // A dark room of one side; the cells around it are invalid, and bright.
    Scene scene;
    scenes::add_box(scene, scenes::add_material(scene, glm::vec3(0.5f)), glm::vec3(-1.1f),
                    glm::vec3(1.1f), scenes::Facing::inward);
    scene.lights = {scenes::sun({0.3, -1, -0.2}, 1e5), scenes::point_light({0, 3, 0}, 1e4)};
    Volume volume = constant_volume(0);
    volume.validity.resize(volume.grid.size());
    for (int z = 0; z < volume.grid.dims.z; ++z)
        for (int y = 0; y < volume.grid.dims.y; ++y)
            for (int x = 0; x < volume.grid.dims.x; ++x) {
                const glm::dvec3 at = glm::abs(volume.grid.center({x, y, z}));
                const bool inside = std::max({at.x, at.y, at.z}) < 1.1;
                const std::size_t i = volume.grid.index({x, y, z});
                volume.validity[i] = inside;
                if (!inside)
                    volume.sh[0][i] = glm::vec3(1000);
            }
    const render::ViewSettings settings =
        view(from({0.9, 0.8, 0.9}, {-1, -1, -1}, 90), render::Show::final, 4);
    for (const float sample : draw(scene, volume, settings).samples)
        EXPECT_EQ(sample, 0);
    EXPECT_GT(render::mean_luminance(draw(scene, volume, settings, Reading::trilinear)), 1.0);
}

TEST_F(Render, ShowsWhatAProgramReads) {
    const Scene scene = scenes::floor_quad(4, glm::vec3(0.5f));
    Volume volume = constant_volume(0);
    for (int z = 0; z < volume.grid.dims.z; ++z) // as bright as it is high, and negative below 0
        for (int y = 0; y < volume.grid.dims.y; ++y)
            for (int x = 0; x < volume.grid.dims.x; ++x)
                volume.sh[0][volume.grid.index({x, y, z})] =
                    glm::vec3(float(volume.grid.center({x, y, z}).y / double(y0)));
    const render::ViewSettings settings =
        view(from({0.6, 3, 0.3}, {0.6, 0, 0.3}), render::Show::irradiance);
    const auto shown = [&](const char* name) {
        return middle(draw(scene, volume, settings, *readers::reader_named(name)));
    };
    const double half = 0.5 * volume.grid.cell * glm::pi<double>();
    expect_near(shown("threejs"), glm::dvec3(half), 1e-5);
    expect_near(shown("unity"), glm::dvec3(0), 1e-5);
    for (glm::vec3& c : volume.sh[0])
        c -= 1.0f;
    expect_near(shown("unity"), glm::dvec3(0), 0);
}

TEST_F(Render, ShowsCellsValidityAndOcclusion) {
    const Scene scene = scenes::floor_quad(4, glm::vec3(0.5f));
    Volume volume = constant_volume(0);
    const Camera above = from({0.6, 3, 0.3}, {0.6, 0, 0.3});
    EXPECT_THROW(draw(scene, volume, view(above, render::Show::occlusion)), Error);
    // Half a cell above the floor at (0.6, 0, 0.3): the cell of (0.6, 0.125, 0.3).
    const glm::ivec3 cell(glm::floor((glm::dvec3(0.6, 0.125, 0.3) + 2.25) / 0.25));
    volume.sh[0][volume.grid.index(cell)] = glm::vec3(3 / y0, 2 / y0, 1 / y0);
    expect_near(middle(draw(scene, volume, view(above, render::Show::cells))), {3, 2, 1}, 1e-5);
    expect_near(middle(draw(scene, volume, view(above, render::Show::validity))), glm::dvec3(1),
                1e-6);
    volume.validity.assign(volume.grid.size(), 0);
    expect_near(middle(draw(scene, volume, view(above, render::Show::validity))), {1, 0, 0}, 1e-6);
    volume.occlusion.assign(4, std::vector<float>(volume.grid.size(), 0));
    volume.occlusion[0].assign(volume.grid.size(), 0.25f / y0);
    expect_near(middle(draw(scene, volume, view(above, render::Show::occlusion))), glm::dvec3(0.25),
                1e-5);
}

TEST_F(Render, PathsSeeWhatTheRasterSees) {
    const Scene scene = scenes::cornell_box_with_point(100);
    const Volume volume = constant_volume(0);
    for (const auto& [show, most] :
         {std::pair(render::Show::albedo, 0.02), std::pair(render::Show::direct, 0.04)}) {
        const render::ViewSettings settings =
            view(from({0.3, 1.2, 3.5}, {0, 1, 0}), show, 256, {24, 20});
        const image::Pixels drawn = draw(scene, volume, settings);
        const render::Rendering traced = trace(scene, volume, settings, {});
        const render::PictureError error = render::compare_pictures(drawn, traced.picture);
        EXPECT_LT(error.relative, most);
        EXPECT_NEAR(error.ratio, 1, 0.003);
    }
}

TEST_F(Render, PathsInAFurnaceCarryAllLight) {
    // Luminance 2 / (1 - 0.5) = 4 everywhere; 2 + 0.5 * 2 after one reflection.
    const Scene scene = scenes::furnace(1, 0.5f, 2);
    Volume volume = constant_volume(0);
    const Camera camera = from({0.2, 0.3, 0.8}, {0.7, 0.5, 0.1});
    const render::Rendering all =
        trace(scene, volume, view(camera, render::Show::final, 64), {std::nullopt, true});
    EXPECT_NEAR(render::mean_luminance(all.picture), 4, 0.02);
    const render::Rendering direct =
        trace(scene, volume, view(camera, render::Show::final, 64), {0, true});
    EXPECT_NEAR(render::mean_luminance(direct.picture), 3, 0.01);
    EXPECT_GT(all.noise, 0);
    volume = constant_volume(4); // the field of all bounces
    for (const float sample : draw(scene, volume, view(camera, render::Show::final)).samples)
        EXPECT_NEAR(sample, 4, 1e-4);
}

TEST_F(Render, ACornerLitByItsFieldIsThatOfPaths) {
    Scene scene;
    const int red = scenes::add_material(scene, {0.8f, 0.2f, 0.1f});
    const int white = scenes::add_material(scene, glm::vec3(0.7f));
    scenes::add_quad(scene, white, {0, 0, 1}, {1, 0, 0}, {0, 0, -1});
    scenes::add_quad(scene, red, {0, 0, 0}, {0, 1, 0}, {0, 0, 1});
    scene.lights = {scenes::sun({-1, -1, 0.2}, 1000)};
    reference::ReferenceSettings settings;
    settings.paths.bounces = 2;
    settings.sh_order = 4;
    settings.rays = 512;
    Progress silent;
    volume::GridSettings lattice;
    lattice.resolution = 16;
    const Volume volume =
        reference::make_reference(scene, volume::fit_grid({0, 0, 0}, {1, 1, 1}, lattice), settings,
                                  silent)
            .volume;
    // A piece of each, off the rims, where the cells are too coarse.
    for (const Camera& camera :
         {from({0.5, 2, 0.6}, {0.5, 0, 0.5}, 14), from({2, 0.5, 0.6}, {0, 0.5, 0.5}, 14)}) {
        const image::Pixels drawn =
            draw(scene, volume, view(camera, render::Show::indirect, 4, glm::ivec2(12)));
        const image::Pixels traced =
            trace(scene, volume, view(camera, render::Show::indirect, 1024, glm::ivec2(12)),
                  settings.paths)
                .picture;
        const render::PictureError error = render::compare_pictures(drawn, traced);
        EXPECT_NEAR(error.ratio, 1, 0.08);
        EXPECT_LT(error.relative, 0.2);
    }
}

TEST_F(Render, SameBitsForAnyNumberOfThreads) {
    Scene scene = scenes::cornell_box_with_point(100);
    scene.materials[0].alpha_mode = AlphaMode::blend;
    scene.materials[0].base_color.a = 0.5f;
    const Volume volume = constant_volume(3);
    const render::ViewSettings settings =
        view(from({0.3, 1.2, 3.5}, {0, 1, 0}), render::Show::final, 3);
    std::vector<std::vector<float>> drawn, traced;
    for (const std::size_t threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        drawn.push_back(draw(scene, volume, settings).samples);
        traced.push_back(trace(scene, volume, settings, {2, true}).picture.samples);
    }
    EXPECT_EQ(drawn[0], drawn[1]);
    EXPECT_EQ(traced[0], traced[1]);
}

TEST_F(Render, PicturesLargerThanATileHaveNoSeam) {
    const Scene scene = scenes::floor_quad(8, {0.25f, 0.5f, 0.75f});
    const image::Pixels picture =
        draw(scene, constant_volume(1),
             view(from({0, 2, 0.1}, {0, 0, 0}, 0.2), render::Show::final, 1, {1040, 3}));
    for (int column = 0; column < 1040; ++column)
        expect_near(pixel(picture, column, 1), {0.25, 0.5, 0.75}, 1e-4);
}

TEST(View, OrbitShowsAllOfTheBoxAndNotMuchMore) {
    const Bounds box{{-3, 0, 1}, {5, 2, 4}};
    for (const double azimuth : {0.0, 0.7, 2.5, -1.0})
        for (const double elevation : {-0.3, 0.4, 1.5}) {
            const double aspect = 1.5, half = std::tan(0.5 * 0.8);
            const Camera camera = render::orbit_camera(box, {azimuth, elevation}, 0.8, aspect);
            double widest = 0;
            for (int i = 0; i < 8; ++i) {
                const glm::dvec3 corner(i & 1 ? 5 : -3, i & 2 ? 2 : 0, i & 4 ? 4 : 1);
                const glm::dvec3 p(glm::inverse(camera.to_world) * glm::dvec4(corner, 1));
                ASSERT_LT(p.z, 0);
                widest = std::max(
                    {widest, std::abs(p.x / p.z) / (half * aspect), std::abs(p.y / p.z) / half});
            }
            EXPECT_LE(widest, 1);
            EXPECT_GT(widest, 0.85);
        }
    const Camera far = render::orbit_camera(box, {glm::half_pi<double>(), 0, 10}, 0.8, 1);
    EXPECT_NEAR(glm::length(glm::dvec3(far.to_world[3]) - glm::dvec3(11, 1, 2.5)), 0, 1e-9);
}

TEST(View, RoomsAreSeenFromInside) {
    const auto room = [](const Scene& scene, Bounds box) {
        const scene::Frame frame{glm::dvec3(-2.25), 0.25, glm::dvec3(18)};
        const visibility::Visibility visibility(scene, frame);
        const Camera inside = render::inside_camera(box, visibility, frame, 1.0);
        const glm::dvec3 eye(inside.to_world[3]);
        EXPECT_TRUE(glm::all(glm::lessThan(eye, box.hi))
                    && glm::all(glm::greaterThan(eye, box.lo)));
        return render::is_room(box, visibility, frame);
    };
    EXPECT_TRUE(room(scenes::furnace(1, 0.5f, 1), {{0, 0, 0}, {1, 1, 1}}));
    EXPECT_FALSE(room(scenes::cornell_box(), {{-1, 0, -1}, {1, 2, 1}}));
    Scene solid;
    scenes::add_box(solid, scenes::add_material(solid, glm::vec3(0.5f)), glm::vec3(-1),
                    glm::vec3(1), scenes::Facing::outward);
    EXPECT_FALSE(room(solid, {glm::dvec3(-1), glm::dvec3(1)}));
}

TEST(Display, NeutralToneMapKeepsBaseColoursAndCompressesTheRest) {
    // Worked out by hand from the specification: an offset of x - 6.25 x^2 below 0.08, else 0.04;
    // from 0.76 on 1 - 0.24^2 / (p + 0.24 - 0.76), blended with its grey by 1 - 1 / (0.15 d + 1).
    expect_near(render::neutral_tone_map(glm::dvec3(0.5)), glm::dvec3(0.46), 1e-12);
    expect_near(render::neutral_tone_map({0.7, 0.04, 0.3}), {0.67, 0.01, 0.27}, 1e-12);
    expect_near(render::neutral_tone_map(glm::dvec3(2)), glm::dvec3(0.96), 1e-12);
    expect_near(render::neutral_tone_map({4.04, 0.04, 0.04}), {0.983496, 0.308763, 0.308763}, 1e-5);
    EXPECT_EQ(render::neutral_tone_map(glm::dvec3(0)), glm::dvec3(0));
}

TEST(Display, ExposureIsACamerasAndShowsTheMedianAsGrey) {
    EXPECT_DOUBLE_EQ(render::exposure_scale(3), 1 / 9.6);
    image::Pixels picture{5, 1, 3, {}};
    for (const float nits : {0.0f, 20.0f, 50.0f, 100.0f, 7000.0f})
        picture.samples.insert(picture.samples.end(), 3, nits);
    const double ev = render::automatic_exposure(picture, render::Show::final);
    EXPECT_NEAR(100 * render::exposure_scale(ev), 0.18, 0.18 * 0.04); // to a tenth of an EV
    // Corners that no light gets to do not count, though they are nine in ten.
    image::Pixels cave{1000, 1, 3, std::vector<float>(3000, 1e-3f)};
    std::fill_n(cave.samples.begin(), 300, 100.0f);
    EXPECT_EQ(render::automatic_exposure(cave, render::Show::final), ev);
    EXPECT_EQ(render::automatic_exposure(image::Pixels{1, 1, 3, {0, 0, 0}}, render::Show::final),
              0);

    // 100 nits at 0.18: sRGB of 0.18 - 0.04 with the tone map, of 0.18 without.
    const double grey = std::log2(100 / (1.2 * 0.18));
    const auto srgb = [](double x) { return 1.055 * std::pow(x, 1 / 2.4) - 0.055; };
    EXPECT_NEAR(
        render::to_display(picture, render::Show::final, grey, render::ToneMap::neutral).samples[9],
        srgb(0.14), 1e-6);
    EXPECT_NEAR(
        render::to_display(picture, render::Show::final, grey, render::ToneMap::none).samples[9],
        srgb(0.18), 1e-6);
    EXPECT_NEAR(render::to_display(picture, render::Show::irradiance, grey, render::ToneMap::none)
                    .samples[9],
                srgb(0.18 / pi), 1e-6);
    const image::Pixels data{1, 1, 3, {-1, 0, 0.5f}};
    EXPECT_EQ(render::to_display(data, render::Show::normal, 9, render::ToneMap::neutral).samples,
              (std::vector<float>{0, 0.5f, 0.75f}));
    EXPECT_NEAR(
        render::to_display(data, render::Show::albedo, 9, render::ToneMap::neutral).samples[2],
        srgb(0.5), 1e-6);
}

TEST(Display, PicturesAreComparedByRootMeanSquare) {
    const image::Pixels a{2, 1, 3, {1, 2, 3, 4, 5, 6}}, b{2, 1, 3, {1, 2, 3, 4, 5, 3}};
    const render::PictureError error = render::compare_pictures(a, b);
    EXPECT_DOUBLE_EQ(error.rmse, std::sqrt(9.0 / 6));
    EXPECT_DOUBLE_EQ(error.relative, std::sqrt(9.0 / 6) / 3);
    EXPECT_DOUBLE_EQ(error.ratio, 21.0 / 18);
    EXPECT_EQ(render::compare_pictures(a, a).rmse, 0);
}

TEST(Flip, IsWhatItsPaperSays) {
    const auto picture = [](glm::ivec2 size, const std::function<glm::vec3(int, int)>& colour) {
        image::Pixels pixels{size.x, size.y, 3, {}};
        for (int y = 0; y < size.y; ++y)
            for (int x = 0; x < size.x; ++x) {
                const glm::vec3 c = colour(x, y);
                pixels.samples.insert(pixels.samples.end(), {c.x, c.y, c.z});
            }
        return pixels;
    };
    const auto plain = [&](glm::vec3 c) { return picture({5, 4}, [c](int, int) { return c; }); };
    EXPECT_EQ(render::flip(plain({0.2f, 0.5f, 0.7f}), plain({0.2f, 0.5f, 0.7f})), 0);
    EXPECT_NEAR(render::flip(plain({0, 1, 0}), plain({0, 0, 1})), 1,
                1e-9); // the largest difference
    EXPECT_NEAR(render::flip(plain({0, 0, 0}), plain({1, 1, 1})), 0.9673798, 1e-5);
    // Patterns, by the formulas written out in another language.
    const image::Pixels a = picture({24, 20}, [](int x, int y) {
        return glm::vec3(float((x * 7 + y * 3) % 11) / 10, float((x * 5 + y * 2) % 7) / 6,
                         float((x + y * 4) % 5) / 4);
    });
    const image::Pixels b = picture({24, 20}, [](int x, int y) {
        return glm::vec3(0.8f * float((x * 7 + y * 3) % 11) / 10,
                         float((x * 5 + y * 2 + (x > 10)) % 7) / 6, float((x + y * 4) % 5) / 4);
    });
    EXPECT_NEAR(render::flip(a, b), 0.3703654, 1e-5);
    EXPECT_NEAR(render::flip(b, a), render::flip(a, b), 1e-12);
}

} // namespace
} // namespace lpvbake
