#include "render/shade.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::render {
namespace {

/// The least weight that a corner has.
constexpr double rim = 1e-4;

} // namespace

Surface::Surface(const Scene& scene, const scene::Frame& frame) : scene_(scene), frame_(frame) {
    for (const Instance& instance : scene.instances) {
        // The adjugate transposed: the inverse would not exist for a flat instance.
        const glm::dmat3 m(instance.to_world);
        normal_to_world_.push_back(
            glm::dmat3(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1])));
    }
}

std::array<glm::dvec3, 3> Surface::corners(uint32_t instance, uint32_t triangle) const {
    const Instance& placed = scene_.instances[instance];
    const Mesh& mesh = scene_.meshes[std::size_t(placed.mesh)];
    std::array<glm::dvec3, 3> corners;
    for (int i = 0; i < 3; ++i)
        corners[std::size_t(i)] = frame_.from_world(
            glm::dvec3(placed.to_world
                       * glm::dvec4(glm::dvec3(mesh.positions[mesh.triangles[triangle][i]]), 1.0)));
    return corners;
}

glm::vec2 Surface::barycentric(uint32_t instance, uint32_t triangle, glm::dvec3 origin,
                               glm::dvec3 direction) const {
    // Möller and Trumbore 1997.
    const auto [a, b, c] = corners(instance, triangle);
    const glm::dvec3 ab = b - a, ac = c - a, across = glm::cross(direction, ac);
    const double volume = glm::dot(ab, across);
    glm::dvec3 weights(1.0 / 3.0);
    if (volume != 0) {
        const glm::dvec3 way = origin - a;
        weights.y = glm::dot(way, across) / volume;
        weights.z = glm::dot(direction, glm::cross(way, ab)) / volume;
        weights.x = 1 - weights.y - weights.z;
    }
    weights = glm::clamp(weights, glm::dvec3(rim), glm::dvec3(1.0));
    weights /= weights.x + weights.y + weights.z;
    return {weights.y, weights.z};
}

SurfacePoint Surface::point(uint32_t instance, uint32_t triangle, glm::vec2 barycentric,
                            glm::dvec3 direction) const {
    SurfacePoint p;
    p.hit.instance = instance;
    p.hit.triangle = triangle;
    p.hit.barycentric = barycentric;
    const auto [a, b, c] = corners(instance, triangle);
    const glm::dvec2 weight(barycentric);
    p.point = a + weight.x * (b - a) + weight.y * (c - a);
    p.normal = glm::normalize(glm::cross(b - a, c - a));
    if (glm::dot(p.normal, direction) > 0)
        p.normal = -p.normal;
    p.smooth = p.normal;
    const Mesh& mesh = scene_.meshes[std::size_t(scene_.instances[instance].mesh)];
    if (!mesh.normals.empty()) {
        const glm::uvec3 corner = mesh.triangles[triangle];
        const glm::dvec3 mean = (1 - weight.x - weight.y) * glm::dvec3(mesh.normals[corner.x])
                                + weight.x * glm::dvec3(mesh.normals[corner.y])
                                + weight.y * glm::dvec3(mesh.normals[corner.z]);
        const glm::dvec3 world = normal_to_world_[instance] * mean;
        if (const double length = glm::length(world); length > 0)
            p.smooth = glm::dot(world, p.normal) < 0 ? -world / length : world / length;
    }
    return p;
}

} // namespace lpvbake::render
