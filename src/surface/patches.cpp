#include "surface/patches.h"

#include "error.h"
#include "scene/material.h"

#include <tbb/parallel_for.h>

#include <array>
#include <atomic>

namespace lpvbake {
namespace {

/// 2 GiB of them. Many sheets that lie on each other could ask for any number.
constexpr uint64_t most_patches = 1 << 25;

/// A corner of a piece: where it is, and its weights in the triangle that it was cut from.
struct Corner {
    glm::vec3 position;
    glm::vec2 barycentric;
};
using Piece = std::array<Corner, 3>;

/// Stratified points of a triangle: centroids of the 16 triangles of its twofold subdivision.
std::array<glm::vec2, 16> sample_points() {
    std::array<glm::vec2, 16> points;
    size_t n = 0;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4 - i; ++j) {
            points[n++] = {(float(i) + 1.0f / 3.0f) / 4.0f, (float(j) + 1.0f / 3.0f) / 4.0f};
            if (i + j < 3)
                points[n++] = {(float(i) + 2.0f / 3.0f) / 4.0f, (float(j) + 2.0f / 3.0f) / 4.0f};
        }
    return points;
}

bool outside(const Piece& piece, glm::vec3 extent) {
    const glm::vec3 a = piece[0].position, b = piece[1].position, c = piece[2].position;
    return glm::any(glm::lessThan(glm::max(a, glm::max(b, c)), glm::vec3(0.0f)))
           || glm::any(glm::greaterThan(glm::min(a, glm::min(b, c)), extent));
}

/// What is constant over one triangle of the scene while it is cut.
struct Source {
    const Scene& scene;
    const Mesh& mesh;
    glm::vec3 extent;
    float max_edge;
    bool textured;
    bool emissive;
    std::atomic<uint64_t>& made; ///< patches so far, of the whole scene
    Patch patch; ///< normal, origin, sidedness; alpha and emission where they are constant
};

void shade(const Source& source, const Piece& piece, Patch& patch) {
    static const std::array<glm::vec2, 16> points = sample_points();
    glm::vec3 emission{0.0f};
    float alpha = 0.0f;
    for (const glm::vec2& p : points) {
        const glm::vec2 b = (1.0f - p.x - p.y) * piece[0].barycentric + p.x * piece[1].barycentric
                            + p.y * piece[2].barycentric;
        alpha += sample_surface(source.scene, source.mesh, patch.triangle, b).alpha;
        if (source.emissive)
            emission += sample_emission(source.scene, source.mesh, patch.triangle, b);
    }
    patch.alpha = alpha / float(points.size());
    patch.emission = emission / float(points.size());
}

/// Halves the longest edge until the piece is small enough.
void cut(const Source& source, const Piece& triangle, std::vector<Patch>& patches) {
    std::vector<Piece> stack{triangle};
    while (!stack.empty()) {
        const Piece piece = stack.back();
        stack.pop_back();
        if (outside(piece, source.extent))
            continue;
        float longest = 0.0f;
        size_t at = 0;
        for (size_t i = 0; i < 3; ++i) {
            const float length = glm::distance(piece[i].position, piece[(i + 1) % 3].position);
            if (length > longest) {
                longest = length;
                at = i;
            }
        }
        const Corner a = piece[at], b = piece[(at + 1) % 3], c = piece[(at + 2) % 3];
        if (longest > source.max_edge) {
            const Corner middle{0.5f * (a.position + b.position),
                                0.5f * (a.barycentric + b.barycentric)};
            stack.push_back({middle, b, c});
            stack.push_back({a, middle, c});
            continue;
        }
        Patch patch = source.patch;
        patch.position = (a.position + b.position + c.position) / 3.0f;
        if (glm::any(glm::lessThan(patch.position, glm::vec3(0.0f)))
            || glm::any(glm::greaterThan(patch.position, source.extent)))
            continue;
        patch.barycentric = (a.barycentric + b.barycentric + c.barycentric) / 3.0f;
        patch.area =
            0.5f * glm::length(glm::cross(b.position - a.position, c.position - a.position));
        if (source.textured)
            shade(source, piece, patch);
        if (!(patch.area > 0.0f && patch.alpha > 0.0f))
            continue;
        if (++source.made > most_patches)
            throw Error(ExitCode::memory,
                        source.scene.path + ": more than " + std::to_string(most_patches)
                            + " patches of surface lie in the grid; lower --resolution");
        patches.push_back(patch);
    }
}

} // namespace

std::vector<Patch> make_patches(const Scene& scene, const Frame& frame, float max_edge) {
    std::vector<std::vector<Patch>> parts(scene.instances.size());
    std::atomic<uint64_t> made = 0;
    tbb::parallel_for(size_t(0), scene.instances.size(), [&](size_t i) {
        const Instance& instance = scene.instances[i];
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const Material& material = scene.materials[size_t(mesh.material)];
        const std::vector<glm::vec3> placed = positions_in_frame(scene, instance, frame);
        const float side = is_mirrored(instance) ? -1.0f : 1.0f;
        Source source{scene,
                      mesh,
                      glm::vec3(frame.extent),
                      max_edge,
                      material.alpha_mode != AlphaMode::opaque || material.emission_texture >= 0,
                      material.emission != glm::vec3(0.0f),
                      made,
                      {}};
        source.patch.instance = uint32_t(i);
        source.patch.double_sided = material.double_sided;
        if (!source.textured)
            source.patch.emission = material.emission;
        for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
            const glm::uvec3 v = mesh.triangles[t];
            const glm::vec3 a = placed[v.x], b = placed[v.y], c = placed[v.z];
            const glm::dvec3 normal =
                glm::cross(glm::dvec3(b) - glm::dvec3(a), glm::dvec3(c) - glm::dvec3(a));
            const double length = glm::length(normal);
            if (!(length > 0.0))
                continue;
            source.patch.triangle = t;
            source.patch.normal = side * glm::vec3(normal / length);
            cut(source, {Corner{a, {0, 0}}, Corner{b, {1, 0}}, Corner{c, {0, 1}}}, parts[i]);
        }
    });
    std::vector<Patch> patches;
    for (const std::vector<Patch>& part : parts)
        patches.insert(patches.end(), part.begin(), part.end());
    return patches;
}

} // namespace lpvbake
