// Messages that name things of a scene.
#pragma once

#include "lpvbake/scene.h"

namespace lpvbake::scene {

/// That light is reflected without end, as by this placed mesh: its material and mesh, by index
/// where they have no name; `at` says where, or nothing.
std::string endless_reflection(const Scene& scene, uint32_t instance, const std::string& at = "");

} // namespace lpvbake::scene
