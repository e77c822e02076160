#include "solver/gather/cell_zone.h"

#include "lpvbake/volume.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>

namespace lpvbake::solver::gather {
namespace {

constexpr int coarsest = 8;          ///< cells between those that test everything
constexpr size_t fewest_corners = 4; ///< that have to agree

} // namespace

std::pair<glm::vec3, glm::vec3> box_of(const surface::Patch& patch) {
    const glm::vec3 a = patch.at({0.0f, 0.0f}), b = patch.at({1.0f, 0.0f}),
                    c = patch.at({0.0f, 1.0f});
    return {glm::min(a, glm::min(b, c)), glm::max(a, glm::max(b, c))};
}

Occupied::Occupied(glm::ivec3 dims) {
    for (int edge = 1; edge <= zone_edge; edge *= 2) {
        grids_.push_back({{}, 1.0, (dims + edge - 1) / edge});
        levels_.emplace_back(grids_.back().size(), uint8_t(0));
    }
}

Occupied::Occupied(const std::vector<surface::Patch>& patches, const Grid& grid)
    : Occupied(grid.dims) {
    for (const surface::Patch& patch : patches)
        add(patch, glm::vec3(0.5f), 1.0f);
    fill_levels();
}

Occupied::Occupied(std::span<const surface::Patch> patches, std::span<const uint32_t> some,
                   glm::vec3 first, float step, glm::ivec3 dims)
    : Occupied(dims) {
    for (const uint32_t i : some)
        add(patches[i], first, step);
    fill_levels();
}

void Occupied::add(const surface::Patch& patch, glm::vec3 first, float step) {
    if (!(patch.area > 0.0f))
        return;
    const auto [lo, hi] = box_of(patch);
    const glm::vec3 last(grids_[0].dims - 1), slack(occupied_slack / step);
    const glm::vec3 begin = (lo - first) / step, end = (hi - first) / step;
    if (glm::any(glm::lessThan(end, glm::vec3(-0.5f)))
        || glm::any(glm::greaterThan(begin, last + 0.5f)))
        return;
    const glm::ivec3 from(glm::clamp(glm::floor(begin - slack), glm::vec3(0.0f), last));
    const glm::ivec3 to(glm::clamp(glm::floor(end + slack), glm::vec3(0.0f), last));
    for (int z = from.z; z <= to.z; ++z)
        for (int y = from.y; y <= to.y; ++y)
            for (int x = from.x; x <= to.x; ++x)
                levels_[0][grids_[0].index({x, y, z})] = 1;
}

void Occupied::fill_levels() {
    for (size_t n = 1; n < levels_.size(); ++n)
        for (int z = 0; z < grids_[n - 1].dims.z; ++z)
            for (int y = 0; y < grids_[n - 1].dims.y; ++y)
                for (int x = 0; x < grids_[n - 1].dims.x; ++x)
                    levels_[n][grids_[n].index({x / 2, y / 2, z / 2})] |=
                        levels_[n - 1][grids_[n - 1].index({x, y, z})];
}

bool Occupied::operator()(glm::ivec3 lo, int level) const {
    return levels_[size_t(level)][grids_[size_t(level)].index(lo >> level)] != 0;
}

CellZone::CellZone(const Surroundings& world, const Cells& cells, glm::ivec3 base, glm::ivec3 last)
    : Zone(world, cells.place(base), cells.place(last), cells.step),
      cells_(cells),
      base_(base),
      known_(size_t(zone_edge + 1) * (zone_edge + 1) * (zone_edge + 1), 0) {}

size_t CellZone::slot(glm::ivec3 point) const {
    return size_t(point.x + (zone_edge + 1) * (point.y + (zone_edge + 1) * point.z));
}

/// Points lie in this zone or on its far side; those in solids see nothing that tells.
bool CellZone::usable(glm::ivec3 point) const {
    const glm::ivec3 cell = base_ + point;
    return glm::all(glm::lessThanEqual(point, glm::ivec3(zone_edge))) && cells_.grid.contains(cell)
           && cells_.validity[cells_.grid.index(cell)] > 0.0f;
}

int CellZone::cube_around(glm::ivec3 point, glm::ivec3& lo) const {
    const int lowest = (point.x | point.y | point.z) & -(point.x | point.y | point.z);
    if (lowest == 0 || lowest >= coarsest)
        return 0;
    const int edge = 2 * lowest;
    lo = point & ~(edge - 1);
    for (int i = 0; i < 3; ++i)
        if (lo[i] == zone_edge)
            lo[i] -= edge;
    return cells_.occupied(base_ + lo, std::countr_zero(uint32_t(edge))) ? 0 : edge;
}

/// With those that it will ask.
void CellZone::add(glm::ivec3 point, Ranks& ranks) {
    uint16_t& known = known_[slot(point)];
    if (known)
        return;
    bits_.push_back(std::make_unique<uint64_t[]>(words()));
    known = uint16_t(bits_.size());
    glm::ivec3 lo;
    const int edge = cube_around(point, lo);
    for (int i = 0; edge > 0 && i < 8; ++i)
        if (const glm::ivec3 corner = lo + edge * glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
            usable(corner))
            add(corner, ranks);
    ranks[edge > 0 ? size_t(std::countr_zero(uint32_t(2 * coarsest / edge))) : 0].push_back(point);
}

void CellZone::find(std::span<const glm::ivec3> cells) {
    Ranks ranks;
    for (const glm::ivec3 cell : cells)
        add(cell - base_, ranks);
    std::atomic<uint64_t> rays = 0;
    const size_t step = std::max(most_looks, together());
    for (const std::vector<glm::ivec3>& points : ranks)
        tbb::parallel_for(size_t(0), (points.size() + step - 1) / step, [&](size_t i) {
            const size_t begin = i * step;
            rays +=
                find_from(std::span(points).subspan(begin, std::min(step, points.size() - begin)));
        });
    rays_ += rays;
}

uint64_t CellZone::find_from(std::span<const glm::ivec3> points) const {
    std::vector<Look> looks(points.size());
    std::vector<uint64_t> open(words_ * points.size());
    for (size_t i = 0; i < points.size(); ++i) {
        const std::span<uint64_t> own = std::span(open).subspan(i * words_, words_);
        take_agreed(points[i], own);
        const glm::ivec3 cell = base_ + points[i];
        const uint32_t pattern = pattern_of(cells_.place(cell)) + 0x9e3779b1u * cells_.draw;
        looks[i] = {cells_.point(world_.visibility, cell), pattern, own, bits(points[i])};
    }
    return look(looks);
}

void CellZone::take_agreed(glm::ivec3 point, std::span<uint64_t> open) const {
    uint64_t* own = bits(point);
    size_t count = 0; // of those corners
    // What the corners of the cube around the cell agree on. Where a surface crosses that, a cell
    // sees for itself: corners around an edge agree on what none between them sees.
    std::ranges::fill(open, ~uint64_t(0));
    glm::ivec3 lo;
    if (const int edge = cube_around(point, lo)) {
        std::vector<uint64_t> all(words(), ~uint64_t(0)), any(words(), 0);
        glm::ivec3 least(lo + edge), most(lo); // of those corners
        for (int i = 0; i < 8; ++i) {
            const glm::ivec3 corner = lo + edge * glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
            if (!usable(corner))
                continue;
            const uint64_t* theirs = bits(corner);
            for (size_t w = 0; w < words(); ++w) {
                all[w] &= theirs[w];
                any[w] |= theirs[w];
            }
            least = glm::min(least, corner);
            most = glm::max(most, corner);
            ++count;
        }
        // What stands beside the cell shades it alone, unless it lies between them.
        const bool between =
            glm::all(glm::lessThanEqual(least, point)) && glm::all(glm::lessThanEqual(point, most));
        if (count >= fewest_corners && between)
            for (size_t w = 0; w < words_; ++w) {
                open[w] = 0;
                for (size_t channel = 0; channel < channels_; ++channel)
                    open[w] |= all[channel * words_ + w] ^ any[channel * words_ + w];
                // What some see by chance says nothing of what others do.
                if (planes_ > channels_)
                    open[w] |= any[channels_ * words_ + w];
                for (size_t channel = 0; channel < channels_; ++channel)
                    own[channel * words_ + w] =
                        all[channel * words_ + w] & any[channel * words_ + w] & ~open[w];
            }
    }
    // The sky ends at edges: what is agreed on one side of a cell tells too little of it.
    if (count < 8)
        for (size_t i = clusters_.size(); i < clusters_.size() + world_.sky.size(); ++i) {
            const uint64_t bit = uint64_t(1) << (i % 64);
            open[i / 64] |= bit;
            for (size_t channel = 0; channel < channels_; ++channel)
                own[channel * words_ + i / 64] &= ~bit;
        }
}

} // namespace lpvbake::solver::gather
