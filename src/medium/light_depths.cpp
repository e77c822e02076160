#include "medium/light_depths.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::medium {

/// A part of a ray as a map sees it: m from 0 to 1 along it. Across the map, and by its key, it is
/// straight.
struct LightDepths::Line {
    glm::dvec2 from, to; ///< in texels
    double key_from, key_to;

    double key(double m) const { return key_from + m * (key_to - key_from); }
    double at(double m, int axis) const { return from[axis] + m * (to[axis] - from[axis]); }
    /// Where it crosses a border.
    double crossing(int axis, double border) const {
        return (border - from[axis]) / (to[axis] - from[axis]);
    }
};

namespace {

/// Joins a part to the last where they meet.
void add(glm::dvec2 part, std::vector<glm::dvec2>& parts) {
    if (!parts.empty() && parts.back().y >= part.x && parts.back().x <= part.x)
        parts.back().y = std::max(parts.back().y, part.y);
    else
        parts.push_back(part);
}

} // namespace

std::vector<scene::RsmView> views_into(const Light& light, const visibility::Visibility& visibility,
                                       const scene::Frame& frame, glm::dvec3 lo, glm::dvec3 hi) {
    const glm::dvec3 scene_lo(visibility.lo()), scene_hi(visibility.hi());
    scene::Frame seen = frame;
    const bool within =
        glm::all(glm::greaterThanEqual(lo, scene_lo)) && glm::all(glm::lessThanEqual(hi, scene_hi));
    seen.coarser = {{glm::vec3(within ? lo : scene_lo), glm::vec3(within ? hi : scene_hi), 1.0f}};
    return scene::views_of(light, seen, scene_lo, scene_hi);
}

std::vector<float> depths_of(const scene::RsmView& view, const visibility::Visibility& visibility,
                             int size) {
    std::vector<float> depths(std::size_t(size) * std::size_t(size));
    tbb::parallel_for(0, size, [&](int y) {
        std::vector<visibility::Ray> rays;
        for (int x = 0; x < size; ++x) {
            const glm::dvec2 at = 2.0 * (glm::dvec2(x, y) + 0.5) / double(size) - 1.0;
            const glm::dvec3 along = view.along(at);
            const glm::dvec3 start =
                view.perspective ? view.start(at) : view.start(at) + view.nearest * along;
            rays.push_back({glm::vec3(start), glm::vec3(along),
                            view.perspective ? float(view.nearest) : 0.0f,
                            view.perspective ? HUGE_VALF : float(view.farthest - view.nearest)});
        }
        std::vector<visibility::Hit> hits(rays.size());
        visibility.closest_of_eights(rays, visibility::Bundle::tight, hits);
        for (int x = 0; x < size; ++x) {
            const visibility::Hit& hit = hits[std::size_t(x)];
            depths[std::size_t(y) * std::size_t(size) + std::size_t(x)] =
                hit.instance == visibility::no_hit ? HUGE_VALF
                : view.perspective                 ? hit.t
                                                   : float(view.nearest + double(hit.t));
        }
    });
    return depths;
}

LightDepths::LightDepths(const Light& light, const visibility::Visibility& visibility,
                         const scene::Frame& frame, glm::dvec3 lo, glm::dvec3 hi, int size) {
    open_ = light.type == LightType::directional;
    for (const scene::RsmView& view : views_into(light, visibility, frame, lo, hi)) {
        open_ = false;
        Map& map = maps_.emplace_back(Map{view, {}});
        Level texels{size, depths_of(view, visibility, size), {}};
        for (Key& key : texels.least)
            key = view.perspective ? 1.0f / key : -key;
        texels.most = texels.least;
        map.levels.push_back(std::move(texels));
        while (map.levels.back().size > 1) {
            const Level& fine = map.levels.back();
            Level level{fine.size / 2, {}, {}};
            for (int y = 0; y < level.size; ++y)
                for (int x = 0; x < level.size; ++x) {
                    const auto first =
                        2 * (std::size_t(y) * std::size_t(fine.size) + std::size_t(x));
                    const auto next = first + std::size_t(fine.size);
                    level.least.push_back(std::min({fine.least[first], fine.least[first + 1],
                                                    fine.least[next], fine.least[next + 1]}));
                    level.most.push_back(std::max({fine.most[first], fine.most[first + 1],
                                                   fine.most[next], fine.most[next + 1]}));
                }
            map.levels.push_back(std::move(level));
        }
    }
}

void LightDepths::descend(const Map& map, std::size_t l, int x, int y, const Line& line,
                          bool pyramid, std::vector<glm::dvec2>& parts, uint64_t& visits) {
    const Level& level = map.levels[l];
    const double edge = double(1 << l);
    double begin = 0, end = 1;
    for (int axis = 0; axis < 2; ++axis) {
        const double lo = (axis == 0 ? x : y) * edge, hi = lo + edge;
        if (line.from[axis] == line.to[axis]) {
            if (!(line.from[axis] >= lo && line.from[axis] < hi))
                return;
            continue;
        }
        const double a = line.crossing(axis, lo), b = line.crossing(axis, hi);
        begin = std::max(begin, std::min(a, b));
        end = std::min(end, std::max(a, b));
    }
    if (!(begin < end))
        return;
    ++visits;
    const std::size_t node = std::size_t(y) * std::size_t(level.size) + std::size_t(x);
    const double a = line.key(begin), b = line.key(end);
    const double least = double(level.least[node]), most = double(level.most[node]);
    if (l == 0 || pyramid) {
        if (std::min(a, b) >= most) {
            parts.push_back({begin, end});
            return;
        }
        if (std::max(a, b) <= least)
            return;
    }
    if (l > 0) {
        for (int i = 0; i < 4; ++i)
            descend(map, l - 1, 2 * x + (i & 1), 2 * y + (i >> 1), line, pyramid, parts, visits);
        return;
    }
    const double turn = (most - line.key_from) / (line.key_to - line.key_from);
    if (a < b)
        parts.push_back({std::max(begin, turn), end});
    else
        parts.push_back({begin, std::min(end, turn)});
}

uint64_t LightDepths::lit_parts(glm::dvec3 origin, glm::dvec3 direction, double begin, double end,
                                std::vector<glm::dvec2>& parts, bool pyramid) const {
    uint64_t visits = 0;
    parts.clear();
    if (open_)
        parts.push_back({begin, end});
    std::vector<glm::dvec2> found;
    for (const Map& map : maps_) {
        const scene::RsmView& view = map.view;
        const double half = 0.5 * map.levels.front().size;
        // Homogeneous places on the map: x, y, depth at both ends, clipped to what it shows.
        const glm::dvec3 u = view.u / glm::dot(view.u, view.u),
                         v = view.v / glm::dot(view.v, view.v);
        const auto place = [&](double t) {
            const glm::dvec3 from = origin + t * direction - view.origin;
            return glm::dvec3(glm::dot(from, u), glm::dot(from, v), glm::dot(from, view.axis));
        };
        double t0 = begin, t1 = end;
        const auto clip = [&](const auto& height) { // what is above 0
            const double a = height(place(begin)), b = height(place(end));
            if (a < 0 && b < 0)
                t1 = t0;
            else if (a < 0)
                t0 = std::max(t0, begin + (end - begin) * a / (a - b));
            else if (b < 0)
                t1 = std::min(t1, begin + (end - begin) * a / (a - b));
        };
        if (view.perspective)
            clip([&](glm::dvec3 p) { return p.z - view.nearest; });
        for (int side = 0; side < 4; ++side)
            clip([&](glm::dvec3 p) {
                return (view.perspective ? p.z : 1.0) + (side & 1 ? -1 : 1) * p[side / 2];
            });
        if (!view.perspective) { // beside the map nothing stands in the light's way
            if (!(t0 < t1)) {
                parts.push_back({begin, end});
                continue;
            }
            if (begin < t0)
                parts.push_back({begin, t0});
        }
        if (!(t0 < t1))
            continue;
        const glm::dvec3 p0 = place(t0), p1 = place(t1);
        Line line;
        if (view.perspective)
            line = {half * (glm::dvec2(p0) / p0.z + 1.0), half * (glm::dvec2(p1) / p1.z + 1.0),
                    1 / p0.z, 1 / p1.z};
        else
            line = {half * (glm::dvec2(p0) + 1.0), half * (glm::dvec2(p1) + 1.0), -p0.z, -p1.z};
        found.clear();
        descend(map, map.levels.size() - 1, 0, 0, line, pyramid, found, visits);
        std::ranges::sort(found, {}, &glm::dvec2::x);
        for (glm::dvec2 part : found) {
            for (int i = 0; i < 2; ++i) {
                const double m = part[i];
                const double w0 = (1 - m) * line.key_from, w1 = m * line.key_to;
                part[i] = view.perspective ? (w0 * t0 + w1 * t1) / (w0 + w1) : t0 + m * (t1 - t0);
            }
            add(part, parts);
        }
        if (!view.perspective && t1 < end)
            add({t1, end}, parts);
    }
    std::ranges::sort(parts, {}, &glm::dvec2::x);
    return visits;
}

} // namespace lpvbake::medium
