#include "volume/dilate.h"

#include <cmath>

namespace lpvbake::volume {

std::size_t dilate(Volume& volume, int rings) {
    const Grid& grid = volume.grid;
    if (volume.validity.empty())
        return 0;
    std::vector<char> known(grid.size());
    for (std::size_t i = 0; i < known.size(); ++i)
        known[i] = volume.validity[i] > 0.0f;

    std::size_t filled = 0;
    std::vector<std::size_t> ring;
    for (int number = 0; number < rings; ++number) {
        ring.clear();
        for (int z = 0; z < grid.dims.z; ++z)
            for (int y = 0; y < grid.dims.y; ++y)
                for (int x = 0; x < grid.dims.x; ++x) {
                    const std::size_t cell = grid.index({x, y, z});
                    if (known[cell])
                        continue;
                    double weights = 0.0;
                    std::vector<glm::dvec3> sums(volume.sh.size(), glm::dvec3(0.0));
                    for (int n = 0; n < 27; ++n) {
                        const glm::ivec3 step = glm::ivec3(n % 3, n / 3 % 3, n / 9) - 1;
                        const glm::ivec3 beside = glm::ivec3(x, y, z) + step;
                        if (!grid.contains(beside) || !known[grid.index(beside)])
                            continue;
                        const double weight = 1.0 / glm::length(glm::dvec3(step));
                        weights += weight;
                        for (std::size_t k = 0; k < sums.size(); ++k)
                            sums[k] += weight * glm::dvec3(volume.sh[k][grid.index(beside)]);
                    }
                    if (weights == 0.0)
                        continue;
                    // What is known stays as it is until the ring is complete, so that no cell
                    // sees another of its own ring.
                    for (std::size_t k = 0; k < sums.size(); ++k)
                        volume.sh[k][cell] = glm::vec3(sums[k] / weights);
                    ring.push_back(cell);
                }
        for (const std::size_t cell : ring)
            known[cell] = true;
        filled += ring.size();
        if (ring.empty())
            break;
    }
    return filled;
}

} // namespace lpvbake::volume
