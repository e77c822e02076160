#include "visibility/capture.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace lpvbake::visibility {
namespace {

/// In margins: how much nearer than the margin a point may stay, where planes meet at an angle.
constexpr float tolerance = 0.05f;
constexpr int most_steps = 32;
/// How many more rays have to tell of one side than of any other.
constexpr int clearly = 2;
/// How many of the six rays a side that is closed in stops.
constexpr int closed = 3;

/// x . normal >= height + surface_margin, x seen from the centre.
struct Plane {
    glm::vec3 normal;
    float height;
};

/// The way from the centre to a point before all planes: step by step out of the one that it is
/// deepest behind (projections onto convex sets; Agmon 1954).
std::optional<glm::vec3> before_all(std::span<const Plane> planes) {
    glm::vec3 x(0.0f);
    for (int step = 0; step < most_steps; ++step) {
        float deepest = 0.0f;
        glm::vec3 out(0.0f);
        for (const Plane& plane : planes)
            if (const float depth = plane.height + surface_margin - glm::dot(x, plane.normal);
                depth > deepest) {
                deepest = depth;
                out = depth * plane.normal;
            }
        if (deepest <= tolerance * surface_margin)
            return x;
        x += out;
        if (glm::dot(x, x) > farthest_capture * farthest_capture)
            return std::nullopt;
    }
    return std::nullopt;
}

/// The point before all planes, if nothing else is beside it.
std::optional<glm::vec3> free_point(const Visibility& visibility, glm::vec3 centre,
                                    std::span<const Plane> planes) {
    const std::optional<glm::vec3> way = before_all(planes);
    if (!way || visibility.nearest_point(centre + *way, 0.5f * surface_margin, {}, 0.0f))
        return std::nullopt;
    return centre + *way;
}

/// The point before the fronts of all surfaces.
std::optional<glm::vec3> before_fronts(const Visibility& visibility, glm::vec3 centre,
                                       std::span<const NearSurface> near) {
    std::vector<Plane> planes;
    for (const NearSurface& surface : near)
        planes.push_back({surface.normal, glm::dot(surface.way, surface.normal)});
    return free_point(visibility, centre, planes);
}

/// The point on that side of all sheets, of surfaces more or less parallel, that is closed in;
/// where none of them is, before their fronts.
std::optional<glm::vec3> most_closed_in(const Visibility& visibility, glm::vec3 centre,
                                        std::span<const NearSurface> near) {
    constexpr size_t most_sheets = 3;
    std::vector<glm::vec3> sheets; // one normal of each
    std::vector<size_t> sheet_of;
    std::vector<Plane> planes;
    for (const NearSurface& surface : near) {
        const auto own = std::ranges::find_if(sheets, [&](glm::vec3 normal) {
            return std::abs(glm::dot(normal, surface.normal)) > 0.5f;
        });
        sheet_of.push_back(size_t(own - sheets.begin()));
        if (own == sheets.end())
            sheets.push_back(surface.normal);
        const float side = glm::dot(sheets[sheet_of.back()], surface.normal) < 0.0f ? -1.0f : 1.0f;
        planes.push_back({side * surface.normal, 0.0f});
    }
    if (sheets.size() > most_sheets)
        return std::nullopt;
    std::optional<glm::vec3> best;
    int most = -7, second = -7; // less than six backs
    for (unsigned sides = 0; sides < 1u << sheets.size(); ++sides) {
        std::vector<Plane> turned = planes;
        for (size_t i = 0; i < near.size(); ++i) {
            if (sides >> sheet_of[i] & 1)
                turned[i].normal = -turned[i].normal;
            turned[i].height = glm::dot(near[i].way, turned[i].normal);
        }
        const std::optional<glm::vec3> point = free_point(visibility, centre, turned);
        if (!point)
            continue;
        const int score = -backs_around(visibility, *point, -1);
        second = std::max(second, std::min(most, score));
        if (score > most) {
            most = score;
            best = point;
        }
    }
    if (most >= second + clearly)
        return best;
    return most < closed ? before_fronts(visibility, centre, near) : std::nullopt;
}

} // namespace

int backs_met(std::span<const Crossing> crossings, bool way_back, int both) {
    const Facing front = way_back ? Facing::back : Facing::front; // seen the other way
    const size_t count = crossings.size();
    const auto at = [&](size_t i) { return crossings[way_back ? count - 1 - i : i]; };
    int met = 1;
    for (size_t i = 0; i < count && std::abs(at(i).t - at(0).t) <= surface_margin; ++i)
        met = std::min(met, at(i).facing == Facing::both ? both : at(i).facing == front ? -1 : 1);
    return met;
}

int backs_around(const Visibility& visibility, glm::vec3 point, int both) {
    thread_local std::vector<Crossing> crossings;
    int backs = 0;
    for (int way = 0; way < 6; ++way) {
        const int axis = way / 2;
        Ray ray{point, glm::vec3(0.0f), 0.0f, HUGE_VALF};
        ray.origin[(axis + 1) % 3] += aside.x;
        ray.origin[(axis + 2) % 3] += aside.y;
        ray.direction[axis] = way % 2 ? -1.0f : 1.0f;
        visibility.crossings(ray, crossings);
        if (!crossings.empty())
            backs += backs_met(crossings, false, both);
    }
    return backs;
}

Capture find_capture(const Visibility& visibility, glm::vec3 centre,
                     std::span<const NearSurface> near) {
    std::optional<glm::vec3> point;
    if (std::ranges::none_of(near, &NearSurface::two_fronts))
        point = before_fronts(visibility, centre, near);
    if (!point)
        point = most_closed_in(visibility, centre, near);
    return {point.value_or(centre), point.has_value()};
}

std::vector<size_t> cells_on_surfaces(const Visibility& visibility, glm::ivec3 dims) {
    constexpr int edge = 8; // of blocks, then of their halves, until a cell is left
    const auto visit = [&](const auto& self, glm::ivec3 lo, int size,
                           std::vector<size_t>& found) -> void {
        if (glm::any(glm::greaterThanEqual(lo, dims)))
            return;
        const float half = 0.5f * float(size - 1);
        if (!visibility.nearest_point(glm::vec3(lo) + 0.5f + half,
                                      surface_margin + std::sqrt(3.0f) * half, {}, 0.0f))
            return;
        if (size == 1) {
            found.push_back(size_t(lo.x)
                            + size_t(dims.x) * (size_t(lo.y) + size_t(dims.y) * size_t(lo.z)));
            return;
        }
        for (int i = 0; i < 8; ++i)
            self(self, lo + size / 2 * glm::ivec3(i & 1, i >> 1 & 1, i >> 2), size / 2, found);
    };
    const glm::ivec3 blocks = (dims + edge - 1) / edge;
    std::vector<std::vector<size_t>> parts(size_t(blocks.y) * size_t(blocks.z));
    tbb::parallel_for(size_t(0), parts.size(), [&](size_t part) {
        for (int x = 0; x < blocks.x; ++x)
            visit(visit, edge * glm::ivec3(x, int(part) % blocks.y, int(part) / blocks.y), edge,
                  parts[part]);
    });
    std::vector<size_t> cells;
    for (const std::vector<size_t>& part : parts)
        cells.insert(cells.end(), part.begin(), part.end());
    std::ranges::sort(cells);
    return cells;
}

} // namespace lpvbake::visibility
