#include "surface/kept.h"

#include "surface/kept_cover.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace lpvbake::surface {
namespace {

constexpr uint32_t none = Elements::none;

std::vector<std::array<uint64_t, 2>> hashes_of(const std::vector<Patch>& patches) {
    constexpr size_t block = 4096;
    std::vector<std::array<uint64_t, 2>> hashes((patches.size() + block - 1) / block);
    tbb::parallel_for(size_t(0), hashes.size(), [&](size_t i) {
        std::vector<PatchNumbers> bytes;
        bytes.reserve(block);
        for (size_t k = i * block; k < std::min(patches.size(), (i + 1) * block); ++k)
            bytes.emplace_back(patches[k]);
        hashes[i] = cache::hash_of(
            {reinterpret_cast<const char*>(bytes.data()), bytes.size() * sizeof(PatchNumbers)});
    });
    return hashes;
}

} // namespace

void add_patches(const LitSurfaces& lit, cache::Key& key) {
    const auto roots_of = [](const PatchTree::Root& root) {
        return uint64_t(root.first) | uint64_t(root.levels) << 32 | uint64_t(root.turn) << 40;
    };
    std::vector<uint64_t> roots(lit.tree.roots.size());
    std::ranges::transform(lit.tree.roots, roots.begin(), roots_of);
    key.add(uint64_t(lit.patches.size()))
        .add_all(hashes_of(lit.patches))
        .add_all(lit.tree.pieces)
        .add_all(lit.tree.nodes)
        .add_all(roots)
        .add_all(lit.tree.first_root);
}

Keeper::Keeper(cache::Cache* cache, const LitSurfaces& lit)
    : cache_(cache),
      sides_(uint32_t(2 * lit.patches.size())) {
    if (!cache)
        return;
    cache::Key key("uncut");
    add_patches(lit, key);
    base_ = key.bytes();
}

void Keeper::settle(const LitSurfaces& lit) {
    if (!cache_)
        return;
    whole_.assign(sides_ / 2, 1);
    for (const uint32_t patch : lit.cut_from)
        if (patch < whole_.size())
            whole_[patch] = 0;
}

cache::Key Keeper::key(std::string_view stage) const {
    cache::Key key = cache_->key(stage);
    key.add_text(base_);
    return key;
}

bool Keeper::are_whole(std::span<const uint32_t> some) const {
    return std::ranges::all_of(some, [&](uint32_t side) { return is_whole(side); });
}

KeptGroups::KeptGroups(const Keeper& keeper, size_t most_of_cube) : keeper_(keeper) {
    if (!keeper)
        return;
    key_ = keeper.key("elements");
    if (keeper.cache().get(*key_, [&](cache::Reader& in) { return read(in, most_of_cube); }))
        key_.reset();
    else
        cube_of_.clear();
}

bool KeptGroups::read(cache::Reader& in, size_t most_of_cube) {
    if (!in.get(cubes_) || !in.get(cube_of_) || !in.get(element_)
        || cube_of_.size() != keeper_.sides() || element_.size() != keeper_.sides())
        return false;
    if (std::ranges::any_of(cubes_, [&](const Cube& of) { return of.elements > most_of_cube; }))
        return false;
    for (size_t side = 0; side < cube_of_.size(); ++side)
        if (const uint32_t cube = cube_of_[side];
            cube != none && (cube >= cubes_.size() || element_[side] >= cubes_[cube].elements))
            return false;
    return true;
}

std::vector<std::vector<uint32_t>> KeptGroups::find(std::span<const uint32_t> sides) const {
    std::vector<std::vector<uint32_t>> parts;
    if (cube_of_.empty() || !keeper_.are_whole(sides))
        return parts;
    const uint32_t cube = cube_of_[sides[0]];
    if (cube == none || cubes_[cube].sides != sides.size()
        || std::ranges::any_of(sides, [&](uint32_t side) { return cube_of_[side] != cube; }))
        return parts;
    parts.resize(cubes_[cube].elements);
    for (const uint32_t side : sides)
        parts[element_[side]].push_back(side);
    if (std::ranges::any_of(parts, [](const auto& part) { return part.empty(); }))
        parts.clear();
    return parts;
}

void KeptGroups::keep(std::span<const std::vector<std::vector<uint32_t>>> cubes) {
    if (!key_)
        return;
    cubes_.clear();
    cube_of_.assign(keeper_.sides(), none);
    element_.assign(keeper_.sides(), 0);
    for (const std::vector<std::vector<uint32_t>>& parts : cubes) {
        // find() gives them in rising order.
        if (!std::ranges::all_of(parts, [&](const std::vector<uint32_t>& part) {
                return std::ranges::is_sorted(part) && keeper_.are_whole(part);
            }))
            continue;
        Cube cube{uint32_t(parts.size()), 0};
        for (size_t part = 0; part < parts.size(); ++part)
            for (const uint32_t side : parts[part]) {
                cube_of_[side] = uint32_t(cubes_.size());
                element_[side] = uint8_t(part);
                ++cube.sides;
            }
        cubes_.push_back(cube);
    }
    keeper_.cache().put(*key_, [&](cache::Writer& out) {
        out.put(cubes_);
        out.put(cube_of_);
        out.put(element_);
    });
}

KeptRays::KeptRays(const Keeper& keeper, const Elements& elements, size_t rays, bool tinted)
    : keeper_(keeper),
      elements_(elements),
      rays_(rays),
      tinted_(tinted) {
    if (!keeper || rays == 0)
        return;
    key_ = keeper.key("rays");
    key_->add(uint64_t(rays));
    size_t found = 0;
    if (keeper.cache().get(*key_, [&](cache::Reader& in) { return read(in); })) {
        kept_.assign(elements.size(), none);
        for (size_t i = 0; i < elements.size(); ++i) {
            const std::span<const uint32_t> members = elements.members_of(i);
            if (!keeper.are_whole(members))
                continue;
            const uint32_t at = of_side_[members[0]];
            if (at == none || counts_[at] != members.size()
                || std::ranges::any_of(members,
                                       [&](uint32_t side) { return of_side_[side] != at; }))
                continue;
            kept_[i] = at;
            ++found;
        }
        // Of elements that light has cut by now little is kept.
        if (4 * found >= 3 * elements.size()) {
            key_.reset();
            return;
        }
    }
    new_there_.assign(elements.size() * rays, anew);
    new_tints_.assign(tinted ? new_there_.size() : 0, glm::vec3(1.0f));
}

bool KeptRays::read(cache::Reader& in) {
    if (!in.get(of_side_) || !in.get(counts_) || !in.get(there_) || !in.get(tinted_rays_)
        || !in.get(tints_) || of_side_.size() != keeper_.sides()
        || there_.size() != counts_.size() * rays_ || tints_.size() != tinted_rays_.size())
        return false;
    return std::ranges::all_of(of_side_,
                               [&](uint32_t at) { return at == none || at < counts_.size(); })
           && std::ranges::all_of(
               there_, [&](uint32_t side) { return side >= anew || side < keeper_.sides(); });
}

glm::vec3 KeptRays::tint(size_t element, uint32_t ray) const {
    if (tints_.empty())
        return glm::vec3(1.0f);
    const auto wanted = uint32_t(kept_[element] * rays_ + ray);
    const auto found = std::ranges::lower_bound(tinted_rays_, wanted);
    return found != tinted_rays_.end() && *found == wanted
               ? tints_[size_t(found - tinted_rays_.begin())]
               : glm::vec3(1.0f);
}

void KeptRays::add(size_t element, uint32_t ray, uint32_t there, glm::vec3 tint) {
    if (!key_)
        return;
    new_there_[element * rays_ + ray] = there >= anew || keeper_.is_whole(there) ? there : anew;
    if (tinted_)
        new_tints_[element * rays_ + ray] = tint;
}

void KeptRays::keep() {
    if (!key_)
        return;
    of_side_.assign(keeper_.sides(), none);
    counts_.clear();
    there_.clear();
    tinted_rays_.clear();
    tints_.clear();
    for (size_t i = 0; i < elements_.size(); ++i) {
        const std::span<const uint32_t> members = elements_.members_of(i);
        if (!keeper_.are_whole(members))
            continue;
        for (const uint32_t side : members)
            of_side_[side] = uint32_t(counts_.size());
        counts_.push_back(uint32_t(members.size()));
        for (size_t ray = i * rays_; ray < (i + 1) * rays_; ++ray) {
            if (tinted_ && new_tints_[ray] != glm::vec3(1.0f)) {
                tinted_rays_.push_back(uint32_t(there_.size()));
                tints_.push_back(new_tints_[ray]);
            }
            there_.push_back(new_there_[ray]);
        }
    }
    keeper_.cache().put(*key_, [&](cache::Writer& out) {
        out.put(of_side_);
        out.put(counts_);
        out.put(there_);
        out.put(tinted_rays_);
        out.put(tints_);
    });
}

} // namespace lpvbake::surface
