#include "render/camera.h"

#include "lpvbake/error.h"
#include "text.h"

namespace lpvbake::render {
namespace {

/// A camera of the scene by name or index; null where there is none.
const Camera* camera_of(const Scene& scene, const std::string& name) {
    for (const Camera& camera : scene.cameras)
        if (!name.empty() && camera.name == name)
            return &camera;
    const bool index = !name.empty() && name.size() < 7
                       && name.find_first_not_of("0123456789") == std::string::npos;
    const std::size_t i = index ? std::stoul(name) : 0;
    if ((index || name.empty()) && i < scene.cameras.size())
        return &scene.cameras[i];
    if (index)
        throw Error(ErrorKind::argument, "`camera` " + name + ": the file has "
                                             + counted(scene.cameras.size(), "camera")
                                             + ", counted from 0");
    return nullptr;
}

/// What of the scene is covered; all of it where that is nothing.
Bounds seen_box(const Scene& scene, const Bounds& covered) {
    const Bounds all = bounds_of(scene);
    const Bounds box{glm::max(all.lo, covered.lo), glm::min(all.hi, covered.hi)};
    return glm::any(glm::greaterThan(box.lo, box.hi)) ? all : box;
}

} // namespace

Camera choose_camera(const CameraChoice& choice, const Scene& scene, const Bounds& covered,
                     const visibility::Visibility& visibility, const scene::Frame& frame,
                     double aspect) {
    if (const Camera* of_scene = camera_of(scene, choice.name)) {
        Camera camera = *of_scene;
        if (camera.name.empty())
            camera.name = std::to_string(of_scene - scene.cameras.data());
        return camera;
    }
    const Bounds box = seen_box(scene, covered);
    CameraChoice made = choice;
    if (choice.name.empty()) {
        const bool room = is_room(box, visibility, frame);
        made.name = room ? "inside" : "orbit";
        made.own = Orbit();
        if (room)
            made.own = Inside();
    }
    Camera camera;
    if (const auto* eye = std::get_if<Camera>(&made.own)) {
        camera = *eye;
    } else if (const auto* orbit = std::get_if<Orbit>(&made.own)) {
        camera = orbit_camera(box, *orbit, glm::radians(45.0), aspect);
    } else if (std::holds_alternative<Inside>(made.own)) {
        camera = inside_camera(box, visibility, frame, glm::radians(60.0));
    } else {
        std::string names;
        for (const Camera& each : scene.cameras)
            names += (names.empty() ? " (it has " : ", ") + each.name;
        throw Error(ErrorKind::argument, "`camera` '" + choice.name + "' is no camera of the file"
                                             + names + (names.empty() ? "" : ")")
                                             + "; without `camera` one is found");
    }
    camera.name = made.name;
    return camera;
}

} // namespace lpvbake::render
