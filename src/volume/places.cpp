#include "volume/places.h"

#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"
#include "volume/grid.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>

namespace lpvbake::volume {
namespace {

[[noreturn]] void reject(const Place& place, const std::string& why) {
    throw Error(ErrorKind::argument, "`volume` " + in_quotes(place.name) + " " + why);
}

/// As file systems that know no capitals have it.
std::string lowered(std::string name) {
    std::ranges::transform(name, name.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    return name;
}

void check_name(const Place& place) {
    if (place.name.empty() || place.name.size() > 100 || place.name.front() == '.'
        || !std::ranges::all_of(place.name, is_of_file_names))
        reject(place, "has a name that is no part of a file's: use up to 100 letters, digits, '_', "
                      "'-' and '.'");
}

void check(const VolumeBox& box) {
    const auto& [place, lo, hi, cell, turn] = box;
    check_name(place);
    if (!glm::all(glm::lessThan(lo, hi)))
        reject(place, format("has a box that is inside out, or without an inside, %.6g,%.6g,%.6g,"
                             "%.6g,%.6g,%.6g; give the lower corner first",
                             lo.x, lo.y, lo.z, hi.x, hi.y, hi.z));
    if (!(std::abs(glm::length(turn) - 1) < 1e-6))
        reject(place, "has a turn that is no unit quaternion");
    if (!(cell > 0))
        reject(place, "has no size of cells above 0");
    const glm::dvec3 dims = glm::ceil((hi - lo) / cell);
    if (dims.x * dims.y * dims.z > std::numeric_limits<int32_t>::max())
        reject(place, "has more than 2^31 - 1 cells; give it larger ones or a smaller box");
}

} // namespace

std::vector<Grid> place_grids(std::vector<VolumeBox>& boxes) {
    if (boxes.size() > most_places)
        throw Error(ErrorKind::argument,
                    format("`volume`: %zu volumes are more than %zu; bake them "
                           "in parts",
                           boxes.size(), most_places));
    std::set<std::string> names;
    for (const VolumeBox& box : boxes) {
        check(box);
        if (!names.insert(lowered(box.place.name)).second)
            reject(box.place, "is there twice; give each a name of its own");
    }
    std::ranges::stable_sort(boxes, {}, &VolumeBox::cell);
    std::vector<Grid> grids;
    for (const VolumeBox& box : boxes) {
        Grid& grid = grids.emplace_back(fit_grid(box.lo, box.hi, {.cell = box.cell, .margin = 0}));
        grid.turn = box.turn;
        if (const glm::dvec3 middle = 0.5 * (box.lo + box.hi); grid.is_turned())
            grid.origin = middle + grid.turn * (grid.origin - middle);
    }
    return grids;
}

VolumeBox box_in_world(const Place& place, glm::dvec3 lo, glm::dvec3 hi,
                       const glm::dmat4& to_world) {
    std::array<glm::dvec3, 3> edges;
    for (int axis = 0; axis < 3; ++axis) {
        edges[axis] = glm::dvec3(to_world[axis]) * (hi[axis] - lo[axis]);
        if (!std::isnormal(glm::length(edges[axis])))
            reject(place, "has a box without an inside, or that is not finite");
    }
    constexpr double slack = 1e-5;
    for (int axis = 0; axis < 3; ++axis)
        if (std::abs(glm::dot(glm::normalize(edges[axis]), glm::normalize(edges[(axis + 1) % 3])))
            > slack)
            reject(place,
                   "has a transform that shears its box; scale it along its own edges alone");
    // To each axis of the world the edge that lies nearest to it, the clearest first.
    glm::dmat3 axes(0.0);
    glm::dvec3 size(0.0);
    std::array<bool, 3> used{}, set{};
    for (int pass = 0; pass < 3; ++pass) {
        int of = 0, to = 0;
        double most = -1;
        for (int edge = 0; edge < 3; ++edge)
            for (int axis = 0; axis < 3; ++axis)
                if (const double along = std::abs(glm::normalize(edges[edge])[axis]);
                    !used[edge] && !set[axis] && along > most + 1e-9) {
                    most = along;
                    of = edge;
                    to = axis;
                }
        used[of] = set[to] = true;
        size[to] = glm::length(edges[of]);
        axes[to] = glm::normalize(edges[of]) * (edges[of][to] < 0 ? -1.0 : 1.0);
    }
    if (glm::determinant(axes) < 0) // of edges half-way between axes: the box is its own mirror
        axes[2] = -axes[2];
    const glm::dvec3 middle(to_world * glm::dvec4(0.5 * (lo + hi), 1));
    if (!std::isfinite(middle.x + middle.y + middle.z))
        reject(place, "has a box that is not finite");
    VolumeBox box{place, middle - 0.5 * size, middle + 0.5 * size, 0};
    double off = 0;
    for (int axis = 0; axis < 3; ++axis)
        off = std::max(off, 1 - axes[axis][axis]);
    if (off > 1e-12)
        box.turn = glm::normalize(glm::quat_cast(axes));
    return box;
}

namespace {

/// Whether two boxes of cells have more than `slack` in common along each direction that could part
/// them (Gottschalk et al. 1996).
bool overlap(const Grid& a, const Grid& b, double slack) {
    const auto axes_of = [](const Grid& grid) { return glm::mat3_cast(grid.turn); };
    const auto half_of = [](const Grid& grid) { return 0.5 * grid.cell * glm::dvec3(grid.dims); };
    const glm::dmat3 of_a = axes_of(a), of_b = axes_of(b);
    const glm::dvec3 half_a = half_of(a), half_b = half_of(b);
    const glm::dvec3 way =
        b.to_world(0.5 * glm::dvec3(b.dims)) - a.to_world(0.5 * glm::dvec3(a.dims));
    const auto parts = [&](glm::dvec3 direction) {
        const double length = glm::length(direction);
        if (length < 1e-6)
            return false;
        direction /= length;
        double reach = -std::abs(glm::dot(way, direction));
        for (int axis = 0; axis < 3; ++axis)
            reach += half_a[axis] * std::abs(glm::dot(of_a[axis], direction))
                     + half_b[axis] * std::abs(glm::dot(of_b[axis], direction));
        return !(reach > slack);
    };
    for (int i = 0; i < 3; ++i) {
        if (parts(of_a[i]) || parts(of_b[i]))
            return false;
        for (int j = 0; j < 3; ++j)
            if (parts(glm::cross(of_a[i], of_b[j])))
                return false;
    }
    return true;
}

} // namespace

std::pair<std::string, std::string> overlapping(const std::vector<Place>& places,
                                                const std::vector<Grid>& grids) {
    for (std::size_t i = 0; i < grids.size(); ++i)
        for (std::size_t j = i + 1; j < grids.size(); ++j)
            if (overlap(grids[i], grids[j], std::max(grids[i].cell, grids[j].cell) * (1 + 1e-6)))
                return {places[i].name, places[j].name};
    return {};
}

double depth_in(const Grid& grid, glm::dvec3 point) {
    const glm::dvec3 from = grid.to_grid(point) * grid.cell;
    const glm::dvec3 to = grid.cell * glm::dvec3(grid.dims) - from;
    const glm::dvec3 inside = glm::min(from, to);
    const double least = std::min({inside.x, inside.y, inside.z});
    return least >= 0 ? least : -glm::length(glm::min(inside, glm::dvec3(0)));
}

} // namespace lpvbake::volume
