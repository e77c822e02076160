// What a punctual light sees, as power: its maps (scene/light_view.h) as quadtrees of texels, a ray
// each, as fine as patches and as the edges of what is seen ask for.
#pragma once

#include "scene/light_view.h"
#include "surface/lit_surfaces.h"

#include <memory>
#include <span>
#include <vector>

namespace lpvbake::surface {

/// What a light gives one side. All power is that of a light of colour 1, lumen.
struct SideFlux {
    uint32_t side = 0;      ///< 2 * patch + side
    bool edged = false;     ///< some of them lie where the light sees something end
    double flux = 0;        ///< of which what it passed may have coloured some
    glm::dvec3 tinted{0.0}; ///< what that left of it, a channel
    double squares = 0;     ///< sum of the squares of the texels' flux
    double peak = 0; ///< sum of those squares over the texels' areas on the surface, frame units
    /// Sums of flux times what hits weigh the second and third corner of their triangles by, and
    /// times the squares of these and their product.
    glm::dvec2 weights{0.0};
    glm::dvec3 squared_weights{0.0};
};

/// Where the power of a light goes, before what it passes colours it.
struct LightPower {
    double sent = 0; ///< all that leaves through its maps: the sum of the others
    double landed = 0;
    double missed = 0; ///< meets nothing, or nothing within the light's range
    double black = 0;  ///< meets the backs of single-sided surfaces
    double lost = 0;   ///< meets a side that no patch shows
};

struct LightMap {
    /// A part of the maps that one thread draws: a square of one of them.
    struct Tile {
        size_t map = 0;
        uint32_t x = 0, y = 0;
        int level = 0;
        LightPower power;
        uint64_t rays = 0;
        size_t met = 0; ///< how many of `met` are its own
    };
    std::vector<SideFlux> sides; ///< each once, in the order of `met`
    LightPower power;
    LightPower beside; ///< what of it no tile holds
    uint64_t rays = 0;
    std::vector<Tile> tiles;
    std::vector<uint32_t> met; ///< sides that tiles give light to, tile by tile; some twice
};

/// Draws the maps of one light after the other.
class LightMapper {
public:
    /// All outlive this. `lights` are those that are going to be drawn: the more, the coarser a map
    /// begins.
    LightMapper(const Scene& scene, const LitSurfaces& lit, const scene::Frame& frame,
                std::span<const Light> lights);
    ~LightMapper();

    /// The same bits for any number of threads. `key`: another one gives other rays. Patches may
    /// have been added since the map before.
    LightMap draw(const Light& light, uint32_t key);
    /// What draw() gives now, where `before` is what it gave before the `cut` patches were cut.
    /// Draws those tiles anew that gave them light, and those that share a side with one.
    LightMap draw_again(const Light& light, uint32_t key, const LightMap& before,
                        std::span<const uint32_t> cut);

    /// The longest edge that patches have around a point, about: they grow outside the grid.
    float patch_edge(glm::vec3 point) const;
    /// The side `seen` that a hit lies on (LitSurfaces::side), or where none shows it, one beside
    /// it on the same surface; no_side: there is none.
    uint32_t side_shown(uint32_t seen, const visibility::Hit& hit, glm::vec3 direction) const;
    /// Corners of the triangle that was hit, frame units.
    glm::dmat3 triangle(const visibility::Hit& hit) const;
    bool blended(const visibility::Hit& hit) const { return blended_[hit.instance] != 0; }
    /// Texels along the scene's side, where a map begins.
    int base() const { return base_; }
    /// Some surfaces are partly transparent.
    bool veiled() const { return veiled_; }

    const LitSurfaces& lit;
    const scene::Frame& frame;

private:
    const Scene& scene_;
    int base_ = 0;
    std::vector<uint8_t> blended_; ///< an instance
    bool veiled_ = false;
    std::vector<uint32_t> place_; ///< a side: where it stands in LightMap::sides
    struct Workers;
    std::unique_ptr<Workers> workers_;
};

} // namespace lpvbake::surface
