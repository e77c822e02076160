// A part of a scene's light that is wanted by itself.
#pragma once

#include "lpvbake/scene.h"

#include <functional>
#include <optional>

namespace lpvbake::scene {

/// How much of each light of a scene a layer has: weights, RGB, which may be 0 or any other number.
/// The sum of layers is the scene's light where their weights sum to 1.
struct LightLayer {
    std::vector<glm::vec3> lights;    ///< of Scene::lights each
    std::vector<glm::vec3> emissions; ///< of the emission of Scene::materials each
    glm::vec3 sky{0.0f};              ///< of the sky, its bright spots with it
    /// Luminance (nits) from a unit direction of a sky beside that, which may be negative; empty:
    /// none.
    std::function<glm::vec3(glm::vec3 towards)> beyond = {};
    enum class Part { all, direct, reflected };
    Part part = Part::all; ///< of the light of `beyond`, what it has
    /// Highest band of its field, of a layer of direct light alone; none: as that of all light.
    std::optional<int> order = {};

    /// Whether surfaces reflect the light of `beyond`, and cells see it themselves.
    bool is_reflected() const { return beyond && part != Part::direct; }
    bool is_seen() const { return beyond && part != Part::reflected; }
};

} // namespace lpvbake::scene
