#include "visibility/walls.h"

#include <tbb/parallel_for.h>

namespace lpvbake::visibility {
namespace {

/// A surface counts beside an earlier plane if it comes this much nearer to the centre; so the next
/// triangle of a curved wall is none of its own.
constexpr float own_share = 0.75f;

} // namespace

size_t walls_around(const Visibility& visibility, glm::vec3 place, float reach,
                    std::span<glm::vec3> walls) {
    size_t found = 0;
    while (found < walls.size()) {
        const auto way = visibility.nearest_point(place, reach, walls.first(found), own_share);
        if (!way)
            break;
        walls[found++] = *way;
    }
    return found;
}

std::vector<std::vector<glm::vec3>> find_walls(const Visibility& visibility, glm::ivec3 dims,
                                               std::span<const float> validity, int count,
                                               float reach, int first_layer) {
    std::vector<std::vector<glm::vec3>> walls(
        static_cast<size_t>(count),
        std::vector<glm::vec3>(size_t(dims.x) * size_t(dims.y) * size_t(dims.z), glm::vec3(0.0f)));
    tbb::parallel_for(0, dims.z, [&](int z) {
        std::vector<glm::vec3> own(walls.size());
        size_t cell = size_t(z) * size_t(dims.y) * size_t(dims.x);
        for (int y = 0; y < dims.y; ++y)
            for (int x = 0; x < dims.x; ++x, ++cell) {
                if (!validity.empty() && validity[cell] == 0.0f)
                    continue;
                const auto [from, open] = visibility.capture({x, y, first_layer + z});
                if (!open)
                    continue;
                const size_t found = walls_around(visibility, from, reach, own);
                for (size_t i = 0; i < found; ++i)
                    walls[i][cell] = own[i];
            }
    });
    return walls;
}

} // namespace lpvbake::visibility
