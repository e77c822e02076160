// What it costs to light all surfaces, beside what their light is worth: processor time, patches,
// elements and power.
//
// Usage: lpvbake_lighting SCENE RESOLUTION [--rays N] [--bounces N] [--sun A,E,LUX]
//        [--point X,Y,Z,CD] [--sky NITS]
#include "lpvbake/scene.h"
#include "options/lights.h"
#include "scene/frame.h"
#include "surface/elements.h"
#include "surface/lit_surfaces.h"
#include "visibility/visibility.h"
#include "volume/grid.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

namespace lpvbake {
namespace {

/// Processor time of all threads, s: what else the machine does leaves it alone.
double seconds() {
    return double(std::clock()) / CLOCKS_PER_SEC;
}

/// What leaves the surfaces, per square unit: luminance times area.
double power_of(const surface::LitSurfaces& lit) {
    double sum = 0.0;
    for (size_t i = 0; i < lit.luminance.size(); ++i) {
        const surface::Patch& patch = lit.patches[i / 2];
        sum += double(patch.area * patch.alpha)
               * double(lit.luminance[i].x + lit.luminance[i].y + lit.luminance[i].z);
    }
    return sum;
}

void measure(const Scene& scene, int resolution, const surface::LightingSettings& settings) {
    const Bounds box = bounds_of(scene);
    const Grid grid = volume::fit_grid(box.lo, box.hi, {resolution});
    const scene::Frame frame = scene::frame_of(grid);
    const visibility::Visibility visibility(scene, frame);
    Progress silent;
    double least = HUGE_VAL;
    surface::LitSurfaces lit;
    for (int i = 0; i < 3; ++i) {
        const double start = seconds();
        lit = surface::light_surfaces(scene, visibility, frame, settings, silent);
        least = std::min(least, seconds() - start);
    }
    double cover = HUGE_VAL;
    for (int i = 0; i < 3; ++i) {
        const double start = seconds();
        surface::cover_surfaces(scene, frame, visibility, 1.0f);
        cover = std::min(cover, seconds() - start);
    }
    const size_t elements =
        surface::group_sides(lit.patches, visibility, glm::vec3(frame.extent)).size();
    std::printf("%zu patches, %zu elements, %d reflections, power %.7g: %.3f s, of it patches "
                "%.3f s\n",
                lit.patches.size(), elements, lit.bounces, power_of(lit), least, cover);
}

} // namespace
} // namespace lpvbake

int main(int count, char** arguments) {
    using namespace lpvbake;
    if (count < 3)
        return 1;
    Scene scene = load_gltf(arguments[1]);
    surface::LightingSettings settings;
    settings.bounces.reset();
    for (int i = 3; i + 1 < count; i += 2) {
        const std::string name = arguments[i];
        const char* value = arguments[i + 1];
        if (name == "--rays")
            settings.rays = uint64_t(std::atoll(value));
        else if (name == "--bounces")
            settings.bounces = std::atoi(value);
        else if (name == "--sun")
            scene.lights.push_back(cmd::options::parse_sun(value));
        else if (name == "--point")
            scene.lights.push_back(cmd::options::parse_point(value));
        else if (name == "--sky")
            scene.sky.luminance = glm::vec3(float(std::atof(value)));
        else
            return 1;
    }
    measure(scene, std::atoi(arguments[2]), settings);
}
