#include "bake/facts.h"

#include "lpvbake/error.h"
#include "scene/material.h"

#include <algorithm>

namespace lpvbake::bake {

SceneFacts survey(const Scene& scene) {
    SceneFacts facts;
    facts.path = scene.path;
    facts.warnings = scene.warnings;
    facts.triangles = scene::triangle_count(scene);
    if (facts.triangles == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to light");
    facts.surfaces = surface::sample_triangles(scene);
    facts.cuts = std::make_shared<surface::CutTrial>(scene);
    facts.bounds = bounds_of(scene);
    facts.crowd = scene::trimmed_bounds(scene, 0.01);
    facts.lights = scene.lights;
    facts.emitters = scene::has_emitters(scene);
    facts.sky = scene::has_sky(scene);
    facts.tinted = std::ranges::any_of(scene.instances, [&](const Instance& instance) {
        return scene::is_tinting(scene, scene.meshes[size_t(instance.mesh)]);
    });
    facts.two_sided = std::ranges::any_of(scene.instances, [&](const Instance& instance) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        return scene.materials[size_t(mesh.material)].double_sided;
    });
    return facts;
}

} // namespace lpvbake::bake
