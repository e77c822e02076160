#include "scene/lights.h"

#include "lpvbake/error.h"

#include <cmath>
#include <numbers>

namespace lpvbake::scene {

void check_light(const Light& light, const std::string& place) {
    const auto require = [&](bool ok, const char* what) {
        if (!ok)
            throw Error(ErrorKind::invalid, place + what);
    };
    const auto at_least_0 = [](double value) { return std::isfinite(value) && value >= 0.0; };
    for (int channel = 0; channel < 3; ++channel)
        require(at_least_0(light.color[channel]), ".color: must be finite and not negative");
    require(at_least_0(light.intensity), ".intensity: must be finite and not negative");
    require(at_least_0(light.range), ".range: must be finite and not negative");
    require(std::isfinite(light.position.x + light.position.y + light.position.z),
            ".position: must be finite");
    require(std::abs(glm::length(light.direction) - 1.0) < 1e-6, ".direction: must not be zero");
    if (light.type == LightType::spot) {
        require(at_least_0(light.inner_cone) && light.inner_cone < light.outer_cone,
                ".spot.innerConeAngle: must be at least 0 and below outerConeAngle");
        require(light.outer_cone <= std::numbers::pi / 2 + 1e-6,
                ".spot.outerConeAngle: must be at most pi/2 radians");
    }
}

void check_light_arrives(const std::string& place, const LightSources& sources) {
    if (sources.emitters || sources.sky)
        return;
    if (!sources.punctual)
        throw Error(ErrorKind::invalid,
                    place + ": no light and no emissive surface; add `lights` or a `sky`");
    if (sources.bounces == 0)
        throw Error(ErrorKind::invalid,
                    place
                        + ": without reflections no light of its lights is in the field; set "
                          "`bounces` 1 or more");
}

} // namespace lpvbake::scene
