// The lights of a scene as virtual point lights.
#pragma once

#include "lpvbake/progress.h"
#include "scene/light_layer.h"
#include "solver/vpl/rsm.h"

#include <span>

namespace lpvbake::solver::vpl {

/// Renders every light's maps and clusters them, in the order of the lights, for the scene's light
/// and for layers of it; `glass` as RsmPass has it. Advances `progress` by one a light.
std::vector<Vpl> render_vpls(const gpu::Device& device, const Scene& scene,
                             const scene::Frame& frame, const RsmSettings& settings,
                             Progress& progress, const visibility::Visibility* glass = nullptr,
                             std::span<const scene::LightLayer> layers = {});

} // namespace lpvbake::solver::vpl
