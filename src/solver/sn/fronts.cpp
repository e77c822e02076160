#include "solver/sn/fronts.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace lpvbake::solver::sn {
namespace {

/// Calls visit(p, q, r) for the places of a front whose coordinates are not below `lowest`.
template <class Visit>
void visit_front(const SweepLayout& layout, int front, int lowest, const Visit& visit) {
    const glm::ivec3 n = layout.dims;
    const int sum = front - 3;
    for (int q = std::max(lowest, sum - (n.x - 1) - (n.z - 1)); q < n.y; ++q)
        for (int p = std::max(lowest, sum - q - (n.z - 1)); p < n.x && sum - p - q >= lowest; ++p)
            visit(p, q, sum - p - q);
}

struct Front {
    std::vector<Entry> near, interior;
    std::vector<SnPlace> given;
};

Front order_front(const Octant& octant, const Occupancy& surfaces, bool boundary, int slab_layers,
                  int front) {
    const SweepLayout& layout = octant.layout;
    Front part;
    visit_front(layout, front, 0, [&](int p, int q, int r) {
        const glm::ivec3 c = octant.cell(p, q, r);
        const bool near = surfaces.is_occupied(octant.cube(c));
        const uint32_t slot = layout.slot(p, q);
        (near ? part.near : part.interior)
            .push_back({layout.base(front) + slot, uint32_t(octant.tile.cells.index(c))});
        if (near)
            part.given.push_back({slot, octant.tile.in_grid(c)});
    });
    const glm::ivec3 dims = octant.tile.cells.dims;
    const uint64_t slab = uint64_t(slab_layers) * uint64_t(dims.x) * uint64_t(dims.y);
    if (slab_layers < dims.z)
        for (std::vector<Entry>* list : {&part.near, &part.interior})
            std::stable_sort(list->begin(), list->end(), [&](const Entry& a, const Entry& b) {
                return a.cell / slab < b.cell / slab;
            });
    // Places outside the tile, beside its upstream faces.
    if (boundary)
        visit_front(layout, front, -1, [&](int p, int q, int r) {
            if (p < 0 || q < 0 || r < 0)
                part.given.push_back(
                    {layout.slot(p, q), octant.tile.in_grid(octant.cell(p, q, r))});
        });
    return part;
}

} // namespace

Octant::Octant(const Tile& t, const SweepLayout& l, int number)
    : tile(t),
      layout(l),
      sign(number & 1 ? -1 : 1, number & 2 ? -1 : 1, number & 4 ? -1 : 1) {}

glm::ivec3 Octant::cell(int p, int q, int r) const {
    glm::ivec3 c;
    const int along[] = {p, q, r};
    for (int i = 0; i < 3; ++i) {
        const int axis = layout.axes[i];
        c[axis] = sign[axis] > 0 ? along[i] : tile.cells.dims[axis] - 1 - along[i];
    }
    return c;
}

FrontOrder order_fronts(const Octant& octant, const Occupancy& surfaces, bool boundary,
                        int slab_layers) {
    const int fronts = octant.layout.fronts();
    std::vector<Front> parts(static_cast<size_t>(fronts));
    tbb::parallel_for(0, fronts, [&](int front) {
        parts[size_t(front)] = order_front(octant, surfaces, boundary, slab_layers, front);
    });
    FrontOrder order;
    order.first.push_back(0);
    order.first_given.push_back(0);
    for (const Front& part : parts) {
        const uint32_t middle = order.first.back() + uint32_t(part.near.size());
        order.middle.push_back(middle);
        order.first.push_back(middle + uint32_t(part.interior.size()));
        order.first_given.push_back(order.first_given.back() + uint32_t(part.given.size()));
    }
    order.cells.resize(order.first.back());
    order.slots.resize(order.first.back());
    order.given.resize(order.first_given.back());
    tbb::parallel_for(0, fronts, [&](int front) {
        const Front& part = parts[size_t(front)];
        const auto first = order.cells.begin() + order.first[size_t(front)];
        const auto end =
            std::ranges::copy(part.interior, std::ranges::copy(part.near, first).out).out;
        const uint32_t base = octant.layout.base(front);
        std::transform(first, end, order.slots.begin() + order.first[size_t(front)],
                       [&](const Entry& entry) { return float(entry.slot - base); });
        std::ranges::copy(part.given, order.given.begin() + order.first_given[size_t(front)]);
    });
    return order;
}

} // namespace lpvbake::solver::sn
