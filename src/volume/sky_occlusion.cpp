#include "volume/sky_occlusion.h"

#include "colour/colour.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <algorithm>
#include <cassert>
#include <numbers>

namespace lpvbake::volume {

void add_sky_occlusion(const Volume& white, Volume& volume) {
    assert(white.sh.size() >= 4 && white.grid.size() == volume.grid.size());
    const glm::vec3 luminance(colour::rec709_luminance);
    const auto share = float(sh_cosine_factor(1) / std::numbers::pi);
    set_grids(volume, sky_occlusion_kind(), 4);
    set_grids(volume, sky_direction_kind(), 1);
    const std::vector<GridView> numbers = grids_of(volume, sky_occlusion_kind());
    float* direction = grids_of(volume, sky_direction_kind())[0].data;
    for (std::size_t cell = 0; cell < white.grid.size(); ++cell) {
        for (std::size_t k = 0; k < 4; ++k)
            numbers[k].data[cell] =
                (k == 0 ? 1.0f : share) * glm::dot(luminance, white.sh[k][cell]);
        const glm::vec3 towards(numbers[3].data[cell], numbers[1].data[cell],
                                numbers[2].data[cell]);
        const float length = glm::length(towards);
        const glm::vec3 unit = length > 0.0f ? towards / length : glm::vec3(0.0f);
        std::copy_n(&unit.x, 3, direction + 3 * cell);
    }
}

} // namespace lpvbake::volume
