// Small scenes built in code, for tests of every stage.
#pragma once

#include "scene/scene.h"

#include <random>

namespace lpvbake::scenes {

/// Which side of a box's walls is the front: out (an object) or in (a room).
enum class Facing { outward, inward };

/// Appends an opaque material; returns its index. Albedo is linear, emission in nits.
int add_material(Scene& scene, glm::vec3 albedo, glm::vec3 emission = glm::vec3(0.0f),
                 bool double_sided = false);

/// Appends a parallelogram of two triangles with corners `corner`, + u, + u + v, + v (mesh space,
/// metres), its normals (u x v) and UVs from (0, 0) to (1, 1); places it; returns the mesh's index.
int add_quad(Scene& scene, int material, glm::vec3 corner, glm::vec3 u, glm::vec3 v,
             const glm::dmat4& to_world = glm::dmat4(1.0));

/// Appends a box of 12 triangles, as one mesh with one normal a wall; places it; returns the mesh's
/// index. Walls come in the order -x, +x, -y, +y, -z, +z, two triangles each.
int add_box(Scene& scene, int material, glm::vec3 lo, glm::vec3 hi, scenes::Facing facing,
            const glm::dmat4& to_world = glm::dmat4(1.0));

/// A turn around any axis by any angle.
glm::dmat4 random_turn(std::mt19937& random);

/// A directional light; `travel` is the direction in which it travels, of any length.
Light sun(glm::dvec3 travel, double lux, glm::vec3 color = glm::vec3(1.0f));

/// A point light of unlimited range.
Light point_light(glm::dvec3 position, double candela, glm::vec3 color = glm::vec3(1.0f));

/// A spot light of unlimited range; cone angles in radians from the axis.
Light spot_light(glm::dvec3 position, glm::dvec3 travel, double candela, double inner,
                 double outer);

/// A square floor in the plane y = 0 that faces up, centred on the origin.
Scene floor_quad(float edge, glm::vec3 albedo);

/// A closed room [0, edge]^3 whose walls all reflect `albedo` and emit `emission` nits inwards.
/// Inside it the luminance is emission / (1 - albedo) everywhere and in all directions.
Scene furnace(float edge, float albedo, float emission);

/// A room of amber glass, [1, 3]^3, in light of luminance 1 from a black room around it or from the
/// sky; its walls are fronts inside. Light passes t = 3/4 by the glass's colour c and the rest is
/// reflected, so that the luminance in it is t c / (1 - (1 - t) c).
Scene glass_room(bool sky);
glm::dvec3 luminance_in_glass_room();

/// A pane of amber glass in the plane x = 2.1 that reflects nothing, before a sky of luminance 1:
/// on either side the mean luminance is (1 + c) / 2.
Scene clear_pane();
glm::dvec3 luminance_beside_clear_pane();

/// A Cornell box [-1, 1] x [0, 2] x [-1, 1], open towards +Z, with a red (-X) and a green (+X) wall
/// and two boxes, of which one is turned; no light.
Scene cornell_box();

/// The same with a point light of `candela` below the middle of the ceiling.
Scene cornell_box_with_point(double candela = 100.0);

/// The same with a sun that shines in through the open side, from above on the left.
Scene cornell_box_with_sun(double lux = 10000.0);

} // namespace lpvbake::scenes
