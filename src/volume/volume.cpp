#include "volume/volume.h"

#include "colour/colour.h"

#include <cmath>
#include <numbers>

namespace lpvbake::volume {

double total_energy(const Volume& volume) {
    if (volume.sh.empty())
        return 0;
    double sum = 0;
    for (size_t cell = 0; cell < volume.sh[0].size(); ++cell)
        if (volume.validity.empty() || volume.validity[cell] > 0)
            sum += glm::dot(glm::dvec3(volume.sh[0][cell]), colour::rec709_luminance);
    return std::sqrt(4 * std::numbers::pi) * sum;
}

} // namespace lpvbake::volume
