// Which triangles may lie on another one's back.
#pragma once

#include <embree3/rtcore.h>
#include <glm/glm.hpp>

#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace lpvbake::visibility {

/// Of each triangle those that may lie on it and show a front where it shows its back. They are
/// found when a triangle is first asked for, and kept: most have none, so that a ray that ends on a
/// back need not look around. May be asked by any number of threads.
class Opposites {
public:
    /// A triangle, and its box.
    struct Other {
        uint32_t primitive;
        glm::vec3 lo, hi;
    };
    struct Answer {
        bool known;                    ///< else the tree has to be asked
        std::span<const Other> others; ///< by rising primitive
    };

    /// Of the triangles of a tree, whose arrays outlive this. `near` (of their units) is how far
    /// apart two places may lie that count as one. `has_two_fronts` says so of a triangle.
    Opposites(RTCScene bvh, const glm::vec3* positions, std::span<const glm::uvec3> triangles,
              float near, std::function<bool(uint32_t)> has_two_fronts);
    ~Opposites();
    Opposites(const Opposites&) = delete;
    Opposites& operator=(const Opposites&) = delete;

    /// Those at a place on a triangle, and maybe some more. Not known where the place does not lie
    /// on the triangle's box, or where too many are near.
    Answer at(uint32_t primitive, glm::vec3 place) const;

private:
    struct Near {
        bool too_many = false;
        std::vector<Other> others;
    };
    struct Box {
        glm::vec3 lo, hi;
    };
    Box box_of(uint32_t primitive) const;
    glm::dvec3 normal_of(uint32_t primitive) const;
    const Near* find(uint32_t primitive) const;

    RTCScene bvh_;
    const glm::vec3* positions_;
    std::span<const glm::uvec3> triangles_;
    float near_;
    std::function<bool(uint32_t)> has_two_fronts_;
    Near none_, unknown_;
    mutable std::vector<std::atomic<const Near*>> of_; ///< a triangle; null: not asked for yet
    mutable std::atomic<int64_t> visits_left_;         ///< of triangles, while these are found
};

} // namespace lpvbake::visibility
