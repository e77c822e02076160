#include "surface/patch_count.h"

#include "surface/cutting.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <numeric>

namespace lpvbake::surface {
namespace {

template <class Take>
void for_each_triangle(const Scene& scene, const Take& take) {
    for (uint32_t i = 0; i < scene.instances.size(); ++i) {
        const Instance& instance = scene.instances[i];
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        const glm::dmat3 turn(instance.to_world);
        const glm::dvec3 offset(instance.to_world[3]);
        for (uint32_t j = 0; j < mesh.triangles.size(); ++j) {
            const glm::uvec3 t = mesh.triangles[j];
            take(TriangleSample::Triangle{{turn * glm::dvec3(mesh.positions[t.x]) + offset,
                                           turn * glm::dvec3(mesh.positions[t.y]) + offset,
                                           turn * glm::dvec3(mesh.positions[t.z]) + offset},
                                          i,
                                          j});
        }
    }
}

bool is_flat(const std::array<glm::dvec3, 3>& t) {
    return !(glm::length(glm::cross(t[1] - t[0], t[2] - t[0])) > 0.0);
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

TrialPiece whole(const TriangleSample::Triangle& triangle, const scene::Frame& frame) {
    TrialPiece piece{triangle.instance, triangle.triangle, {}, {{{0, 0}, {1, 0}, {0, 1}}}};
    for (size_t i = 0; i < 3; ++i)
        piece.corners[i] = glm::vec3(frame.from_world(triangle.corners[i]));
    return piece;
}

/// One half of a piece, whose edge from corner `at` on is halved.
TrialPiece half(TrialPiece piece, int at, bool second) {
    const size_t a = size_t(at), b = (a + 1) % 3, moved = second ? b : a;
    piece.corners[moved] = 0.5f * (piece.corners[a] + piece.corners[b]);
    piece.weights[moved] = 0.5f * (piece.weights[a] + piece.weights[b]);
    return piece;
}

/// Halves a triangle until all patches of a piece may be of one size, and takes each with how many
/// these are.
template <class Take>
void for_each_even_piece(const TrialPiece& triangle, const Boxes& boxes, float max_edge,
                         const Take& take) {
    std::vector<TrialPiece> stack{triangle};
    while (!stack.empty()) {
        const TrialPiece piece = stack.back();
        stack.pop_back();
        const Corners& corners = piece.corners;
        const auto [at, length] = longest_edge(corners);
        if (!(length > edge_limit(corners, boxes, max_edge))) {
            take(piece, 1.0);
            continue;
        }
        // All points of the piece lie between these distances.
        float farthest = 0.0f;
        for (const glm::vec3& corner : corners)
            farthest = std::max(farthest, boxes.distance(corner));
        const glm::vec3 lo = glm::min(corners[0], glm::min(corners[1], corners[2]));
        const glm::vec3 hi = glm::max(corners[0], glm::max(corners[1], corners[2]));
        const float nearest = boxes.distance(lo, hi);
        const float shortest = graded(max_edge, nearest), longest = graded(max_edge, farthest);
        if (longest < 1.01f * shortest) {
            take(piece, count_halves(corners, double(0.5f * (shortest + longest))));
            continue;
        }
        stack.push_back(half(piece, at, false));
        stack.push_back(half(piece, at, true));
    }
}

PatchCount count_triangle(const TrialPiece& triangle, const Boxes& boxes, float max_edge) {
    PatchCount count;
    for_each_even_piece(triangle, boxes, max_edge, [&](const TrialPiece& piece, double patches) {
        const auto& [a, b, c] = piece.corners;
        count.patches += patches;
        const float away = boxes.distance((a + b + c) / 3.0f);
        const double area = 0.5 * double(glm::length(glm::cross(b - a, c - a)));
        if (away == 0.0f)
            count.inside += area;
        const double edge = double(graded(max_edge, away));
        count.faces += area / (edge * edge);
    });
    return count;
}

/// How many patches a piece of `patches` equal ones would give if all of it were cut as at a place
/// of it, [0, 1).
double try_at(double place, TrialPiece piece, double patches, const scene::Frame& frame,
              float max_edge, const CutTrial& trial) {
    double pieces = 1.0;
    for (;;) {
        const auto [at, length] = longest_edge(piece.corners);
        if (!(length > edge_limit(piece.corners, frame, max_edge)))
            return double(trial.count(piece, frame, max_edge)) * pieces / patches;
        pieces *= 2.0;
        place *= 2.0;
        piece = half(piece, at, place >= 1.0);
        place -= std::floor(place);
    }
}

/// How many patches there are for one that halving alone makes, of which there are `patches`.
double cut_further(const TriangleSample& sample, const std::vector<PatchCount>& counts,
                   double patches, const scene::Frame& frame, float max_edge,
                   const CutTrial& trial) {
    constexpr double number = 4096;
    std::vector<double> begins; // of a triangle among all, in what is drawn
    double up_to = 0.0;
    for (size_t i = 0; i < counts.size(); ++i) {
        begins.push_back(up_to);
        up_to += counts[i].patches * sample.triangles[i].stands_for * number / patches;
    }
    begins.push_back(up_to);
    std::vector<double> sums(counts.size());
    tbb::parallel_for(size_t(0), counts.size(), [&](size_t i) {
        double next = std::ceil(begins[i] - 0.5) + 0.5; // of those at a half
        if (!(next < begins[i + 1]))
            return;
        const double width = (begins[i + 1] - begins[i]) / counts[i].patches; // of a patch
        double begin = begins[i];
        for_each_even_piece(whole(sample.triangles[i], frame), frame, max_edge,
                            [&](const TrialPiece& piece, double inside) {
                                const double end = begin + inside * width;
                                for (; next < end; next += 1.0)
                                    sums[i] += try_at((next - begin) / (end - begin), piece, inside,
                                                      frame, max_edge, trial);
                                begin = end;
                            });
    });
    return std::accumulate(sums.begin(), sums.end(), 0.0) / number;
}

} // namespace

TriangleSample sample_triangles(const Scene& scene, size_t most) {
    TriangleSample sample;
    size_t number = 0;
    double length = 0.0;
    for_each_triangle(scene, [&](const TriangleSample::Triangle& triangle) {
        if (is_flat(triangle.corners))
            return;
        ++number;
        length += half_way_around(triangle.corners);
        if (number <= most)
            sample.triangles.push_back(triangle);
    });
    if (number <= most)
        return sample;
    sample.triangles.clear();
    double up_to = 0.0, next = 0.5;
    for_each_triangle(scene, [&](const TriangleSample::Triangle& triangle) {
        if (is_flat(triangle.corners))
            return;
        const double share =
            0.5 / double(number) + 0.5 * half_way_around(triangle.corners) / length;
        const double steps = double(most) * share;
        up_to += steps;
        double met = 0.0;
        for (; next < up_to; next += 1.0)
            met += 1.0;
        if (met > 0.0) {
            sample.triangles.push_back(triangle);
            sample.triangles.back().stands_for = met / steps;
        }
    });
    return sample;
}

PatchCount count_patches(const TriangleSample& sample, const scene::Frame& frame, float max_edge,
                         const CutTrial* trial) {
    std::vector<PatchCount> counts(sample.triangles.size());
    tbb::parallel_for(size_t(0), counts.size(), [&](size_t i) {
        counts[i] = count_triangle(whole(sample.triangles[i], frame), frame, max_edge);
    });
    PatchCount sum;
    for (size_t i = 0; i < counts.size(); ++i) {
        sum.patches += counts[i].patches * sample.triangles[i].stands_for;
        sum.inside += counts[i].inside * sample.triangles[i].stands_for;
        sum.faces += counts[i].faces * sample.triangles[i].stands_for;
    }
    if (trial && sum.patches > 0.0)
        sum.patches *= cut_further(sample, counts, sum.patches, frame, max_edge, *trial);
    return sum;
}

} // namespace lpvbake::surface
