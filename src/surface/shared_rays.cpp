#include "surface/shared_rays.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace lpvbake::surface {
namespace {

constexpr float cube_edge = 3.0f;  ///< about nine faces of cells of a wall
constexpr float cube_shift = 0.3f; ///< so that walls, which often lie on the lattice, lie in one
constexpr float lift = 0.25f;      ///< above the surface, where a point looks for the others

/// The cube that a point lies in, and the axis that it looks along.
std::array<int32_t, 4> place_of(const SidePoint& point) {
    std::array<int32_t, 4> place;
    for (int axis = 0; axis < 3; ++axis)
        place[size_t(axis)] = int32_t(std::floor((point.position[axis] + cube_shift) / cube_edge));
    const glm::vec3 along = glm::abs(point.normal);
    const int axis = along.x >= along.y && along.x >= along.z ? 0 : along.y >= along.z ? 1 : 2;
    place[3] = 2 * axis + (point.normal[axis] < 0.0f);
    return place;
}

/// Orders the points along the longest edge of the box around them.
void order_along(std::span<uint32_t> members, std::span<const SidePoint> points) {
    glm::vec3 lo(HUGE_VALF), hi(-HUGE_VALF);
    for (const uint32_t i : members) {
        lo = glm::min(lo, points[i].position);
        hi = glm::max(hi, points[i].position);
    }
    const glm::vec3 size = hi - lo;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    std::ranges::sort(members, {},
                      [&](uint32_t i) { return std::pair(points[i].position[axis], i); });
}

glm::vec3 above(const SidePoint& point) {
    return point.position + lift * point.normal;
}

} // namespace

PointGroups group_points(const visibility::Visibility& visibility,
                         std::span<const SidePoint> points, size_t most) {
    std::vector<std::array<int32_t, 4>> places(points.size());
    std::ranges::transform(points, places.begin(), place_of);
    std::vector<uint32_t> sorted(points.size());
    std::iota(sorted.begin(), sorted.end(), 0u);
    std::ranges::stable_sort(sorted, {}, [&](uint32_t i) { return places[i]; });
    std::vector<size_t> first; // of each place
    for (size_t i = 0; i < sorted.size(); ++i)
        if (i == 0 || places[sorted[i]] != places[sorted[i - 1]])
            first.push_back(i);
    first.push_back(sorted.size());

    // Parts of each place, that are no larger than `most`.
    std::vector<std::vector<uint32_t>> ends(first.size() - 1);
    tbb::parallel_for(size_t(0), ends.size(), [&](size_t place) {
        const auto end = sorted.begin() + std::ptrdiff_t(first[place + 1]);
        for (auto begin = sorted.begin() + std::ptrdiff_t(first[place]); begin != end;) {
            const glm::vec3 from = above(points[*begin]);
            const auto seen = std::stable_partition(begin + 1, end, [&](uint32_t i) {
                return visibility.transmittance({from, above(points[i]) - from}) > 0.5f;
            });
            const size_t count = size_t(seen - begin), parts = (count + most - 1) / most;
            for (size_t part = 1; part <= parts; ++part)
                ends[place].push_back(
                    uint32_t(size_t(begin - sorted.begin()) + count * part / parts));
            begin = seen;
        }
    });
    PointGroups groups{std::move(sorted), {0}};
    for (const std::vector<uint32_t>& of_place : ends)
        groups.first.insert(groups.first.end(), of_place.begin(), of_place.end());
    return groups;
}

void add_shared(std::span<const SidePoint> points, std::span<const SharedRay> rays, int each,
                std::span<glm::vec3> irradiance) {
    const size_t count = points.size();
    if (count == 0)
        return;
    std::vector<float> x(count), y(count), z(count), nx(count), ny(count), nz(count), seen(count);
    for (size_t q = 0; q < count; ++q) {
        const auto& [p, n] = points[q];
        x[q] = p.x, y[q] = p.y, z[q] = p.z;
        nx[q] = n.x, ny[q] = n.y, nz[q] = n.z;
    }
    for (const SharedRay& ray : rays) {
        const bool away = ray.normal == glm::vec3(0.0f);
        // Density of each point's rays there: over directions, or over the surface, times pi.
        for (size_t q = 0; q < count; ++q) {
            const float wx = ray.end.x - x[q], wy = ray.end.y - y[q], wz = ray.end.z - z[q];
            const float square = wx * wx + wy * wy + wz * wz;
            const float there = wx * ray.normal.x + wy * ray.normal.y + wz * ray.normal.z;
            const float here = wx * nx[q] + wy * ny[q] + wz * nz[q];
            seen[q] = std::max(here, 0.0f) * std::abs(there) / std::max(square * square, 1e-20f);
        }
        if (away)
            for (size_t q = 0; q < count; ++q)
                seen[q] = std::max(ray.end.x * nx[q] + ray.end.y * ny[q] + ray.end.z * nz[q], 0.0f);
        float density = 0.0f;
        for (size_t q = 0; q < count; ++q)
            density += seen[q];
        if (!(density > 0.0f))
            continue;
        const glm::vec3 share = ray.luminance * (glm::pi<float>() / (float(each) * density));
        for (size_t q = 0; q < count; ++q)
            irradiance[q] += share * seen[q];
    }
}

OwnLight light_alone(std::span<const SharedRay> rays, int count) {
    glm::vec3 mean(0.0f), square(0.0f);
    for (const SharedRay& ray : rays) {
        mean += ray.luminance / float(count);
        square += ray.luminance * ray.luminance / float(count);
    }
    constexpr float pi = glm::pi<float>();
    return {pi * mean, pi * pi * glm::max(square - mean * mean, 0.0f) / float(count)};
}

void tell_apart(std::span<const SidePoint> points, std::span<const OwnLight> own,
                std::span<glm::vec3> irradiance) {
    struct Part {
        std::span<uint32_t> members;
        glm::vec3 has{0.0f}, lacks{0.0f};
    };
    std::vector<uint32_t> order(points.size());
    std::iota(order.begin(), order.end(), 0u);
    std::vector<Part> parts{{order}}, halves;
    for (;; parts.swap(halves)) {
        halves.clear();
        for (const Part& part : parts)
            if (const size_t count = part.members.size(); count > 1) {
                order_along(part.members, points);
                halves.push_back({part.members.first(count / 2)});
                halves.push_back({part.members.subspan(count / 2)});
            }
        if (halves.empty())
            return;
        float noise = 0.0f, square = 0.0f;
        for (Part& part : halves) {
            for (const uint32_t i : part.members) {
                part.has += irradiance[i];
                part.lacks += own[i].irradiance - irradiance[i];
                noise += own[i].variance.x + own[i].variance.y + own[i].variance.z;
            }
            square += glm::dot(part.lacks, part.lacks);
        }
        if (!(square > noise))
            continue;
        const float share = 1.0f - noise / square;
        for (const Part& part : halves)
            for (int c = 0; c < 3; ++c)
                if (part.has[c] > 0.0f)
                    for (const uint32_t i : part.members)
                        irradiance[i][c] *=
                            std::max(0.0f, 1.0f + share * part.lacks[c] / part.has[c]);
    }
}

} // namespace lpvbake::surface
