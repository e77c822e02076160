#include "scene/light_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>

namespace lpvbake::scene {

namespace {

constexpr double widest_spot = 80 * 3.14159265358979323846 / 180; ///< half-angle of a single map
constexpr double nearest_depth = 1e-3;                            ///< perspective, frame units

std::array<glm::dvec3, 8> corners_of(glm::dvec3 lo, glm::dvec3 hi) {
    std::array<glm::dvec3, 8> corners;
    for (int i = 0; i < 8; ++i)
        corners[i] = {i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z};
    return corners;
}

/// Completes `axis` to an orthonormal frame, a world axis within the plane of u and axis where
/// possible: rectangles along the world's axes then fill a map without slanted edges.
std::array<glm::dvec3, 2> across(glm::dvec3 axis) {
    const glm::dvec3 size = glm::abs(axis);
    glm::dvec3 least(0);
    least[size.x <= size.y && size.x <= size.z ? 0 : size.z <= size.y ? 2 : 1] = 1;
    const glm::dvec3 u = glm::normalize(glm::cross(axis, least));
    return {u, glm::cross(axis, u)};
}

std::vector<RsmView> parallel_view(const Light& light, const Frame& frame, glm::dvec3 lo,
                                   glm::dvec3 hi) {
    const glm::dvec3 inner_lo = glm::max(lo, frame.lo()), inner_hi = glm::min(hi, frame.hi());
    if (glm::any(glm::greaterThan(inner_lo, inner_hi)))
        return {};
    RsmView view;
    view.axis = glm::normalize(light.direction);
    const auto [u, v] = across(view.axis);
    glm::dvec2 least(1e300), most(-1e300);
    for (const glm::dvec3 corner : corners_of(inner_lo, inner_hi)) {
        const glm::dvec2 p(glm::dot(corner, u), glm::dot(corner, v));
        least = glm::min(least, p);
        most = glm::max(most, p);
    }
    const glm::dvec2 half = 0.5 * (most - least), middle = 0.5 * (most + least);
    if (!(half.x * half.y > 0)) // a flat scene seen edge-on catches nothing
        return {};
    view.u = half.x * u;
    view.v = half.y * v;
    view.origin =
        middle.x * u + middle.y * v + glm::dot(0.5 * (inner_lo + inner_hi), view.axis) * view.axis;
    view.nearest = 1e300;
    view.farthest = -1e300;
    for (const glm::dvec3 corner : corners_of(lo, hi)) {
        const double depth = glm::dot(corner - view.origin, view.axis);
        view.nearest = std::min(view.nearest, depth);
        view.farthest = std::max(view.farthest, depth);
    }
    const double slack = 1e-3 * (view.farthest - view.nearest) + 1e-3;
    view.nearest -= slack;
    view.farthest += slack;
    return {view};
}

/// Of a rectangle of edges `edge` around the point `at` of the plane at distance 1, sr.
double solid_angle(glm::dvec2 at, glm::dvec2 edge) {
    // f = (1 + r^2)^(-3/2) is the solid angle of a unit of the plane at distance 1; its mean over a
    // rectangle is f + (edge.x^2 f_xx + edge.y^2 f_yy) / 24 up to fourth order.
    const double q = 1 + at.x * at.x + at.y * at.y;
    const double f = 1 / (q * std::sqrt(q)), p = 1 / q;
    const double fxx = 3 * f * p * (5 * at.x * at.x * p - 1);
    const double fyy = 3 * f * p * (5 * at.y * at.y * p - 1);
    return edge.x * edge.y * (f + (edge.x * edge.x * fxx + edge.y * edge.y * fyy) / 24);
}

} // namespace

glm::dmat4 RsmView::clip() const {
    const glm::dvec3 x = u / glm::dot(u, u), y = v / glm::dot(v, v);
    const glm::dmat4 rows = perspective
                                ? glm::dmat4(glm::dvec4(x, 0), glm::dvec4(y, 0),
                                             glm::dvec4(0, 0, 0, nearest), glm::dvec4(axis, 0))
                                : glm::dmat4(glm::dvec4(x, 0), glm::dvec4(y, 0),
                                             glm::dvec4(-axis, farthest) / (farthest - nearest),
                                             glm::dvec4(0, 0, 0, 1));
    return glm::transpose(rows);
}

std::vector<RsmView> views_of(const Light& light, const Frame& frame, glm::dvec3 lo,
                              glm::dvec3 hi) {
    if (glm::any(glm::greaterThan(lo, hi)))
        return {};
    if (light.type == LightType::directional)
        return parallel_view(light, frame, lo, hi);

    RsmView view;
    view.perspective = true;
    view.origin = frame.from_world(light.position);
    view.nearest = nearest_depth;
    if (light.type == LightType::spot && light.outer_cone <= widest_spot) {
        if (!(light.outer_cone > 0))
            return {};
        view.axis = glm::normalize(light.direction);
        const auto [u, v] = across(view.axis);
        view.u = std::tan(light.outer_cone) * u;
        view.v = std::tan(light.outer_cone) * v;
        return {view};
    }
    // A cube: around the world's axes, or a wide spot's.
    std::array<glm::dvec3, 3> axes{glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1)};
    if (light.type == LightType::spot) {
        axes[2] = glm::normalize(light.direction);
        std::tie(axes[0], axes[1]) = std::pair(across(axes[2])[0], across(axes[2])[1]);
    }
    std::vector<RsmView> faces;
    for (int face = 0; face < 6; ++face) {
        view.axis = face % 2 ? -axes[face / 2] : axes[face / 2];
        view.u = axes[(face / 2 + 1) % 3];
        view.v = axes[(face / 2 + 2) % 3];
        // The face behind a spot begins 125 degrees from its axis.
        if (light.type == LightType::spot && face == 5 && light.outer_cone < 2.18)
            continue;
        faces.push_back(view);
    }
    return faces;
}

TexelFlux::TexelFlux(const Light& light, const Frame& frame, const RsmView& view, int size)
    : spot_(light.type == LightType::spot),
      intensity_(light.intensity),
      axis_(view.axis),
      half_(glm::length(view.u), glm::length(view.v)),
      edge_(2.0 * half_ / double(size)),
      parts_(std::clamp(512 / size, 1, 16)) {
    u_ = view.u / half_.x;
    v_ = view.v / half_.y;
    if (!view.perspective)
        parallel_ = light.intensity * edge_.x * edge_.y * frame.unit * frame.unit;
    else if (spot_)
        cone_ = Cone(light);
}

glm::dvec3 TexelFlux::towards(glm::dvec2 at) const {
    return glm::normalize(axis_ + at.x * u_ + at.y * v_);
}

double TexelFlux::through(glm::dvec2 at, glm::dvec2 extent) const {
    const double flux = intensity_ * solid_angle(at, extent);
    return spot_ ? flux * cone_(towards(at)) : flux;
}

double TexelFlux::operator()(int column, int row) const {
    if (parallel_ > 0)
        return parallel_;
    const glm::dvec2 at = (glm::dvec2(column, row) + 0.5) * edge_ - half_;
    if (!spot_)
        return through(at, edge_);
    // Half the texel's diagonal is an upper bound of the angle from its centre to its rim.
    const double angle = std::acos(std::clamp(glm::dot(towards(at), cone_.axis), -1.0, 1.0));
    const double reach = 0.5 * glm::length(edge_);
    if (angle - reach >= cone_.outer)
        return 0;
    const int parts = angle + reach <= cone_.inner ? 1 : parts_;
    double sum = 0;
    for (int j = 0; j < parts; ++j)
        for (int i = 0; i < parts; ++i)
            sum += through(at + edge_ * ((glm::dvec2(i, j) + 0.5) / double(parts) - 0.5),
                           edge_ / double(parts));
    return sum;
}

} // namespace lpvbake::scene
