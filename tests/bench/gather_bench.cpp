// Error and time of the gather beside path-traced probes: one bounce, one line a setting.
//
// lpvbake_gather_bench SCENE RESOLUTION [LIGHT]... [vpls=N,kappa=X,tolerance=X,order=N,...]...
//   SCENE: cornell, rooms, canyon, sky, or a glTF file
//   LIGHT: sun:AZIMUTH,ELEVATION,LUX or point:X,Y,Z,CD
//   repeat=N takes the best of so many runs; in the first setting rays=N and probes=N are the
//   reference's
#include "lpvbake/scene.h"
#include "options/lights.h"
#include "reference/reference.h"
#include "scenes.h"
#include "solver/gather/gather.h"
#include "visibility/validity.h"
#include "volume/compare.h"
#include "volume/grid.h"
#include "volume/sh.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <string>

namespace lpvbake {
namespace {

double seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

/// Two rooms of 2 m x 2 m x 2 m side by side, a wall of 5 cm with a door between them; a lamp in
/// the first.
Scene rooms() {
    Scene scene;
    const int white = scenes::add_material(scene, glm::vec3(0.7f));
    scenes::add_box(scene, white, {0, 0, 0}, {4.05f, 2, 2}, scenes::Facing::inward);
    scenes::add_box(scene, white, {2, 0, 0}, {2.05f, 2, 0.7f}, scenes::Facing::outward);
    scenes::add_box(scene, white, {2, 0, 1.3f}, {2.05f, 2, 2}, scenes::Facing::outward);
    scenes::add_box(scene, white, {2, 1.5f, 0.7f}, {2.05f, 2, 1.3f}, scenes::Facing::outward);
    scene.lights.push_back(scenes::point_light({0.8, 1.7, 0.7}, 100.0));
    return scene;
}

/// A street of 4 m between houses of 8 m, in the sun.
Scene canyon() {
    Scene scene;
    const int grey = scenes::add_material(scene, glm::vec3(0.4f));
    const int red = scenes::add_material(scene, {0.6f, 0.3f, 0.2f});
    scenes::add_quad(scene, grey, {-5, 0, 8}, {10, 0, 0}, {0, 0, -16});
    for (int i = 0; i < 3; ++i) {
        const float z = -8.0f + 5.5f * float(i);
        scenes::add_box(scene, red, {-5, 0, z}, {-2, 8, z + 5}, scenes::Facing::outward);
        scenes::add_box(scene, grey, {2, 0, z + 0.3f}, {5, 7, z + 5}, scenes::Facing::outward);
    }
    scene.lights.push_back(scenes::sun({0.6, -1.0, 0.3}, 50000.0));
    return scene;
}

/// Of all threads, over the two that the program has where nothing else runs.
double processor_seconds() {
    return 0.5 * double(std::clock()) / CLOCKS_PER_SEC;
}

double value(const char* text, const char* name, double otherwise) {
    const char* found = std::strstr(text, (std::string(name) + "=").c_str());
    return found ? std::atof(found + std::strlen(name) + 1) : otherwise;
}

int run(const std::string& name, int resolution, int count, char** settings_texts) {
    Scene scene = name == "rooms"                     ? rooms()
                  : name == "canyon" || name == "sky" ? canyon()
                  : name == "cornell"                 ? scenes::cornell_box_with_point()
                                                      : load_gltf(name, {});
    if (name == "sky") {
        scene.lights.clear();
        scene.sky.luminance = {1000, 2000, 4000};
    }
    for (; count > 0 && std::strchr(settings_texts[0], ':'); --count, ++settings_texts) {
        const std::string text = settings_texts[0], rest = text.substr(text.find(':') + 1);
        scene.lights.push_back(text[0] == 's' ? cmd::options::parse_sun(rest)
                                              : cmd::options::parse_point(rest));
    }
    const Bounds box = bounds_of(scene);
    const Grid grid = volume::fit_grid(box.lo, box.hi, {resolution});
    const scene::Frame frame{grid.origin, grid.cell, glm::dvec3(grid.dims)};
    const visibility::Visibility visibility(scene, frame);
    Progress silent;
    double start = seconds();
    const surface::LitSurfaces lit = surface::light_surfaces(scene, visibility, frame, {}, silent);
    std::printf("%s %d x %d x %d: %zu patches lit in %.2f s\n", name.c_str(), grid.dims.x,
                grid.dims.y, grid.dims.z, lit.patches.size(), seconds() - start);

    Volume volume;
    volume.grid = grid;
    volume.validity = visibility::trace_validity(visibility, grid.dims);
    // Probes: valid cells that lie inside the scene.
    std::vector<size_t> cells;
    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    const int probes = int(value(settings_texts[0] ? settings_texts[0] : "", "probes", 400));
    uint64_t random = 1;
    for (int tries = 0; tries < 100 * probes && int(cells.size()) < probes; ++tries) {
        glm::ivec3 cell;
        for (int i = 0; i < 3; ++i) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            cell[i] = int((random >> 33) % uint64_t(grid.dims[i] - 2)) + 1;
        }
        const glm::dvec3 p = grid.center(cell);
        if (!(volume.validity[grid.index(cell)] > 0.0f) || glm::any(glm::lessThan(p, box.lo))
            || glm::any(glm::greaterThan(p, box.hi)))
            continue;
        cells.push_back(grid.index(cell));
        points.push_back(glm::vec3(cell) + 0.5f);
        keys.push_back(cells.size());
    }
    reference::ReferenceSettings settings;
    settings.sh_order = 4;
    settings.rays = uint64_t(value(settings_texts[0] ? settings_texts[0] : "", "rays", 8192));
    start = seconds();
    const reference::ProbeField truth =
        reference::trace_probes(scene, visibility, frame, points, keys, settings, silent,
                                {volume::neighbour_normals(), {}});
    const double reference_time = seconds() - start;

    const auto irradiance = [](const auto& sh, size_t at, int order, int channel, glm::vec3 n) {
        std::vector<float> c;
        for (int k = 0; k < volume::sh_count(order); ++k)
            c.push_back(sh[size_t(k)][at][channel]);
        return std::max(0.0, double(volume::sh_irradiance(c, n)));
    };
    const auto& normals = volume::neighbour_normals();
    double sum = 0.0, noise = 0.0, floor_1 = 0.0, floor_2 = 0.0, floor_4 = 0.0;
    for (size_t i = 0; i < cells.size(); ++i)
        for (size_t n = 0; n < normals.size(); ++n)
            for (int c = 0; c < 3; ++c) {
                const double e = double(truth.irradiance[n][i][c]);
                const glm::vec3 w(normals[n]);
                sum += e;
                noise += 0.8 * double(truth.irradiance_error[n][i][c]);
                floor_1 += std::abs(e - irradiance(truth.sh, i, 1, c, w));
                floor_2 += std::abs(e - irradiance(truth.sh, i, 2, c, w));
                floor_4 += std::abs(e - irradiance(truth.sh, i, 4, c, w));
            }
    std::printf("%zu probes of %llu rays in %.2f s (%.3g s a cell at 64 rays); their noise %.2f %%;"
                " floor L1 %.2f %%, L2 %.2f %%, L4 %.2f %%\n",
                cells.size(), static_cast<unsigned long long>(truth.rays), reference_time,
                reference_time / double(cells.size()) / double(truth.rays) * 64, 100 * noise / sum,
                100 * floor_1 / sum, 100 * floor_2 / sum, 100 * floor_4 / sum);
    // What probes of so many rays would err.
    std::printf("%-32s %6s %6s %6s %6s %6s | %6s %6s %6s %6s %6s %6s %6s | %7s %7s %6s %6s\n",
                "setting", "error", "to SH", "bias", "energy", "dark", "total", "cpu/2", "tree",
                "see", "list", "device", "mix", "solved", "mixed", "rays", "src");
    const gpu::Device device{gpu::DeviceOptions{}};
    for (int s = 0; s < std::max(count, 1); ++s) {
        const char* text = count ? settings_texts[s] : "";
        solver::gather::GatherSettings gather;
        gather.order = int(value(text, "order", gather.order));
        gather.vpls = int(value(text, "vpls", gather.vpls));
        gather.kappa = float(value(text, "kappa", double(gather.kappa)));
        gather.tolerance = float(value(text, "tolerance", double(gather.tolerance)));
        const solver::gather::GatherProgram program(device, gather);
        solver::gather::GatherReport report;
        double best = 1e9, processor = 1e9;
        for (int repeat = 0; repeat < int(value(text, "repeat", 1)); ++repeat) {
            start = seconds();
            const double before = processor_seconds();
            report = program.gather(lit, scene.sky, visibility, volume, silent);
            best = std::min(best, seconds() - start);
            processor = std::min(processor, processor_seconds() - before);
        }
        double error = 0.0, to_sh = 0.0, got = 0.0, c0 = 0.0, c0_truth = 0.0, dark = 0.0,
               dark_truth = 0.0;
        for (size_t i = 0; i < cells.size(); ++i)
            for (int c = 0; c < 3; ++c) {
                c0 += double(volume.sh[0][cells[i]][c]);
                c0_truth += double(truth.sh[0][i][c]);
                if (points[i].x > 0.5f * float(grid.dims.x)) {
                    dark += double(volume.sh[0][cells[i]][c]);
                    dark_truth += double(truth.sh[0][i][c]);
                }
                for (size_t n = 0; n < normals.size(); ++n) {
                    const glm::vec3 w(normals[n]);
                    const double e = irradiance(volume.sh, cells[i], gather.order, c, w);
                    error += std::abs(e - double(truth.irradiance[n][i][c]));
                    to_sh += std::abs(e - irradiance(truth.sh, i, gather.order, c, w));
                    got += e;
                }
            }
        std::printf("%-32s %6.2f %6.2f %6.3f %6.3f %6.3f | %6.3f %6.3f %6.3f %6.3f %6.3f %6.3f "
                    "%6.3f | %7llu "
                    "%7llu %6.2f %6.1f\n",
                    text, 100 * error / sum, 100 * to_sh / sum, got / sum, c0 / c0_truth,
                    dark / dark_truth, best, processor, report.clusters_seconds,
                    report.visibility_seconds, report.lists_seconds, report.device_seconds,
                    report.interpolation_seconds, static_cast<unsigned long long>(report.solved),
                    static_cast<unsigned long long>(report.interpolated),
                    1e-6 * double(report.rays), double(report.sources) / double(report.solved));
        std::fflush(stdout);
    }
    return 0;
}

} // namespace
} // namespace lpvbake

int main(int argc, char** argv) {
    if (argc < 3) {
        std::fprintf(stderr, "lpvbake_gather_bench SCENE RESOLUTION [SETTING=VALUE,...]...\n");
        return 1;
    }
    return lpvbake::run(argv[1], std::atoi(argv[2]), argc - 3, argv + 3);
}
