#include "surface/emitters.h"

#include <glm/gtc/constants.hpp>

namespace lpvbake {

void emit_vpls(const std::vector<Patch>& patches, double unit, std::vector<Vpl>& vpls) {
    for (const Patch& patch : patches) {
        if (patch.emission == glm::vec3(0.0f))
            continue;
        const double area = double(patch.area) * unit * unit;
        const glm::vec3 power{glm::pi<double>() * area * glm::dvec3(patch.emission)};
        vpls.push_back({patch.position, patch.normal, power});
        if (patch.double_sided)
            vpls.push_back({patch.position, -patch.normal, power});
    }
}

} // namespace lpvbake
