#include "report/points.h"

#include "reference/sampler.h"
#include "scene/material.h"
#include "scene/roles.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::report {
namespace {

using Polygon = std::vector<glm::dvec3>;

/// The part of a convex polygon on the side of a plane across `axis` where
/// sign (p[axis] - at) <= 0 (Sutherland and Hodgman 1974).
Polygon clip(const Polygon& polygon, int axis, double at, double sign) {
    Polygon kept;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const glm::dvec3 &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
        const double a = sign * (p[axis] - at), b = sign * (q[axis] - at);
        if (a <= 0)
            kept.push_back(p);
        if ((a < 0 && b > 0) || (a > 0 && b < 0))
            kept.push_back(p + a / (a - b) * (q - p));
    }
    return kept;
}

Polygon clip(Polygon polygon, const Bounds& box) {
    for (int axis = 0; axis < 3 && !polygon.empty(); ++axis) {
        polygon = clip(polygon, axis, box.lo[axis], -1);
        polygon = clip(polygon, axis, box.hi[axis], 1);
    }
    return polygon;
}

double area(glm::dvec3 a, glm::dvec3 b, glm::dvec3 c) {
    return 0.5 * glm::length(glm::cross(b - a, c - a));
}

/// A triangle of the part of a placed triangle that lies in the box.
struct Piece {
    std::size_t instance;
    uint32_t triangle;
    glm::dvec3 a, b, c;
    double area_up_to; ///< of all pieces up to this one, square metres
};

std::array<glm::dvec3, 3> corners(const Scene& scene, std::size_t instance, uint32_t triangle) {
    const Instance& placed = scene.instances[instance];
    const Mesh& mesh = scene.meshes[std::size_t(placed.mesh)];
    std::array<glm::dvec3, 3> result;
    for (int i = 0; i < 3; ++i) {
        const glm::vec3 local = mesh.positions[mesh.triangles[triangle][i]];
        result[std::size_t(i)] = glm::dvec3(placed.to_world * glm::dvec4(local, 1.0));
    }
    return result;
}

std::vector<Piece> pieces_in(const Scene& scene, const Bounds& box) {
    std::vector<Piece> pieces;
    double sum = 0;
    for (std::size_t instance = 0; instance < scene.instances.size(); ++instance) {
        if (!scene::is_asked(scene.instances[instance].role))
            continue;
        const Mesh& mesh = scene.meshes[std::size_t(scene.instances[instance].mesh)];
        for (uint32_t triangle = 0; triangle < mesh.triangles.size(); ++triangle) {
            const auto [a, b, c] = corners(scene, instance, triangle);
            const Polygon inside = clip({a, b, c}, box);
            for (std::size_t i = 2; i < inside.size(); ++i) {
                const double own = area(inside[0], inside[i - 1], inside[i]);
                if (!(own > 0) || !std::isfinite(own))
                    continue;
                sum += own;
                pieces.push_back({instance, triangle, inside[0], inside[i - 1], inside[i], sum});
            }
        }
    }
    return pieces;
}

/// Weights of the triangle's second and third corner at a point of its plane.
glm::vec2 barycentric(glm::dvec3 p, const std::array<glm::dvec3, 3>& triangle) {
    const glm::dvec3 u = triangle[1] - triangle[0], v = triangle[2] - triangle[0];
    const glm::dvec3 n = glm::cross(u, v), w = p - triangle[0];
    const double square = glm::dot(n, n);
    return {glm::dot(glm::cross(w, v), n) / square, glm::dot(glm::cross(u, w), n) / square};
}

/// True if most of what a front sees are the backs of single-sided surfaces.
bool is_buried(const visibility::Visibility& visibility, const scene::Frame& frame,
               const FrontPoint& point, reference::PathSampler& sampler) {
    constexpr int looks = 9;
    // Clear of the surface itself, by 64 steps of single precision.
    const glm::dvec3 at = frame.from_world(point.position);
    const double lift = 0x1p-17 * std::max({1.0, std::abs(at.x), std::abs(at.y), std::abs(at.z)});
    int backs = 0;
    for (int i = 0; i < looks; ++i) {
        const glm::dvec2 sample = sampler.pair();
        const double z = 1 - 2 * sample.x, turn = glm::two_pi<double>() * sample.y;
        const double radius = std::sqrt(std::max(0.0, 1 - z * z));
        glm::dvec3 way(radius * std::cos(turn), radius * std::sin(turn), z);
        if (glm::dot(way, point.normal) < 0)
            way = -way;
        const visibility::Hit hit = visibility.closest(
            {glm::vec3(at + lift * point.normal), glm::vec3(way), 0.0f, HUGE_VALF});
        backs += hit.instance != visibility::no_hit && hit.facing == visibility::Facing::back;
    }
    return 2 * backs > looks;
}

} // namespace

std::vector<std::size_t> draw_cells(std::span<const float> validity, uint64_t count,
                                    uint64_t seed) {
    return reference::sample_cells(reference::valid_cells(validity), count,
                                   reference::mix_bits(seed));
}

glm::vec3 lifted(const FrontPoint& point, const scene::Frame& frame) {
    const glm::dvec3 at = frame.from_world(point.position);
    const double lift = 0x1p-17 * std::max({1.0, std::abs(at.x), std::abs(at.y), std::abs(at.z)});
    return glm::vec3(at + lift * point.normal);
}

std::vector<FrontPoint> draw_surface_points(const Scene& scene,
                                            const visibility::Visibility& visibility,
                                            const scene::Frame& frame, const Bounds& box,
                                            uint64_t count, uint64_t seed) {
    const std::vector<Piece> pieces = pieces_in(scene, box);
    std::vector<FrontPoint> points;
    if (pieces.empty())
        return points;
    for (uint64_t draw = 0; points.size() < count && draw < 100 * count; ++draw) {
        reference::PathSampler sampler(reference::join_bits(seed, draw), 0);
        const double wanted = sampler.plain() * pieces.back().area_up_to;
        const auto piece =
            std::min(std::upper_bound(pieces.begin(), pieces.end(), wanted,
                                      [](double x, const Piece& p) { return x < p.area_up_to; }),
                     pieces.end() - 1);
        const glm::dvec2 sample = sampler.pair();
        const double root = std::sqrt(sample.x); // uniform over the triangle
        FrontPoint point;
        point.position =
            (1 - root) * piece->a + root * (1 - sample.y) * piece->b + root * sample.y * piece->c;
        const auto triangle = corners(scene, piece->instance, piece->triangle);
        point.normal =
            glm::normalize(glm::cross(triangle[1] - triangle[0], triangle[2] - triangle[0]));
        const Instance& instance = scene.instances[piece->instance];
        if (scene::is_mirrored(instance))
            point.normal = -point.normal;
        const Mesh& mesh = scene.meshes[std::size_t(instance.mesh)];
        const float alpha = scene::sample_surface(scene, mesh, piece->triangle,
                                                  barycentric(point.position, triangle))
                                .alpha;
        if (sampler.plain() < double(alpha) && !is_buried(visibility, frame, point, sampler))
            points.push_back(point);
    }
    return points;
}

} // namespace lpvbake::report
