#include "reference/lit_pieces.h"

#include "reference/sampler.h"
#include "reference/sampling.h"
#include "scene/material.h"
#include "scene/roles.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>

namespace lpvbake::reference {
namespace {

/// Photons of all lights, of which half go by number and half by power.
constexpr uint32_t all_photons = 1 << 14;
/// A piece with more is halved.
constexpr std::size_t few_photons = 16;
constexpr int most_halvings = 24;
/// Of a photon that is reflected.
constexpr uint32_t most_hits = 16;
/// Places where leaves may be parted, along each axis, and one more.
constexpr int bins = 16;

uint64_t key_of(uint32_t instance, uint32_t triangle) {
    return uint64_t(instance) << 32 | triangle;
}

/// A light as photons leave it.
struct Source {
    const Light* light;
    glm::dvec3 origin;     ///< frame units; directional: of the middle of a disc
    double disc = 0;       ///< its radius
    double cos_outer = -1; ///< 1: directional
    double power = 0;      ///< flux, lumens by its largest channel
};

Source source_of(const Light& light, const visibility::Visibility& visibility,
                 const scene::Frame& frame) {
    Source source{&light, frame.from_world(light.position)};
    const double strength = double(max_component(light.color)) * light.intensity;
    if (light.type == LightType::directional) {
        const glm::dvec3 lo(visibility.lo()), hi(visibility.hi());
        source.disc = 0.5 * glm::length(hi - lo) + 1e-3;
        source.origin = 0.5 * (lo + hi) - 2 * source.disc * light.direction;
        source.cos_outer = 1;
        const double metres = source.disc * frame.unit;
        source.power = glm::pi<double>() * metres * metres * strength;
    } else {
        if (light.type == LightType::spot)
            source.cos_outer = std::cos(light.outer_cone);
        source.power = glm::two_pi<double>() * (1 - source.cos_outer) * strength;
    }
    return source;
}

visibility::Ray ray_of(const Source& source, glm::dvec2 sample) {
    const glm::dvec3 axis = source.light->direction;
    const double turn = glm::two_pi<double>() * sample.y;
    glm::dvec3 u =
        glm::cross(axis, std::abs(axis.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0));
    u = glm::normalize(u);
    const glm::dvec3 across = std::cos(turn) * u + std::sin(turn) * glm::cross(axis, u);
    if (source.disc > 0)
        return {glm::vec3(source.origin + source.disc * std::sqrt(sample.x) * across),
                glm::vec3(axis), 0.0f, HUGE_VALF};
    const double cosine = 1 - sample.x * (1 - source.cos_outer);
    const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
    return {glm::vec3(source.origin), glm::vec3(cosine * axis + sine * across), 0.0f, HUGE_VALF};
}

/// What of a light's power goes along a ray from it to so far away, metres, over the mean.
double share_of(const Source& source, glm::dvec3 towards, double metres) {
    const Light& light = *source.light;
    double share = 1;
    if (light.type == LightType::spot)
        share *=
            spot_ramp(glm::dot(towards, light.direction),
                      std::cos(std::min(light.inner_cone, light.outer_cone)), source.cos_outer);
    if (light.type != LightType::directional && light.range > 0)
        share *= std::clamp(1 - std::pow(metres / light.range, 4.0), 0.0, 1.0);
    return share;
}

/// Around the middles of some leaves.
struct Box {
    double power = 0;
    glm::dvec3 lo{HUGE_VAL}, hi{-HUGE_VAL};
    void add(const Box& other) {
        power += other.power;
        lo = glm::min(lo, other.lo);
        hi = glm::max(hi, other.hi);
    }
    double spread() const { return power > 0 ? power * glm::dot(hi - lo, hi - lo) : 0; }
};

} // namespace

LitPieces::LitPieces(const Scene& scene, const visibility::Visibility& visibility,
                     const scene::Frame& frame, Light of) {
    const uint32_t hits = of == Light::all ? most_hits : 1;
    std::vector<Source> sources;
    double power = 0;
    for (const lpvbake::Light& light : scene.lights) {
        if (of == Light::spots && light.type == LightType::directional)
            continue;
        sources.push_back(source_of(light, visibility, frame));
        power += sources.back().power;
    }
    std::vector<Photon> photons;
    for (std::size_t s = 0; s < sources.size() && power > 0 && std::isfinite(power); ++s) {
        const Source& source = sources[s];
        const double own_share = source.power / power;
        const double part = 0.5 / double(sources.size()) + 0.5 * own_share;
        const auto count = uint32_t(std::ceil(part * all_photons));
        std::vector<Photon> own(count * hits, {visibility::no_hit, 0, {}, {}});
        tbb::parallel_for(0u, count, [&](uint32_t i) {
            PathSampler sampler(join_bits(0x6c6974, s), i);
            visibility::Ray ray = ray_of(source, sampler.pair());
            double left = own_share / count;
            for (uint32_t h = 0; h < hits; ++h) {
                const visibility::Hit hit = visibility.closest(ray);
                if (hit.instance == visibility::no_hit || hit.facing == visibility::Facing::back
                    || !scene::reflects(scene.instances[hit.instance].role))
                    return;
                if (h == 0)
                    left *= share_of(source, glm::dvec3(ray.direction), double(hit.t) * frame.unit);
                const Mesh& mesh = scene.meshes[std::size_t(scene.instances[hit.instance].mesh)];
                const double reflected = double(max_component(
                    hit.tint
                    * scene::sample_surface(scene, mesh, hit.triangle, hit.barycentric).albedo));
                if (!(left * reflected > 0))
                    return;
                const glm::vec3 n =
                    glm::dot(hit.normal, ray.direction) > 0 ? -hit.normal : hit.normal;
                own[i * hits + h] = {hit.instance, hit.triangle, hit.barycentric,
                                     float(left * reflected) * n};
                if (sampler.plain() >= reflected) // what goes on keeps its power
                    return;
                const glm::dvec3 point =
                    glm::dvec3(ray.origin) + double(hit.t) * glm::dvec3(ray.direction);
                ray.origin = glm::vec3(point + ray_offset(point) * glm::dvec3(n));
                ray.direction = glm::vec3(sample_cosine(glm::dvec3(n), sampler.pair()));
            }
        });
        std::ranges::copy_if(own, std::back_inserter(photons), [](const Photon& photon) {
            return photon.instance != visibility::no_hit;
        });
    }
    std::ranges::stable_sort(
        photons, {}, [](const Photon& photon) { return key_of(photon.instance, photon.triangle); });
    std::vector<glm::vec3> positions;
    uint32_t instance = visibility::no_hit;
    for (std::size_t i = 0, end = 0; i < photons.size(); i = end) {
        const uint64_t key = key_of(photons[i].instance, photons[i].triangle);
        while (end < photons.size() && key_of(photons[end].instance, photons[end].triangle) == key)
            ++end;
        if (photons[i].instance != instance) {
            instance = photons[i].instance;
            positions = scene::positions_in_frame(scene, scene.instances[instance], frame);
        }
        const glm::uvec3 v = scene.meshes[std::size_t(scene.instances[instance].mesh)]
                                 .triangles[photons[i].triangle];
        placed_.push_back({positions[v.x], positions[v.y] - positions[v.x],
                           positions[v.z] - positions[v.x], instance, photons[i].triangle});
        roots_[key] = uint32_t(pieces_.size());
        halve(std::span(photons).subspan(i, end - i), uint32_t(placed_.size() - 1));
    }
    std::vector<uint32_t> all(leaves_.size());
    std::iota(all.begin(), all.end(), 0u);
    if (!all.empty())
        grow(all, ~0u);
}

void LitPieces::halve(std::span<Photon> all, uint32_t placed) {
    struct Open {
        std::span<Photon> photons;
        Corners corners;
        uint32_t piece;
        int halvings;
    };
    const Placed& triangle = placed_[placed];
    std::vector<Open> open{{all, whole_triangle, uint32_t(pieces_.size()), 0}};
    pieces_.emplace_back();
    while (!open.empty()) {
        const auto [photons, corners, piece, halvings] = open.back();
        open.pop_back();
        if (photons.empty())
            continue;
        if (photons.size() <= few_photons || halvings == most_halvings) {
            const glm::vec2 u = corners[1] - corners[0], v = corners[2] - corners[0];
            Leaf leaf{placed, corners};
            leaf.area = 0.5 * std::abs(double(u.x) * double(v.y) - double(u.y) * double(v.x))
                        * glm::length(glm::cross(glm::dvec3(triangle.ab), glm::dvec3(triangle.ac)));
            for (const Photon& photon : photons) {
                leaf.power += glm::length(glm::dvec3(photon.facing));
                leaf.facing += glm::dvec3(photon.facing);
            }
            if (leaf.area > 0) {
                pieces_[piece].leaf = uint32_t(leaves_.size());
                leaves_.push_back(leaf);
            }
            continue;
        }
        const Halves halves = halves_of(corners, triangle.ab, triangle.ac);
        const auto half = uint32_t(pieces_.size());
        pieces_[piece].first_half = half;
        pieces_[piece].edge = halves.edge;
        pieces_.resize(half + 2);
        // As piece_at finds them.
        const uint32_t root = roots_.at(key_of(triangle.instance, triangle.triangle));
        const auto second =
            std::stable_partition(photons.begin(), photons.end(), [&](const Photon& photon) {
                return &piece_at(pieces_, root, photon.barycentric) == &pieces_[half];
            });
        const auto in_first = std::size_t(second - photons.begin());
        open.push_back({photons.subspan(in_first), halves.second, half + 1, halvings + 1});
        open.push_back({photons.first(in_first), halves.first, half, halvings + 1});
    }
}

glm::dvec3 LitPieces::corner(const Leaf& leaf, std::size_t i) const {
    const Placed& placed = placed_[leaf.placed];
    return glm::dvec3(placed.a + leaf.corners[i].x * placed.ab + leaf.corners[i].y * placed.ac);
}

glm::dvec3 LitPieces::middle(uint32_t leaf) const {
    const Leaf& own = leaves_[leaf];
    return (corner(own, 0) + corner(own, 1) + corner(own, 2)) / 3.0;
}

std::size_t LitPieces::part(std::span<uint32_t> leaves, glm::dvec3 lo, glm::dvec3 hi) const {
    const auto bin_of = [&](uint32_t leaf, int axis) {
        const double along = (middle(leaf)[axis] - lo[axis]) / (hi[axis] - lo[axis]);
        return std::clamp(int(bins * along), 0, bins - 1);
    };
    double least = HUGE_VAL;
    int best_axis = 0, best_plane = 0;
    for (int axis = 0; axis < 3; ++axis) {
        if (!(hi[axis] > lo[axis]))
            continue;
        std::array<Box, bins> boxes;
        for (const uint32_t leaf : leaves)
            boxes[std::size_t(bin_of(leaf, axis))].add(
                {leaves_[leaf].power, middle(leaf), middle(leaf)});
        std::array<double, bins> beyond{};
        Box box;
        for (std::size_t plane = bins - 1; plane > 0; --plane) {
            box.add(boxes[plane]);
            beyond[plane] = box.spread();
        }
        box = {};
        for (std::size_t plane = 1; plane < bins; ++plane) {
            box.add(boxes[plane - 1]);
            if (box.spread() + beyond[plane] < least) {
                least = box.spread() + beyond[plane];
                best_axis = axis;
                best_plane = int(plane);
            }
        }
    }
    const auto second = std::stable_partition(leaves.begin(), leaves.end(), [&](uint32_t leaf) {
        return least < HUGE_VAL && bin_of(leaf, best_axis) < best_plane;
    });
    const auto first = std::size_t(second - leaves.begin());
    return first == 0 || first == leaves.size() ? leaves.size() / 2 : first;
}

void LitPieces::grow(std::span<uint32_t> leaves, uint32_t parent) {
    const auto own = uint32_t(tree_.size());
    Branch branch;
    branch.parent = parent;
    glm::dvec3 lo(HUGE_VAL), hi(-HUGE_VAL);
    for (const uint32_t leaf : leaves) {
        branch.power += leaves_[leaf].power;
        branch.facing += leaves_[leaf].facing;
        lo = glm::min(lo, middle(leaf));
        hi = glm::max(hi, middle(leaf));
    }
    branch.centre = 0.5 * (lo + hi);
    branch.even = std::max(0.0, branch.power - glm::length(branch.facing));
    for (const uint32_t leaf : leaves)
        for (std::size_t i = 0; i < 3; ++i) {
            const glm::dvec3 way = corner(leaves_[leaf], i) - branch.centre;
            branch.around = std::max(branch.around, glm::dot(way, way));
        }
    if (leaves.size() == 1) {
        branch.leaf = leaves[0];
        leaves_[leaves[0]].branch = own;
        tree_.push_back(branch);
        return;
    }
    tree_.push_back(branch);
    const std::size_t half = part(leaves, lo, hi);
    grow(leaves.first(half), own);
    tree_[own].second = uint32_t(tree_.size());
    grow(leaves.subspan(half), own);
}

double LitPieces::importance(const Branch& branch, glm::dvec3 origin) {
    const glm::dvec3 way = origin - branch.centre;
    const double square = glm::dot(way, way);
    if (square <= branch.around)
        return branch.power / branch.around;
    // Of what turns one way the cosine, the largest from any place of it; of what turns all ways a
    // quarter.
    const double facing =
        glm::dot(branch.facing, way) + glm::length(branch.facing) * std::sqrt(branch.around);
    return (0.25 * branch.even + std::max(0.0, facing / std::sqrt(square))) / square;
}

double LitPieces::first_share(const Branch& branch, glm::dvec3 origin) const {
    const double first = importance(*(&branch + 1), origin);
    const double second = importance(tree_[branch.second], origin);
    return first + second > 0 ? first / (first + second) : 0.5;
}

Emitters::Target LitPieces::target(glm::dvec3 origin, glm::dvec2 sample) const {
    const Branch* branch = tree_.data();
    while (branch->leaf == ~0u) {
        const double share = first_share(*branch, origin);
        const bool is_first = sample.x < share;
        sample.x = is_first ? sample.x / share : (sample.x - share) / (1 - share);
        branch = is_first ? branch + 1 : &tree_[branch->second];
    }
    const Leaf& leaf = leaves_[branch->leaf];
    const Placed& placed = placed_[leaf.placed];
    const glm::dvec2 weights = point_in(leaf.corners, {std::min(sample.x, 1.0), sample.y});
    return {placed.instance, placed.triangle,
            glm::dvec3(placed.a) + weights.x * glm::dvec3(placed.ab)
                + weights.y * glm::dvec3(placed.ac)};
}

double LitPieces::density(const visibility::Hit& hit, glm::dvec3 origin, glm::dvec3 towards) const {
    const auto root = roots_.find(key_of(hit.instance, hit.triangle));
    if (root == roots_.end())
        return 0;
    const uint32_t found = piece_at(pieces_, root->second, hit.barycentric).leaf;
    const double cosine = std::abs(glm::dot(glm::dvec3(hit.normal), towards));
    if (found == ~0u || !(cosine > 0))
        return 0;
    const Leaf& leaf = leaves_[found];
    double share = 1;
    for (uint32_t own = leaf.branch; tree_[own].parent != ~0u; own = tree_[own].parent) {
        const uint32_t parent = tree_[own].parent;
        const double first = first_share(tree_[parent], origin);
        share *= own == parent + 1 ? first : 1 - first;
    }
    const double distance = double(hit.t);
    return share / leaf.area * distance * distance / cosine;
}

} // namespace lpvbake::reference
