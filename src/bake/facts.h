// What planning has to know of a scene.
#pragma once

#include "scene/scene.h"
#include "surface/patch_count.h"

#include <memory>
#include <string>
#include <vector>

namespace lpvbake::bake {

/// A scene, surveyed once for any number of plans.
struct SceneFacts {
    std::string path;
    std::vector<std::string> warnings;             ///< the scene's
    uint64_t triangles = 0;                        ///< placed, at least one
    surface::TriangleSample surfaces;              ///< some of them
    std::shared_ptr<const surface::CutTrial> cuts; ///< what stands on them
    Bounds bounds;                                 ///< of them all
    Bounds crowd; ///< what is left of that without 1 % of them on each side: see trimmed_bounds
    std::vector<Light> lights;
    bool emitters = false;  ///< some surface emits
    bool sky = false;       ///< it is not black
    bool tinted = false;    ///< some surface may colour what it lets through
    bool two_sided = false; ///< some has light on both sides
};

/// The scene outlives the facts. Throws Error (invalid) where there is no triangle.
SceneFacts survey(const Scene& scene);
SceneFacts survey(Scene&& scene) = delete;

} // namespace lpvbake::bake
