// What of a large scene the light in one box is made from, so that it can be baked box by box.
#pragma once

#include "scene/scene.h"

#include <span>
#include <string>
#include <vector>

namespace lpvbake::scene {

/// A box, and how far around it surfaces count, metres.
struct Surroundings {
    Bounds box;
    double reach = 0;
};

/// "50;x0,y0,z0,x1,y1,z1", as metadata have it.
std::string text_of(const Surroundings& around);
/// Empty where the text is none.
std::optional<Surroundings> parse_surroundings(const std::string& text);

/// Which instances count for boxes: those within reach, and of those beyond the ones that are at
/// least as large as they are far, that emit, or that stand in the way of a directional light's
/// beams to what is within reach.
class Around {
public:
    /// Of the scene's.
    explicit Around(const Scene& scene);
    /// Of instances in these boxes, of which some emit, and of directional lights.
    Around(std::vector<Bounds> boxes, std::vector<bool> emits,
           std::span<const glm::dvec3> directions);

    /// The box around each instance; empty where it has no triangle.
    const std::vector<Bounds>& boxes() const { return boxes_; }
    /// Indices, in order.
    std::vector<std::size_t> operator()(const Surroundings& around) const;

private:
    std::vector<Bounds> boxes_;
    std::vector<bool> emits_;
    std::vector<glm::dvec3> directions_;           ///< of directional lights
    std::vector<std::vector<Bounds>> along_light_; ///< of each the boxes, as it sees them
};

/// Where the directional lights of a scene shine to.
std::vector<glm::dvec3> directions_of(std::span<const Light> lights);

/// The scene of these instances alone, in their order, without the meshes, materials, textures and
/// images that none of them has.
Scene with_instances(Scene&& scene, std::span<const std::size_t> kept);
Scene with_instances(const Scene& scene, std::span<const std::size_t> kept);

/// with_instances of those around.
Scene within(Scene scene, const Surroundings& around);

} // namespace lpvbake::scene
