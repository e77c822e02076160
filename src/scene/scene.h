// What is asked of a scene.
#pragma once

#include "lpvbake/scene.h"

#include <span>
#include <vector>

namespace lpvbake::scene {

/// Whether a name fits a pattern of the shell (fnmatch without flags).
bool fits_pattern(const std::string& name, const std::string& pattern);

/// Throws Error: argument where an index leads nowhere, sizes do not fit or a number is none;
/// invalid for a light (see check_light). What load_gltf gives holds.
void check_scene(const Scene& scene);

/// The box of the scene's (bounds_of) that is left when, along each axis, the share `share` of the
/// placed triangles that reach lowest and the share that reach highest are left out; on a raster of
/// 1/1024 of the bounds.
Bounds trimmed_bounds(const Scene& scene, double share);

/// The box around each instance; empty where it has no triangle.
std::vector<Bounds> instance_boxes(const Scene& scene);
/// The boxes of a part of them in one.
Bounds union_of(std::span<const Bounds> boxes);

/// The scene and all its light, turned by the rotation about a point.
Scene turned(const Scene& scene, const glm::dmat3& rotation, glm::dvec3 about);

/// Number of placed triangles (instances counted as often as they are placed).
uint64_t triangle_count(const Scene& scene);

/// Of each material, whether a placed surface has it and an emission above zero that lights others.
std::vector<bool> emissive_materials(const Scene& scene);

/// True if any placed surface has an emission above zero that lights others.
bool has_emitters(const Scene& scene);

/// True if any placed surface is not black to light that falls on it.
bool has_reflectors(const Scene& scene);

/// Names of the lights that are static.
std::vector<std::string> static_names(const Scene& scene);

/// True if the sky is not black.
bool has_sky(const Scene& scene);

} // namespace lpvbake::scene
