#include "solver/gather/zone.h"

#include "lpvbake/volume.h"
#include "mix_word.h"
#include "visibility/capture.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <queue>

namespace lpvbake::solver::gather {
namespace {

constexpr uint32_t strata = 16;       ///< points of a cluster that cells may test
constexpr int coarsest = 8;           ///< cells between those that test everything
constexpr size_t fewest_corners = 4;  ///< that have to agree
constexpr float smallest = 0.25f;     ///< clusters of this size are not opened
constexpr float near_triangle = 1.0f; ///< sizes of a triangle within which it is not a point
constexpr float divided_weight = 8.0f;

float unit(uint32_t bits) {
    return float(bits >> 8) * 0x1p-24f;
}

/// A number for each cell that spreads over all 32 bits whatever the stride between cells: the
/// additive sequence of the plastic number's relative in three dimensions.
uint32_t pattern_of(glm::ivec3 cell) {
    return 0xd1b54a33u * uint32_t(cell.x) + 0xabc98389u * uint32_t(cell.y)
           + 0x8cb92ba7u * uint32_t(cell.z);
}

glm::vec3 centre_of(glm::ivec3 cell) {
    return glm::vec3(cell) + 0.5f;
}

/// 1 in one channel.
glm::vec3 channel_of(int channel) {
    glm::vec3 unit(0.0f);
    unit[channel] = 1.0f;
    return unit;
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

void Sources::clear() {
    points.clear();
    triangles.clear();
    bins.clear();
}

Zone::Zone(const Surroundings& world, glm::ivec3 base)
    : world_(world),
      base_(base),
      dims_(glm::min(glm::ivec3(zone_edge), world.grid.dims - base)) {
    choose_clusters();
    targets_.reserve(clusters_.size() * strata);
    for (const uint32_t index : clusters_) {
        const Cluster& cluster = world_.clusters.nodes[index];
        for (uint32_t s = 0; s < strata; ++s) {
            const uint32_t key = mix_word(mix_word(index) + s);
            const double share = (double(s) + double(unit(key))) / strata;
            const Emitter& emitter =
                world_.clusters.emitters[world_.clusters.emitter_at(cluster, share)];
            targets_.push_back({emitter.point({unit(mix_word(key + 1)), unit(mix_word(key + 2))}),
                                emitter.normal});
        }
    }
    channels_ = world.visibility.is_tinted() ? 3 : 1;
    planes_ = channels_ + (world.visibility.is_veiled() ? 1 : 0);
    words_ = (clusters_.size() + world_.sky.size() + 63) / 64;
    known_.assign(size_t(zone_edge + 1) * (zone_edge + 1) * (zone_edge + 1), 0);
}

void Zone::choose_clusters() {
    const std::vector<Cluster>& nodes = world_.clusters.nodes;
    if (nodes.empty())
        return;
    const glm::vec3 half = 0.5f * glm::vec3(dims_ - 1);
    const glm::vec3 centre = centre_of(base_) + half;
    const float radius = 0.5f * zone_edge;
    struct Open {
        float weight;
        uint32_t node;
        bool operator<(const Open& other) const {
            return weight != other.weight ? weight < other.weight : node > other.node;
        }
    };
    std::priority_queue<Open> open;
    const auto offer = [&](uint32_t index) {
        const Cluster& cluster = nodes[index];
        if (faces_away(cluster, centre, half + visibility::farthest_capture))
            return;
        const glm::vec3 to = glm::clamp(centre, cluster.lo, cluster.hi) - centre;
        const float square = std::max(glm::dot(to, to), radius * radius);
        float weight = cluster.power / square;
        weight *= 1.0f + 8.0f * (1.0f - glm::length(cluster.normal));
        if (cluster.divided)
            weight *= divided_weight;
        if (cluster.count == 1)
            clusters_.push_back(index);
        else
            open.push({weight, index});
    };
    offer(0);
    while (!open.empty() && clusters_.size() + open.size() < size_t(world_.vpls)) {
        const uint32_t index = open.top().node;
        open.pop();
        offer(index + 1);
        offer(nodes[index].second);
    }
    for (; !open.empty(); open.pop())
        clusters_.push_back(open.top().node);
    std::sort(clusters_.begin(), clusters_.end());
}

size_t Zone::slot(glm::ivec3 point) const {
    return size_t(point.x + (zone_edge + 1) * (point.y + (zone_edge + 1) * point.z));
}

/// Points lie in this zone or on its far side; those in solids see nothing that tells.
bool Zone::usable(glm::ivec3 point) const {
    const glm::ivec3 cell = base_ + point;
    return glm::all(glm::lessThanEqual(point, glm::ivec3(zone_edge))) && world_.grid.contains(cell)
           && world_.validity[world_.grid.index(cell)] > 0.0f;
}

/// The ray by which a cell looks at a source. False: the cluster has its back to it.
bool Zone::aim(glm::vec3 from, uint32_t source, uint32_t pattern, visibility::Ray& ray,
               float& threshold) const {
    const uint32_t shift = mix_word(source + 1), key = mix_word(pattern ^ shift);
    threshold = unit(key);
    if (source >= clusters_.size()) {
        const SkyBin& bin = world_.sky[source - clusters_.size()];
        ray = {from, bin.direction({unit(pattern + shift), unit(mix_word(key))}), 0.0f, HUGE_VALF};
        return true;
    }
    // The first of the points, from the cell's own on, that face it.
    const uint32_t start = (pattern + shift) >> 28;
    static_assert(strata == 16);
    for (uint32_t i = 0; i < strata; ++i) {
        const Target& target = targets_[source * strata + (start + 5 * i) % strata];
        ray = {from, target.point - from};
        if (glm::dot(ray.direction, target.normal) < 0.0f)
            return true;
    }
    return false;
}

/// Sets the bits of the sources in `open` that the cell sees: by chance, as much as passes.
void Zone::test(glm::ivec3 point, const std::vector<uint64_t>& open, uint64_t* own) {
    const glm::vec3 from = world_.visibility.capture(base_ + point).point;
    const uint32_t pattern = pattern_of(base_ + point);
    const auto sources = uint32_t(clusters_.size() + world_.sky.size());
    tests_.clear();
    ways_.clear();
    for (uint32_t i = 0; i < sources; ++i) {
        visibility::Ray ray;
        float threshold;
        if ((open[i / 64] >> (i % 64) & 1) && aim(from, i, pattern, ray, threshold)) {
            tests_.push_back({i, threshold});
            ways_.push_back(ray);
        }
    }
    passes_.resize(ways_.size());
    rays_ += ways_.size();
    world_.visibility.filter_of_eights(ways_, visibility::Bundle::loose, passes_);
    for (size_t i = 0; i < tests_.size(); ++i) {
        const uint32_t source = tests_[i].source;
        const auto set = [&](size_t plane, bool bit) {
            own[plane * words_ + source / 64] |= uint64_t(bit) << (source % 64);
        };
        const glm::vec3 passes = passes_[i];
        for (size_t channel = 0; channel < channels_; ++channel)
            set(channel, passes[int(channel)] > tests_[i].threshold);
        if (planes_ > channels_)
            set(channels_, glm::any(glm::greaterThan(passes, glm::vec3(0.0f)))
                               && glm::any(glm::lessThan(passes, glm::vec3(1.0f))));
    }
}

const uint64_t* Zone::bits(glm::ivec3 point) {
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
        const bool crossed = world_.occupied(base_ + lo, std::countr_zero(uint32_t(edge)));
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
    test(point, open, own.get());

    bits_.push_back(std::move(own));
    known_[at] = uint16_t(bits_.size());
    return bits_.back().get();
}

Zone::Masks Zone::masks_of(std::span<const glm::ivec3> cells, size_t source) const {
    std::array<uint32_t, 3> seen{};
    for (size_t i = 0; i < cells.size(); ++i) {
        const uint64_t* sees = bits_[known_[slot(cells[i] - base_)] - 1u].get();
        for (size_t channel = 0; channel < channels_; ++channel)
            seen[channel] |= uint32_t(sees[channel * words_ + source / 64] >> (source % 64) & 1)
                             << i;
    }
    if (channels_ == 1)
        return {seen[0]};
    const uint32_t all = seen[0] & seen[1] & seen[2];
    return {all, {seen[0] & ~all, seen[1] & ~all, seen[2] & ~all}};
}

void Zone::gather_surfaces(std::span<const glm::ivec3> cells, std::span<const glm::vec3> points,
                           Sources& sources) const {
    glm::vec3 lo = points[0], hi = points[0];
    for (const glm::vec3 point : points) {
        lo = glm::min(lo, point);
        hi = glm::max(hi, point);
    }
    const glm::vec3 half = 0.5f * (hi - lo), centre = lo + half;
    for (size_t i = 0; i < clusters_.size(); ++i) {
        const Masks masks = masks_of(cells, i);
        if (masks.all)
            descend(clusters_[i], masks.all, glm::vec3(1.0f), centre, half, sources);
        for (int channel = 0; channel < 3; ++channel)
            if (const uint32_t mask = masks.one[size_t(channel)])
                descend(clusters_[i], mask, channel_of(channel), centre, half, sources);
    }
}

void Zone::gather_sky(std::span<const glm::ivec3> cells, int order, Sources& sources) const {
    std::vector<float> sum, part;
    const auto add_bin = [&](const std::vector<float>& c, uint32_t mask) {
        const size_t first = sources.bins.size();
        sources.bins.resize(first + bin_words(order), glm::vec4(0.0f));
        std::memcpy(&sources.bins[first], c.data(), c.size() * sizeof(float));
        sources.bins.back().w = float(mask);
    };
    const auto add = [&](const std::vector<float>& c, const Masks& masks) {
        if (masks.all)
            add_bin(c, masks.all);
        for (size_t channel = 0; channel < 3; ++channel)
            if (masks.one[channel]) {
                part.assign(c.size(), 0.0f);
                for (size_t t = channel; t < c.size(); t += 3)
                    part[t] = c[t];
                add_bin(part, masks.one[channel]);
            }
    };
    for (size_t i = 0; i < world_.sky.size(); i += sky_group) {
        std::array<Masks, sky_group> masks;
        for (size_t k = 0; k < sky_group; ++k)
            masks[k] = masks_of(cells, clusters_.size() + i + k);
        if (std::all_of(masks.begin(), masks.end(),
                        [&](const Masks& mask) { return mask == masks[0]; })) {
            if (masks[0] == Masks{})
                continue;
            sum.assign(world_.sky[i].coefficients.size(), 0.0f);
            for (size_t k = 0; k < sky_group; ++k)
                for (size_t t = 0; t < sum.size(); ++t)
                    sum[t] += world_.sky[i + k].coefficients[t];
            add(sum, masks[0]);
        } else {
            for (size_t k = 0; k < sky_group; ++k)
                add(world_.sky[i + k].coefficients, masks[k]);
        }
    }
}

void Zone::descend(uint32_t cluster, uint32_t mask, glm::vec3 channels, glm::vec3 centre,
                   glm::vec3 half, Sources& sources) const {
    const std::vector<Cluster>& nodes = world_.clusters.nodes;
    uint32_t stack[512]; // deeper than a tree whose halves hold a sixteenth at least
    size_t depth = 0;
    stack[depth++] = cluster;
    while (depth > 0) {
        const uint32_t index = stack[--depth];
        const Cluster& c = nodes[index];
        if (faces_away(c, centre, half))
            continue;
        const glm::vec3 apart = glm::max(glm::abs(c.position - centre) - half, glm::vec3(0.0f));
        const float square = glm::dot(apart, apart);
        const float wanted = c.size * (c.count == 1 ? near_triangle : world_.kappa);
        if (square >= wanted * wanted || c.size <= smallest) {
            const float guard = 0.25f * c.size * c.size;
            sources.points.push_back(glm::vec4(c.position, mask));
            sources.points.push_back(glm::vec4(c.normal, guard));
            sources.points.push_back(glm::vec4(channels * c.intensity, 0.5f * c.spread));
        } else if (c.count == 1) {
            const Emitter& e = world_.clusters.emitters[c.first];
            sources.triangles.push_back(glm::vec4(e.a, 0));
            sources.triangles.push_back(glm::vec4(e.b, 0));
            sources.triangles.push_back(glm::vec4(e.c, 0));
            sources.triangles.push_back(glm::vec4(channels * e.luminance, mask));
        } else {
            stack[depth++] = c.second;
            stack[depth++] = index + 1;
        }
    }
}

} // namespace lpvbake::solver::gather
