#include "solver/gather/cell_zone.h"

#include "lpvbake/volume.h"

#include <algorithm>
#include <bit>

namespace lpvbake::solver::gather {
namespace {

constexpr int coarsest = 8;          ///< cells between those that test everything
constexpr size_t fewest_corners = 4; ///< that have to agree

glm::vec3 centre_of(glm::ivec3 cell) {
    return glm::vec3(cell) + 0.5f;
}

} // namespace

Occupied::Occupied(const std::vector<surface::Patch>& patches, const Grid& grid) {
    for (int edge = 1; edge <= zone_edge; edge *= 2) {
        grids_.push_back({{}, 1.0, (grid.dims + edge - 1) / edge});
        levels_.emplace_back(grids_.back().size(), uint8_t(0));
    }
    for (const surface::Patch& patch : patches) {
        if (!(patch.area > 0.0f))
            continue;
        const glm::vec3 a = patch.at({0.0f, 0.0f}), b = patch.at({1.0f, 0.0f}),
                        c = patch.at({0.0f, 1.0f});
        const glm::vec3 lo = glm::min(a, glm::min(b, c)), hi = glm::max(a, glm::max(b, c));
        const glm::vec3 last(grid.dims - 1);
        if (glm::any(glm::lessThan(hi, glm::vec3(0.0f)))
            || glm::any(glm::greaterThan(lo, last + 1.0f)))
            continue;
        constexpr float slack = surface_margin + 1e-3f;
        const glm::ivec3 from(glm::clamp(glm::floor(lo - 0.5f - slack), glm::vec3(0.0f), last));
        const glm::ivec3 to(glm::clamp(glm::floor(hi - 0.5f + slack), glm::vec3(0.0f), last));
        for (int z = from.z; z <= to.z; ++z)
            for (int y = from.y; y <= to.y; ++y)
                for (int x = from.x; x <= to.x; ++x)
                    levels_[0][grids_[0].index({x, y, z})] = 1;
    }
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

CellZone::CellZone(const Surroundings& world, const Cells& cells, glm::ivec3 base)
    : Zone(world, centre_of(base), centre_of(glm::min(base + zone_edge, cells.grid.dims) - 1)),
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

const uint64_t* CellZone::bits(glm::ivec3 point) {
    const size_t at = slot(point);
    if (known_[at])
        return bits_[known_[at] - 1u].get();
    const size_t words = words_ * planes_;
    auto own = std::make_unique<uint64_t[]>(words);

    size_t count = 0; // of those corners
    // What the corners of the cube around the cell agree on, of those that it sees.
    std::vector<uint64_t> open(words_, ~uint64_t(0));
    const int lowest = (point.x | point.y | point.z) & -(point.x | point.y | point.z);
    if (lowest != 0 && lowest < coarsest) {
        const int edge = 2 * lowest;
        glm::ivec3 lo = point & ~(edge - 1);
        for (int i = 0; i < 3; ++i)
            if (lo[i] == zone_edge)
                lo[i] -= edge;
        const bool crossed = cells_.occupied(base_ + lo, std::countr_zero(uint32_t(edge)));
        const auto captured = [&](glm::ivec3 place) {
            return world_.visibility.capture(base_ + place).point;
        };
        const glm::vec3 from = crossed ? captured(point) : glm::vec3(0.0f);
        std::vector<uint64_t> all(words, ~uint64_t(0)), any(words, 0);
        glm::ivec3 least(lo + edge), most(lo); // of those corners
        for (int i = 0; i < 8; ++i) {
            const glm::ivec3 corner = lo + edge * glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
            if (!usable(corner))
                continue;
            if (crossed) {
                ++rays_;
                if (world_.visibility.filter({from, captured(corner) - from}) != glm::vec3(1.0f))
                    continue;
            }
            const uint64_t* theirs = bits(corner);
            for (size_t w = 0; w < words; ++w) {
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
    const glm::ivec3 cell = base_ + point;
    rays_ +=
        look(world_.visibility.capture(cell).point, pattern_of(centre_of(cell)), open, own.get());

    bits_.push_back(std::move(own));
    known_[at] = uint16_t(bits_.size());
    return bits_.back().get();
}

} // namespace lpvbake::solver::gather
