#include "reference/emitters.h"

#include "scene/material.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::reference {
namespace {

/// Largest channel of what the triangle emits, mean over points spread over it.
double mean_emission(const Scene& scene, const Mesh& mesh, uint32_t triangle) {
    const Material& material = scene.materials[size_t(mesh.material)];
    const bool even = material.emission_texture < 0 && material.alpha_mode == AlphaMode::opaque;
    const int steps = even ? 1 : 6;
    double sum = 0.0;
    int points = 0;
    for (int i = 0; i < steps; ++i)
        for (int j = 0; i + j < steps; ++j, ++points) {
            const glm::vec2 place = (glm::vec2(i, j) + 1.0f / 3.0f) / float(steps);
            const glm::vec3 emission = scene::sample_emission(scene, mesh, triangle, place);
            sum += double(std::max({emission.r, emission.g, emission.b}));
        }
    return sum / points;
}

} // namespace

Emitters::Emitters(const Scene& scene, const scene::Frame& frame)
    : first_(scene.instances.size(), ~0u) {
    double total = 0.0;
    for (uint32_t i = 0; i < scene.instances.size(); ++i) {
        const Mesh& mesh = scene.meshes[size_t(scene.instances[i].mesh)];
        if (scene.materials[size_t(mesh.material)].emission == glm::vec3(0.0f))
            continue;
        first_[i] = uint32_t(triangles_.size());
        const std::vector<glm::vec3> placed =
            scene::positions_in_frame(scene, scene.instances[i], frame);
        for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
            const glm::uvec3 v = mesh.triangles[t];
            const glm::vec3 ab = placed[v.y] - placed[v.x], ac = placed[v.z] - placed[v.x];
            const double area = 0.5 * glm::length(glm::cross(glm::dvec3(ab), glm::dvec3(ac)));
            const double luminance = area > 0.0 ? mean_emission(scene, mesh, t) : 0.0;
            triangles_.push_back({placed[v.x], ab, ac, i, t, luminance});
            cumulative_.push_back(total += area * luminance);
        }
    }
    if (!(total > 0.0)) {
        triangles_.clear();
        return;
    }
    for (double& power : cumulative_)
        power /= total;
    for (Triangle& triangle : triangles_)
        triangle.luminance /= total;
}

Emitters::Target Emitters::target(glm::dvec2 sample) const {
    const auto chosen = std::upper_bound(cumulative_.begin(), cumulative_.end() - 1, sample.x);
    const size_t i = size_t(chosen - cumulative_.begin());
    // What is left of the first number is uniform within the triangle's share.
    const double below = i ? cumulative_[i - 1] : 0.0;
    const double rest =
        std::clamp((sample.x - below) / std::max(*chosen - below, 1e-300), 0.0, 1.0);
    const double root = std::sqrt(rest);
    const Triangle& t = triangles_[i];
    const glm::dvec3 point = glm::dvec3(t.a) + root * (1.0 - sample.y) * glm::dvec3(t.ab)
                             + root * sample.y * glm::dvec3(t.ac);
    return {t.instance, t.triangle, point};
}

double Emitters::density(const visibility::Hit& hit, glm::dvec3 towards) const {
    if (triangles_.empty() || first_[hit.instance] == ~0u)
        return 0.0;
    const double cosine = std::abs(glm::dot(glm::dvec3(hit.normal), towards));
    const double distance = double(hit.t);
    return cosine > 0.0 ? triangles_[first_[hit.instance] + hit.triangle].luminance * distance
                              * distance / cosine
                        : 0.0;
}

} // namespace lpvbake::reference
