// Patches that are kept from bake to bake, as geometry cuts them.
#pragma once

#include "cache/cache.h"
#include "surface/patches.h"

namespace lpvbake::surface {

/// All of a patch but what it sends by itself, as numbers without padding.
struct PatchNumbers {
    glm::vec3 position, normal, edge_u, edge_v, albedo;
    float area, alpha;
    uint32_t instance, triangle, flags;

    PatchNumbers() = default;
    explicit PatchNumbers(const Patch& of);
    /// False where they are of no patch of the scene; null: of whichever it is.
    bool to(const Scene* scene, Patch& patch) const;
};

/// As cover_surfaces; it is taken from the cache, if there is one, and kept there.
PatchCover cover_surfaces(const Scene& scene, const scene::Frame& frame,
                          const visibility::Visibility& visibility, float max_edge,
                          cache::Cache* cache);

/// Puts a cover, and takes it again, from bytes that anybody may have written: false where it is
/// none of the scene. Null: it may be of any, and is there to be written again.
void write_cover(const PatchCover& cover, cache::Writer& out);
bool read_cover(cache::Reader& in, const Scene* scene, PatchCover& cover);

} // namespace lpvbake::surface
