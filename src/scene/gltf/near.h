// What of a file counts for boxes of the world, told before it is decoded.
#pragma once

#include "scene/surroundings.h"

#include <glm/glm.hpp>

#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

/// Boxes, and where directional lights shine to that are beside the file's.
struct Near {
    std::vector<Surroundings> boxes;
    std::vector<glm::dvec3> directions;
};

/// load_gltf, but meshes that count for none of the boxes have no vertices, and images that are
/// theirs alone no texels. What scene::within takes of it for one of the boxes is what it takes of
/// the whole, value by value. Boxes of meshes are those of all vertices, of Draco's those that
/// accessors tell, half as large again; what is skinned or morphed is decoded whatever it is. Of
/// broken meshes and images among those left out there is no word; with `strict` all are decoded.
Scene load_near(const std::string& path, const LoadSettings& settings, const Near& near);

} // namespace lpvbake::scene::gltf
