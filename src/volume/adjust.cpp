#include "volume/adjust.h"

#include "text.h"

#include <algorithm>
#include <cmath>

namespace lpvbake::volume {
namespace {

/// Calls `set(cell)` for each cell whose centre lies in the box.
template <class Set>
void for_cells_in(const Adjustment& box, const Grid& grid, const Set& set) {
    constexpr double slack = 1e-6; // of a cell
    if (grid.is_turned() || box.turn != glm::dquat(1.0, 0.0, 0.0, 0.0)) {
        for (std::size_t cell = 0; cell < grid.size(); ++cell) {
            const glm::dvec3 at =
                box.about + box.turn * (grid.center(grid.cell_at(cell)) - box.about);
            if (glm::all(glm::lessThanEqual(box.lo - slack * grid.cell, at))
                && glm::all(glm::lessThanEqual(at, box.hi + slack * grid.cell)))
                set(cell);
        }
        return;
    }
    const glm::dvec3 lo = grid.to_grid(box.lo) - 0.5 - slack,
                     hi = grid.to_grid(box.hi) - 0.5 + slack;
    const glm::dvec3 last(grid.dims - 1);
    if (glm::any(glm::lessThan(hi, glm::dvec3(0))) || glm::any(glm::greaterThan(lo, last)))
        return;
    const glm::ivec3 from(glm::ceil(glm::max(lo, glm::dvec3(0))));
    const glm::ivec3 to(glm::floor(glm::min(hi, last)));
    for (int z = from.z; z <= to.z; ++z)
        for (int y = from.y; y <= to.y; ++y)
            for (int x = from.x; x <= to.x; ++x)
                set(grid.index({x, y, z}));
}

} // namespace

bool holds_cells(const Adjustment& box, const Grid& grid) {
    bool any = false;
    for_cells_in(box, grid, [&](std::size_t) { any = true; });
    return any;
}

void adjust_validity(std::span<const Adjustment> boxes, Volume& volume) {
    for (const Adjustment& box : boxes)
        if (box.valid)
            for_cells_in(box, volume.grid, [&](std::size_t cell) {
                volume.validity[cell] = *box.valid ? 1.0f : 0.0f;
            });
}

std::optional<bool> validity_at(std::span<const Adjustment> boxes, glm::dvec3 point, double slack) {
    std::optional<bool> valid;
    for (const Adjustment& box : boxes)
        if (box.valid && glm::all(glm::greaterThanEqual(point, box.lo - slack))
            && glm::all(glm::lessThanEqual(point, box.hi + slack)))
            valid = box.valid;
    return valid;
}

void adjust_intensity(std::span<const Adjustment> boxes, Volume& volume) {
    for (const Adjustment& box : boxes)
        if (box.intensity != 1)
            for_cells_in(box, volume.grid, [&](std::size_t cell) {
                for (std::vector<glm::vec3>& coefficient : volume.sh)
                    coefficient[cell] *= float(box.intensity);
            });
}

std::string text_of(std::span<const Adjustment> boxes) {
    std::string text;
    for (const Adjustment& box : boxes) {
        text += format("%s%.9g,%.9g,%.9g,%.9g,%.9g,%.9g", text.empty() ? "" : "; ", box.lo.x,
                       box.lo.y, box.lo.z, box.hi.x, box.hi.y, box.hi.z);
        if (box.valid)
            text += *box.valid ? " valid" : " invalid";
        if (box.finer)
            text += *box.finer ? " finer" : " coarser";
        if (box.intensity != 1)
            text += format(" intensity %.9g", box.intensity);
    }
    return text;
}

} // namespace lpvbake::volume
