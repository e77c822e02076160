// The stages that all bakes begin with: rays into the scene, and its surfaces lit.
#pragma once

#include "bake/plan.h"
#include "surface/lit_surfaces.h"
#include "visibility/visibility.h"

#include <span>

namespace lpvbake::bake {

/// What layers have of the scene's light, as solvers take it.
std::vector<scene::LightLayer> layers_in(const BakePlan& plan);

/// How a bake of the plan lights surfaces.
surface::LightingSettings lighting_of(const BakePlan& plan);

/// What surfaces that the plan lights are of.
LitOrigin lit_origin(const BakePlan& plan, const visibility::Visibility& visibility);

/// What answers the plan's rays, on the device too where it says so.
visibility::Visibility open_visibility(const Scene& scene, const BakePlan& plan,
                                       const gpu::Device& device);
/// The same as a stage; warns of lights that meet backs.
visibility::Visibility open_scene(const Scene& scene, const BakePlan& plan,
                                  const gpu::Device& device, solver::Stages& stages);

/// The surfaces as the plan wants them lit, in layers too, or of BakeSettings::lit; empty where it
/// does not; warns of light
/// that is not told. Throws as surface::light_surfaces.
surface::LitSurfaces light_scene(const Scene& scene, const BakePlan& plan,
                                 const visibility::Visibility& visibility, solver::Stages& stages,
                                 std::span<const scene::LightLayer> layers = {});

/// A part of light_scene's work; all of them make it up (surface::join). Of a plan without layers
/// and maps.
surface::LitPart light_part(const Scene& scene, const BakePlan& plan,
                            const visibility::Visibility& visibility, volume::Shard shard,
                            solver::Stages& stages);

/// Adds to the metadata what light it is, and by what it was computed.
void describe_light(const Scene& scene, const BakePlan& plan, const gpu::Device& device,
                    const visibility::Visibility& visibility, Volume& volume);

/// Adds to that of a layer what is told of the volume of all light, and which of it the layer has.
void describe_layer(const BakePlan& plan, const Layer& layer, const Volume& whole, Volume& volume);

/// Warns where none of the volumes of a bake holds light, and says why.
void warn_of_dark(const Scene& scene, std::span<const Volume> volumes, solver::Stages& stages);

/// Warns of boxes in which no cell of the grids lies.
void warn_of_empty(std::span<const volume::Adjustment> boxes, std::span<const Grid> grids,
                   solver::Stages& stages);

} // namespace lpvbake::bake
