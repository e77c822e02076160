#include "render/view.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <cmath>

namespace lpvbake::render {
namespace {

glm::dvec3 towards(double azimuth, double elevation) {
    return {std::cos(elevation) * std::sin(azimuth), std::sin(elevation),
            std::cos(elevation) * std::cos(azimuth)};
}

glm::dvec3 middle_of(const Bounds& box) {
    return 0.5 * (box.lo + box.hi);
}

visibility::Ray ray_from(const scene::Frame& frame, glm::dvec3 point, glm::dvec3 direction) {
    return {glm::vec3(frame.from_world(point)), glm::vec3(direction), 0.0f, HUGE_VALF};
}

} // namespace

std::optional<visibility::Visibility> eye_of(const Scene& scene, const scene::Frame& frame) {
    const auto differs = [](Role role) { return scene::blocks(role) != scene::is_asked(role); };
    if (!scene::any_of_role(scene, differs))
        return std::nullopt;
    return std::optional<visibility::Visibility>(std::in_place, scene, frame,
                                                 visibility::Isa::automatic, scene::is_asked);
}

Camera look_at(glm::dvec3 eye, glm::dvec3 target, double yfov) {
    const glm::dvec3 back = glm::normalize(eye - target);
    glm::dvec3 right = glm::cross(glm::dvec3(0, 1, 0), back);
    if (glm::length(right) < 1e-9)
        right = glm::dvec3(1, 0, 0);
    right = glm::normalize(right);
    Camera camera;
    camera.to_world = glm::dmat4(glm::dvec4(right, 0), glm::dvec4(glm::cross(back, right), 0),
                                 glm::dvec4(back, 0), glm::dvec4(eye, 1));
    camera.yfov = yfov;
    return camera;
}

Camera orbit_camera(const Bounds& box, const Orbit& orbit, double yfov, double aspect) {
    const glm::dvec3 middle = middle_of(box), way = towards(orbit.azimuth, orbit.elevation);
    Camera camera = look_at(middle + way, middle, yfov);
    double distance = orbit.distance;
    if (!(distance > 0)) {
        const double up = std::tan(0.5 * yfov), right = aspect * up;
        for (int i = 0; i < 8; ++i) {
            const glm::dvec3 corner =
                glm::dvec3(i & 1 ? box.hi.x : box.lo.x, i & 2 ? box.hi.y : box.lo.y,
                           i & 4 ? box.hi.z : box.lo.z)
                - middle;
            const double x = std::abs(glm::dot(corner, glm::dvec3(camera.to_world[0])));
            const double y = std::abs(glm::dot(corner, glm::dvec3(camera.to_world[1])));
            distance = std::max(distance, glm::dot(corner, way) + std::max(x / right, y / up));
        }
        distance = 1.05 * std::max(distance, 1e-6);
    }
    camera.to_world[3] = glm::dvec4(middle + distance * way, 1);
    return camera;
}

bool is_room(const Bounds& box, const visibility::Visibility& visibility,
             const scene::Frame& frame) {
    constexpr int count = 256;
    int shut_in = 0;
    for (int i = 0; i < count; ++i) { // a spiral around the sphere
        const double y = 1 - (2 * i + 1.0) / count;
        const glm::dvec3 way = towards(i * glm::pi<double>() * (3 - std::sqrt(5.0)), std::asin(y));
        const visibility::Hit hit = visibility.closest(ray_from(frame, middle_of(box), way));
        shut_in += hit.instance != visibility::no_hit && hit.facing != visibility::Facing::back;
    }
    return shut_in > count * 9 / 10;
}

Camera inside_camera(const Bounds& box, const visibility::Visibility& visibility,
                     const scene::Frame& frame, double yfov) {
    constexpr int count = 32;
    const glm::dvec3 middle = middle_of(box);
    glm::dvec3 eye = middle;
    double farthest = 0;
    for (int i = 0; i < count; ++i) {
        const glm::dvec3 way = towards(glm::two_pi<double>() * i / count, 0.15);
        const visibility::Hit hit = visibility.closest(ray_from(frame, middle, way));
        if (hit.instance != visibility::no_hit && hit.t > farthest) {
            farthest = hit.t;
            eye = middle + 0.93 * farthest * frame.unit * way;
        }
    }
    return look_at(farthest > 0 ? eye : middle + glm::dvec3(0, 0, frame.unit), middle, yfov);
}

scene::RsmView view_of(const Camera& camera, const scene::Frame& frame, glm::ivec2 size) {
    scene::RsmView view;
    view.perspective = true;
    view.origin = frame.from_world(glm::dvec3(camera.to_world[3]));
    view.axis = -glm::normalize(glm::dvec3(camera.to_world[2]));
    const double up = std::tan(0.5 * camera.yfov);
    view.u = up * size.x / size.y * glm::normalize(glm::dvec3(camera.to_world[0]));
    view.v = -up * glm::normalize(glm::dvec3(camera.to_world[1]));
    view.nearest = 1e-3;
    return view;
}

} // namespace lpvbake::render
