#include "medium/lamp_radius.h"

#include "scene/scene.h"

namespace lpvbake::medium {

double radius_of(const Light& light, std::span<const LampRadius> radii) {
    double metres = 0;
    if (light.type != LightType::directional)
        for (const LampRadius& radius : radii)
            if (scene::fits_pattern(light.name, radius.names))
                metres = radius.metres;
    return metres;
}

} // namespace lpvbake::medium
