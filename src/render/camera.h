// Which camera a picture is seen by: one of the scene's, one's own, or one that the scene calls
// for.
#pragma once

#include "render/view.h"

#include <string>
#include <variant>

namespace lpvbake::render {

/// Across a room: see inside_camera.
struct Inside {};

struct CameraChoice {
    /// The name or the index of one of the scene's; else `own`, which is called so. Empty: the
    /// scene's first; if it has none, from inside of a room, and from outside of all else.
    std::string name;
    std::variant<std::monostate, Camera, Orbit, Inside> own;
};

/// `covered` is what of the scene matters, such as the box of a grid; what it has of the scene's
/// own box is looked at. `aspect` is width / height of the picture, for cameras around. Throws
/// Error (argument) with a name or an index that the scene does not have.
Camera choose_camera(const CameraChoice& choice, const Scene& scene, const Bounds& covered,
                     const visibility::Visibility& visibility, const scene::Frame& frame,
                     double aspect);

} // namespace lpvbake::render
