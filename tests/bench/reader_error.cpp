// What each program shows on surfaces of a bake, as the field is, filled, and fitted to the
// program's reader. Error, energy and leak are those of readers::SurfaceError, at points that no
// fit has seen, against path-traced irradiance, whose own noise comes first.
//
// Usage: lpvbake_reader_error SCENE RESOLUTION [READER ...] [--sun A,E,LUX] [--point X,Y,Z,CD]
//        [--points N] [--paths N] [--hold H] [--density D] [--rays N] [--steps N] [--traced 0]
//        [--alone 1] [--air 1]
// SCENE: lamp, sun (a box of thin double-sided walls), rooms (two, one thin wall), or a glTF file.
#include "bake/bake.h"
#include "bake/volume_fit.h"
#include "lpvbake/scene.h"
#include "options/lights.h"
#include "reference/reference.h"
#include "scenes.h"
#include "visibility/visibility.h"
#include "volume/compare.h"
#include "volume/dering.h"
#include "volume/dilate.h"

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

namespace lpvbake {
namespace {

using readers::Reader;

double now() {
    return double(std::clock()) / CLOCKS_PER_SEC;
}

/// Share of the valid cells with negative irradiance towards any normal, of bands 0 to `order`.
double negative_share(const Volume& volume, int order) {
    size_t valid = 0, negative = 0;
    const auto count = size_t(volume::sh_count(std::min(order, 2)));
    for (size_t cell = 0; cell < volume.grid.size(); ++cell) {
        if (!volume.is_valid(cell))
            continue;
        ++valid;
        bool any = false;
        for (int c = 0; c < 3; ++c) {
            std::array<float, 9> colour{};
            for (size_t k = 0; k < count; ++k)
                colour[k] = volume.sh[k][cell][c];
            any = any || volume::least_irradiance(std::span(colour).first(count)) < 0;
        }
        negative += any;
    }
    return valid ? double(negative) / double(valid) : 0;
}

/// Light below 0 that a reader shows at the points, of what arrives there; NaN if any of it is.
double negative_light(const Reader& reader, const Volume& volume,
                      const std::vector<readers::FitPoint>& points) {
    double negative = 0, whole = 0;
    for (const readers::FitPoint& point : points) {
        const glm::dvec3 e = readers::irradiance(reader, volume, point.position, point.normal);
        for (int c = 0; c < 3; ++c) {
            negative += point.weight * (e[c] < 0 ? -e[c] : 0 * e[c]);
            whole += point.weight * point.irradiance[c];
        }
    }
    return negative / whole;
}

/// Walls without thickness, seen from both sides. `open`: without the one at +z.
void add_thin_box(Scene& scene, glm::vec3 lo, glm::vec3 hi, bool open) {
    const glm::vec3 size = hi - lo, x(size.x, 0, 0), y(0, size.y, 0), z(0, 0, size.z);
    const auto wall = [&](glm::vec3 colour, glm::vec3 corner, glm::vec3 u, glm::vec3 v) {
        scenes::add_quad(scene, scenes::add_material(scene, colour, glm::vec3(0.0f), true), corner,
                         u, v);
    };
    const glm::vec3 white(0.7f);
    wall(white, lo, z, x);
    wall(white, lo + y, x, z);
    wall({0.7f, 0.1f, 0.1f}, lo, y, z);
    wall({0.1f, 0.6f, 0.1f}, lo + x, z, y);
    wall(white, lo, x, y);
    if (!open)
        wall(white, lo + z, y, x);
}

Scene scene_named(const std::string& name) {
    Scene scene;
    if (name == "lamp" || name == "sun") {
        add_thin_box(scene, {0, 0, 0}, {2.0f, 2.1f, 2.2f}, true);
        const int grey = scenes::add_material(scene, glm::vec3(0.6f));
        scenes::add_box(scene, grey, {0.4f, 0, 0.5f}, {0.9f, 1.1f, 1.0f}, scenes::Facing::outward);
        scene.lights.push_back(name == "lamp" ? scenes::point_light({1.0, 1.8, 1.2}, 100)
                                              : scenes::sun({0.3, -0.6, -1.0}, 10000));
    } else if (name == "rooms") {
        add_thin_box(scene, {0, 0, 0}, {2.13f, 2.1f, 2.2f}, false);
        add_thin_box(scene, {2.13f, 0, 0}, {4.2f, 2.1f, 2.2f}, false);
        scene.lights.push_back(scenes::point_light({1.0, 1.8, 1.2}, 100));
    } else {
        scene = load_gltf(name);
    }
    return scene;
}

/// Irradiance towards 26 normals at the valid cells, as all bands have it, against what the reader
/// makes of the bands that it has: as they are, and fitted to it there.
void tell_air(const Reader& reader, const Volume& field) {
    std::vector<readers::FitPoint> points;
    const readers::Reader whole{.name = "", .clamped = true};
    for (size_t i = 0; i < field.grid.size(); ++i)
        for (const glm::dvec3& n : volume::neighbour_normals())
            if (field.is_valid(i)) {
                const glm::dvec3 at = field.grid.center(field.grid.cell_at(i));
                points.push_back({at, n, 1, readers::irradiance(whole, field, at, n)});
            }
    Volume fitted = field;
    readers::FitSettings settings;
    settings.hold_valid = settings.hold_other = 1e-6;
    readers::fit(reader, points, settings, fitted);
    std::printf("  air by %d bands %.1f %%, fitted there %.1f %%", readers::order_of(reader, field),
                100 * readers::error_of(reader, field, points).relative,
                100 * readers::error_of(reader, fitted, points).relative);
}

struct Options {
    int resolution = 16;
    uint64_t points = 2000, paths = 4096;
    bool traced = true;
    bool air = false;   ///< order 1 at the cells' centres, too
    bool alone = false; ///< what convert fits, too: without lit surfaces
    bake::SurfaceFitSettings fit;
    std::vector<const Reader*> readers;
};

void print(const char* what, const readers::SurfaceError& error) {
    std::printf("  %s %5.1f %% %6.3f %5.2f %%", what, 100 * error.relative, error.energy,
                100 * error.leak);
}

void measure(const Scene& scene, const Options& options) {
    Progress silent;
    const gpu::Device device{gpu::DeviceOptions{}};
    bake::BakeSettings settings;
    settings.grid.resolution = options.resolution;
    const bake::BakePlan plan = bake::plan_bake(bake::survey(scene), settings, device.info());
    double begin = now();
    const Volume field = bake::bake(scene, plan, device, silent).volume;
    const double bake_seconds = now() - begin;
    const visibility::Visibility visibility(scene, plan.frame);
    const surface::LitSurfaces lit =
        surface::light_surfaces(scene, visibility, plan.frame, {.bounces = {}}, silent);

    // What is open, as one sees it; all of it alike.
    const surface::SidePoints sides = surface::draw_side_points(
        lit, glm::vec3(plan.frame.extent), {.most_points = options.points, .seed = 99});
    std::vector<surface::SidePoint> places;
    std::vector<readers::FitPoint> points;
    std::vector<glm::vec3> at;
    std::vector<glm::dvec3> own;
    std::vector<uint64_t> keys;
    for (size_t i = 0; i < sides.points.size(); ++i) {
        if (sides.open[i] < 0.5f)
            continue;
        places.push_back(sides.points[i]);
        own.push_back(glm::normalize(glm::dvec3(sides.points[i].normal)));
        at.push_back(sides.points[i].position
                     + surface::ray_offset(sides.points[i].position) * sides.points[i].normal);
        keys.push_back(i);
        points.push_back({plan.frame.to_world(glm::dvec3(sides.points[i].position)),
                          own.back(),
                          double(sides.area[i]),
                          {}});
    }
    const auto near = surface::irradiance_at(scene, lit, places, true, 2048, 7, silent);
    double off = 0, noise = 0, whole = 0, energy = 0;
    if (options.traced) {
        reference::ReferenceSettings reference;
        reference.sh_order = 0;
        reference.rays = options.paths;
        reference.paths = {std::nullopt, true};
        const reference::ProbeField traced = reference::trace_probes(
            scene, visibility, plan.frame, at, keys, reference, silent, {{}, own});
        for (size_t i = 0; i < points.size(); ++i) {
            points[i].irradiance = glm::dvec3(traced.own_irradiance[i]);
            for (int c = 0; c < 3; ++c) {
                noise += double(traced.own_irradiance_error[i][c]);
                whole += points[i].irradiance[c];
                off += std::abs(points[i].irradiance[c] - double(near[i][c]));
                energy += double(near[i][c]);
            }
        }
        std::printf("%zu points; paths: noise %.1f %%; lit surfaces: %.1f %% off, energy %.3f\n",
                    points.size(), 100 * noise / whole, 100 * off / whole, energy / whole);
    } else {
        for (size_t i = 0; i < points.size(); ++i)
            points[i].irradiance = glm::dvec3(near[i]);
        std::printf("%zu points by 2048 rays into lit surfaces\n", points.size());
    }

    Volume filled = field;
    volume::dilate(filled, 2);
    for (const Reader* reader : options.readers) {
        const int order = readers::order_of(*reader, field);
        const bool ours = reader->lookup == Reading::facing;
        Volume fitted = field;
        begin = now();
        const bake::SurfaceFit fit = bake::fit_to_surfaces(scene, lit, plan.frame, true, *reader,
                                                           options.fit, fitted, silent);
        const double seconds = now() - begin;
        std::printf("%-9s", reader->name);
        print("own", readers::error_of(*readers::reader_named("lpvbake"), field, points));
        print("none", readers::error_of(*reader, field, points));
        if (!ours)
            print("dilated", readers::error_of(*reader, filled, points));
        print("fitted", readers::error_of(*reader, fitted, points));
        if (options.air)
            tell_air(*reader, field);
        if (options.alone) {
            Volume alone = field;
            const bake::SurfacePoints walls = bake::wall_points(field);
            bake::fit_to_points(*reader, walls.points, walls.checks, options.fit, alone);
            print("by walls", readers::error_of(*reader, alone, points));
            alone = field;
            const bake::SurfacePoints surfaces = bake::scene_points(scene, field, silent);
            bake::fit_to_points(*reader, surfaces.points, surfaces.checks, options.fit, alone);
            print("by surfaces", readers::error_of(*reader, alone, points));
        }
        std::printf("  below 0 %.2f %%", 100 * negative_light(*reader, fitted, points));
        std::printf("  told %4.1f %%, contested %.1f %%; air %4.1f %% (dark %4.1f %%); %zu cells, "
                    "%zu points, %d steps"
                    " to %.1e, %.2f s of %.2f s; negative cells %.1f %% to %.1f %%\n",
                    100 * fit.after.relative, 100 * fit.contested.share, 100 * fit.fit.moved,
                    100 * fit.fit.moved_dark, fit.fit.cells, fit.fit.points, fit.fit.steps,
                    fit.fit.residual, seconds, bake_seconds, 100 * negative_share(field, order),
                    100 * negative_share(fitted, order));
    }
}

} // namespace
} // namespace lpvbake

int main(int count, char** arguments) {
    using namespace lpvbake;
    Scene scene = scene_named(count > 1 ? arguments[1] : "lamp");
    Options options;
    for (int i = 2; i < count; ++i) {
        const std::string name = arguments[i];
        const char* value = i + 1 < count ? arguments[i + 1] : "";
        if (const readers::Reader* reader = readers::reader_named(name)) {
            options.readers.push_back(reader);
            continue;
        }
        if (i == 2) {
            options.resolution = std::atoi(arguments[i]);
            continue;
        }
        ++i;
        if (name == "--sun")
            scene.lights.push_back(cmd::options::parse_sun(value));
        else if (name == "--point")
            scene.lights.push_back(cmd::options::parse_point(value));
        else if (name == "--points")
            options.points = uint64_t(std::atoll(value));
        else if (name == "--paths")
            options.paths = uint64_t(std::atoll(value));
        else if (name == "--traced")
            options.traced = std::atoi(value) != 0;
        else if (name == "--alone")
            options.alone = std::atoi(value) != 0;
        else if (name == "--air")
            options.air = std::atoi(value) != 0;
        else if (name == "--hold") {
            options.fit.solve.hold_valid = std::atof(value);
            options.fit.solve.hold_other = std::atof(value) / 20;
        } else if (name == "--density")
            options.fit.density = std::atof(value);
        else if (name == "--rays")
            options.fit.rays = uint64_t(std::atoll(value));
        else if (name == "--steps")
            options.fit.solve.steps = std::atoi(value);
        else
            return 1;
    }
    if (options.readers.empty())
        for (const char* name : {"lpvbake", "unity", "threejs", "vrc", "bevy"})
            options.readers.push_back(readers::reader_named(name));
    measure(scene, options);
}
