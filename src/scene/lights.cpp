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
        require(at_least_0(light.inner_cone) && light.inner_cone <= light.outer_cone,
                ".spot.innerConeAngle: must be at least 0 and at most outerConeAngle");
        require(light.outer_cone > 0.0, ".spot.outerConeAngle: must be above 0");
        require(light.outer_cone <= std::numbers::pi / 2 + 1e-6,
                ".spot.outerConeAngle: must be at most pi/2 radians");
    }
}

bool make_hard_edge(Light& light, double most) {
    const double past = light.inner_cone - light.outer_cone;
    if (light.type != LightType::spot || !(past >= 0.0 && past <= most))
        return false;
    light.inner_cone = light.outer_cone;
    return true;
}

std::string why_dark(const Scene& scene) {
    if (scene.rules.max_albedo == 0.0f)
        return "the volume holds no light: nothing reflects any with `max_albedo` 0";
    if (!has_reflectors(scene))
        return "the volume holds no light: all surfaces are black, and it holds what they reflect; "
               "give their materials a base colour";
    return "the volume holds no light: none reaches a surface that would reflect it into the grid; "
           "look at where the lights stand, their range and their direction";
}

void check_light_arrives(const std::string& place, const LightSources& sources) {
    if (sources.emitters || sources.sky || sources.statics)
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
