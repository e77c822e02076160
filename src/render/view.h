// Where a picture is seen from.
#pragma once

#include "scene/light_view.h"
#include "visibility/visibility.h"

#include <optional>

namespace lpvbake::render {

/// What an eye sees (scene::is_asked), in the frame, where that is not what light meets; else none.
std::optional<visibility::Visibility> eye_of(const Scene& scene, const scene::Frame& frame);

/// A camera at `eye` that looks at `target` (world, metres), +Y up in the picture; +Z where it
/// looks along Y. yfov in radians.
Camera look_at(glm::dvec3 eye, glm::dvec3 target, double yfov);

/// Towards the middle of a box: `azimuth` from +Z towards +X and `elevation` above the horizon say
/// where the eye stands (radians); `distance` from the middle in metres, 0: the nearest from which
/// all of the box is in the picture, with a margin.
struct Orbit {
    double azimuth = 0.5;
    double elevation = 0.35;
    double distance = 0.0;
};

/// `aspect`: width / height of the picture.
Camera orbit_camera(const Bounds& box, const Orbit& orbit, double yfov, double aspect);

/// True if the middle of the box is shut in by surfaces of which its side can be seen: a room.
bool is_room(const Bounds& box, const visibility::Visibility& visibility,
             const scene::Frame& frame);

/// Looks across the middle of a room from before the wall that is farthest from it, a little from
/// above.
Camera inside_camera(const Bounds& box, const visibility::Visibility& visibility,
                     const scene::Frame& frame, double yfov);

/// The rays of a picture of `size` pixels, row 0 at its top.
scene::RsmView view_of(const Camera& camera, const scene::Frame& frame, glm::ivec2 size);

} // namespace lpvbake::render
