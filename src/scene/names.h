// What things of a scene are called where a message names them.
#pragma once

#include "lpvbake/scene.h"

namespace lpvbake::scene {

/// The material and the mesh of a placed mesh, by index where they have no name.
std::string name_of_surface(const Scene& scene, uint32_t instance);

} // namespace lpvbake::scene
