#include "volume/grid.h"

#include "lpvbake/error.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>

namespace lpvbake::volume {
namespace {

std::ostream& operator<<(std::ostream& out, glm::dvec3 v) {
    return out << '(' << v.x << ", " << v.y << ", " << v.z << ')';
}

template <typename... Parts>
[[noreturn]] void reject(const Parts&... parts) {
    std::ostringstream text;
    (text << ... << parts);
    throw Error(ErrorKind::invalid, text.str());
}

/// Cells that cover `extent`. Rounding errors of the division must not buy an extra layer.
double cells_across(double extent, double cell) {
    const double cells = extent / cell;
    return std::max(1.0, std::ceil(cells - 1e-9 * std::max(1.0, cells)));
}

} // namespace

GridBox box_of(const Grid& grid) {
    const glm::dvec3 end = grid.to_world(glm::dvec3(grid.dims));
    GridBox box{grid.origin, end};
    for (int corner = 0; corner < 8 && grid.is_turned(); ++corner) {
        const glm::dvec3 at = grid.to_world(glm::dvec3(grid.dims)
                                            * glm::dvec3(corner & 1, corner >> 1 & 1, corner >> 2));
        box.lo = glm::min(box.lo, at);
        box.hi = glm::max(box.hi, at);
    }
    return box;
}

Grid fit_grid(glm::dvec3 lo, glm::dvec3 hi, const GridSettings& settings) {
    const glm::dvec3 extent = hi - lo;
    const double longest = std::max({extent.x, extent.y, extent.z});
    for (int a = 0; a < 3; ++a) {
        if (!std::isfinite(lo[a]) || !std::isfinite(hi[a]) || !std::isfinite(extent[a]))
            reject("the box ", lo, " to ", hi, " is not finite; set `bounds`");
        if (extent[a] < 0)
            reject("the box ", lo, " to ", hi, " is inside out; set `bounds`");
    }
    if (longest <= 0)
        reject("the box is the single point ", lo, "; set `bounds`");
    const int margin = settings.margin;
    if (margin < 0)
        reject("the grid's margin of ", margin, " cells is negative");
    const bool by_cell = settings.cell != 0;
    if (by_cell && !(settings.cell > 0 && std::isnormal(settings.cell)))
        reject("the cell size of ", settings.cell, " m is not a positive number");
    const int64_t inner = int64_t(settings.resolution) - 2 * int64_t(margin);
    if (!by_cell && (settings.resolution < 3 || inner < 1))
        reject("a resolution of ", settings.resolution, " leaves no cell between the margins; use ",
               std::max<int64_t>(3, 2 * int64_t(margin) + 1), " or more");

    Grid grid;
    grid.cell = by_cell ? settings.cell : longest / double(inner);
    // Positions must resolve a thousandth of a cell.
    const glm::dvec3 reach = glm::max(glm::abs(lo), glm::abs(hi));
    const double farthest = std::max({reach.x, reach.y, reach.z});
    if (!std::isnormal(grid.cell)
        || farthest * std::numeric_limits<double>::epsilon() > grid.cell / 1000)
        reject("cells of ", grid.cell, " m cannot be told apart at ", farthest,
               " m from the origin; move the scene there or set a larger `cell_size`");
    glm::dvec3 dims;
    for (int a = 0; a < 3; ++a)
        dims[a] = cells_across(extent[a], grid.cell) + 2.0 * margin;
    if (dims.x * dims.y * dims.z > std::numeric_limits<int32_t>::max())
        reject("the grid would have ", dims.x, " x ", dims.y, " x ", dims.z,
               " cells, more than 2^31 - 1; lower `resolution` or raise `cell_size`");
    grid.dims = glm::ivec3(dims);
    grid.origin = lo + 0.5 * extent - 0.5 * grid.cell * dims;
    return grid;
}

} // namespace lpvbake::volume
