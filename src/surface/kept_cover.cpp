#include "surface/kept_cover.h"

#include "scene/roles.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace lpvbake::surface {
namespace {

using Node = PatchTree::Node;
using Root = PatchTree::Root;

uint64_t packed(const Node& of) {
    return of.at | uint64_t(of.halved) << 32 | uint64_t(of.crossed) << 33 | uint64_t(of.turn) << 40
           | uint64_t(of.cover) << 48;
}

Node node_of(uint64_t bits) {
    return {uint32_t(bits), (bits >> 32 & 1) != 0, uint8_t(bits >> 40), (bits >> 33 & 1) != 0,
            uint8_t(bits >> 48)};
}

uint64_t packed(const Root& of) {
    return of.first | uint64_t(of.levels) << 32 | uint64_t(of.turn) << 40;
}

Root root_of(uint64_t bits) {
    return {uint32_t(bits), uint8_t(bits >> 32), uint8_t(bits >> 40)};
}

/// What Embree takes of a ray, and what has a product of two whose square a float holds.
constexpr float farthest = 1e18f, longest = 4e9f;

/// Calls `of(i)` for all below a number on all threads; true where all say so.
template <class Of>
bool all_of(size_t count, const Of& of) {
    std::atomic<bool> all = true;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 4096),
                      [&](const tbb::blocked_range<size_t>& range) {
                          for (size_t i = range.begin(); i < range.end(); ++i)
                              if (!of(i))
                                  all = false;
                      });
    return all;
}

struct Kept {
    std::vector<PatchNumbers> patches;
    std::vector<glm::vec3> emissions; ///< empty where nothing emits

    void take(const std::vector<Patch>& from) {
        patches.resize(from.size());
        tbb::parallel_for(size_t(0), from.size(),
                          [&](size_t i) { patches[i] = PatchNumbers(from[i]); });
        const auto is_dark = [](const Patch& p) { return p.emission == glm::vec3(0.0f); };
        if (std::ranges::all_of(from, is_dark))
            return;
        emissions.resize(from.size());
        std::ranges::transform(from, emissions.begin(), &Patch::emission);
    }
    bool give(const Scene* scene, std::vector<Patch>& to) const {
        if (!emissions.empty() && emissions.size() != patches.size())
            return false;
        to.resize(patches.size());
        return all_of(to.size(), [&](size_t i) {
            if (!emissions.empty())
                to[i].emission = emissions[i];
            return patches[i].to(scene, to[i]);
        });
    }
    bool read(cache::Reader& in) { return in.get(patches) && in.get(emissions); }
    void write(cache::Writer& out) const {
        out.put(patches);
        out.put(emissions);
    }
};

/// Whether every way down ends, and at a patch.
bool is_sound(const PatchTree& tree, size_t patches) {
    const auto leads_on = [&](const Node& node, size_t at) {
        if (node.turn > 2)
            return false;
        return node.halved
                   ? node.at < tree.nodes.size() && tree.nodes.size() - node.at > 1 && node.at >= at
                   : node.at == PatchTree::none || node.at < patches;
    };
    return all_of(tree.nodes.size(), [&](size_t i) { return leads_on(tree.nodes[i], i + 1); })
           && all_of(tree.pieces.size(), [&](size_t i) { return leads_on(tree.pieces[i], 0); })
           && all_of(tree.roots.size(), [&](size_t i) {
                  const Root& root = tree.roots[i];
                  return root.first == PatchTree::none
                         || (root.turn <= 2 && root.levels < 32
                             && root.first + (uint64_t(1) << root.levels) <= tree.pieces.size());
              });
}

/// Whether every triangle has its way down.
bool is_of(const Scene& scene, const PatchTree& tree) {
    if (tree.first_root.size() != scene.instances.size())
        return false;
    for (size_t i = 0; i < scene.instances.size(); ++i) {
        const size_t triangles = scene.meshes[size_t(scene.instances[i].mesh)].triangles.size();
        if (scene::blocks(scene.instances[i].role)
            && (tree.first_root[i] > tree.roots.size()
                || tree.roots.size() - tree.first_root[i] < triangles))
            return false;
    }
    return true;
}

template <class T>
std::vector<uint64_t> all_packed(const std::vector<T>& from) {
    std::vector<uint64_t> bits(from.size());
    std::ranges::transform(from, bits.begin(), [](const T& of) { return packed(of); });
    return bits;
}

template <class T, class Unpack>
void unpack(const std::vector<uint64_t>& bits, std::vector<T>& to, const Unpack& of) {
    to.resize(bits.size());
    std::ranges::transform(bits, to.begin(), of);
}

} // namespace

bool read_cover(cache::Reader& in, const Scene* scene, PatchCover& cover) {
    Kept patches, receivers;
    std::vector<uint64_t> pieces, nodes, roots;
    PatchTree& tree = cover.tree;
    if (!patches.read(in) || !receivers.read(in) || !in.get(pieces) || !in.get(nodes)
        || !in.get(roots) || !in.get(tree.first_root))
        return false;
    unpack(pieces, tree.pieces, node_of);
    unpack(nodes, tree.nodes, node_of);
    unpack(roots, tree.roots, root_of);
    return patches.give(scene, cover.patches) && receivers.give(scene, cover.receivers)
           && is_sound(tree, cover.patches.size()) && (!scene || is_of(*scene, tree));
}

void write_cover(const PatchCover& cover, cache::Writer& out) {
    for (const std::vector<Patch>* of : {&cover.patches, &cover.receivers}) {
        Kept kept;
        kept.take(*of);
        kept.write(out);
    }
    out.put(all_packed(cover.tree.pieces));
    out.put(all_packed(cover.tree.nodes));
    out.put(all_packed(cover.tree.roots));
    out.put(cover.tree.first_root);
}

PatchNumbers::PatchNumbers(const Patch& of)
    : position(of.position),
      normal(of.normal),
      edge_u(of.edge_u),
      edge_v(of.edge_v),
      albedo(of.albedo),
      area(of.area),
      alpha(of.alpha),
      instance(of.instance),
      triangle(of.triangle),
      flags(uint32_t(of.double_sided) | uint32_t(of.crossed) << 1 | uint32_t(of.fading) << 2
            | uint32_t(of.met) << 3 | uint32_t(of.asked) << 4 | uint32_t(of.under) << 8) {}

bool PatchNumbers::to(const Scene* scene, Patch& patch) const {
    if (scene
        && (instance >= scene->instances.size()
            || triangle >= scene->meshes[size_t(scene->instances[instance].mesh)].triangles.size()))
        return false;
    patch.position = position;
    patch.normal = normal;
    patch.edge_u = edge_u;
    patch.edge_v = edge_v;
    patch.albedo = albedo;
    patch.area = area;
    patch.alpha = alpha;
    patch.instance = instance;
    patch.triangle = triangle;
    patch.double_sided = (flags & 1) != 0;
    patch.crossed = (flags >> 1 & 1) != 0;
    patch.fading = (flags >> 2 & 1) != 0;
    patch.met = (flags >> 3 & 1) != 0;
    patch.asked = (flags >> 4 & 1) != 0;
    patch.under = uint8_t(flags >> 8);
    const auto within = [](glm::vec3 value, float least, float most) {
        return glm::all(glm::greaterThanEqual(value, glm::vec3(least)))
               && glm::all(glm::lessThanEqual(value, glm::vec3(most)));
    };
    return within(position, -farthest, farthest) && within(edge_u, -longest, longest)
           && within(edge_v, -longest, longest) && within(normal, -2, 2) && within(albedo, 0, 2)
           && within({area, alpha, 0}, 0, longest * longest) && alpha <= 2
           && std::isfinite(patch.emission.x + patch.emission.y + patch.emission.z);
}

PatchCover cover_surfaces(const Scene& scene, const scene::Frame& frame,
                          const visibility::Visibility& visibility, float max_edge,
                          cache::Cache* cache) {
    if (!cache)
        return cover_surfaces(scene, frame, visibility, max_edge);
    cache::Key key = cache->key("patches");
    key.add(max_edge);
    for (const Material& material : scene.materials) // patches are as small as their light is even
        key.add(material.emission, material.emission_texture);
    for (const Mesh& mesh : scene.meshes)
        key.add_all(mesh.uv_emission);
    PatchCover cover;
    if (!cache->get(key, [&](cache::Reader& in) { return read_cover(in, &scene, cover); })) {
        cover = cover_surfaces(scene, frame, visibility, max_edge);
        cache->put(key, [&](cache::Writer& out) { write_cover(cover, out); });
    }
    return cover;
}

} // namespace lpvbake::surface
