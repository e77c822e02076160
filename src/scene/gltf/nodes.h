// The node graph: what stands where in the world.
#pragma once

#include "scene/gltf/animation.h"
#include "scene/gltf/document.h"
#include "scene/gltf/roles.h"

namespace lpvbake::scene::gltf {

/// A glTF mesh in one shape. Placed with other weights or another skin, it is another shape.
struct Shape {
    int mesh;
    std::vector<double> weights; ///< of morph targets; those that are missing are 0
    int skin = -1;
    /// Of a skin: from mesh space to the space that the shape is placed from, one a joint.
    std::vector<glm::dmat4> joints;
};

struct PlacedShape {
    int shape;
    glm::dmat4 to_world;
    int rule = -1; ///< of its node, of those above, and of the mesh (roles.h)
};

struct Graph {
    std::vector<Shape> shapes; ///< each once, however often it is placed
    std::vector<PlacedShape> placed;
    std::vector<SceneFile::Node> nodes; ///< by indices into `placed`
    std::vector<SceneFile::Box> boxes;
    std::vector<Light> lights;
    std::vector<Camera> cameras;
};

/// Walks the settings' scene in the document's order. Hidden nodes (KHR_node_visibility) place
/// neither meshes nor lights, nor do those that are excluded; a mesh whose transform leaves no area
/// is left out with a warning. Throws Error, also for nodes that form anything but trees.
Graph walk(Document& document, const LoadSettings& settings, const Pose& pose, Roles& roles);

} // namespace lpvbake::scene::gltf
