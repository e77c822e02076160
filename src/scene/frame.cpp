#include "scene/frame.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace lpvbake::scene {

std::vector<glm::vec3> positions_in_frame(const Scene& scene, const Instance& instance,
                                          const Frame& frame) {
    const std::vector<glm::vec3>& positions = scene.meshes[instance.mesh].positions;
    const glm::dmat3 linear = glm::dmat3(instance.to_world) / frame.unit;
    const glm::dvec3 offset = frame.from_world(glm::dvec3(instance.to_world[3]));
    std::vector<glm::vec3> result(positions.size());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, positions.size(), 16384),
                      [&](const tbb::blocked_range<size_t>& range) {
                          for (size_t i = range.begin(); i < range.end(); ++i)
                              result[i] = linear * glm::dvec3(positions[i]) + offset;
                      });
    return result;
}

bool is_mirrored(const Instance& instance) {
    return glm::determinant(glm::dmat3(instance.to_world)) < 0.0;
}

} // namespace lpvbake::scene
