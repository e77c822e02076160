#include "surface/patch_count.h"

#include "surface/cutting.h"

#include <tbb/parallel_for.h>

namespace lpvbake::surface {
namespace {

template <class Take>
void for_each_triangle(const Scene& scene, const Take& take) {
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const glm::dmat3 turn(instance.to_world);
        const glm::dvec3 offset(instance.to_world[3]);
        for (const glm::uvec3& t : mesh.triangles)
            take(std::array{turn * glm::dvec3(mesh.positions[t.x]) + offset,
                            turn * glm::dvec3(mesh.positions[t.y]) + offset,
                            turn * glm::dvec3(mesh.positions[t.z]) + offset});
    }
}

double half_way_around(const std::array<glm::dvec3, 3>& t) {
    return 0.5
           * (glm::distance(t[0], t[1]) + glm::distance(t[1], t[2]) + glm::distance(t[2], t[0]));
}

/// Triangles of one shape: the squares of their edges, rising.
struct Shape {
    std::array<double, 3> squares;
    double number;
};

void add_shape(std::vector<Shape>& shapes, std::array<double, 3> squares, double number) {
    std::ranges::sort(squares);
    for (Shape& shape : shapes)
        if (std::abs(shape.squares[0] - squares[0]) < 1e-5 * squares[2]
            && std::abs(shape.squares[1] - squares[1]) < 1e-5 * squares[2]
            && std::abs(shape.squares[2] - squares[2]) < 1e-5 * squares[2]) {
            shape.number += number;
            return;
        }
    shapes.push_back({squares, number});
}

/// How many pieces halvings of longest edges make until none is longer than `limit`. Their shapes
/// are few (Adler 1983), so that alike ones are counted together.
double count_halves(const Corners& piece, double limit) {
    std::vector<Shape> shapes, halves;
    const auto square = [&](size_t i, size_t j) {
        const glm::dvec3 way = glm::dvec3(piece[j]) - glm::dvec3(piece[i]);
        return glm::dot(way, way);
    };
    add_shape(shapes, {square(0, 1), square(1, 2), square(2, 0)}, 1.0);
    double count = 0.0;
    while (!shapes.empty()) {
        halves.clear();
        for (const auto& [squares, number] : shapes) {
            const auto [a, b, c] = squares;
            if (!(c > limit * limit)) {
                count += number;
                continue;
            }
            const double median = (2.0 * a + 2.0 * b - c) / 4.0;
            add_shape(halves, {c / 4.0, median, a}, number);
            add_shape(halves, {c / 4.0, median, b}, number);
        }
        std::swap(shapes, halves);
    }
    return count;
}

PatchCount count_triangle(const Corners& triangle, glm::vec3 extent, float max_edge) {
    PatchCount count;
    std::vector<Corners> stack{triangle};
    while (!stack.empty()) {
        const Corners piece = stack.back();
        stack.pop_back();
        const auto [at, length] = longest_edge(piece);
        const auto add = [&](double patches) {
            count.patches += patches;
            const glm::vec3 centroid = (piece[0] + piece[1] + piece[2]) / 3.0f;
            const float away = distance_to_box(centroid, extent);
            const double area =
                0.5 * double(glm::length(glm::cross(piece[1] - piece[0], piece[2] - piece[0])));
            if (away == 0.0f)
                count.inside += area;
            const double edge = double(graded(max_edge, away));
            count.faces += area / (edge * edge);
        };
        if (!(length > edge_limit(piece, extent, max_edge))) {
            add(1.0);
            continue;
        }
        // All points of the piece lie between these distances.
        float farthest = 0.0f;
        for (const glm::vec3& corner : piece)
            farthest = std::max(farthest, distance_to_box(corner, extent));
        const glm::vec3 lo = glm::min(piece[0], glm::min(piece[1], piece[2]));
        const glm::vec3 hi = glm::max(piece[0], glm::max(piece[1], piece[2]));
        const float nearest = glm::length(glm::max(glm::max(lo - extent, -hi), glm::vec3(0.0f)));
        const float shortest = graded(max_edge, nearest), longest = graded(max_edge, farthest);
        if (longest < 1.01f * shortest) {
            add(count_halves(piece, double(0.5f * (shortest + longest))));
            continue;
        }
        const size_t a = size_t(at), b = (a + 1) % 3, c = (a + 2) % 3;
        const glm::vec3 middle = 0.5f * (piece[a] + piece[b]);
        stack.push_back({middle, piece[b], piece[c]});
        stack.push_back({piece[a], middle, piece[c]});
    }
    return count;
}

} // namespace

TriangleSample sample_triangles(const Scene& scene, size_t most) {
    TriangleSample sample;
    size_t number = 0;
    double length = 0.0;
    for_each_triangle(scene, [&](const std::array<glm::dvec3, 3>& corners) {
        if (!(glm::length(glm::cross(corners[1] - corners[0], corners[2] - corners[0])) > 0.0))
            return;
        ++number;
        length += half_way_around(corners);
        if (number <= most)
            sample.triangles.push_back({corners, 1.0});
    });
    if (number <= most)
        return sample;
    sample.triangles.clear();
    double up_to = 0.0, next = 0.5;
    for_each_triangle(scene, [&](const std::array<glm::dvec3, 3>& corners) {
        if (!(glm::length(glm::cross(corners[1] - corners[0], corners[2] - corners[0])) > 0.0))
            return;
        const double share = 0.5 / double(number) + 0.5 * half_way_around(corners) / length;
        const double steps = double(most) * share;
        up_to += steps;
        double met = 0.0;
        for (; next < up_to; next += 1.0)
            met += 1.0;
        if (met > 0.0)
            sample.triangles.push_back({corners, met / steps});
    });
    return sample;
}

PatchCount count_patches(const TriangleSample& sample, const scene::Frame& frame, float max_edge) {
    std::vector<PatchCount> counts(sample.triangles.size());
    tbb::parallel_for(size_t(0), counts.size(), [&](size_t i) {
        Corners corners;
        for (size_t k = 0; k < 3; ++k)
            corners[k] = glm::vec3(frame.from_world(sample.triangles[i].corners[k]));
        counts[i] = count_triangle(corners, glm::vec3(frame.extent), max_edge);
    });
    PatchCount sum;
    for (size_t i = 0; i < counts.size(); ++i) {
        sum.patches += counts[i].patches * sample.triangles[i].stands_for;
        sum.inside += counts[i].inside * sample.triangles[i].stands_for;
        sum.faces += counts[i].faces * sample.triangles[i].stands_for;
    }
    return sum;
}

} // namespace lpvbake::surface
