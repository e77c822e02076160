// Light of surfaces beside the grid, where it comes in.
#pragma once

#include "solver/vpl/rsm.h"

#include <vector>

namespace lpvbake::solver::vpl {

/// Virtual point lights outside the grid become such on the outer faces of border cells: of the
/// power that rays carry through each, whose mean direction is the normal. 2^18 rays, shared by all
/// of them, but 1 to 8192 each. What goes past the grid, into a wall or in by another of its sides
/// is gone. Layers share rays and ways. The same bits for any number of threads.
void let_in(std::vector<Vpl>& vpls, const visibility::Visibility& visibility,
            const scene::Frame& frame, Sides sides = all_sides);

/// Whether a point (frame units) lies in the grid, or on its border.
bool is_inside(glm::vec3 point, const scene::Frame& frame);

} // namespace lpvbake::solver::vpl
