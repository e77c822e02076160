// Which meshes count for boxes of the world, told before they are decoded.
#pragma once

#include "scene/gltf/materials.h"
#include "scene/gltf/meshes.h"
#include "scene/gltf/near.h"
#include "scene/gltf/nodes.h"

#include <vector>

namespace lpvbake::scene::gltf {

/// Of each job whether an instance of it may be one that scene::Around takes for one of the boxes:
/// all that is one is told, with few others. Throws Error for positions that cannot be read.
std::vector<bool> jobs_near(const Document& document, const Graph& graph, const Jobs& jobs,
                            const std::vector<SourceMaterial>& materials, const Near& near);

} // namespace lpvbake::scene::gltf
