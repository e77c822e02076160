// Shafts of light as VolumeLight makes them (NVIDIA's sample of that name, white paper
// WP-03017-001, 2008): by a map of distances from the light, its tiles, and a march at a quarter of
// the resolution whose traces are blurred. Unlike there light is in nits, of a medium's own
// coefficients, and attenuated. To compare `exact` with.
#pragma once

#include "medium/light_depths.h"
#include "medium/medium_in_frame.h"

#include <cstdint>
#include <vector>

namespace lpvbake::medium {

template <class T>
struct Texture {
    glm::ivec2 size{0};
    std::vector<T> texels; ///< row-major

    explicit Texture(glm::ivec2 of_size = glm::ivec2(0), T value = T(0))
        : size(of_size),
          texels(std::size_t(of_size.x) * std::size_t(of_size.y), value) {}
    T& operator[](glm::ivec2 at) {
        return texels[std::size_t(at.y) * std::size_t(size.x) + std::size_t(at.x)];
    }
    const T& operator[](glm::ivec2 at) const {
        return texels[std::size_t(at.y) * std::size_t(size.x) + std::size_t(at.x)];
    }
    /// The nearest that there is.
    const T& clamped(glm::ivec2 at) const {
        return (*this)[glm::clamp(at, glm::ivec2(0), size - 1)];
    }
    /// Between the middles of four, which lie at halves.
    T between(glm::dvec2 at) const {
        const glm::dvec2 corner = glm::floor(at - 0.5), part = at - 0.5 - corner;
        const glm::ivec2 i(corner);
        const auto row = [&](int y) {
            return clamped({i.x, y}) * (1 - part.x) + clamped({i.x + 1, y}) * part.x;
        };
        return T(row(i.y) * (1 - part.y) + row(i.y + 1) * part.y);
    }
};

// ---------------------------------------------------------------- passes, in their order

inline constexpr int tile_edge = 16; ///< texels of the map, a power of two
inline constexpr int coarseness = 4; ///< pixels of the picture along a texel of the march

/// The least and the largest distance of each tile: x and y.
Texture<glm::vec2> tiles_of(const Texture<float>& distances);

/// The least distance of tiles, holes of up to six tiles in it closed: three times the least of 3 x
/// 3, then five times the largest, so that what is no hole recedes by two tiles.
Texture<float> with_filled_holes(const Texture<glm::vec2>& tiles);

/// Sobel's operator of 5 x 5 on every second pixel around each coarse texel: along the edge, as
/// long as the share of its distance by which that changes, at most 1.
Texture<glm::dvec2> edges_of(const Texture<float>& picture_distances);

/// The mean of 15 places along each edge; where there is none, the same.
Texture<glm::dvec3> blurred_along(const Texture<glm::dvec2>& edges,
                                  const Texture<glm::dvec3>& light);

/// The mean of 9 x 9 texels.
Texture<glm::dvec3> blurred(const Texture<glm::dvec3>& light);

// ---------------------------------------------------------------- all of them

struct VolumeLightSettings {
    int map_size = 1024; ///< texels along the map's side, a power of two from tile_edge
    /// How much more light counts behind holes that are filled; there 40. No physics.
    double boost = 0;
    bool long_steps = true; ///< over a tile's width where that is all lit or all dark
};

struct StepCount {
    uint64_t all = 0, coarse = 0;
};

/// Of a scene's directional lights.
class VolumeLight {
public:
    /// Looks from the lights. `with_statics` takes those in whose light a field has.
    VolumeLight(const Scene& scene, const visibility::Visibility& visibility,
                const scene::Frame& frame, bool with_statics, const Medium& medium,
                const VolumeLightSettings& settings);

    /// What is scattered into a ray before `distance` (frame units, may be infinite), nits: steps
    /// of less than half a texel, each judged at `jitter` of its length, 0 to 1; where the map's
    /// tile there is farther than all of a long step, or nearer, that is taken to be lit, or dark,
    /// as its beginning is, though it may end on another tile.
    glm::dvec3 march(glm::dvec3 origin, glm::dvec3 direction, double distance, double jitter,
                     StepCount& steps) const;
    /// The same of a picture from march to the last blur, coarse. `distances`: from the eye to what
    /// the middle of each pixel sees, frame units; infinite: to nothing.
    Texture<glm::dvec3> scattered(const scene::RsmView& eye, const Texture<float>& distances,
                                  StepCount& steps) const;

private:
    struct Sun {
        glm::dvec3 power, direction; ///< lux; unit
        scene::RsmView view;
        Texture<float> distances, filled;
        Texture<glm::vec2> tiles;
        bool open = true; ///< there is no map: nothing stands in its way

        /// In texels of the map, and depth.
        glm::dvec3 place(glm::dvec3 point) const;
    };
    glm::dvec3 march(const Sun& sun, const MediumInFrame::Part& part, double jitter,
                     StepCount& steps) const;

    MediumInFrame air_;
    VolumeLightSettings settings_;
    std::vector<Sun> suns_;
};

} // namespace lpvbake::medium
