// Emissive triangles as targets of rays.
#pragma once

#include "reference/halves.h"
#include "scene/emission.h"
#include "visibility/visibility.h"

#include <optional>
#include <vector>

namespace lpvbake::reference {

/// Chooses points on all emissive surfaces with a density that follows the emitted luminance.
/// Triangles whose textures light a part of them are halved until their pieces glow evenly.
class Emitters {
public:
    Emitters(const Scene& scene, const scene::Frame& frame);
    bool empty() const { return pieces_.empty(); }

    /// A place on an emissive triangle.
    struct Target {
        uint32_t instance = 0;
        uint32_t triangle = 0; ///< of the instance's mesh
        glm::dvec3 point{0.0}; ///< frame units
        /// Where no ray meets it: how one would, but for Hit::t and tint; of the front, or both.
        std::optional<visibility::Hit> unmet = {};
        bool is_met(const visibility::Hit& hit) const {
            return hit.instance == instance && hit.triangle == triangle;
        }
    };
    /// A piece of a triangle with probability proportional to its area times luminance, and a point
    /// uniform over it.
    Target target(glm::dvec2 sample) const;

    /// How likely, per steradian, `target` chooses the direction in which `hit` was met, and the
    /// triangle that was hit; `towards` is the ray's unit direction, so that Hit::t is the
    /// distance. 0 for what does not glow.
    double density(const visibility::Hit& hit, glm::dvec3 towards) const;

private:
    /// A triangle as it is placed.
    struct Triangle {
        glm::vec3 a, ab, ac;
        uint32_t instance, triangle;
        uint32_t root = 0; ///< in nodes_
        float turn = 1.0f; ///< of the corners' winding: -1 where the instance mirrors
        bool two_fronts = false;
        bool met = true; ///< by rays
    };
    struct Node : Halved {
        double density = 0.0; ///< per unit of area, of a piece that is not halved
    };
    /// A piece that glows.
    struct Piece {
        uint32_t triangle; ///< in triangles_
        Corners corners;
    };

    void halve(const scene::EmissionMaps& maps, const Mesh& mesh, uint32_t triangle, size_t most);

    std::vector<Triangle> triangles_;
    std::vector<Node> nodes_;
    std::vector<Piece> pieces_;
    std::vector<double> cumulative_; ///< power up to and with each piece, over the total
    std::vector<uint32_t> first_;    ///< an instance: its first in triangles_; ~0u: none
};

} // namespace lpvbake::reference
