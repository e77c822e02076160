// The stage that keeps operators of local radiance transfer beside the field.
#pragma once

#include "bake/plan.h"
#include "visibility/visibility.h"

namespace lpvbake::bake {

/// Adds transfer and visibility of the surfaces near each cell, as the plan's settings want them,
/// to a volume that has its validity.
void add_local_transfer(const Scene& scene, const BakePlan& plan,
                        const visibility::Visibility& visibility, const scene::Frame& frame,
                        solver::Stages& stages, Volume& volume);
/// Adds metadata `local_transfer` ("cells" or "object"), `local_radius` (metres) and
/// `local_surfaces` (scene::surfaces_hash), where the plan wants them.
void describe_local_transfer(const Scene& scene, const BakePlan& plan, Volume& volume);

/// The box of an object (metres), wider by the radius and on to whole multiples of the cell: cells
/// of all objects lie on each other.
Bounds object_box(const Bounds& object, double radius, double cell);

} // namespace lpvbake::bake
