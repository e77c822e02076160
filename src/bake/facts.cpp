#include "bake/facts.h"

#include "lpvbake/error.h"

namespace lpvbake::bake {
namespace {

/// Of all placed triangles, m^2.
double surface_area(const Scene& scene) {
    double area = 0.0;
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const glm::dmat3 turn(instance.to_world);
        for (const glm::uvec3& t : mesh.triangles) {
            const glm::dvec3 origin(mesh.positions[t.x]);
            area += 0.5
                    * glm::length(glm::cross(turn * (glm::dvec3(mesh.positions[t.y]) - origin),
                                             turn * (glm::dvec3(mesh.positions[t.z]) - origin)));
        }
    }
    return area;
}

} // namespace

SceneFacts survey(const Scene& scene) {
    SceneFacts facts;
    facts.path = scene.path;
    facts.warnings = scene.warnings;
    facts.triangles = scene::triangle_count(scene);
    if (facts.triangles == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to light");
    facts.area = surface_area(scene);
    facts.bounds = bounds_of(scene);
    facts.crowd = scene::trimmed_bounds(scene, 0.01);
    facts.lights = scene.lights;
    facts.emitters = scene::has_emitters(scene);
    facts.sky = scene::has_sky(scene);
    return facts;
}

} // namespace lpvbake::bake
