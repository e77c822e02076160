// What a bake keeps for the next one, by what it is made of.
#pragma once

#include "cache/cache.h"
#include "scene/frame.h"
#include "visibility/visibility.h"
#include "volume/volume.h"

namespace lpvbake::bake {

/// All that rays can meet, the frame that surfaces are cut and lit in, and what traces: without
/// lights, the sky and what surfaces emit.
cache::Key world_key(const Scene& scene, const scene::Frame& frame,
                     const visibility::Visibility& visibility);

/// As visibility::find_walls, of the volume's cells, by its validity, where the volume begins with
/// a layer of the frame's.
std::vector<std::vector<glm::vec3>> find_walls(const visibility::Visibility& visibility,
                                               const scene::Frame& frame, const Volume& volume,
                                               int first_layer, cache::Cache* cache);

} // namespace lpvbake::bake
