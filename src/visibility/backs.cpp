#include "visibility/backs.h"

#include "visibility/tangents.h"

#include <glm/gtc/constants.hpp>

namespace lpvbake::visibility {
namespace {

constexpr int ray_count = 1024;

} // namespace

double share_of_backs(const Visibility& visibility, const Light& light, const scene::Frame& frame) {
    const glm::dvec3 lo{visibility.lo()}, hi{visibility.hi()};
    const double across = glm::length(hi - lo) + glm::length(frame.extent);
    const auto [u, v] = tangents_of(light.direction);
    const double golden = glm::pi<double>() * (3.0 - std::sqrt(5.0));
    int hits = 0, backs = 0;
    for (int i = 0; i < ray_count; ++i) {
        const double turn = golden * i;
        const double share = (i + 0.5) / ray_count;
        glm::dvec3 origin = frame.from_world(light.position);
        glm::dvec3 direction = light.direction;
        if (light.type == LightType::directional) {
            const double radius = 0.5 * glm::length(frame.extent) * std::sqrt(share);
            const glm::dvec3 through =
                0.5 * frame.extent + radius * std::cos(turn) * u + radius * std::sin(turn) * v;
            origin = through - across * direction;
            direction *= 2.0;
        } else {
            // Equal solid angles over the cone, the whole sphere for a point light.
            const double edge = light.type == LightType::spot ? std::cos(light.outer_cone) : -1.0;
            const double z = 1.0 - share * (1.0 - edge);
            const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
            direction = r * std::cos(turn) * u + r * std::sin(turn) * v + z * light.direction;
        }
        const Hit hit =
            visibility.closest({glm::vec3(origin), glm::vec3(direction), 0.0f, float(across)});
        hits += hit.instance != no_hit;
        backs += hit.instance != no_hit && hit.facing == Facing::back;
    }
    return hits ? double(backs) / hits : 0.0;
}

} // namespace lpvbake::visibility
