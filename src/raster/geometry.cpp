#include "raster/geometry.h"

#include "lpvbake/error.h"
#include "scene/material.h"
#include "scene/roles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <tuple>
#include <utility>

namespace lpvbake::raster {

namespace {

/// Unit normal and offset of a triangle's plane; false if it has no area.
bool plane_of(const std::array<glm::vec3, 3>& corner, glm::vec4& plane) {
    const glm::dvec3 a = corner[0];
    const glm::dvec3 area = glm::cross(glm::dvec3(corner[1]) - a, glm::dvec3(corner[2]) - a);
    const double length = glm::length(area);
    if (!(length > 0) || !std::isfinite(length))
        return false;
    const glm::dvec3 normal = area / length;
    plane = glm::vec4(glm::vec3(normal), float(glm::dot(normal, a)));
    return true;
}

} // namespace

RsmGeometry flatten(const Scene& scene, const scene::Frame& frame, bool (*is_there)(Role)) {
    // Materials that share a pipeline, then a texture, stand together.
    std::vector<int> order;
    for (size_t i = 0; i < scene.instances.size(); ++i)
        if (is_there(scene.instances[i].role))
            order.push_back(int(i));
    const auto key = [&](int i) {
        const int index = scene.meshes[scene.instances[i].mesh].material;
        const Material& material = scene.materials[index];
        return std::tuple(scene::is_partly_clear(material), material.base_color_texture, index);
    };
    std::ranges::stable_sort(order, {}, key);

    uint64_t triangles = 0;
    for (const int i : order)
        triangles += scene.meshes[scene.instances[i].mesh].triangles.size();
    if (triangles > 0x7fffffffu)
        throw Error(ErrorKind::memory, "the scene has more than 2^31 - 1 placed triangles");

    RsmGeometry geometry;
    geometry.vertices.reserve(3 * triangles);
    for (const int i : order) {
        const Instance& instance = scene.instances[i];
        const Mesh& mesh = scene.meshes[instance.mesh];
        const Material& material = scene.materials[mesh.material];
        const std::vector<glm::vec3> positions = scene::positions_in_frame(scene, instance, frame);
        const bool mirrored = scene::is_mirrored(instance);
        const glm::vec4 color =
            material.base_color
            * (instance.role == Role::cast_only ? glm::vec4(0, 0, 0, 1) : glm::vec4(1));
        if (geometry.runs.empty() || geometry.runs.back().material != mesh.material)
            geometry.runs.push_back({mesh.material, geometry.vertices.size(), 0});
        for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
            glm::uvec3 triangle = mesh.triangles[t];
            if (mirrored)
                std::swap(triangle.y, triangle.z);
            glm::vec4 plane;
            if (!plane_of({positions[triangle.x], positions[triangle.y], positions[triangle.z]},
                          plane))
                continue;
            geometry.origins.push_back({uint32_t(i), t});
            for (int corner = 0; corner < 3; ++corner) {
                const uint32_t v = triangle[corner];
                geometry.lo = glm::min(geometry.lo, glm::dvec3(positions[v]));
                geometry.hi = glm::max(geometry.hi, glm::dvec3(positions[v]));
                geometry.vertices.push_back(
                    {positions[v], plane, mesh.uv.empty() ? glm::vec2(0) : mesh.uv[v],
                     color * (mesh.colors.empty() ? glm::vec4(1) : mesh.colors[v])});
            }
        }
        geometry.runs.back().count = geometry.vertices.size() - geometry.runs.back().first;
    }
    std::erase_if(geometry.runs, [](const MaterialRun& run) { return run.count == 0; });
    return geometry;
}

} // namespace lpvbake::raster
