#include "scene/sky.h"

namespace lpvbake {

glm::vec3 sky_luminance(const Sky& sky, glm::vec3) {
    return sky.luminance;
}

} // namespace lpvbake
