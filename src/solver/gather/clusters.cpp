#include "solver/gather/clusters.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

namespace lpvbake::solver::gather {
namespace {

/// Subtrees of fewer emitters are built by one thread.
constexpr uint32_t own_task = 4096;
/// By how much a cluster counts larger for normals that differ.
constexpr float bend = 40.0f;
constexpr float flat = 0.999f; ///< length of the mean normal of a sheet

std::vector<Emitter> emitters_of(const surface::LitSurfaces& surfaces, float above) {
    std::vector<Emitter> emitters;
    for (size_t i = 0; i < surfaces.patches.size(); ++i) {
        const surface::Patch& patch = surfaces.patches[i];
        for (size_t side = 0; side < 2; ++side) {
            Emitter e;
            // What no ray meets is gathered whole.
            const glm::vec3 luminance = surfaces.luminance[2 * i + side];
            e.luminance =
                patch.alpha * (patch.met ? surface::luminance_above(luminance, above) : luminance);
            e.power = (e.luminance.x + e.luminance.y + e.luminance.z) * patch.area;
            if (!(e.power > 0.0f))
                continue;
            e.crossed = patch.crossed ? 1u : 0u;
            e.side = uint32_t(2 * i + side) & 0x7fffffffu;
            e.normal = side == 0 ? patch.normal : -patch.normal;
            e.a = patch.position - (patch.edge_u + patch.edge_v) / 3.0f;
            e.b = e.a + patch.edge_u;
            e.c = e.a + patch.edge_v;
            // A mirrored patch's corners run the other way.
            if (glm::dot(glm::cross(patch.edge_u, patch.edge_v), e.normal) < 0.0f)
                std::swap(e.b, e.c);
            emitters.push_back(e);
        }
    }
    return emitters;
}

/// What parts emitters.
struct Key {
    glm::vec3 center, normal;
    uint32_t emitter;
};

struct Builder {
    const std::vector<Emitter>& emitters;
    std::vector<Key>& keys; ///< the emitters', in the tree's order
    std::vector<Cluster>& nodes;
    const visibility::Visibility& visibility;

    void build(uint32_t node, uint32_t first, uint32_t count) {
        if (count == 1) {
            nodes[node] = leaf(first);
            return;
        }
        const uint32_t half = split(first, count);
        const uint32_t second = node + 2 * half;
        const auto left = [&] { build(node + 1, first, half); };
        const auto right = [&] { build(second, first + half, count - half); };
        if (count >= own_task) {
            tbb::parallel_invoke(left, right);
        } else {
            left();
            right();
        }
        nodes[node] = join(nodes[node + 1], nodes[second]);
        nodes[node].second = second;
    }

private:
    const Emitter& at(uint32_t index) const { return emitters[keys[index].emitter]; }

    Cluster leaf(uint32_t index) const {
        const Emitter& e = at(index);
        Cluster c;
        c.position = e.center();
        c.normal = e.normal;
        c.lo = glm::min(e.a, glm::min(e.b, e.c));
        c.hi = glm::max(e.a, glm::max(e.b, e.c));
        c.size =
            std::max({glm::distance(e.a, e.b), glm::distance(e.b, e.c), glm::distance(e.c, e.a)});
        // Second moment of a triangle: a twelfth of the sum over its corners.
        const auto square = [&](glm::vec3 corner) {
            return glm::dot(corner - c.position, corner - c.position);
        };
        c.spread = (square(e.a) + square(e.b) + square(e.c)) / 12.0f;
        c.intensity = e.luminance * (0.5f * glm::length(glm::cross(e.b - e.a, e.c - e.a)));
        c.power = e.power;
        c.first = index;
        c.count = 1;
        return c;
    }

    Cluster join(const Cluster& a, const Cluster& b) const {
        Cluster c;
        const float share = b.power / (a.power + b.power);
        c.position = glm::mix(a.position, b.position, share);
        c.normal = glm::mix(a.normal, b.normal, share);
        c.intensity = a.intensity + b.intensity;
        c.power = a.power + b.power;
        const glm::vec3 apart = b.position - a.position;
        c.spread =
            glm::mix(a.spread, b.spread, share) + share * (1.0f - share) * glm::dot(apart, apart);
        c.lo = glm::min(a.lo, b.lo);
        c.hi = glm::max(a.hi, b.hi);
        c.size = glm::distance(c.lo, c.hi) * (1.0f + bend * (1.0f - glm::length(c.normal)));
        c.first = a.first;
        c.count = a.count + b.count;
        c.divided = a.divided || b.divided || !see_each_other(a, b);
        return c;
    }

    /// Whether the middle emitters of two clusters see each other, if they face each other or lie
    /// in one plane.
    bool see_each_other(const Cluster& a, const Cluster& b) const {
        const glm::vec3 p = at(a.first + a.count / 2).point({0.25f, 0.5f});
        const glm::vec3 q = at(b.first + b.count / 2).point({0.25f, 0.5f});
        return visibility.transmittance({p, q - p}) > 0.5f;
    }

    /// Where keys lie and face.
    struct Spread {
        glm::vec3 facing{0.0f}; ///< mean normal
        glm::vec3 lo{HUGE_VALF}, hi{-HUGE_VALF}, turned_lo{1.0f}, turned_hi{-1.0f};

        explicit Spread(std::span<const Key> of) {
            for (const Key& key : of) {
                facing += key.normal / float(of.size());
                lo = glm::min(lo, key.center);
                hi = glm::max(hi, key.center);
                turned_lo = glm::min(turned_lo, key.normal);
                turned_hi = glm::max(turned_hi, key.normal);
            }
        }
    };

    /// Where the nearer of two flat sheets ends, if that is what the emitters are: a cell sees one
    /// of them, so that no cluster should hold both. Their gap is small, or else they part anyhow.
    static std::optional<uint32_t> first_sheet(std::span<Key> of, const Spread& spread) {
        const glm::vec3 lo = spread.lo, hi = spread.hi;
        if (!(glm::length(spread.facing) > flat))
            return std::nullopt;
        const auto height = [&spread](const Key& key) {
            return glm::dot(key.center - spread.lo, spread.facing);
        };
        float low = HUGE_VALF, high = -HUGE_VALF;
        for (const Key& key : of) {
            low = std::min(low, height(key));
            high = std::max(high, height(key));
        }
        const float gap = high - low;
        if (!(gap > 4.0f * surface::ray_offset(lo) && gap < 0.25f * glm::distance(lo, hi)))
            return std::nullopt;
        for (const Key& key : of)
            if (std::abs(height(key) - 0.5f * (low + high)) < 0.25f * gap)
                return std::nullopt;
        const auto upper = std::stable_partition(
            of.begin(), of.end(), [&](const Key& key) { return height(key) < low + 0.5f * gap; });
        return uint32_t(upper - of.begin());
    }

    uint32_t split(uint32_t first, uint32_t count) {
        const std::span<Key> of = std::span(keys).subspan(first, count);
        const Spread spread(of);
        if (const auto sheet = first_sheet(of, spread))
            return *sheet;
        const glm::vec3 extent = spread.hi - spread.lo,
                        turn = (spread.turned_hi - spread.turned_lo) * glm::length(extent);
        int axis = 0;
        for (int i = 1; i < 6; ++i) {
            const auto across = [&](int k) { return k < 3 ? extent[k] : turn[k - 3]; };
            if (across(i) > across(axis))
                axis = i;
        }
        const auto place = [axis](const Key& key) {
            return axis < 3 ? key.center[axis] : key.normal[axis - 3];
        };
        const float middle = axis < 3
                                 ? 0.5f * (spread.lo[axis] + spread.hi[axis])
                                 : 0.5f * (spread.turned_lo[axis - 3] + spread.turned_hi[axis - 3]);
        const auto cut = std::stable_partition(of.begin(), of.end(),
                                               [&](const Key& key) { return place(key) < middle; });
        const auto half = uint32_t(cut - of.begin());
        // All in one place, or a tree that would grow too deep.
        const uint32_t least = count / 16;
        if (half > least && count - half > least)
            return half;
        std::stable_sort(of.begin(), of.end(),
                         [&](const Key& a, const Key& b) { return place(a) < place(b); });
        return count / 2;
    }
};

void add_layers(const surface::LitSurfaces& surfaces, Clusters& clusters) {
    const size_t count = surfaces.layer_count;
    clusters.layer_count = count;
    clusters.layers.resize(count * clusters.nodes.size());
    const auto of = [&](size_t node) { return clusters.layers.data() + count * node; };
    for (size_t node = clusters.nodes.size(); node-- > 0;) { // halves come after their whole
        const Cluster& cluster = clusters.nodes[node];
        if (cluster.count > 1) {
            for (size_t layer = 0; layer < count; ++layer)
                of(node)[layer] = of(node + 1)[layer] + of(cluster.second)[layer];
            continue;
        }
        const Emitter& e = clusters.emitters[cluster.first];
        // What of the side's light is taken, its covered share and area with it, a channel alike.
        const glm::vec3 all = surfaces.luminance[e.side];
        const float share = (cluster.intensity.x + cluster.intensity.y + cluster.intensity.z)
                            / (all.x + all.y + all.z);
        for (size_t layer = 0; layer < count; ++layer)
            of(node)[layer] = share * surfaces.layers[count * e.side + layer];
    }
}

} // namespace

glm::vec3 Emitter::point(glm::vec2 u) const {
    const float root = std::sqrt(crossed ? 4.0f / 9.0f : u.x);
    if (crossed)
        u.y = 0.5f;
    const glm::vec3 p = a + root * (1.0f - u.y) * (b - a) + root * u.y * (c - a);
    return p + 2.0f * surface::ray_offset(p) * normal;
}

uint32_t Clusters::emitter_at(const Cluster& cluster, double share) const {
    const double from = power_before[cluster.first];
    const double to = power_before[cluster.first + cluster.count];
    const auto begin = power_before.begin() + cluster.first;
    const auto at = std::upper_bound(begin, begin + cluster.count, from + share * (to - from));
    return uint32_t(std::max<ptrdiff_t>(at - power_before.begin() - 1, cluster.first));
}

Clusters make_clusters(const surface::LitSurfaces& surfaces,
                       const visibility::Visibility& visibility, float above) {
    Clusters clusters;
    const std::vector<Emitter> emitters = emitters_of(surfaces, above);
    const auto count = uint32_t(emitters.size());
    if (count == 0)
        return clusters;
    std::vector<Key> keys(count);
    tbb::parallel_for(0u, count, [&](uint32_t i) {
        keys[i] = {emitters[i].center(), emitters[i].normal, i};
    });
    clusters.nodes.resize(2 * size_t(count) - 1);
    Builder{emitters, keys, clusters.nodes, visibility}.build(0, 0, count);
    clusters.emitters.resize(count);
    tbb::parallel_for(0u, count,
                      [&](uint32_t i) { clusters.emitters[i] = emitters[keys[i].emitter]; });
    clusters.power_before.resize(count + 1);
    for (uint32_t i = 0; i < count; ++i)
        clusters.power_before[i + 1] =
            clusters.power_before[i] + double(clusters.emitters[i].power);
    if (surfaces.layer_count > 0)
        add_layers(surfaces, clusters);
    return clusters;
}

bool faces_away(const Cluster& cluster, glm::vec3 centre, glm::vec3 half) {
    if (glm::dot(cluster.normal, cluster.normal) < 0.99999f)
        return false;
    const glm::vec3 middle = 0.5f * (cluster.lo + cluster.hi);
    const glm::vec3 reach = half + 0.5f * (cluster.hi - cluster.lo);
    const glm::vec3 n = cluster.normal;
    return glm::dot(n, centre - middle) + glm::dot(glm::abs(n), reach) <= 0.0f;
}

} // namespace lpvbake::solver::gather
