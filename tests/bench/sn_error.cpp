// Error and time of the sweep by scene, grid and directions, against path-traced irradiance.
// Usage: lpvbake_sn_error [SCENE] [RESOLUTION] [DIRECTIONS] [PROBES]; 0 or nothing: all.
#include "reference/reference.h"
#include "scenes.h"
#include "solver/sn/directions.h"
#include "solver/sn/sn.h"
#include "visibility/validity.h"
#include "volume/compare.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <tbb/global_control.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

namespace lpvbake {
namespace {

/// Processor time of all threads, s: what else the machine does leaves it alone.
double seconds() {
    return double(std::clock()) / CLOCKS_PER_SEC;
}

/// A room of 6 m, parted by a wall with a door; the light is in one half.
Scene two_rooms() {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.7f));
    const int red = scenes::add_material(scene, {0.7f, 0.3f, 0.2f});
    const int blue = scenes::add_material(scene, {0.3f, 0.4f, 0.7f});
    using scenes::Facing;
    scenes::add_box(scene, white, {0, 0, 0}, {6, 2.5f, 3}, Facing::inward);
    scenes::add_box(scene, red, {2.95f, 0, 0}, {3.05f, 2.5f, 1}, Facing::outward);
    scenes::add_box(scene, red, {2.95f, 0, 1.9f}, {3.05f, 2.5f, 3}, Facing::outward);
    scenes::add_box(scene, red, {2.95f, 2, 1}, {3.05f, 2.5f, 1.9f}, Facing::outward);
    scenes::add_box(scene, blue, {4.5f, 0, 0.5f}, {5.2f, 1, 1.2f}, Facing::outward);
    scene.lights.push_back(scenes::point_light({1.2, 2.0, 1.7}, 100.0));
    return scene;
}

/// A street between houses.
Scene canyon() {
    Scene scene;
    const int street = scenes::add_material(scene, glm::vec3(0.3f));
    const int colors[] = {scenes::add_material(scene, {0.6f, 0.5f, 0.4f}),
                          scenes::add_material(scene, {0.4f, 0.5f, 0.6f})};
    scenes::add_quad(scene, street, {-12, 0, -15}, {0, 0, 30}, {24, 0, 0});
    for (int i = 0; i < 3; ++i) {
        const float z = float(-14 + 10 * i), height = float(2 * i);
        scenes::add_box(scene, colors[i % 2], {-11, 0, z}, {-4, 8 + height, z + 8},
                        scenes::Facing::outward);
        scenes::add_box(scene, colors[1 - i % 2], {4, 0, z + 1}, {11, 11 - height, z + 8},
                        scenes::Facing::outward);
    }
    scene.lights.push_back(scenes::sun({0.5, -1.0, 0.35}, 80000.0));
    return scene;
}

void turn(Scene& scene) {
    const glm::dmat4 turned =
        glm::rotate(glm::dmat4(1.0), glm::radians(31.0), glm::normalize(glm::dvec3(1, 3, 2)));
    for (Instance& instance : scene.instances)
        instance.to_world = turned * instance.to_world;
    for (Light& light : scene.lights) {
        light.position = glm::dvec3(turned * glm::dvec4(light.position, 1.0));
        light.direction = glm::dvec3(turned * glm::dvec4(light.direction, 0.0));
    }
}

void measure(const gpu::Device& device, const char* name, Scene scene, bool turned, int resolution,
             int wanted_directions, uint64_t probes) {
    if (turned)
        turn(scene);
    const Bounds box = bounds_of(scene);
    const Grid grid = volume::fit_grid(box.lo, box.hi, {resolution});
    const scene::Frame frame{grid.origin, grid.cell, glm::dvec3(grid.dims)};
    const visibility::Visibility visibility(scene, frame);
    const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);

    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    std::vector<size_t> cells;
    uint64_t state = 1;
    while (points.size() < probes) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        const size_t cell = size_t((state >> 20) % grid.size());
        if (validity[cell] == 0.0f)
            continue;
        const size_t nx = size_t(grid.dims.x), ny = size_t(grid.dims.y);
        points.push_back(glm::vec3(cell % nx, cell / nx % ny, cell / (nx * ny)) + 0.5f);
        keys.push_back(cell);
        cells.push_back(cell);
    }
    Progress silent;
    reference::ReferenceSettings truth;
    truth.sh_order = 2;
    truth.rays = 16384;
    const reference::ProbeField probe = reference::trace_probes(
        scene, visibility, frame, points, keys, truth, silent, {volume::neighbour_normals(), {}});
    double begin = seconds();
    const surface::LitSurfaces lit = surface::light_surfaces(scene, visibility, frame, {}, silent);
    const double lighting = seconds() - begin;

    const auto report = [&](const char* what, double time, const auto& coefficient) {
        double off = 0.0, sum = 0.0, mean = 0.0;
        for (size_t i = 0; i < points.size(); ++i)
            for (size_t n = 0; n < 26; ++n)
                for (int channel = 0; channel < 3; ++channel) {
                    std::array<float, 9> c;
                    for (size_t k = 0; k < 9; ++k)
                        c[k] = coefficient(i, k)[channel];
                    const double is =
                        std::max(0.0, double(volume::sh_irradiance(
                                          c, glm::vec3(volume::neighbour_normals()[n]))));
                    const double ought = double(probe.irradiance[n][i][channel]);
                    off += std::abs(is - ought);
                    mean += is;
                    sum += ought;
                }
        std::printf(
            "%-8s %-7s %3d  %-16s  error %6.2f %%  mean %.4f  %7.2f cpu s  (lighting %.2f)\n", name,
            turned ? "turned" : "", resolution, what, 100.0 * off / sum, mean / sum, time,
            lighting);
        std::fflush(stdout);
    };
    report("exact, SH L2", 0.0, [&](size_t i, size_t k) { return probe.sh[k][i]; });
    for (const int directions : solver::sn::sn_direction_counts()) {
        if (wanted_directions ? directions != wanted_directions : directions == 288)
            continue;
        Volume volume;
        volume.grid = grid;
        volume.validity = validity;
        const solver::sn::SnProgram program(device, grid, {directions, 2});
        begin = seconds();
        const float limit = program.gather_peaks(lit, visibility, scene.sky, silent, volume);
        const double gather = seconds() - begin;
        program.sweep(lit, visibility, scene.sky, limit, silent, volume);
        char what[40];
        std::snprintf(what, sizeof what, "%3d (gather %.2f s)", directions, gather);
        report(what, seconds() - begin, [&](size_t i, size_t k) { return volume.sh[k][cells[i]]; });
    }
}

} // namespace
} // namespace lpvbake

int main(int argc, char** argv) {
    using namespace lpvbake;
    setenv("LP_NUM_THREADS", "2", 0);
    const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, 2);
    const gpu::Device device{gpu::DeviceOptions{}};
    const char* wanted = argc > 1 ? argv[1] : "0";
    const auto number = [&](int i, int otherwise) {
        const int value = argc > i ? std::atoi(argv[i]) : 0;
        return value ? value : otherwise;
    };
    for (const int resolution : {16, 32, 64}) {
        if (number(2, resolution) != resolution)
            continue;
        for (const char* name : {"cornell", "sun", "rooms", "canyon"}) {
            if (std::strcmp(wanted, "0") != 0 && std::strcmp(wanted, name) != 0)
                continue;
            for (const bool turned : {false, true})
                measure(device, name,
                        *name == 'c' && name[1] == 'o' ? scenes::cornell_box_with_point()
                        : *name == 's'                 ? scenes::cornell_box_with_sun()
                        : *name == 'r'                 ? two_rooms()
                                                       : canyon(),
                        turned, resolution, number(3, 0), uint64_t(number(4, 300)));
        }
    }
}
