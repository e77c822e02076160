// Primitives of glTF meshes as triangle lists.
#pragma once

#include "scene/gltf/document.h"
#include "scene/gltf/materials.h"
#include "scene/gltf/nodes.h"

#include <utility>
#include <vector>

namespace lpvbake::scene::gltf {

/// One primitive of a shape, to become a Mesh.
struct Job {
    int shape;
    size_t primitive;
    int material; ///< index into Jobs::materials
    int rule;     ///< of its material (roles.h)
};

/// The primitives of all placed shapes that hold triangles.
struct Jobs {
    std::vector<Job> jobs;
    std::vector<std::pair<size_t, size_t>> of_shape; ///< [begin, end) in `jobs`
    std::vector<int> materials;                      ///< glTF materials in use, -1: the default
};

/// Without what is excluded. Takes the memory that the meshes will need. Throws Error.
Jobs collect_jobs(Document& document, const LoadSettings& settings, const Graph& graph,
                  Roles& roles);

/// Decodes jobs, in their order; those that are not `wanted` become meshes without vertices.
/// Warnings go to the document. Throws Error.
std::vector<Mesh> read_meshes(Document& document, const Graph& graph, const Jobs& jobs,
                              const std::vector<SourceMaterial>& materials,
                              const std::vector<bool>& wanted);

} // namespace lpvbake::scene::gltf
