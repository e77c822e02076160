// What may answer many rays at once in Embree's place.
#pragma once

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lpvbake::visibility {

struct Ray;

/// A triangle as rays meet it, in the frame that the structure was built in.
struct CastTriangle {
    glm::uvec3 corners;
    bool partly_clear; ///< some rays that meet it pass, or a part of the light
    bool culled;       ///< rays along (b - a) x (c - a) pass it
};

/// All placed triangles.
struct CastSurfaces {
    std::span<const glm::vec3> positions;
    std::vector<CastTriangle> triangles;
};

/// Answers rays by itself, each as Embree would but for rounding, whatever others are asked for
/// with it; where it does not know enough of a surface on the way it says that it is unsure, and
/// Embree is asked. May be asked by any number of threads.
class Caster {
public:
    static constexpr uint32_t none = ~0u, unsure = none - 1;
    struct Met {
        float t;
        uint32_t triangle;     ///< of CastSurfaces, or one of those
        glm::vec2 barycentric; ///< weights of its second and third vertex
    };

    virtual ~Caster() = default;
    /// The nearest that each ray meets.
    virtual void nearest(std::span<const Ray> rays, std::span<Met> met) const = 0;
    /// Forms rays itself, and says what is on them: a program of solver/gather's, look.rgen, which
    /// runs once for each answer.
    virtual void look(std::span<const std::byte> given, std::span<uint32_t> answers) const = 0;
    /// How it is told of in metadata.
    virtual std::string name() const = 0;
    /// Rays that it takes at a time; in their place as many bytes may be given to look().
    virtual size_t batch() const = 0;
};

} // namespace lpvbake::visibility
