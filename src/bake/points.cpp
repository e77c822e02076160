#include "bake/points.h"

#include "lpvbake/error.h"
#include "text.h"
#include "visibility/around.h"
#include "visibility/capture.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace lpvbake::bake {
namespace {

constexpr double farthest = 1e6; ///< cells from the grid's corner

/// Margins that a point of a surface is moved along its normal, to be clear of it.
constexpr float before_surface = 1.1f;

/// Where light is asked for, frame units.
std::vector<glm::vec3> places_of(const volume::Points& points, const scene::Frame& frame,
                                 const visibility::Visibility& visibility) {
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        const glm::dvec3 at = points.positions[i], place = frame.from_world(at);
        if (!(std::max({std::abs(place.x), std::abs(place.y), std::abs(place.z)}) < farthest))
            throw Error(ErrorKind::invalid,
                        format("points[%zu], %.6g,%.6g,%.6g, is more than a million patches of "
                               "%.4g m from the scene; leave it out",
                               i, at.x, at.y, at.z, frame.unit));
    }
    std::vector<glm::vec3> places(points.positions.size());
    tbb::parallel_for(std::size_t(0), places.size(), [&](std::size_t i) {
        places[i] = frame.from_world(points.positions[i]);
        if (!points.normals.empty()
            && visibility.nearest_point(places[i], surface_margin, {}, 0.0f))
            places[i] += before_surface * surface_margin * points.normals[i];
    });
    return places;
}

/// Finds validity, backs and sky.
void look(const std::vector<glm::vec3>& places, const visibility::Visibility& visibility,
          volume::LitPoints& lit, solver::Stages& stages) {
    const std::size_t count = places.size();
    lit.light.validity.resize(count);
    lit.backs.resize(count);
    lit.sky.resize(count);
    stages.begin("around", count);
    constexpr std::size_t block = 8192;
    for (std::size_t first = 0; first < count; first += block) {
        stages.progress().advance(first);
        tbb::parallel_for(first, std::min(count, first + block), [&](std::size_t i) {
            const visibility::Capture capture = visibility.capture_at(places[i]);
            const visibility::Around around = visibility::look_around(visibility, capture.point);
            const bool outside =
                capture.open && visibility::backs_around(visibility, capture.point, 0) <= 0;
            lit.light.validity[i] = outside ? 1.0f : 0.0f;
            lit.backs[i] = around.backs;
            lit.sky[i] = around.sky;
        });
    }
    stages.end(counted(uint64_t(std::ranges::count(lit.light.validity, 0.0f)), "point")
               + " inside geometry");
}

} // namespace

void find_irradiance(volume::LitPoints& lit) {
    lit.irradiance.resize(lit.points.normals.size());
    tbb::parallel_for(std::size_t(0), lit.irradiance.size(), [&](std::size_t i) {
        std::array<float, volume::sh_count(volume::sh_max_order)> one;
        for (int channel = 0; channel < 3; ++channel) {
            for (std::size_t k = 0; k < lit.light.sh.size(); ++k)
                one[k] = lit.light.sh[k][i][channel];
            lit.irradiance[i][channel] =
                std::max(0.0f, volume::sh_irradiance(std::span(one).first(lit.light.sh.size()),
                                                     lit.points.normals[i]));
        }
    });
}

BakedPoints bake_points(const Scene& scene, const BakePlan& plan, volume::Points points,
                        const gpu::Device& device, Progress& progress) {
    BakedPoints baked;
    baked.warnings = plan.warnings;
    volume::LitPoints& lit = baked.lit;
    lit.points = std::move(points);
    lit.light.grid.dims = {int(lit.points.positions.size()), 1, 1};
    solver::Stages stages(progress, baked.warnings, scene.path, plan.settings.cache);
    const std::unique_ptr<solver::Solver> solver =
        plan.settings.solver.kind().make(device, plan.grid, plan.settings.solver);

    const visibility::Visibility visibility = open_scene(scene, plan, device, stages);
    const std::vector<glm::vec3> places = places_of(lit.points, plan.frame, visibility);
    const std::vector<scene::LightLayer> layers = layers_in(plan);
    const surface::LitSurfaces surfaces = light_scene(scene, plan, visibility, stages, layers);
    look(places, visibility, lit, stages);
    solver::Inputs inputs{scene, device, plan.grid, plan.frame, visibility, &surfaces, plan.maps};
    inputs.layers = layers;
    baked.layers.resize(layers.size());
    for (Volume& layer : baked.layers)
        layer.grid = lit.light.grid;
    solver->solve_at(places, inputs, stages, lit.light, baked.layers);
    find_irradiance(lit);
    describe_light(scene, plan, device, visibility, lit.light);
    for (std::size_t i = 0; i < layers.size(); ++i) {
        baked.layers[i].validity = lit.light.validity;
        describe_layer(plan, plan.settings.layers[i], lit.light, baked.layers[i]);
    }
    baked.stages = stages.reports();
    return baked;
}

} // namespace lpvbake::bake
