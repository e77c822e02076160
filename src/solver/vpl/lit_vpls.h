// Surfaces and the sky as virtual point lights.
#pragma once

#include "scene/light_layer.h"
#include "solver/vpl/rsm.h"
#include "surface/lit_surfaces.h"

#include <span>
#include <vector>

namespace lpvbake::solver::vpl {

/// Appends VPLs, of the surfaces' layers too, for each side of a patch that light leaves, of pi * L
/// * A (lm): four that share it, one where the patch is more than a cell away from the grid and all
/// levels around it.
void emit_vpls(const surface::LitSurfaces& surfaces, const scene::Frame& frame,
               std::vector<Vpl>& vpls);

/// Appends the sky's light where it enters the grid by these sides: a VPL on each outer face of a
/// border cell, as bright as the sky that cosine-distributed rays meet from there. Of layers, which
/// have no sky beside the scene's, what they have of it.
void sky_vpls(const Sky& sky, const visibility::Visibility& visibility, const scene::Frame& frame,
              std::vector<Vpl>& vpls, Sides sides = all_sides,
              std::span<const scene::LightLayer> layers = {});

} // namespace lpvbake::solver::vpl
