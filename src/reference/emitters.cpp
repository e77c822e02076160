#include "reference/emitters.h"

#include "scene/material.h"
#include "scene/roles.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::reference {
namespace {

/// Pieces that textures may ask for, of all triangles together, and of each at least.
constexpr size_t most_pieces = 1 << 16, least_pieces = 16;

double greatest(glm::vec3 v) {
    return double(std::max({v.x, v.y, v.z}));
}

} // namespace

Emitters::Emitters(const Scene& scene, const scene::Frame& frame)
    : first_(scene.instances.size(), ~0u) {
    const scene::EmissionMaps maps(scene);
    size_t textured = 1;
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        if (scene.materials[size_t(mesh.material)].emission_texture >= 0)
            textured += mesh.triangles.size();
    }
    const size_t most = std::max(most_pieces / textured, least_pieces);
    for (uint32_t i = 0; i < scene.instances.size(); ++i) {
        const Mesh& mesh = scene.meshes[size_t(scene.instances[i].mesh)];
        const Material& material = scene.materials[size_t(mesh.material)];
        const Instance& instance = scene.instances[i];
        if (material.emission == glm::vec3(0.0f) || !scene::shines(instance.role))
            continue;
        const bool even = material.emission_texture < 0 && !scene::is_partly_clear(material);
        first_[i] = uint32_t(triangles_.size());
        const std::vector<glm::vec3> placed = scene::positions_in_frame(scene, instance, frame);
        for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
            const glm::uvec3 v = mesh.triangles[t];
            triangles_.push_back({placed[v.x], placed[v.y] - placed[v.x], placed[v.z] - placed[v.x],
                                  i, t, uint32_t(nodes_.size()),
                                  scene::is_mirrored(instance) ? -1.0f : 1.0f,
                                  material.double_sided, scene::blocks(instance.role)});
            halve(maps, mesh, uint32_t(triangles_.size() - 1), even ? 1 : most);
        }
    }
    const double total = cumulative_.empty() ? 0.0 : cumulative_.back();
    if (!(total > 0.0)) {
        pieces_.clear();
        return;
    }
    for (double& power : cumulative_)
        power /= total;
    for (Node& node : nodes_)
        node.density /= total;
}

void Emitters::halve(const scene::EmissionMaps& maps, const Mesh& mesh, uint32_t triangle,
                     size_t most) {
    struct Open {
        Piece piece;
        uint32_t node;
    };
    const Triangle& placed = triangles_[triangle];
    const auto area_of = [](glm::vec3 u, glm::vec3 v) {
        return 0.5 * glm::length(glm::cross(glm::dvec3(u), glm::dvec3(v)));
    };
    nodes_.emplace_back();
    // The large ones first.
    std::vector<Open> open{{{triangle, whole_triangle}, placed.root}};
    for (size_t next = 0; next < open.size(); ++next) {
        const Piece piece = open[next].piece;
        const uint32_t node = open[next].node;
        const auto edge = [&](size_t to) {
            const glm::vec2 w = piece.corners[to] - piece.corners[0];
            return w.x * placed.ab + w.y * placed.ac;
        };
        const double area = area_of(edge(1), edge(2));
        if (!(area > 0.0))
            continue;
        const scene::PieceEmission emission = maps.over(mesh, placed.triangle, piece.corners);
        const double luminance = greatest(emission.mean);
        if (!(luminance > 0.0))
            continue;
        if (open.size() < 2 * most - 1 && emission.lit < 0.8f) {
            const Halves halves = halves_of(piece.corners, placed.ab, placed.ac);
            nodes_[node].first_half = uint32_t(nodes_.size());
            nodes_[node].edge = halves.edge;
            open.push_back({{triangle, halves.first}, uint32_t(nodes_.size())});
            open.push_back({{triangle, halves.second}, uint32_t(nodes_.size() + 1)});
            nodes_.resize(nodes_.size() + 2);
            continue;
        }
        // The root of the mean square: the variance is least where a piece glows in part.
        const double density = luminance / std::sqrt(double(emission.lit));
        nodes_[node].density = density;
        pieces_.push_back(piece);
        cumulative_.push_back((cumulative_.empty() ? 0.0 : cumulative_.back()) + area * density);
    }
}

Emitters::Target Emitters::target(glm::dvec2 sample) const {
    const auto chosen = std::upper_bound(cumulative_.begin(), cumulative_.end() - 1, sample.x);
    const size_t i = size_t(chosen - cumulative_.begin());
    // What is left of the first number is uniform within the piece's share.
    const double below = i ? cumulative_[i - 1] : 0.0;
    const double rest =
        std::clamp((sample.x - below) / std::max(*chosen - below, 1e-300), 0.0, 1.0);
    const glm::dvec2 weights = point_in(pieces_[i].corners, {rest, sample.y});
    const Triangle& t = triangles_[pieces_[i].triangle];
    Target target{t.instance, t.triangle,
                  glm::dvec3(t.a) + weights.x * glm::dvec3(t.ab) + weights.y * glm::dvec3(t.ac)};
    if (!t.met)
        target.unmet = {.instance = t.instance,
                        .triangle = t.triangle,
                        .barycentric = weights,
                        .normal = t.turn * glm::normalize(glm::cross(t.ab, t.ac)),
                        .facing =
                            t.two_fronts ? visibility::Facing::both : visibility::Facing::front};
    return target;
}

double Emitters::density(const visibility::Hit& hit, glm::dvec3 towards) const {
    if (pieces_.empty() || first_[hit.instance] == ~0u)
        return 0.0;
    const Node& node =
        piece_at(nodes_, triangles_[first_[hit.instance] + hit.triangle].root, hit.barycentric);
    const double cosine = std::abs(glm::dot(glm::dvec3(hit.normal), towards));
    const double distance = double(hit.t);
    return cosine > 0.0 ? node.density * distance * distance / cosine : 0.0;
}

} // namespace lpvbake::reference
