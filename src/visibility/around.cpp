#include "visibility/around.h"

#include <array>
#include <cmath>

#include <glm/gtc/constants.hpp>

namespace lpvbake::visibility {
namespace {

std::array<glm::vec3, looks> make_directions() {
    std::array<glm::vec3, looks> directions;
    constexpr double golden_angle = 2.39996322972865332; // pi (3 - sqrt 5)
    for (int i = 0; i < looks / 2; ++i) {
        const double y = (i + 0.5) / (looks / 2), radius = std::sqrt(1.0 - y * y);
        const glm::vec3 up(radius * std::cos(golden_angle * i), y,
                           radius * std::sin(golden_angle * i));
        directions[size_t(i)] = up;
        directions[size_t(i) + looks / 2] = -up;
    }
    return directions;
}

} // namespace

Around look_around(const Visibility& visibility, glm::vec3 place) {
    static const std::array<glm::vec3, looks> directions = make_directions();
    std::array<Ray, looks> rays;
    for (size_t i = 0; i < looks; ++i)
        rays[i] = {place, directions[i], 0.0f, HUGE_VALF};
    std::array<Hit, looks> hits;
    visibility.closest_of_eights(rays, Bundle::loose, hits);
    int backs = 0;
    glm::dvec4 sky(0.0);
    for (size_t i = 0; i < looks; ++i) {
        const Hit& hit = hits[i];
        const glm::dvec3 w(directions[i]);
        if (hit.instance == no_hit)
            sky += double(hit.tint.r + hit.tint.g + hit.tint.b) / 3.0
                   * glm::dvec4(1.0, std::sqrt(3.0) * glm::dvec3(w.y, w.z, w.x));
        else if (hit.facing == Facing::back)
            ++backs;
    }
    // Each ray stands for 4 pi / looks, and Y_0 is 1 / sqrt(4 pi).
    return {float(backs) / looks, glm::vec4(std::sqrt(4.0 * glm::pi<double>()) / looks * sky)};
}

} // namespace lpvbake::visibility
