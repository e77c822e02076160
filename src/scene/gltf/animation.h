// Animations, read at one time.
#pragma once

#include "scene/gltf/document.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

/// What an animation sets of a node; the rest stays as the file has it.
struct NodePose {
    std::optional<glm::dvec3> translation;
    std::optional<glm::dquat> rotation; ///< of unit length
    std::optional<glm::dvec3> scale;
    std::vector<double> weights; ///< of morph targets; empty: not set
};
using Pose = std::map<int, NodePose>; ///< by node

/// The pose of the settings' animation at their time (glTF 2.0, section 3.11 and appendix C:
/// LINEAR, STEP and CUBICSPLINE; before the first key and after the last its value holds). Empty
/// where neither is set. Channels of other paths than a node's transform and weights are left out
/// with a warning. Throws Error.
Pose read_pose(Document& document, const LoadSettings& settings);

/// Seconds of the last key of an animation; 0 if it has none that can be read.
double duration(const Document& document, int animation);

/// A unit quaternion of x, y, z, w. Throws Error for one without a length.
glm::dquat unit_quaternion(const Document& document, glm::dvec4 xyzw, const std::string& place);

} // namespace lpvbake::scene::gltf
