// The first reflection of punctual lights as real-time renderers of phones have it: from a few
// texels of reflective shadow maps a pixel (Dachsbacher and Stamminger 2005), and what may stand
// between judged by the picture's own depths.
#pragma once

#include "render/shade.h"
#include "scene/light_view.h"
#include "visibility/visibility.h"

#include <optional>
#include <vector>

namespace lpvbake::render {

struct RsmLightSettings {
    int texels = 64;                                        ///< that a point takes of each map
    int map_size = 256;                                     ///< texels along each side
    enum class Seen { none, ssdo, rays } seen = Seen::rays; ///< what decides whether one is seen
    /// Of ssdo (after Ritschel, Grosch and Seidel 2009): places on the way to a texel that are
    /// looked up among the depths, those at most so far from the point, and how thick what is seen
    /// is taken to be; metres.
    int samples = 8;
    double radius = 1, thickness = 0.1;
    bool compare = false; ///< counts where it is wrong, by rays
};

/// How far a picture's depths tell what rays do, over all pairs of a point and a texel that would
/// light it.
struct PairCount {
    uint64_t pairs = 0, falsely_lit = 0, falsely_dark = 0;
    uint64_t hidden = 0; ///< that rays find blocked

    void add(const PairCount& other) {
        pairs += other.pairs;
        falsely_lit += other.falsely_lit;
        falsely_dark += other.falsely_dark;
        hidden += other.hidden;
    }
};

/// The planes that a picture's pixels see, by which a place is before or behind what is seen.
class SeenPlanes {
public:
    struct Plane {
        glm::dvec3 point{0.0}, normal{0.0}; ///< normal 0: nothing
    };
    /// Row-major, of the view's picture.
    SeenPlanes(const scene::RsmView& view, glm::ivec2 size, std::vector<Plane> planes);
    /// Whether what is seen in the pixel of a place lies before it, less than `thickness` away
    /// along the view. Off the picture and behind the eye nothing does.
    bool blocks(glm::dvec3 place, double thickness) const;

private:
    scene::RsmView view_;
    glm::ivec2 size_;
    std::vector<Plane> planes_;
};

class RsmLight {
public:
    /// Looks from each light with a ray a texel. Refers to its arguments.
    RsmLight(const Scene& scene, const scene::Frame& frame,
             const visibility::Visibility& visibility, const RsmLightSettings& settings);

    const RsmLightSettings& settings() const { return settings_; }
    /// Illuminance (lux, RGB) on a point (frame units, off the surface) with unit normal n: a disc
    /// of texels around its own place in each map, denser in its middle, by their density. `key`
    /// turns them; the mean over keys is the sum over all texels. `planes`: of ssdo. Adds to
    /// `rays` and `count`.
    glm::dvec3 illuminance(glm::dvec3 point, glm::dvec3 n, uint32_t key, const SeenPlanes* planes,
                           uint64_t& rays, PairCount& count) const;
    /// The sum over all texels that rays reach.
    glm::dvec3 all_texels(glm::dvec3 point, glm::dvec3 n, uint64_t& rays) const;

private:
    struct Texel {
        glm::dvec3 point, normal; ///< a hair off the surface, on the lit side
        glm::dvec3 luminance;     ///< nits
        double area = 0;          ///< of surface, frame units squared; 0: nothing is lit
    };
    struct Map {
        scene::RsmView view;
        std::vector<Texel> texels;
    };
    glm::dvec2 place_in(const Map& map, glm::dvec3 point) const;
    /// Of so many times a texel, if it is seen; 0 where it is turned away.
    glm::dvec3 from_texel(const Texel& texel, glm::dvec3 point, glm::dvec3 n, double times) const;
    bool is_hidden(const Texel& texel, glm::dvec3 point, uint32_t key, const SeenPlanes* planes,
                   uint64_t& rays, PairCount& count) const;
    bool is_hidden_by_rays(const Texel& texel, glm::dvec3 point, uint64_t& rays) const;

    const visibility::Visibility& visibility_;
    RsmLightSettings settings_;
    double unit_;
    std::vector<Map> maps_;
};

} // namespace lpvbake::render
