#include "medium/light_depths.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::medium {

/// A part of a ray as a map sees it: m from 0 to 1 along it. Across the map, and by its key, it is
/// straight.
struct LightDepths::Line {
    glm::dvec2 from, way; ///< in texels; to where it ends
    double key_from, key_to;

    double key(double m) const { return key_from + m * (key_to - key_from); }
    /// Where it crosses a border; infinite if it does not.
    double crossing(int axis, double border) const {
        return way[axis] == 0 ? HUGE_VAL : (border - from[axis]) / way[axis];
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
        Level texels{size, {}};
        for (const float depth : depths_of(view, visibility, size)) {
            const Key key = view.perspective ? 1.0f / depth : -depth;
            texels.nodes.push_back({key, key});
        }
        map.levels.push_back(std::move(texels));
        while (map.levels.back().size > 1) {
            const Level& fine = map.levels.back();
            Level level{fine.size / 2, {}};
            for (int y = 0; y < level.size; ++y)
                for (int x = 0; x < level.size; ++x) {
                    const Keys* const first =
                        &fine.nodes[2 * (std::size_t(y) * std::size_t(fine.size) + std::size_t(x))];
                    const Keys* const next = first + fine.size;
                    level.nodes.push_back(
                        {std::min({first[0].least, first[1].least, next[0].least, next[1].least}),
                         std::max({first[0].most, first[1].most, next[0].most, next[1].most})});
                }
            map.levels.push_back(std::move(level));
        }
    }
}

/// Of a line that lies on the map.
struct LightDepths::Descent {
    const Map& map;
    const Line& line;
    bool pyramid;
    std::vector<glm::dvec2>& parts; ///< those that are lit, by rising m
    uint64_t visits = 0;

    /// Looks at the part of the line from `begin` to `end`, which is that in a node.
    void into(std::size_t l, int x, int y, double begin, double end) {
        ++visits;
        const Level& level = map.levels[l];
        const Keys keys = level.nodes[std::size_t(y) * std::size_t(level.size) + std::size_t(x)];
        const double a = line.key(begin), b = line.key(end);
        const double least = double(keys.least), most = double(keys.most);
        if (l == 0 || pyramid) {
            if (std::min(a, b) >= most) {
                add({begin, end}, parts);
                return;
            }
            if (std::max(a, b) <= least)
                return;
        }
        if (l > 0) {
            into_children(l, x, y, begin, end);
            return;
        }
        const double turn = (most - line.key_from) / (line.key_to - line.key_from);
        add(a < b ? glm::dvec2(std::max(begin, turn), end) : glm::dvec2(begin, std::min(end, turn)),
            parts);
    }
    /// At most three of the four: it crosses each of the borders between them once.
    void into_children(std::size_t l, int x, int y, double begin, double end) {
        const int half = 1 << (l - 1);
        const glm::ivec2 corner(2 * x, 2 * y);
        glm::dvec2 cut;
        glm::ivec2 side;
        for (int axis = 0; axis < 2; ++axis) {
            const double border = double((corner[axis] + 1) * half);
            cut[axis] = line.crossing(axis, border);
            side[axis] = line.way[axis] == 0 ? line.from[axis] >= border
                                             : (cut[axis] <= begin) == (line.way[axis] > 0);
            if (cut[axis] <= begin)
                cut[axis] = HUGE_VAL; // behind
        }
        for (double at = begin; at < end;) {
            const double next = std::min({cut.x, cut.y, end});
            into(l - 1, corner.x + side.x, corner.y + side.y, at, next);
            for (int axis = 0; axis < 2; ++axis)
                if (cut[axis] <= next) {
                    side[axis] = 1 - side[axis];
                    cut[axis] = HUGE_VAL;
                }
            at = next;
        }
    }
};

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
        line.way -= line.from;
        found.clear();
        Descent descent{map, line, pyramid, found};
        descent.into(map.levels.size() - 1, 0, 0, 0, 1);
        visits += descent.visits;
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
